//! Faces of a PLY as triangles and polygons, grouped by texture.

use super::FileMesh;
use super::ply_colour::{ColourPlaces, colour_of};
use insula_dress::polygon::is_fan;
use insula_simplify::model::ply_header::PlyElement;
use insula_simplify::model::ply_values::PlyRow;
use insula_source::object::{ObjectSink, SourceImage, SourceMaterial, SourceTexture, Surface, TriangleMesh, Wrap};
use std::collections::{BTreeMap, HashMap};

/// Names of the list of a face's corners.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// As many textures have a table of all vertices.
const DENSE_GROUPS: usize = 8;

#[derive(Debug, Default)]
pub(super) struct Vertices {
    pub(super) positions: Vec<[f64; 3]>,
    /// One for each position, or empty.
    pub(super) uv: Vec<[f32; 2]>,
    /// One for each position, or empty.
    pub(super) colours: Vec<[u8; 3]>,
}

/// A corner of a face: a vertex, with what the face itself says of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Corner {
    vertex: u32,
    /// Bits of the face's own texture coordinates.
    uv: Option<[u32; 2]>,
    colour: Option<[u8; 3]>,
}

/// The faces of one texture.
#[derive(Default)]
struct Group {
    mesh: TriangleMesh,
    polygons: Vec<Surface>,
    /// Numbers of corners in the mesh.
    numbers: HashMap<Corner, u32>,
    /// Numbers of the vertices of corners that have nothing of their own, for the first groups.
    plain_numbers: Vec<u32>,
}

/// Where the properties of a face are.
pub(super) struct FaceLayout {
    is_strips: bool,
    corners: Option<usize>,
    uv: Option<usize>,
    texture: Option<usize>,
    colour: Option<ColourPlaces>,
}

impl FaceLayout {
    pub(super) fn of(element: &PlyElement) -> Self {
        let list = |name: &str| element.properties.iter().position(|p| p.name == name && p.length.is_some());
        Self {
            is_strips: element.name == "tristrips",
            corners: CORNERS.iter().find_map(|name| list(name)),
            uv: list("texcoord"),
            texture: element.places(["texnumber"]).map(|[place]| place),
            colour: colour_of(element),
        }
    }
}

/// Collects faces.
pub(super) struct FaceBuilder {
    vertices: Vertices,
    /// Number of images.
    textures: usize,
    /// By number of the image; 0 for faces without a number.
    groups: BTreeMap<usize, Group>,
    polygon: Vec<Corner>,
    out_of_range: u64,
    not_finite: u64,
    too_few: u64,
}

impl FaceBuilder {
    pub(super) fn new(vertices: Vertices, textures: usize) -> Self {
        let groups = BTreeMap::new();
        Self { vertices, textures, groups, polygon: Vec::new(), out_of_range: 0, not_finite: 0, too_few: 0 }
    }

    /// Adds a row of the element `face` or `tristrips`.
    pub(super) fn add(&mut self, layout: &FaceLayout, row: &PlyRow) {
        let Some(corners) = layout.corners else { return };
        let corners = row.list(corners);
        if layout.is_strips {
            self.add_strips(corners);
            return;
        }
        let colour = layout.colour.as_ref().filter(|_| self.vertices.colours.is_empty()).map(|colour| colour.of(row));
        let uv = layout.uv.map(|list| row.list(list)).filter(|uv| uv.len() == corners.len() * 2);
        let texture = layout.texture.map_or(0.0, |place| row.single(place)) as usize;
        let corner = |(index, vertex): (usize, &f64)| Corner {
            vertex: vertex_number(*vertex),
            uv: uv.and_then(|uv| uv.get(2 * index..2 * index + 2)).map(|uv| [0, 1].map(|k| (uv[k] as f32).to_bits())),
            colour,
        };
        let mut polygon = std::mem::take(&mut self.polygon);
        polygon.clear();
        polygon.extend(corners.iter().enumerate().map(corner));
        self.add_polygon(if texture < self.textures { texture } else { 0 }, &polygon);
        self.polygon = polygon;
    }

