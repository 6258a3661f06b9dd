//! Makes surfaces and meshes of collected pieces, with their colours and textures.

use super::appearance::Appearances;
use super::gather::{Faults, Piece, PieceGeometry};
use super::shape::open_ring;
use super::store::StoredGeometry;
use super::tree::{Ring, Tree};
use insula_source::object::{ObjectSink, Shape, Surface, TriangleMesh, ring_ranges};
use std::collections::HashMap;

const FEW_POINTS: &str = "ring has fewer than three points";
const NO_NUMBERS: &str = "coordinates that are no numbers";
pub(super) const UNREAD_CURVE: &str = "ring with a curve that is not read";
const UV_MISFIT: &str = "texture coordinates do not fit the ring";

/// Surfaces of one object.
#[derive(Debug, Default)]
pub(super) struct Surfaces {
    pub(super) polygons: Vec<Surface>,
    pub(super) meshes: Vec<TriangleMesh>,
    pub(super) faults: Faults,
}

impl Surfaces {
    pub(super) fn is_empty(&self) -> bool {
        self.polygons.is_empty() && self.meshes.is_empty()
    }

    pub(super) fn into_shape(self) -> Shape {
        if self.is_empty() {
            return Shape::None;
        }
        Shape::Surfaces { polygons: self.polygons, meshes: self.meshes }
    }
}

/// Makes surfaces of pieces.
pub(super) struct Converter<'c> {
    tree: &'c Tree,
    appearances: &'c mut Appearances,
    sink: &'c mut dyn ObjectSink,
    surfaces: Surfaces,
    /// Meshes of plain triangles by their materials.
    meshes: HashMap<Option<u32>, MeshBuilder>,
}

/// A mesh whose equal points are one.
#[derive(Default)]
struct MeshBuilder {
    mesh: TriangleMesh,
    indices: HashMap<[u64; 3], u32>,
}

impl<'c> Converter<'c> {
    pub(super) fn new(tree: &'c Tree, appearances: &'c mut Appearances, sink: &'c mut dyn ObjectSink) -> Self {
        Self { tree, appearances, sink, surfaces: Surfaces::default(), meshes: HashMap::new() }
    }

    pub(super) fn convert(mut self, pieces: &[Piece]) -> Surfaces {
        for piece in pieces {
            match &piece.geometry {
                PieceGeometry::Face(face) => self.add_face(piece, *face),
                PieceGeometry::Triangles(range) => {
                    let points = self.tree.points.get(range.start as usize..range.end as usize).unwrap_or(&[]);
                    self.add_triangles(piece, points);
                }
                PieceGeometry::Stored(geometry) => self.add_stored(piece, geometry),
            }
        }
        let mut meshes: Vec<_> = self.meshes.into_iter().collect();
        meshes.sort_unstable_by_key(|(material, _)| *material);
        let meshes = meshes.into_iter().map(|(_, builder)| builder.mesh).filter(|mesh| !mesh.triangles.is_empty());
        self.surfaces.meshes.extend(meshes);
        self.surfaces
    }

    fn add_face(&mut self, piece: &Piece, face: u32) {
        let tree = self.tree;
        let rings = tree.rings_of(face);
        let mut surface = Surface { role: piece.role, ..Surface::default() };
        let outer = rings.iter().find(|ring| !ring.is_hole);
        let texture = outer.and_then(|ring| self.appearances.texture_of_ring(ring.id)).map(|(material, _)| material);
        let mut has_uv = texture.is_some();
        let holes = rings.iter().filter(|ring| ring.is_hole);
        for ring in outer.into_iter().chain(holes) {
            let start = surface.points.len();
            match self.add_ring(&mut surface, ring, piece, texture.filter(|_| has_uv)) {
                Ok(fits) => has_uv &= fits,
                Err(fault) => {
                    self.surfaces.faults.note(fault);
                    surface.points.truncate(start);
                    surface.uv.truncate(start);
                    if start == 0 {
                        return;
                    }
                    continue;
                }
            }
            if start > 0 {
                surface.hole_starts.push(start as u32);
            }
        }
        if surface.points.is_empty() {
            return self.surfaces.faults.note(FEW_POINTS);
        }
        if !has_uv {
            surface.uv = Vec::new();
        }
        if texture.is_some() && !has_uv {
            self.surfaces.faults.note(UV_MISFIT);
        }
        let material = texture.filter(|_| has_uv).or(piece.material);
        surface.material = material.and_then(|material| self.appearances.number_of(material, self.sink));
        self.surfaces.polygons.push(surface);
    }

