//! The surfaces of a part of a city, with names for their edges.

use crate::error::{DrawError, DrawProgress, DrawStep, advance};
use crate::face::{FACE_BYTES, Face, FacePlane, NO_EDGE};
use glam::DVec3;
use insula_export::leaves::{LeafObject, LeafObjects, LeafSurfaces, is_land, visit_leaf_meshes};
use insula_export::selection::ObjectSelection;
use insula_export::source::ExportSource;
use insula_protocol::TileId;
use insula_protocol::mesh_tile::NO_OBJECT;
use std::collections::HashMap;
use std::hash::Hash;

/// Surfaces of a part of a city.
#[derive(Debug, Default)]
pub(crate) struct DrawnScene {
    /// World metres of the scene's origin.
    pub(crate) origin: [f64; 3],
    /// Of several in one place, the first one that is not turned is seen, as in ray-casters.
    pub(crate) faces: Vec<Face>,
    /// Index of the object of each face.
    pub(crate) face_objects: Vec<u32>,
    pub(crate) objects: Vec<LeafObject>,
    pub(crate) edges: Vec<SceneEdge>,
    pub(crate) has_terrain: bool,
    /// Leaves and other end nodes without a mesh, which are drawn from their columns.
    pub(crate) without_mesh: u64,
}

/// An edge of a leaf's mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SceneEdge {
    /// Number of its faces.
    pub(crate) count: u32,
    /// The first two of them.
    pub(crate) faces: [u32; 2],
}

