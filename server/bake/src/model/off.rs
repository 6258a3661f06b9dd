//! OFF: a header, counts, vertices, faces, as words.
//!
//! In: bytes. Out: a [`TriangleModel`], and back. Next: `model`.

use super::{ModelError, TriangleModel, fan, limit};
use std::fmt::Write;

const FORMAT: &str = "OFF";

pub(super) fn read(bytes: &[u8]) -> Result<TriangleModel, ModelError> {
    let text = std::str::from_utf8(bytes).map_err(|_| ModelError::Whole("an OFF file is text"))?;
    let lines =
        text.lines().enumerate().map(|(number, line)| (number + 1, line.split('#').next().unwrap_or_default().trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty());
    let error = |what, line| ModelError::Line { what, line, format: FORMAT };
    let (at, first) = lines.next().ok_or(ModelError::Whole("an empty file"))?;
    let rest = first.strip_prefix("OFF").ok_or(error("no OFF", at))?.trim();
    let (at, counts) = if rest.is_empty() { lines.next().ok_or(error("no counts", at))? } else { (at, rest) };
    let counts: Vec<usize> = counts.split_whitespace().map_while(|word| word.parse().ok()).collect();
    let [vertices, faces, ..] = counts[..] else { return Err(error("no counts", at)) };
    limit(vertices)?;
    limit(faces)?;
    let mut model = TriangleModel::default();
    let mut polygon = Vec::new();
    for (at, line) in lines {
        let mut words = line.split_whitespace();
        if model.positions.len() < vertices {
            let mut position = [0.0; 3];
            for v in &mut position {
                *v = words.next().and_then(|word| word.parse().ok()).ok_or(error("no three coordinates", at))?;
            }
            model.positions.push(position);
            continue;
        }
        let corners: usize = words.next().and_then(|word| word.parse().ok()).ok_or(error("no face", at))?;
        polygon.clear();
        polygon.extend(words.map_while(|word| word.parse::<u32>().ok()).take(corners));
        if polygon.len() != corners {
            return Err(error("a face with fewer corners than it says", at));
        }
        fan(&polygon, |triangle| model.triangles.push(triangle));
        limit(model.triangles.len())?;
    }
    if model.positions.len() != vertices {
        return Err(ModelError::Whole("fewer vertices than the file says"));
    }
    Ok(model)
}

pub(super) fn write(model: &TriangleModel) -> Vec<u8> {
    let mut out = format!("OFF\n{} {} 0\n", model.positions.len(), model.triangles.len());
    for [x, y, z] in &model.positions {
        let _ = writeln!(out, "{x} {y} {z}");
    }
    for [a, b, c] in &model.triangles {
        let _ = writeln!(out, "3 {a} {b} {c}");
    }
    out.into_bytes()
}
