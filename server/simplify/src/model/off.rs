//! OFF: a header, counts, vertices and faces as text.

use super::triangle_model::{ModelError, TriangleModel, check_count, push_fan};
use std::fmt::Write;

const FORMAT: &str = "OFF";

pub(super) fn read(bytes: &[u8]) -> Result<TriangleModel, ModelError> {
    let text = std::str::from_utf8(bytes).map_err(|_| ModelError::Whole("an OFF file must be text"))?;
    let lines =
        text.lines().enumerate().map(|(number, line)| (number + 1, line.split('#').next().unwrap_or_default().trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty());
    let error = |what, line| ModelError::Line { what, line, format: FORMAT };
    let (at, first) = lines.next().ok_or(ModelError::Whole("the file is empty"))?;
    let rest = first.strip_prefix("OFF").ok_or(error("no `OFF` header", at))?.trim();
    let (at, counts) = if rest.is_empty() { lines.next().ok_or(error("no counts", at))? } else { (at, rest) };
    let counts: Vec<usize> = counts.split_whitespace().map_while(|word| word.parse().ok()).collect();
    let [vertices, faces, ..] = counts[..] else { return Err(error("no counts", at)) };
    check_count(vertices)?;
    check_count(faces)?;
    let mut model = TriangleModel::default();
    let mut polygon = Vec::new();
    for (at, line) in lines {
        let mut words = line.split_whitespace();
        if model.positions.len() < vertices {
            let mut position = [0.0; 3];
            for v in &mut position {
                *v =
                    words.next().and_then(|word| word.parse().ok()).ok_or(error("fewer than three coordinates", at))?;
            }
            model.positions.push(position);
            continue;
        }
        let corners: usize = words.next().and_then(|word| word.parse().ok()).ok_or(error("an invalid face", at))?;
        polygon.clear();
        polygon.extend(words.map_while(|word| word.parse::<u32>().ok()).take(corners));
        if polygon.len() != corners {
            return Err(error("a face with fewer corners than declared", at));
        }
        push_fan(&polygon, |triangle| model.triangles.push(triangle));
        check_count(model.triangles.len())?;
    }
    if model.positions.len() != vertices {
        return Err(ModelError::Whole("fewer vertices than declared"));
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