/// Triangles over shared vertices.
#[derive(Debug, Default)]
pub(crate) struct SceneMesh {
    /// Metres from the scene's origin.
    pub(crate) points: Vec<DVec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl DrawnScene {
    /// Reads the selected part of a city, in levels of detail with an error of at most `error_m`. Fails if it has more
    /// than `max_triangles`.
    pub(crate) fn read(
        source: &dyn ExportSource,
        selection: &ObjectSelection,
        (error_m, max_triangles): (f64, usize),
        progress: DrawProgress<'_>,
    ) -> Result<Self, DrawError> {
        let manifest = source.manifest();
        let [min, max] = manifest.bounds;
        let everything = [[min[0], min[1]], [max[0], max[1]]];
        let area = selection.area().unwrap_or(everything);
        let middle = |k: usize| (0.5 * (area[0][k] + area[1][k])).round();
        let origin = [middle(0), middle(1), manifest.ground_z_m.round()];
        let mut reader = SceneReader {
            scene: Self { origin, has_terrain: manifest.has_terrain, ..Self::default() },
            names: LeafObjects::new(source, selection),
            indices: HashMap::new(),
            area,
            max_triangles,
            last_columns: None,
        };
        // Objects are selected by their middle, so they may reach out of the area.
        let grown = [area[0].map(|v| v - MARGIN_M), area[1].map(|v| v + MARGIN_M)];
        let mut leaves = 0u32;
        visit_leaf_meshes(source, grown, error_m, &mut |mesh| {
            leaves += 1;
            advance(progress, DrawStep::Read, f64::from(leaves % 1000) / 1000.0)?;
            // Land and all else of a node come one after the other.
            if mesh.lod.is_none() && reader.last_columns.replace(mesh.leaf) != Some(mesh.leaf) {
                reader.scene.without_mesh += 1;
            }
            reader.add(&mesh)
        })?;
        if !manifest.has_terrain {
            reader.add_ground(area, manifest.ground_z_m - GROUND_DEPTH_M)?;
        }
        if reader.scene.faces.is_empty() { Err(DrawError::Empty) } else { Ok(reader.scene) }
    }

    /// The scene with the mesh of an object in the place of the faces for which `is_replaced` is true.
    #[must_use]
    pub(crate) fn with_faces_replaced(&self, is_replaced: &[bool], mesh: &SceneMesh, object: u32) -> Self {
        let (origin, objects) = (self.origin, self.objects.clone());
        let (has_terrain, without_mesh) = (self.has_terrain, self.without_mesh);
        let mut scene = Self { origin, objects, has_terrain, without_mesh, ..Self::default() };
        let old = self.faces.iter().zip(&self.face_objects);
        let kept = old.zip(is_replaced).filter(|(_, is_replaced)| !**is_replaced).map(|(face, _)| face);
        let (mut edges, mut known) = (Vec::new(), HashMap::new());
        for (face, object) in kept {
            let mut face = face.clone();
            face.triangle = scene.faces.len() as u32;
            for edge in face.edges.iter_mut().filter(|edge| **edge != NO_EDGE) {
                *edge = edge_of_face(&mut known, EdgeName::Old(*edge), face.triangle, &mut edges);
            }
            scene.faces.push(face);
            scene.face_objects.push(*object);
        }
        for corners in &mesh.triangles {
            let Some(plane) = FacePlane::of(corners.map(|v| mesh.points[v as usize])) else { continue };
            let triangle = scene.faces.len() as u32;
            let name = |k: usize| {
                let [a, b] = [corners[k], corners[(k + 1) % 3]];
                EdgeName::New([a.min(b), a.max(b)])
            };
            let names = [0, 1, 2].map(|k| edge_of_face(&mut known, name(k), triangle, &mut edges)).to_vec();
            let points = corners.map(|v| mesh.points[v as usize]).to_vec();
            scene.faces.push(Face { points, edges: names, plane, triangle });
            scene.face_objects.push(object);
        }
        scene.edges = edges;
        scene
    }

    /// Estimated memory.
    pub(crate) fn byte_len(&self) -> usize {
        let faces = self.faces.len() * (FACE_BYTES + size_of::<u32>());
        let identifiers: usize = self.objects.iter().map(|object| object.identifier.len()).sum();
        faces + self.edges.len() * size_of::<SceneEdge>() + self.objects.len() * size_of::<LeafObject>() + identifiers
    }

    /// Whether each object has surfaces that end above its foot, so that the backs of others may be seen.
    pub(crate) fn open_objects(&self) -> Vec<bool> {
        let mut heights = vec![[f64::INFINITY, f64::NEG_INFINITY]; self.objects.len()];
        for (face, object) in self.faces.iter().zip(&self.face_objects) {
            for point in &face.points {
                let [low, high] = &mut heights[*object as usize];
                (*low, *high) = (low.min(point.z), high.max(point.z));
            }
        }
        let mut is_open = vec![false; self.objects.len()];
        for (face, object) in self.faces.iter().zip(&self.face_objects) {
            let [low, high] = heights[*object as usize];
            let foot = low + FOOT_SHARE * (high - low);
            for (k, edge) in face.edges.iter().enumerate() {
                let is_border = self.edges.get(*edge as usize).is_some_and(|edge| edge.count == 1);
                let top = face.points[k].z.max(face.points[(k + 1) % face.points.len()].z);
                is_open[*object as usize] |= is_border && top > foot;
            }
        }
        for (object, is_open) in self.objects.iter().zip(&mut is_open) {
            *is_open &= !is_land(object.kind);
        }
        is_open
    }

    pub(crate) fn object(&self, face: u32) -> &LeafObject {
        &self.objects[self.face_objects[face as usize] as usize]
    }
}

/// Objects are open at the foot: this share of their height, in which their ground may be uneven.
const FOOT_SHARE: f64 = 0.3;
/// The ground plane is this far below the city's own ground, so that the two are never in one plane.
const GROUND_DEPTH_M: f64 = 0.05;
/// How far objects may reach out of the area in which their middle is.
const MARGIN_M: f64 = 200.0;

struct SceneReader<'a> {
    scene: DrawnScene,
    names: LeafObjects<'a>,
    /// Index in the scene of each object's number; `None` if it is not selected.
    indices: HashMap<u32, Option<u32>>,
    /// World metres: land is cut at its border.
    area: [[f64; 2]; 2],
    max_triangles: usize,
    /// The last node that was drawn from its columns.
    last_columns: Option<TileId>,
}

