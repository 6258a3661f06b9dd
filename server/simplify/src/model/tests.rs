//! Tests of all formats.

use super::*;
use insula_protocol::mesh::{AttributeKind, Mesh};

fn model() -> TriangleModel {
    let positions = vec![[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 2.25, 0.0], [0.0, 0.0, -3.0]];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    TriangleModel { positions, triangles, layers: vec![] }
}

#[test]
fn every_format_round_trips() {
    for format in [ModelFormat::Ply, ModelFormat::Off, ModelFormat::Obj] {
        assert_eq!(TriangleModel::read(&model().write(format), format).unwrap(), model(), "{format:?}");
    }
    // STL has no numbers of vertices.
    let stl = TriangleModel::read(&model().write(ModelFormat::Stl), ModelFormat::Stl).unwrap();
    let corners = |model: &TriangleModel| -> Vec<[f64; 3]> {
        model.triangles.as_flattened().iter().map(|vertex| model.positions[*vertex as usize]).collect()
    };
    assert_eq!((stl.positions.len(), corners(&stl)), (4, corners(&model())));
}

#[test]
fn concave_faces_are_covered_and_no_more() {
    // An L of 45 m2, of which a fan from the first corner would cover more.
    let corners = ["9 3 0", "3 3 0", "3 9 0", "0 9 0", "0 0 0", "9 0 0"].join("\n");
    let obj = format!("v {}\nf 1 2 3 4 5 6\n", corners.replace('\n', "\nv "));
    let off = format!("OFF\n6 1 0\n{corners}\n6 0 1 2 3 4 5\n");
    let header = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header";
    let ply = format!("{header}\n{corners}\n6 0 1 2 3 4 5\n");
    for (format, text) in [(ModelFormat::Obj, obj), (ModelFormat::Off, off), (ModelFormat::Ply, ply)] {
        let model = TriangleModel::read(text.as_bytes(), format).unwrap();
        let twice_area = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|vertex| model.positions[vertex as usize]);
            (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        };
        let areas: Vec<f64> = model.triangles.iter().map(twice_area).collect();
        assert!(areas.len() == 4 && areas.iter().all(|area| *area > 0.0), "{format:?}: {areas:?}");
        assert!((areas.iter().sum::<f64>() - 90.0).abs() < 1e-9, "{format:?}: {areas:?}");
    }
}

#[test]
fn layers_round_trip_in_obj_and_ply() {
    let mut model = model();
    let corners: Vec<u32> = model.triangles.as_flattened().to_vec();
    let layer = |kind, width, values: [[f32; 4]; 4]| CornerLayer {
        kind,
        width,
        values: values.to_vec(),
        corners: corners.clone(),
    };
    let value = |v: f32| [v, 1.0 - v, 0.0, 0.0];
    model.layers.push(layer(AttributeKind::TexCoord, 2, [0.0, 0.25, 0.5, 1.0].map(value)));
    let normal = |k: usize| std::array::from_fn(|i| f32::from(i == k));
    model.layers.push(layer(AttributeKind::Normal, 3, [0, 1, 2, 0].map(normal)));
    assert_eq!(TriangleModel::read(&model.write(ModelFormat::Obj), ModelFormat::Obj).unwrap(), model);
    let grey = |v: u8| [f32::from(v) / 255.0, 1.0, f32::from(v) / 255.0, 0.0];
    model.layers.push(layer(AttributeKind::Colour, 3, [0, 7, 128, 255].map(grey)));
    let ply = model.write(ModelFormat::Ply);
    assert!(String::from_utf8_lossy(&ply).contains("property uchar green\n"), "other programs expect bytes");
    let read = TriangleModel::read(&ply, ModelFormat::Ply).unwrap();
    let values = |model: &TriangleModel, layer: usize| -> Vec<[f32; 4]> {
        let layer = &model.layers[layer];
        layer.corners.iter().map(|value| layer.values[*value as usize]).collect()
    };
    assert_eq!(read.layers.len(), 3);
    assert!((0..3).all(|layer| values(&read, layer) == values(&model, layer)));
}

