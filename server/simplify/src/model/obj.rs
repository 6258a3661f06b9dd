//! OBJ: vertices, normals, texture coordinates and faces. Materials are ignored; `read::obj` reads cities with
//! materials.

use super::face::FaceTriangles;
use super::triangle_model::{CornerLayer, ModelError, NO_VALUE, TriangleModel, check_count};
use insula_protocol::mesh::AttributeKind;
use std::fmt::Write;

const FORMAT: &str = "OBJ";

pub(super) fn read(bytes: &[u8]) -> Result<TriangleModel, ModelError> {
    let text = String::from_utf8_lossy(bytes);
    let mut model = TriangleModel::default();
    // Indices of texture coordinates and normals are read before it is known whether these exist.
    let (mut texcoords, mut normals) = (Vec::new(), Vec::new());
    let mut corners: [Vec<Option<u32>>; 2] = Default::default();
    let (mut polygon, mut faces) = (Vec::<[Option<u32>; 3]>::new(), FaceTriangles::default());
    for (at, line) in text.lines().enumerate() {
        let error = |what| ModelError::Line { what, line: at + 1, format: FORMAT };
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let position = numbers(words).ok_or(error("fewer than three coordinates"))?;
                model.positions.push(position);
                check_count(model.positions.len())?;
            }
            Some("vt") => {
                let [u, v] = numbers(words).ok_or(error("fewer than two texture coordinates"))?;
                texcoords.push([u as f32, v as f32, 0.0, 0.0]);
            }
            Some("vn") => {
                let [x, y, z] = numbers(words).ok_or(error("an invalid normal"))?;
                normals.push([x as f32, y as f32, z as f32, 0.0]);
            }
            Some("f") => {
                polygon.clear();
                let counts = [model.positions.len(), texcoords.len(), normals.len()];
                for word in words {
                    polygon.push(corner(word, counts).ok_or(error("an invalid corner"))?);
                }
                let vertices = polygon.iter().map(|corner| corner[0].unwrap_or_default());
                for triangle in faces.of(&model.positions, vertices) {
                    let triangle = triangle.map(|i| polygon[i as usize]);
                    model.triangles.push(triangle.map(|corner| corner[0].unwrap_or_default()));
                    for (k, corners) in corners.iter_mut().enumerate() {
                        corners.extend(triangle.map(|corner| corner[k + 1]));
                    }
                }
                check_count(model.triangles.len())?;
            }
            _ => {}
        }
    }
    let [uv, normal] = corners;
    for (kind, width, values, corners) in
        [(AttributeKind::TexCoord, 2, texcoords, uv), (AttributeKind::Normal, 3, normals, normal)]
    {
        model.layers.extend(layer(kind, width, values, corners));
    }
    Ok(model)
}

/// A layer if any corner has a value, else `None`. An index out of range counts as no value.
fn layer(kind: AttributeKind, width: usize, values: Vec<[f32; 4]>, corners: Vec<Option<u32>>) -> Option<CornerLayer> {
    let existing = |value: Option<u32>| value.filter(|value| (*value as usize) < values.len()).unwrap_or(NO_VALUE);
    let corners: Vec<u32> = corners.into_iter().map(existing).collect();
    corners.iter().any(|value| *value != NO_VALUE).then_some(CornerLayer { kind, width, values, corners })
}

fn numbers<'a, const N: usize>(mut words: impl Iterator<Item = &'a str>) -> Option<[f64; N]> {
    let mut out = [0.0; N];
    for v in &mut out {
        *v = words.next()?.parse().ok()?;
    }
    Some(out)
}

/// Parses `7`, `7/2`, `7//3` or `7/2/3`; negative numbers count from the last. Returns the vertex first, from 0.
/// `counts` are the numbers of vertices, texture coordinates and normals.
fn corner(word: &str, counts: [usize; 3]) -> Option<[Option<u32>; 3]> {
    let mut out = [None; 3];
    for ((part, count), out) in word.split('/').zip(counts).zip(&mut out) {
        if part.is_empty() {
            continue;
        }
        let number: i64 = part.parse().ok()?;
        let from_zero = if number < 0 { count as i64 + number } else { number - 1 };
        *out = Some(u32::try_from(from_zero).ok()?);
    }
    out[0]?;
    Some(out)
}

pub(super) fn write(model: &TriangleModel) -> Vec<u8> {
    let mut out = String::new();
    for [x, y, z] in &model.positions {
        let _ = writeln!(out, "v {x} {y} {z}");
    }
    let layer = |kind| model.layers.iter().find(|layer| layer.kind == kind);
    let (uv, normal) = (layer(AttributeKind::TexCoord), layer(AttributeKind::Normal));
    for value in uv.iter().flat_map(|layer| &layer.values) {
        let _ = writeln!(out, "vt {} {}", value[0], value[1]);
    }
    for value in normal.iter().flat_map(|layer| &layer.values) {
        let _ = writeln!(out, "vn {} {} {}", value[0], value[1], value[2]);
    }
    for (t, triangle) in model.triangles.iter().enumerate() {
        out.push('f');
        for (k, vertex) in triangle.iter().enumerate() {
            let value = |layer: Option<&CornerLayer>| layer?.corners[3 * t + k].checked_add(1);
            let vertex = vertex + 1;
            let _ = match (value(uv), value(normal)) {
                (None, None) => write!(out, " {vertex}"),
                (Some(uv), None) => write!(out, " {vertex}/{uv}"),
                (None, Some(normal)) => write!(out, " {vertex}//{normal}"),
                (Some(uv), Some(normal)) => write!(out, " {vertex}/{uv}/{normal}"),
            };
        }
        out.push('\n');
    }
    out.into_bytes()
}