impl SceneReader<'_> {
    fn add(&mut self, mesh: &LeafSurfaces) -> Result<(), DrawError> {
        let mut edges = LeafEdges { mesh, known: HashMap::new() };
        let origin = DVec3::from(self.scene.origin);
        for t in mesh.order() {
            let Some(corners) = mesh.tile.mesh.triangles.get(t as usize) else { continue };
            let number = mesh.tile.objects.get(t as usize).copied().unwrap_or(NO_OBJECT);
            let Some(object) = self.object(number)? else { continue };
            let points = corners.map(|v| DVec3::from(mesh.positions[v as usize]) - origin);
            let Some(plane) = FacePlane::of(points) else { continue };
            let index = self.scene.faces.len() as u32;
            let names = [0, 1, 2].map(|k| edges.name([corners[k], corners[(k + 1) % 3]]));
            let names = names.map(|key| {
                key.map_or(NO_EDGE, |key| edge_of_face(&mut edges.known, key, index, &mut self.scene.edges))
            });
            let face = Face { points: points.to_vec(), edges: names.to_vec(), plane, triangle: index };
            let is_cut = is_land(self.scene.objects[object as usize].kind);
            let Some(face) = (if is_cut { clip_to_area(face, self.area, origin) } else { Some(face) }) else {
                continue;
            };
            self.scene.faces.push(face);
            self.scene.face_objects.push(object);
        }
        if self.scene.faces.len() > self.max_triangles {
            return Err(DrawError::TooManyTriangles { limit: self.max_triangles });
        }
        Ok(())
    }

    /// Adds the ground plane that viewers show where a city without terrain has nothing.
    fn add_ground(&mut self, [min, max]: [[f64; 2]; 2], z: f64) -> Result<(), DrawError> {
        let Some(object) = self.object(NO_OBJECT)? else { return Ok(()) };
        let corners = [[min[0], min[1]], [max[0], min[1]], max, [min[0], max[1]]];
        let points = corners.map(|[x, y]| DVec3::new(x, y, z) - DVec3::from(self.scene.origin)).to_vec();
        let plane = FacePlane { normal: DVec3::Z, offset: points[0].z };
        let triangle = self.scene.faces.len() as u32;
        self.scene.faces.push(Face { points, edges: vec![NO_EDGE; 4], plane, triangle });
        self.scene.face_objects.push(object);
        Ok(())
    }

    fn object(&mut self, number: u32) -> Result<Option<u32>, DrawError> {
        if let Some(known) = self.indices.get(&number) {
            return Ok(*known);
        }
        let object = self.names.get(number)?;
        let next = self.scene.objects.len() as u32;
        let index = object.is_selected.then_some(next);
        if index.is_some() {
            self.scene.objects.push(object.clone());
        }
        self.indices.insert(number, index);
        Ok(index)
    }
}

/// The part of a face in an area of the map.
fn clip_to_area(face: Face, [min, max]: [[f64; 2]; 2], origin: DVec3) -> Option<Face> {
    let planes = [
        FacePlane { normal: DVec3::X, offset: min[0] - origin.x },
        FacePlane { normal: DVec3::NEG_X, offset: origin.x - max[0] },
        FacePlane { normal: DVec3::Y, offset: min[1] - origin.y },
        FacePlane { normal: DVec3::NEG_Y, offset: origin.y - max[1] },
    ];
    clip(face, &planes)
}

/// The part of a face in front of all planes.
pub(crate) fn clip(mut face: Face, planes: &[FacePlane]) -> Option<Face> {
    use crate::face::Side;
    for plane in planes {
        match face.side(plane) {
            Side::Front | Side::On => {}
            Side::Back => return None,
            Side::Both => face = face.split(plane, NO_EDGE)[0].take()?,
        }
    }
    Some(face)
}

/// A face as seen from its other side.
pub(crate) fn turned(face: &Face) -> Face {
    let mut points = face.points.clone();
    points.reverse();
    // The edge from each point to the next one is now the one that led to it.
    let mut edges = face.edges.clone();
    edges.reverse();
    edges.rotate_left(1);
    let plane = FacePlane { normal: -face.plane.normal, offset: -face.plane.offset };
    Face { points, edges, plane, triangle: face.triangle }
}

/// What an edge is known by while faces are replaced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum EdgeName {
    /// Its index before.
    Old(u32),
    /// Vertices of the new mesh, the smaller first.
    New([u32; 2]),
}

/// The index of an edge, which gets one more face.
fn edge_of_face<K: Eq + Hash>(known: &mut HashMap<K, u32>, key: K, face: u32, edges: &mut Vec<SceneEdge>) -> u32 {
    let next = edges.len() as u32;
    let index = *known.entry(key).or_insert(next);
    if index == next {
        edges.push(SceneEdge { count: 1, faces: [face, face] });
    } else if let Some(edge) = edges.get_mut(index as usize) {
        if edge.count == 1 {
            edge.faces[1] = face;
        }
        edge.count += 1;
    }
    index
}

/// Both ends of an edge on the mesh's grid, the smaller first.
type EdgeKey = [[u32; 3]; 2];

struct LeafEdges<'a> {
    mesh: &'a LeafSurfaces,
    known: HashMap<EdgeKey, u32>,
}

impl LeafEdges<'_> {
    /// What an edge is known by; `None` at the leaf's border, where the bake cut the surface.
    fn name(&self, ends: [u32; 2]) -> Option<EdgeKey> {
        let [min, max] = self.mesh.area;
        let [a, b] = ends.map(|v| self.mesh.positions[v as usize]);
        let is_border = (0..2).any(|k| [min[k], max[k]].iter().any(|border| a[k] == *border && b[k] == *border));
        let [a, b] = ends.map(|v| self.mesh.tile.mesh.positions[v as usize]);
        (!is_border && a != b).then_some(if a < b { [a, b] } else { [b, a] })
    }
}
