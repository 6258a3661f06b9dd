//! Tests of PLY and STL.

use super::read;
use insula_source::error::InputError;
use insula_source::files::EmbeddedFiles;
use insula_source::input::Input;
use insula_source::object::{Shape, SourceImage, Surface, TriangleMesh};
use insula_source::problems::MESH_UNIT;
use insula_source::testing::TestSink;

fn read_bytes(name: &str, bytes: &[u8]) -> Result<TestSink, InputError> {
    let files = EmbeddedFiles { files: &[(name, bytes)] };
    let input = Input::new(name, name, &files, 1 << 20);
    let mut sink = TestSink::default();
    read(&input, &mut sink).map(|()| sink)
}

fn geometry(sink: &TestSink) -> (&[Surface], &[TriangleMesh]) {
    assert_eq!(sink.objects.len(), 1, "{sink:?}");
    match &sink.objects[0].shape {
        Shape::Surfaces { polygons, meshes } => (polygons, meshes),
        shape => panic!("{shape:?}"),
    }
}

const HEADER: &str = "ply\nformat FORMAT 1.0\ncomment made by hand\nelement vertex 4\nproperty uchar red\nproperty float x\n\
    property double y\nproperty short z\nproperty list uchar int ignored\nproperty uchar green\nproperty uchar blue\n\
    element face 2\nproperty uchar flags\nproperty list uchar uint vertex_indices\nend_header\n";

