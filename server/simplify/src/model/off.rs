//! OFF: a header, counts, vertices and faces as text. Colours, normals and texture coordinates are passed over.

use super::face::FaceTriangles;
use super::triangle_model::{ModelError, TriangleModel, check_count};
use std::fmt::Write;

const FORMAT: &str = "OFF";

pub(super) fn read(bytes: &[u8]) -> Result<TriangleModel, ModelError> {
    let (mut triangles, mut faces) = (Vec::new(), FaceTriangles::default());
    let positions = each_face(bytes, |positions, corners| {
        let own = faces.of(positions, corners.iter().copied());
        triangles.extend(own.iter().map(|triangle| triangle.map(|i| corners[i as usize])));
    })?;
    Ok(TriangleModel { positions, triangles, ..TriangleModel::default() })
}

/// Calls `add` with all vertices and the corners of each face, which are among them. Returns the vertices. Fails if the file is damaged,
/// has a value that is not finite, or exceeds [`MAX_COUNT`](super::MAX_COUNT).
pub fn each_face(bytes: &[u8], mut add: impl FnMut(&[[f64; 3]], &[u32])) -> Result<Vec<[f64; 3]>, ModelError> {
    let text = std::str::from_utf8(bytes).map_err(|_| ModelError::Whole("an OFF file must be text"))?;
    let lines =
        text.lines().enumerate().map(|(number, line)| (number + 1, line.split('#').next().unwrap_or_default().trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty());
    let error = |what, line| ModelError::Line { what, line, format: FORMAT };
    let (at, first) = lines.next().ok_or(ModelError::Whole("the file is empty"))?;
    let plain = ["ST", "C", "N"].into_iter().fold(first, |rest, letters| rest.strip_prefix(letters).unwrap_or(rest));
    let rest = plain.strip_prefix("OFF").ok_or(error("no `OFF` header", at))?.trim();
    let (at, counts) = if rest.is_empty() { lines.next().ok_or(error("no counts", at))? } else { (at, rest) };
    let counts: Vec<usize> = counts.split_whitespace().map_while(|word| word.parse().ok()).collect();
    let [vertices, faces, ..] = counts[..] else { return Err(error("no counts", at)) };
    check_count(vertices)?;
    check_count(faces)?;
    let (mut positions, mut polygon, mut triangles) = (Vec::new(), Vec::new(), 0);
    for (at, line) in lines {
        let mut words = line.split_whitespace();
        if positions.len() < vertices {
            let mut position = [0.0; 3];
            for v in &mut position {
                *v =
                    words.next().and_then(|word| word.parse().ok()).ok_or(error("fewer than three coordinates", at))?;
            }
            if position.iter().any(|v: &f64| !v.is_finite()) {
                return Err(error("a coordinate that is not finite", at));
            }
            positions.push(position);
            continue;
        }
        let corners: usize = words.next().and_then(|word| word.parse().ok()).ok_or(error("an invalid face", at))?;
        polygon.clear();
        polygon.extend(words.map_while(|word| word.parse::<u32>().ok()).take(corners));
        if polygon.len() != corners {
            return Err(error("a face with fewer corners than declared", at));
        }
        if polygon.iter().any(|corner| *corner as usize >= positions.len()) {
            return Err(error("a face with a vertex that does not exist", at));
        }
        triangles += corners.saturating_sub(2);
        check_count(triangles)?;
        add(&positions, &polygon);
    }
    if positions.len() != vertices {
        return Err(ModelError::Whole("fewer vertices than declared"));
    }
    Ok(positions)
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
