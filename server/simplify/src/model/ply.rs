//! PLY: a header that describes elements, then their values as text or binary.
//!
//! Of vertices, x, y, z, normals (nx, ny, nz), texture coordinates (u, v or s, t) and colours (red, green, blue, alpha)
//! are read; of faces the list of corners. Everything else is skipped.

use super::triangle_model::{CornerLayer, ModelError, TriangleModel, check_count, push_fan};
use insula_protocol::mesh::AttributeKind;
use std::collections::HashMap;

#[derive(Debug, Clone, Copy, PartialEq)]
enum PlyNumber {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl PlyNumber {
    fn by_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Converts the first [`Self::bytes`] of `bytes`, little-endian.
    fn value(self, bytes: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = bytes;
        match self {
            Self::I8 => (a as i8).into(),
            Self::U8 => a.into(),
            Self::I16 => i16::from_le_bytes([a, b]).into(),
            Self::U16 => u16::from_le_bytes([a, b]).into(),
            Self::I32 => i32::from_le_bytes([a, b, c, d]).into(),
            Self::U32 => u32::from_le_bytes([a, b, c, d]).into(),
            Self::F32 => f32::from_le_bytes([a, b, c, d]).into(),
            Self::F64 => f64::from_le_bytes(bytes),
        }
    }
}

struct PlyProperty {
    name: String,
    /// Type of a list's length; `None` for a single value.
    length: Option<PlyNumber>,
    number: PlyNumber,
}

struct PlyElement {
    name: String,
    count: usize,
    properties: Vec<PlyProperty>,
}

enum PlyEncoding {
    Text,
    Little,
    Big,
}

/// The values after the header.
struct PlyValues<'a> {
    rest: &'a [u8],
    encoding: PlyEncoding,
}

impl PlyValues<'_> {
    fn next(&mut self, number: PlyNumber) -> Result<f64, ModelError> {
        const SHORT: ModelError = ModelError::Whole("a PLY file ends before its declared content");
        if let PlyEncoding::Text = self.encoding {
            let start = self.rest.iter().position(|byte| !byte.is_ascii_whitespace()).ok_or(SHORT)?;
            let word = &self.rest[start..];
            let end = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
            self.rest = &word[end..];
            let word = std::str::from_utf8(&word[..end]).ok().and_then(|word| word.parse().ok());
            return word.ok_or(ModelError::Whole("a value of a PLY file is not a number"));
        }
        let (head, rest) = self.rest.split_at_checked(number.bytes()).ok_or(SHORT)?;
        self.rest = rest;
        let mut bytes = [0; 8];
        bytes[..head.len()].copy_from_slice(head);
        if let PlyEncoding::Big = self.encoding {
            bytes[..head.len()].reverse();
        }
        Ok(number.value(bytes))
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<TriangleModel, ModelError> {
    let (elements, mut values) = read_header(bytes)?;
    let mut model = TriangleModel::default();
    for element in &elements {
        check_count(element.count)?;
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

fn read_header(bytes: &[u8]) -> Result<(Vec<PlyElement>, PlyValues<'_>), ModelError> {
    let mut elements: Vec<PlyElement> = Vec::new();
    let mut encoding = None;
    let mut rest = bytes;
    for at in 1..10_000 {
        let error = |what| ModelError::Line { what, line: at, format: "PLY" };
        let end = rest.iter().position(|byte| *byte == b'\n').ok_or(error("an incomplete header"))?;
        let line = std::str::from_utf8(&rest[..end]).map_err(|_| error("invalid text"))?;
        rest = &rest[end + 1..];
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |name: &str| PlyNumber::by_name(name).ok_or(error("an unknown type"));
        match words[..] {
            ["ply"] if at == 1 => {}
            _ if at == 1 => return Err(error("no `ply` header")),
            ["format", "ascii", _] => encoding = Some(PlyEncoding::Text),
            ["format", "binary_little_endian", _] => encoding = Some(PlyEncoding::Little),
            ["format", "binary_big_endian", _] => encoding = Some(PlyEncoding::Big),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| error("an invalid count"))?;
                elements.push(PlyElement { name: name.into(), count, properties: Vec::new() });
            }
            ["property", "list", length, item, name] => {
                let property = PlyProperty { name: name.into(), length: Some(number(length)?), number: number(item)? };
                elements.last_mut().ok_or(error("a property before any element"))?.properties.push(property);
            }
            ["property", item, name] => {
                let property = PlyProperty { name: name.into(), length: None, number: number(item)? };
                elements.last_mut().ok_or(error("a property before any element"))?.properties.push(property);
            }
            ["end_header"] => {
                let encoding = encoding.ok_or(error("no format"))?;
                return Ok((elements, PlyValues { rest, encoding }));
            }
            _ => {}
        }
    }
    Err(ModelError::Whole("a PLY file's header has no end_header"))
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
    let places: HashMap<&str, usize> = element.properties.iter().zip(0..).map(|(p, i)| (p.name.as_str(), i)).collect();
    let place = |names: &[&str]| names.iter().map(|name| places.get(name).copied()).collect::<Option<Vec<usize>>>();
    let Some(xyz) = place(&["x", "y", "z"]) else {
        return Err(ModelError::Whole("a PLY file's vertices have no x, y, z"));
    };
    let mut layers: Vec<(AttributeKind, Vec<usize>)> = Vec::new();
    for (kind, names) in LAYERS {
        if let Some(place) = place(names)
            && layers.iter().all(|(other, _)| *other != kind)
        {
            layers.push((kind, place));
        }
    }
    for (kind, place) in &layers {
        model.layers.push(CornerLayer { kind: *kind, width: place.len(), values: Vec::new(), corners: Vec::new() });
    }
    let mut row = vec![0.0; element.properties.len()];
    for _ in 0..element.count {
        for (property, value) in element.properties.iter().zip(&mut row) {
            *value = skip_list(property, values)?;
        }
        model.positions.push(std::array::from_fn(|k| row[xyz[k]]));
        for ((kind, place), layer) in layers.iter().zip(&mut model.layers) {
            // In nearly all files colours are bytes.
            let is_byte = element.properties[place[0]].number == PlyNumber::U8;
            let scale = if *kind == AttributeKind::Colour && is_byte { 255.0 } else { 1.0 };
            layer.values.push(std::array::from_fn(|k| place.get(k).map_or(0.0, |place| (row[*place] / scale) as f32)));
        }
    }
    Ok(())
}

/// Reads a value, or skips a list and returns 0.
fn skip_list(property: &PlyProperty, values: &mut PlyValues<'_>) -> Result<f64, ModelError> {
    let Some(length) = property.length else { return values.next(property.number) };
    for _ in 0..values.next(length)? as usize {
        values.next(property.number)?;
    }
    Ok(0.0)
}

fn read_faces(model: &mut TriangleModel, element: &PlyElement, values: &mut PlyValues<'_>) -> Result<(), ModelError> {
    let mut polygon = Vec::new();
    for _ in 0..element.count {
        for property in &element.properties {
            let is_corners = matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
            match property.length {
                Some(length) if element.name == "face" && is_corners => {
                    let count = values.next(length)? as usize;
                    polygon.clear();
                    for _ in 0..count {
                        polygon.push(values.next(property.number)? as u32);
                    }
                    push_fan(&polygon, |triangle| model.triangles.push(triangle));
                    check_count(model.triangles.len())?;
                }
                _ => drop(skip_list(property, values)?),
            }
        }
    }
    Ok(())
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