#[test]
fn corners_without_texture_coordinates_stay_without() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n\
        f 1/1/1 2/2/1 3/3/1\nf 1//1 3/7/1 4\n";
    let model = TriangleModel::read(text.as_bytes(), ModelFormat::Obj).unwrap();
    assert_eq!(model.layers[0].corners, [0, 1, 2, NO_VALUE, NO_VALUE, NO_VALUE]);
    assert_eq!(model.layers[1].corners, [0, 0, 0, 0, 0, NO_VALUE]);
    assert_eq!(TriangleModel::read(&model.write(ModelFormat::Obj), ModelFormat::Obj).unwrap(), model);
    let mesh = quantise::to_mesh(&model, 12, 12);
    let decoded = Mesh::decode(&mesh.encode().unwrap().bytes).unwrap();
    let again = quantise::to_model(&decoded);
    let values = |model: &TriangleModel, layer: usize| -> Vec<Option<[f32; 4]>> {
        (0..6).map(|corner| model.layers[layer].value(corner)).collect()
    };
    // The codec may turn the order of triangles.
    assert_eq!(again.triangles.len(), 2);
    for layer in 0..2 {
        let mut sorted = [values(&again, layer), values(&model, layer)];
        sorted.iter_mut().for_each(|values| values.sort_by(|a, b| a.partial_cmp(b).unwrap()));
        assert_eq!(again.layers[layer].width, model.layers[layer].width);
        assert_eq!(sorted[0].iter().flatten().count(), sorted[1].iter().flatten().count());
        for (a, b) in sorted[0].iter().flatten().flatten().zip(sorted[1].iter().flatten().flatten()) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }
    let ply = TriangleModel::read(&model.write(ModelFormat::Ply), ModelFormat::Ply).unwrap();
    assert_eq!(values(&ply, 0)[3], Some([0.0; 4]), "PLY cannot leave values out");
}

#[test]
fn text_variants_of_other_programs_are_read() {
    let off = "OFF # a comment\n# another\n\n5 2 0\n0 0 0\n1 0 0 \n1 1 0\n0 1 0\n0 0 1\n4 0 1 2 3\n3 0 1 4 255 0 0\n";
    let model = TriangleModel::read(off.as_bytes(), ModelFormat::Off).unwrap();
    assert_eq!(model.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
    let coloured = "STCNOFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 255 0 0 255\n0 1 0 255 0 0 255\n3 0 1 2\n";
    assert_eq!(TriangleModel::read(coloured.as_bytes(), ModelFormat::Off).unwrap().triangles, [[0, 1, 2]]);
    for broken in ["4OFF\n1 0 0\n0 0 0 1\n", "OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "OFF\n1 0 0\n0 nan 0\n"] {
        assert!(TriangleModel::read(broken.as_bytes(), ModelFormat::Off).is_err(), "{broken}");
    }
    let obj = "mtllib a.mtl\nv 0 0 0 1\nv 1 0 0\n\nv 1 1 0\nusemtl x\nf -3//1 -2 3\ng\nf 1/1/1 2/1/1 3/1/1\nvt 0 0\nvn 0 0 1\n";
    let model = TriangleModel::read(obj.as_bytes(), ModelFormat::Obj).unwrap();
    assert_eq!(model.triangles, [[0, 1, 2], [0, 1, 2]]);
    let ply = "ply\r\nformat ascii 1.0\r\ncomment c\r\nelement vertex 3\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\nproperty float confidence\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n0 0 0 1\r\n1 0 0 1\r\n0 1 0 1\r\n3 0 1 2\r\n";
    assert_eq!(TriangleModel::read(ply.as_bytes(), ModelFormat::Ply).unwrap().triangles, [[0, 1, 2]]);
}

#[test]
fn damaged_files_are_an_error_or_a_valid_model() {
    for format in [ModelFormat::Ply, ModelFormat::Off, ModelFormat::Obj, ModelFormat::Stl] {
        let whole = model().write(format);
        for length in 0..whole.len() {
            let _ = TriangleModel::read(&whole[..length], format);
            for byte in [0, b'9', b' ', b'\n', 0xff] {
                let mut bytes = whole.clone();
                bytes[length] = byte;
                if let Ok(model) = TriangleModel::read(&bytes, format) {
                    assert!(model.triangles.as_flattened().iter().all(|v| (*v as usize) < model.positions.len()));
                }
            }
        }
    }
    let huge = b"ply\nformat binary_little_endian 1.0\nelement vertex 9999999999\nproperty float x\nend_header\n";
    assert!(TriangleModel::read(huge, ModelFormat::Ply).is_err());
    assert!(TriangleModel::read(b"OFF\n4000000000 1 1\n", ModelFormat::Off).is_err());
    let strips =
        b"ply\nformat ascii 1.0\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n4 0 1 2 3\n";
    assert!(TriangleModel::read(strips, ModelFormat::Ply).is_err());
}
