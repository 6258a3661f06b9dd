//! PLY: a header that describes elements, then their values as text or binary.
//!
//! Of vertices, x, y, z, normals (nx, ny, nz), texture coordinates (u, v or s, t) and colours (red, green, blue, alpha)
//! are read; of faces the list of corners. Everything else is skipped.

use super::face::FaceTriangles;
use super::ply_header::{PlyElement, PlyHeader, PlyNumber, PlyProperty};
use super::ply_values::{PlyRow, PlyValues};
use super::triangle_model::{CornerLayer, ModelError, TriangleModel, check_count};
use insula_protocol::mesh::AttributeKind;
use std::collections::HashMap;

pub(super) fn read(bytes: &[u8]) -> Result<TriangleModel, ModelError> {
    let header = PlyHeader::parse(bytes)?;
    let mut values = PlyValues::new(bytes, &header);
    let mut model = TriangleModel::default();
    for element in header.elements.iter().filter(|element| !element.properties.is_empty()) {
        check_count(usize::try_from(element.count).unwrap_or(usize::MAX))?;
        match element.name.as_str() {
            "vertex" => read_vertices(&mut model, element, &mut values)?,
            "tristrips" if element.count > 0 => {
                return Err(ModelError::Whole("a PLY file has triangle strips: convert them to faces"));
            }
            _ => read_faces(&mut model, element, &mut values)?,
        }
    }
    let corners: Vec<u32> = model.triangles.as_flattened().to_vec();
    model.layers.iter_mut().for_each(|layer| layer.corners.clone_from(&corners));
    Ok(model)
}

fn each_row(
    element: &PlyElement,
    values: &mut PlyValues<'_>,
    mut take: impl FnMut(&PlyRow) -> Result<(), ModelError>,
) -> Result<(), ModelError> {
    let mut row = PlyRow::default();
    for _ in 0..element.count {
        values.row(element, &mut row).map_err(ModelError::Whole)?;
        take(&row)?;
    }
    Ok(())
}

/// Names of the vertex properties that form a layer.
const LAYERS: [(AttributeKind, &[&str]); 5] = [
    (AttributeKind::TexCoord, &["u", "v"]),
    (AttributeKind::TexCoord, &["s", "t"]),
    (AttributeKind::Normal, &["nx", "ny", "nz"]),
    (AttributeKind::Colour, &["red", "green", "blue", "alpha"]),
    (AttributeKind::Colour, &["red", "green", "blue"]),
];

/// A single number for each vertex. It is only written: MeshLab keeps results of its filters there, which mean something else
/// to each.
const QUALITY: (AttributeKind, &[&str]) = (AttributeKind::Other, &["quality"]);

/// Names of the properties that a layer is written as; none if PLY has no word for it.
fn written_names(layer: &CornerLayer) -> &'static [&'static str] {
    let found = LAYERS.iter().chain([&QUALITY]).find(|(kind, names)| *kind == layer.kind && names.len() == layer.width);
    found.map_or(&[], |(_, names)| names)
}

fn read_vertices(
    model: &mut TriangleModel,
    element: &PlyElement,
    values: &mut PlyValues<'_>,
) -> Result<(), ModelError> {
    let xyz = element.places(["x", "y", "z"]).ok_or(ModelError::Whole("a PLY file's vertices have no x, y, z"))?;
    let single = |name: &&str| element.places([name]).map(|[place]| place);
    let mut layers: Vec<(AttributeKind, Vec<usize>)> = Vec::new();
    for (kind, names) in LAYERS {
        if let Some(places) = names.iter().map(single).collect()
            && layers.iter().all(|(other, _)| *other != kind)
        {
            layers.push((kind, places));
        }
    }
    for (kind, places) in &layers {
        model.layers.push(CornerLayer { kind: *kind, width: places.len(), values: Vec::new(), corners: Vec::new() });
    }
    each_row(element, values, |row| {
        model.positions.push(xyz.map(|place| row.single(place)));
        for ((kind, places), layer) in layers.iter().zip(&mut model.layers) {
            // In nearly all files colours are bytes.
            let is_byte = element.properties[places[0]].number == PlyNumber::U8;
            let scale = if *kind == AttributeKind::Colour && is_byte { 255.0 } else { 1.0 };
            let value = |k: usize| places.get(k).map_or(0.0, |place| (row.single(*place) / scale) as f32);
            layer.values.push(std::array::from_fn(value));
        }
        Ok(())
    })
}

fn read_faces(model: &mut TriangleModel, element: &PlyElement, values: &mut PlyValues<'_>) -> Result<(), ModelError> {
    let is_corners = |property: &PlyProperty| {
        property.length.is_some() && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
    };
    let corners = element.properties.iter().position(is_corners).filter(|_| element.name == "face");
    let (mut polygon, mut faces) = (Vec::<u32>::new(), FaceTriangles::default());
    each_row(element, values, |row| {
        let Some(corners) = corners else { return Ok(()) };
        polygon.clear();
        polygon.extend(row.list(corners).iter().map(|corner| *corner as u32));
        let own = faces.of(&model.positions, polygon.iter().copied());
        model.triangles.extend(own.iter().map(|triangle| triangle.map(|i| polygon[i as usize])));
        check_count(model.triangles.len())
    })
}

pub(super) fn write(model: &TriangleModel) -> Vec<u8> {
    // In PLY a vertex has one value of each layer. A vertex with several is written several times.
    let mut numbers: HashMap<Vec<u32>, u32> = HashMap::new();
    let mut rows: Vec<Vec<u32>> = Vec::new();
    let mut row = |row: Vec<u32>| {
        *numbers.entry(row.clone()).or_insert_with(|| {
            rows.push(row);
            rows.len() as u32 - 1
        })
    };
    let own: Vec<u32> = if model.layers.is_empty() {
        for vertex in 0..model.positions.len() as u32 {
            row(vec![vertex]);
        }
        model.triangles.as_flattened().to_vec()
    } else {
        let corner = |(i, vertex): (usize, &u32)| {
            row([*vertex].into_iter().chain(model.layers.iter().map(|layer| layer.corners[i])).collect())
        };
        model.triangles.as_flattened().iter().enumerate().map(corner).collect()
    };
    let mut head = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", rows.len());
    for axis in ["x", "y", "z"] {
        head += &format!("property double {axis}\n");
    }
    for layer in &model.layers {
        // Other programs expect bytes.
        let number = if layer.kind == AttributeKind::Colour { "uchar" } else { "float" };
        for name in written_names(layer) {
            head += &format!("property {number} {name}\n");
        }
    }
    head += &format!("element face {}\nproperty list uchar uint vertex_indices\nend_header\n", own.len() / 3);
    let mut out = head.into_bytes();
    for row in &rows {
        model.positions[row[0] as usize].iter().for_each(|v| out.extend(v.to_le_bytes()));
        for (layer, value) in model.layers.iter().zip(&row[1..]) {
            if !written_names(layer).is_empty() {
                // PLY cannot leave a value out.
                let value = layer.values.get(*value as usize).unwrap_or(&[0.0; 4]);
                let values = &value[..layer.width];
                match layer.kind {
                    AttributeKind::Colour => out.extend(values.iter().map(|v| (v * 255.0).round() as u8)),
                    _ => values.iter().for_each(|v| out.extend(v.to_le_bytes())),
                }
            }
        }
    }
    for triangle in own.chunks(3) {
        out.push(3);
        triangle.iter().for_each(|vertex| out.extend(vertex.to_le_bytes()));
    }
    out
}