    /// Adds a ring without its repeated points. Returns whether its texture coordinates fit.
    fn add_ring(
        &self,
        surface: &mut Surface,
        ring: &Ring,
        piece: &Piece,
        texture: Option<u32>,
    ) -> Result<bool, &'static str> {
        if ring.is_unread {
            return Err(UNREAD_CURVE);
        }
        let points = open_ring(self.tree.points_of(ring));
        let of_ring = texture.and_then(|material| {
            let (of_ring, uv) = self.appearances.texture_of_ring(ring.id)?;
            let fits =
                of_ring == material && uv.len() >= points.len() && uv.iter().flatten().all(|value| value.is_finite());
            fits.then_some(uv)
        });
        let start = surface.points.len();
        let mut last = points.last().filter(|_| points.len() > 1);
        for (index, point) in points.iter().enumerate() {
            if !point.iter().all(|value| value.is_finite()) {
                return Err(NO_NUMBERS);
            }
            if last == Some(point) {
                continue;
            }
            last = Some(point);
            surface.points.push(place(piece, *point));
            if let Some(uv) = of_ring.and_then(|uv| uv.get(index)) {
                surface.uv.push(*uv);
            }
        }
        if surface.points.len() - start < 3 {
            return Err(FEW_POINTS);
        }
        if piece.is_reversed {
            surface.points[start..].reverse();
            if let Some(uv) = surface.uv.get_mut(start..) {
                uv.reverse();
            }
        }
        Ok(of_ring.is_some())
    }

    fn add_triangles(&mut self, piece: &Piece, points: &[[f64; 3]]) {
        let material = piece.material.and_then(|material| self.appearances.number_of(material, self.sink));
        let builder = self.meshes.entry(material).or_default();
        builder.mesh.material = material;
        for triangle in points.chunks_exact(3) {
            let is_degenerate = triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0];
            if !triangle.iter().flatten().all(|value| value.is_finite()) {
                self.surfaces.faults.note(NO_NUMBERS);
            } else if is_degenerate {
                self.surfaces.faults.note(FEW_POINTS);
            } else {
                let [a, b, c] = [0, 1, 2].map(|corner| builder.index_of(place(piece, triangle[corner])));
                builder.mesh.triangles.push(if piece.is_reversed { [a, c, b] } else { [a, b, c] });
            }
        }
    }

    fn add_stored(&mut self, piece: &Piece, geometry: &StoredGeometry) {
        for polygon in &geometry.polygons {
            let mut surface = polygon.clone();
            surface.role = piece.role;
            place_all(piece, &mut surface.points);
            if piece.is_reversed {
                for ring in ring_ranges(surface.points.len(), &surface.hole_starts) {
                    surface.points[ring.clone()].reverse();
                    if let Some(uv) = surface.uv.get_mut(ring) {
                        uv.reverse();
                    }
                }
            }
            self.surfaces.polygons.push(surface);
        }
        for mesh in &geometry.meshes {
            let mut mesh = mesh.clone();
            place_all(piece, &mut mesh.positions);
            if piece.is_reversed {
                mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            }
            self.surfaces.meshes.push(mesh);
        }
    }
}

impl MeshBuilder {
    fn index_of(&mut self, point: [f64; 3]) -> u32 {
        let next = self.mesh.positions.len() as u32;
        // Zero has two forms of bits.
        let key = point.map(|value| (value + 0.0).to_bits());
        *self.indices.entry(key).or_insert_with(|| {
            self.mesh.positions.push(point);
            next
        })
    }
}

fn place(piece: &Piece, point: [f64; 3]) -> [f64; 3] {
    piece.placement.as_deref().map_or(point, |place| place.apply(point))
}

fn place_all(piece: &Piece, points: &mut [[f64; 3]]) {
    for point in points {
        *point = place(piece, *point);
    }
}