    /// Adds strips of triangles, which negative numbers separate.
    fn add_strips(&mut self, corners: &[f64]) {
        for strip in corners.split(|corner| *corner < 0.0) {
            for (index, triangle) in strip.windows(3).enumerate() {
                let order = if index % 2 == 0 { [0, 1, 2] } else { [1, 0, 2] };
                let corners = order.map(|k| Corner { vertex: vertex_number(triangle[k]), uv: None, colour: None });
                if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
                    self.add_polygon(0, &corners);
                }
            }
        }
    }

    fn add_polygon(&mut self, texture: usize, corners: &[Corner]) {
        if corners.len() < 3 {
            self.too_few += 1;
            return;
        }
        let vertices = &self.vertices;
        for corner in corners {
            match vertices.positions.get(corner.vertex as usize) {
                Some(point) if point.iter().all(|value| value.is_finite()) => {}
                Some(_) => {
                    self.not_finite += 1;
                    return;
                }
                None => {
                    self.out_of_range += 1;
                    return;
                }
            }
        }
        let group = self.groups.entry(texture).or_insert_with(|| Group::new(texture, vertices));
        let has_colours = !vertices.colours.is_empty() || corners.iter().any(|corner| corner.colour.is_some());
        let point = |corner: &Corner| vertices.positions.get(corner.vertex as usize).copied().unwrap_or_default();
        // Polygons have no colours at their corners.
        if corners.len() == 3 || has_colours {
            group.add_fan(vertices, corners);
            return;
        }
        let points: Vec<[f64; 3]> = corners.iter().map(point).collect();
        if is_fan(&points) {
            group.add_fan(vertices, corners);
        } else {
            let uv: Vec<[f32; 2]> = corners.iter().filter_map(|corner| corner_uv(vertices, corner)).collect();
            let uv = if uv.len() == points.len() { uv } else { Vec::new() };
            group.polygons.push(Surface { points, uv, ..Surface::default() });
        }
    }

    /// The geometry, with materials for the textures. Reports faces that were left out.
    pub(super) fn finish(self, id: &str, textures: &[String], sink: &mut dyn ObjectSink) -> FileMesh {
        let faults = [
            (self.out_of_range, "vertex index out of range"),
            (self.not_finite, "position is not a number"),
            (self.too_few, "polygon has fewer than three corners"),
        ];
        for (count, kind) in faults.into_iter().filter(|(count, _)| *count > 0) {
            sink.problem(kind, format!("{id}: {count} faces"));
        }
        let mut file = FileMesh { source_type: "PLY", ..FileMesh::default() };
        for (number, mut group) in self.groups {
            let material = textures.get(number).filter(|name| !name.is_empty()).map(|name| {
                let image = SourceImage::File(name.replace('\\', "/"));
                let texture = Some(SourceTexture { image, wrap: Wrap::Repeat });
                sink.add_material(SourceMaterial { texture, ..SourceMaterial::default() })
            });
            // Texture coordinates without an image, or not for all corners, are of no use.
            if material.is_none() || group.mesh.uv.len() != group.mesh.positions.len() {
                group.mesh.uv.clear();
            }
            group.mesh.material = material;
            group.polygons.iter_mut().for_each(|polygon| {
                polygon.material = material;
                if material.is_none() {
                    polygon.uv.clear();
                }
            });
            if group.mesh.colours.len() != group.mesh.positions.len() {
                group.mesh.colours.clear();
            }
            file.polygons.append(&mut group.polygons);
            if !group.mesh.triangles.is_empty() {
                file.meshes.push(group.mesh);
            }
        }
        file
    }
}

impl Group {
    fn new(texture: usize, vertices: &Vertices) -> Self {
        let length = if texture < DENSE_GROUPS { vertices.positions.len() } else { 0 };
        Self { plain_numbers: vec![u32::MAX; length], ..Self::default() }
    }

    fn add_fan(&mut self, vertices: &Vertices, corners: &[Corner]) {
        let mut first = 0;
        let mut last = 0;
        for (index, corner) in corners.iter().enumerate() {
            let number = self.number(vertices, corner);
            match index {
                0 => first = number,
                1 => {}
                _ => self.mesh.triangles.push([first, last, number]),
            }
            last = number;
        }
    }

    fn number(&mut self, vertices: &Vertices, corner: &Corner) -> u32 {
        let next = self.mesh.positions.len() as u32;
        let is_plain = corner.uv.is_none() && corner.colour.is_none();
        let plain = self.plain_numbers.get_mut(corner.vertex as usize).filter(|_| is_plain);
        let number = match plain {
            Some(number) if *number == u32::MAX => {
                *number = next;
                next
            }
            Some(number) => *number,
            None => *self.numbers.entry(*corner).or_insert(next),
        };
        if number == next {
            let vertex = corner.vertex as usize;
            self.mesh.positions.push(vertices.positions.get(vertex).copied().unwrap_or_default());
            self.mesh.uv.extend(corner_uv(vertices, corner));
            self.mesh.colours.extend(corner.colour.or_else(|| vertices.colours.get(vertex).copied()));
        }
        number
    }
}

fn corner_uv(vertices: &Vertices, corner: &Corner) -> Option<[f32; 2]> {
    let own = corner.uv.map(|uv| uv.map(f32::from_bits));
    let uv = own.or_else(|| vertices.uv.get(corner.vertex as usize).copied())?;
    Some(if uv.iter().all(|value| value.is_finite()) { uv } else { [0.0; 2] })
}

/// The number of a vertex; one that no file has if it is negative or not whole.
fn vertex_number(value: f64) -> u32 {
    if (0.0..4_294_967_295.0).contains(&value) && value.fract() == 0.0 { value as u32 } else { u32::MAX }
}