fn expected() -> TriangleMesh {
    TriangleMesh {
        positions: vec![[0.0, 0.5, -1.0], [1.0, 0.5, -1.0], [1.0, 2.5, -1.0], [0.0, 2.5, -1.0]],
        colours: vec![[255, 0, 1], [255, 0, 2], [255, 0, 3], [255, 0, 4]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    }
}

fn binary(is_big: bool) -> Vec<u8> {
    let mut bytes =
        HEADER.replace("FORMAT", if is_big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
    let mut push = |little: &[u8]| match is_big {
        true => bytes.extend(little.iter().rev()),
        false => bytes.extend(little),
    };
    for (position, colour) in expected().positions.iter().zip(expected().colours) {
        push(&[colour[0]]);
        push(&(position[0] as f32).to_le_bytes());
        push(&position[1].to_le_bytes());
        push(&(position[2] as i16).to_le_bytes());
        push(&[1]);
        push(&77i32.to_le_bytes());
        push(&[colour[1]]);
        push(&[colour[2]]);
    }
    for face in [[0u32, 1, 2], [0, 2, 3]] {
        push(&[9]);
        push(&[3]);
        face.iter().for_each(|vertex| push(&vertex.to_le_bytes()));
    }
    bytes
}

#[test]
fn ply_of_all_encodings_is_equal() {
    let text = HEADER.replace("FORMAT", "ascii")
        + "255 0 0.5 -1 1 77 0 1\n255 1 0.5 -1 0 0 2\n255 1 2.5 -1 2 7 8 0 3\n255 0 2.5 -1 0 0 4\n9 3 0 1 2\n9 3 0 2 3\n";
    for bytes in [text.clone().into_bytes(), text.replace('\n', "\r\n").into(), binary(false), binary(true)] {
        let sink = read_bytes("a house.ply", &bytes).expect("readable");
        let (polygons, meshes) = geometry(&sink);
        assert!(polygons.is_empty() && sink.problems.is_empty());
        assert_eq!(meshes, [expected()]);
        assert_eq!(sink.objects[0].id, "a house");
        assert_eq!(sink.bytes_done, bytes.len() as u64);
    }
}

#[test]
fn truncated_ply_is_an_error_at_every_length() {
    let whole = binary(true);
    for length in 0..whole.len() {
        let result = read_bytes("a.ply", &whole[..length]);
        assert!(matches!(result, Err(InputError::Damaged { .. })), "{length}: {result:?}");
    }
}

#[test]
fn ply_rows_with_further_values_are_lines() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_index\nend_header\n0 0 0 9 9\n1 0 0 9 9\n0 1 0 9 9\n3 0 1 2 4 5\n";
    let sink = read_bytes("a.ply", text.as_bytes()).expect("readable");
    assert_eq!(geometry(&sink).1[0].positions[2], [0.0, 1.0, 0.0]);
    let one_line = text.replace(" 9 9\n", " ");
    let sink = read_bytes("a.ply", one_line.as_bytes()).expect("readable");
    assert_eq!(geometry(&sink).1[0].positions[2], [0.0, 1.0, 0.0], "without lines, values follow each other");
}

#[test]
fn ply_faces_have_textures_and_polygons() {
    let text = "ply\nformat ascii 1.0\ncomment TextureFile my wall.png\ncomment TextureFile b.png\nelement vertex 5\n\
        property float x\nproperty float y\nproperty float z\nelement face 5\nproperty list uchar int vertex_indices\n\
        property list uchar float texcoord\nproperty int texnumber\nend_header\n\
        0 0 0\n2 0 0\n2 2 0\n0 2 0\n1 0.5 0\n\
        4 0 1 2 3 8 0 0 1 0 1 1 0 1 1\n4 0 1 4 3 8 0 0 1 0 1 1 0 1 0\n3 0 1 2 6 .5 .5 1 0 1 1 0\n2 0 1 0 0\n3 0 1 9 0 0\n";
    let sink = read_bytes("a.ply", text.as_bytes()).expect("readable");
    let (polygons, meshes) = geometry(&sink);
    assert_eq!(meshes.len(), 2);
    assert_eq!(meshes[0].triangles, [[0, 1, 2], [0, 2, 3], [4, 1, 5]]);
    assert_eq!(
        meshes[0].uv[4..],
        [[0.5, 0.5], [1.0, 1.0]],
        "corners with other texture coordinates are vertices of their own"
    );
    assert_eq!(meshes[1].triangles, [[0, 1, 2], [0, 2, 3]], "a convex quadrilateral is two triangles");
    assert_eq!(polygons.len(), 0, "the concave one is a fan from its first corner");
    let names: Vec<_> =
        meshes.iter().map(|mesh| &sink.materials[mesh.material.expect("a material") as usize]).collect();
    let file = |name: &str| SourceImage::File(name.into());
    assert_eq!(names[0].texture.as_ref().expect("a texture").image, file("my wall.png"));
    assert_eq!(names[1].texture.as_ref().expect("a texture").image, file("b.png"));
    let kinds: Vec<_> = sink.problems.iter().map(|(kind, _)| *kind).collect();
    assert_eq!(kinds, ["vertex index out of range", "polygon has fewer than three corners"]);
}

#[test]
fn concave_off_faces_stay_polygons() {
    let vertices = "0 0 0\n4 0 0\n1 1 0\n0 4 0\n";
    let off = format!("COFF\n4 2 0\n{}4 1 2 3 0 255 0 0\n4 0 1 2 3\n", vertices.replace('\n', " 9 9 9 255\n"));
    let sink = read_bytes("a.off", off.as_bytes()).unwrap();
    let (polygons, meshes) = geometry(&sink);
    assert_eq!((polygons.len(), polygons[0].points.len()), (1, 4), "the corner that points inwards is not the first");
    assert_eq!(meshes[0].triangles.len(), 2);
}

#[test]
fn floats_beyond_one_are_bytes() {
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float red\n\
        property float green\nproperty float blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    for (colour, expected) in [("60 70 1", [60, 70, 1]), ("0.2 1 0", [51, 255, 0])] {
        let ply = format!("{header}0 0 0 {colour}\n1 0 0 {colour}\n0 1 0 {colour}\n3 0 1 2\n");
        let sink = read_bytes("a.ply", ply.as_bytes()).unwrap();
        assert_eq!(geometry(&sink).1[0].colours, [expected; 3]);
    }
}

#[test]
fn concave_ply_polygons_stay_polygons() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n2 0 0\n1 0.5 0\n0 0 0\n1 2 0\n4 0 1 2 3\n";
    let turned = text.replace("4 0 1 2 3", "4 0 3 2 1");
    for text in [text, &turned] {
        let sink = read_bytes("a.ply", text.as_bytes()).expect("readable");
        let (polygons, meshes) = geometry(&sink);
        assert_eq!((polygons.len(), meshes.len()), (1, 0));
        assert_eq!(polygons[0].points.len(), 4);
    }
}

#[test]
fn absurd_ply_headers_are_errors() {
    let header = |element: &str| format!("ply\nformat binary_little_endian 1.0\n{element}\nend_header\n");
    let vertices = "property float x\nproperty float y\nproperty float z\n";
    let huge = header(&format!(
        "element vertex 18446744073709551615\n{vertices}element face 1\nproperty list uint int vertex_indices"
    ));
    assert!(matches!(read_bytes("a.ply", huge.as_bytes()), Err(InputError::Damaged { .. })));
    let nothing = header("element vertex 18446744073709551615\nelement face 18446744073709551615");
    assert!(read_bytes("a.ply", nothing.as_bytes()).is_ok(), "rows without properties take no time");
    let mut list = header("element vertex 0\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uint int vertex_indices").into_bytes();
    list.extend([255; 4]);
    assert!(matches!(read_bytes("a.ply", &list), Err(InputError::Damaged { .. })));
    let cloud = header(&format!("element vertex 7\n{vertices}"));
    let error = read_bytes("a.ply", cloud.as_bytes()).expect_err("no faces").to_string();
    assert!(error.contains("cloud of 7 points"), "{error}");
}

