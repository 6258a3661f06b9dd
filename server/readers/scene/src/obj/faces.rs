//! Makes polygons and meshes of the faces of an object.

use super::materials::FaceMaterial;
use super::parse::{NONE, ObjFace, ObjFile};
use insula_dress::polygon::{NO_AREA, is_fan};
use insula_source::object::{ObjectSink, Shape, Surface, TriangleMesh};
use std::collections::HashMap;

/// An object of more faces is a scan: its triangles are meshes, which take a tenth of the memory of polygons.
const MAX_POLYGONS: usize = 1 << 16;

/// The surfaces of an object. Faults are reported.
pub(super) fn shape_of(
    file: &ObjFile,
    faces: &[&ObjFace],
    materials: &[FaceMaterial],
    sink: &mut dyn ObjectSink,
) -> Shape {
    let mut polygons = Vec::new();
    let mut meshes = Meshes::default();
    for face in faces {
        let (corners, line) = (file.corners_of(face), face.line);
        let material = materials[face.material as usize];
        let FaceMaterial { number, has_texture, mapping } = material;
        let uv_of = |corner: &[u32; 2]| file.uvs.get(corner[1] as usize).map(|uv| mapping.apply(*uv));
        let uv: Option<Vec<[f32; 2]>> = corners.iter().map(|corner| uv_of(corner).filter(|_| has_texture)).collect();
        if has_texture && uv.is_none() {
            sink.problem("textured face without texture coordinates", format!("line {line}"));
        }
        let points: Vec<[f64; 3]> = corners.iter().map(|corner| file.positions[corner[0] as usize]).collect();
        // Polygons have no colours at their corners.
        let is_coloured = !file.colours.is_empty() && uv.is_none();
        if faces.len() <= MAX_POLYGONS && !is_coloured || !is_fan(&points) {
            let uv = uv.unwrap_or_default();
            polygons.push(Surface { points, uv, material: number, line, ..Surface::default() });
        } else if !meshes.add(file, corners, material, uv.is_some()) {
            sink.problem(NO_AREA, format!("line {line}"));
        }
    }
    Shape::Surfaces { polygons, meshes: meshes.meshes }
}

/// Meshes by their material, in the order of their first face.
#[derive(Default)]
struct Meshes {
    meshes: Vec<TriangleMesh>,
    /// By material and whether there are texture coordinates.
    numbers: HashMap<(Option<u32>, bool), usize>,
    /// For each mesh the numbers of its vertices, by position and texture coordinate.
    vertices: Vec<HashMap<[u32; 2], u32>>,
}

impl Meshes {
    /// Adds a face that is a fan of triangles. Returns whether one of them has three different corners.
    fn add(&mut self, file: &ObjFile, corners: &[[u32; 2]], material: FaceMaterial, has_uv: bool) -> bool {
        let number = *self.numbers.entry((material.number, has_uv)).or_insert_with(|| {
            self.meshes.push(TriangleMesh { material: material.number, ..TriangleMesh::default() });
            self.vertices.push(HashMap::new());
            self.meshes.len() - 1
        });
        let (mesh, vertices) = (&mut self.meshes[number], &mut self.vertices[number]);
        let mut vertex = |[position, uv]: [u32; 2]| {
            let next = mesh.positions.len() as u32;
            let vertex = *vertices.entry([position, if has_uv { uv } else { NONE }]).or_insert(next);
            if vertex == next {
                mesh.positions.push(file.positions[position as usize]);
                if has_uv {
                    mesh.uv.push(material.mapping.apply(file.uvs[uv as usize]));
                } else {
                    mesh.colours.extend(file.colours.get(position as usize));
                }
            }
            vertex
        };
        let numbers: Vec<u32> = corners.iter().map(|corner| vertex(*corner)).collect();
        let before = mesh.triangles.len();
        for (pair, of) in numbers.windows(2).zip(corners.windows(2)).skip(1) {
            let [a, b, c] = [corners[0][0], of[0][0], of[1][0]];
            if a != b && b != c && c != a {
                mesh.triangles.push([numbers[0], pair[0], pair[1]]);
            }
        }
        mesh.triangles.len() > before
    }
}

#[cfg(test)]
mod tests {
    use super::super::mtl::UvMapping;
    use super::super::parse::parse;
    use super::*;
    use insula_source::testing::TestSink;

    #[test]
    fn coloured_faces_are_meshes() {
        let text = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0 0 1 0\nf 1 2 3 4\n";
        let file = parse("a.obj", &mut text.as_bytes(), 1 << 30, &mut TestSink::default(), &|| 0).unwrap();
        let faces: Vec<&ObjFace> = file.faces.iter().collect();
        let shape = shape_of(&file, &faces, &[FaceMaterial::default()], &mut TestSink::default());
        let Shape::Surfaces { polygons, meshes } = shape else { panic!("{shape:?}") };
        assert!(polygons.is_empty());
        assert_eq!((meshes[0].triangles.len(), meshes[0].colours[3]), (2, [0, 255, 0]));
    }

    #[test]
    fn textures_are_scaled_and_moved_in_polygons_and_meshes() {
        let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n";
        let mapping = UvMapping { scale: [2.0, 4.0], offset: [0.5, 0.0], is_clamped: false };
        let material = FaceMaterial { number: Some(0), has_texture: true, mapping };
        let file = parse("a.obj", &mut text.as_bytes(), 1 << 30, &mut TestSink::default(), &|| 0).unwrap();
        let mapped = [[0.5, 0.0], [2.5, 0.0], [2.5, 4.0]];
        for count in [1, MAX_POLYGONS + 1] {
            let faces: Vec<&ObjFace> = std::iter::repeat_n(&file.faces[0], count).collect();
            let shape = shape_of(&file, &faces, &[material], &mut TestSink::default());
            let Shape::Surfaces { polygons, meshes } = shape else { panic!("{shape:?}") };
            let uv = polygons.first().map_or_else(|| meshes[0].uv.clone(), |polygon| polygon.uv.clone());
            assert_eq!((uv, polygons.len()), (mapped.to_vec(), count % (MAX_POLYGONS + 1)));
        }
    }

    #[test]
    fn scans_are_meshes_with_shared_vertices() {
        let side = 200_u32;
        let mut text: String = (0..side * side).map(|i| format!("v {} {} 0\n", i % side, i / side)).collect();
        for i in (0..side * (side - 1)).filter(|i| (i + 1) % side > 0) {
            let [a, b, c, d] = [i, i + 1, i + side + 1, i + side].map(|v| v + 1);
            text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
        }
        let mut sink = TestSink::default();
        text += "f 1 1 2\n";
        let file = parse("a.obj", &mut text.as_bytes(), 1 << 30, &mut sink, &|| 0).unwrap();
        let faces: Vec<&ObjFace> = file.faces.iter().collect();
        let shape = shape_of(&file, &faces, &[FaceMaterial::default()], &mut sink);
        let Shape::Surfaces { polygons, meshes } = shape else { panic!("{shape:?}") };
        assert!(polygons.is_empty() && meshes.len() == 1);
        assert_eq!((meshes[0].positions.len(), meshes[0].triangles.len()), (40_000, 79_202));
        assert_eq!(sink.problems.len(), 1);
    }
}
