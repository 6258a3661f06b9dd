//! OBJ: vertices, normals, texture coordinates and faces; materials are not looked at.
//!
//! In: bytes. Out: a [`Model`], and back. Next: `model`. (`read::obj` reads cities, with materials and pictures.)

use super::{Layer, Model, ModelError, fan, limit};
use insula_protocol::mesh::AttributeKind;
use std::fmt::Write;

const FORMAT: &str = "OBJ";

pub(super) fn read(bytes: &[u8]) -> Result<Model, ModelError> {
    let text = String::from_utf8_lossy(bytes);
    let mut model = Model::default();
    // Numbers of texture coordinates and normals: read before they are known to be there.
    let (mut texcoords, mut normals) = (Vec::new(), Vec::new());
    let mut corners: [Vec<Option<u32>>; 2] = Default::default();
    let mut polygon: Vec<[Option<u32>; 3]> = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let error = |what| ModelError::Line { what, line: at + 1, format: FORMAT };
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let position = numbers(words).ok_or(error("no three coordinates"))?;
                model.positions.push(position);
                limit(model.positions.len())?;
            }
            Some("vt") => {
                let [u, v] = numbers(words).ok_or(error("no two texture coordinates"))?;
                texcoords.push([u as f32, v as f32, 0.0, 0.0]);
            }
            Some("vn") => {
                let [x, y, z] = numbers(words).ok_or(error("no normal"))?;
                normals.push([x as f32, y as f32, z as f32, 0.0]);
            }
            Some("f") => {
                polygon.clear();
                let counts = [model.positions.len(), texcoords.len(), normals.len()];
                for word in words {
                    polygon.push(corner(word, counts).ok_or(error("a corner that is none"))?);
                }
                let order: Vec<u32> = (0..polygon.len() as u32).collect();
                fan(&order, |triangle| {
                    let triangle = triangle.map(|i| polygon[i as usize]);
                    model.triangles.push(triangle.map(|corner| corner[0].unwrap_or_default()));
                    for (k, corners) in corners.iter_mut().enumerate() {
                        corners.extend(triangle.map(|corner| corner[k + 1]));
                    }
                });
                limit(model.triangles.len())?;
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

/// A layer if all corners have a value; what some lack, none is given.
fn layer(kind: AttributeKind, width: usize, values: Vec<[f32; 4]>, corners: Vec<Option<u32>>) -> Option<Layer> {
    let corners: Vec<u32> = corners.into_iter().collect::<Option<_>>()?;
    let all_there = !corners.is_empty() && corners.iter().all(|value| (*value as usize) < values.len());
    all_there.then_some(Layer { kind, width, values, corners })
}

fn numbers<'a, const N: usize>(mut words: impl Iterator<Item = &'a str>) -> Option<[f64; N]> {
    let mut out = [0.0; N];
    for v in &mut out {
        *v = words.next()?.parse().ok()?;
    }
    Some(out)
}

/// `7`, `7/2`, `7//3`, `7/2/3`, or counted back from the last with a minus: from 0, vertex first.
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

pub(super) fn write(model: &Model) -> Vec<u8> {
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
            let value = |layer: Option<&Layer>| layer.map(|layer| layer.corners[3 * t + k] + 1);
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