fn binary_stl(title: &[u8], triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = title.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        triangle.as_flattened().iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        bytes.extend([0xff, 0x7f]);
    }
    bytes
}

const SQUARE: [[[f32; 3]; 3]; 2] =
    [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]], [[-0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]];

#[test]
fn stl_is_text_or_binary_by_its_content() {
    let text = "solid a\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 1e0 1 0\n  endloop\n endfacet\n\
        FACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX 0 0 0\nVERTEX 1 1 0\nVERTEX 0 1 0\nENDLOOP\nENDFACET\nendsolid a\n";
    let files = [
        text.as_bytes().to_vec(),
        text.replace('\n', "\r").into_bytes(),
        binary_stl(b"exported", &SQUARE),
        binary_stl(b"solid facet", &SQUARE),
        [binary_stl(b"with more", &SQUARE), vec![0; 7]].concat(),
    ];
    for bytes in files {
        let sink = read_bytes("x.y.STL", &bytes).expect("readable");
        let (_, meshes) = geometry(&sink);
        assert_eq!(meshes[0].triangles, [[0, 1, 2], [0, 2, 3]], "welded");
        assert_eq!(meshes[0].positions.len(), 4);
        assert_eq!(sink.objects[0].id, "x.y");
    }
}

#[test]
fn damaged_stl_is_an_error() {
    let whole = binary_stl(b"exported", &SQUARE);
    for length in 0..whole.len() {
        assert!(matches!(read_bytes("a.stl", &whole[..length]), Err(InputError::Damaged { .. })), "{length}");
    }
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 x 0\n";
    let error = read_bytes("a.stl", text.as_bytes()).expect_err("no number").to_string();
    assert!(error.contains("line 5"), "{error}");
    let cut = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n";
    assert!(matches!(read_bytes("a.stl", cut.as_bytes()), Err(InputError::Damaged { .. })));
}

#[test]
fn useless_triangles_are_reported() {
    let triangles = [SQUARE[0], [[1.0; 3]; 3], [[f32::NAN; 3], [0.0; 3], [1.0; 3]]];
    let sink = read_bytes("a.stl", &binary_stl(b"", &triangles)).expect("readable");
    assert_eq!(geometry(&sink).1[0].triangles.len(), 1);
    assert_eq!(sink.problems.len(), 2);
    let empty = read_bytes("a.stl", &binary_stl(b"", &triangles[1..])).expect("readable");
    assert!(empty.objects.is_empty());
    assert_eq!(empty.skipped, [("mesh has no triangles", "a".to_owned())]);
}

#[test]
fn changed_bytes_never_panic() {
    let mut state = 7u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as usize
    };
    for whole in [binary(false), binary_stl(b"", &SQUARE)] {
        for _ in 0..500 {
            let mut bytes = whole.clone();
            for _ in 0..=random() % 4 {
                let at = random() % bytes.len();
                bytes[at] = random() as u8;
            }
            let _ = read_bytes("a.ply", &bytes);
        }
    }
}

#[test]
fn units_in_headers_are_named() {
    let ply = |comment: &str| HEADER.replace("FORMAT", "ascii").replace("made by hand", comment);
    let text = "0 0.5 0 0 0 0 0\n0 0.5 0 0 0 0 0\n0 0.5 0 0 0 0 0\n0 0.5 0 0 0 0 0\n";
    let stl = |title: &[u8]| binary_stl(title, &SQUARE);
    let off = b"OFF\n# units: cm\n3 1 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n";
    for (name, bytes, scale) in [
        ("a.ply", (ply("Units: millimeters") + text).into_bytes(), Some("0.001")),
        ("a.ply", (ply("units: m") + text).into_bytes(), None),
        ("a.stl", stl(b"UNITS= mm"), Some("0.001")),
        ("a.stl", stl(b"solid"), None),
        ("a.off", off.to_vec(), Some("0.01")),
    ] {
        let files = EmbeddedFiles { files: &[(name, &bytes[..])] };
        let mut sink = TestSink::default();
        // A file without its faces is damaged, but its header is read.
        let _ = read(&Input::new(name, name, &files, 1 << 20), &mut sink);
        let told: Vec<&str> =
            sink.problems.iter().filter(|(kind, _)| *kind == MESH_UNIT).map(|(_, text)| text.as_str()).collect();
        let is_named = |scale: &str| told.len() == 1 && told[0].contains(&format!("\"scale\": {scale} in"));
        assert!(scale.map_or(told.is_empty(), is_named), "{name}: {told:?}");
    }
}
