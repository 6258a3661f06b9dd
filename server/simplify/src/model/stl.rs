//! STL, as text or binary.

use super::triangle_model::{ModelError, TriangleModel, check_count};

/// Bytes of a binary STL before its triangles: a text of 80 bytes and a count.
const HEADER_BYTES: usize = 84;
/// Bytes of a triangle: normal, three corners, two bytes of attributes.
const TRIANGLE_BYTES: usize = 50;
/// Bytes of the start of a text that must name a facet.
const PROBE_BYTES: usize = 4096;

/// Calls `add` with the corners of each triangle of a file. Fails if it is damaged.
pub fn each_triangle(bytes: &[u8], mut add: impl FnMut([[f64; 3]; 3])) -> Result<(), ModelError> {
    match binary_triangles(bytes) {
        Some(triangles) => triangles.chunks_exact(TRIANGLE_BYTES).for_each(|triangle| add(corners(triangle))),
        None if is_text(bytes) => each_of_text(bytes, add)?,
        None => return Err(ModelError::Whole("neither a whole binary STL nor a text STL")),
    }
    Ok(())
}

pub(super) fn read(bytes: &[u8]) -> Result<TriangleModel, ModelError> {
    let mut model = TriangleModel::default();
    each_triangle(bytes, |corners| {
        let first = model.positions.len() as u32;
        model.positions.extend(corners);
        model.triangles.push([first, first + 1, first + 2]);
    })?;
    check_count(model.positions.len())?;
    model.weld();
    Ok(model)
}

/// A binary file. Its numbers have 24 bits.
pub(super) fn write(model: &TriangleModel) -> Vec<u8> {
    let mut out = b"STL, binary".to_vec();
    out.resize(HEADER_BYTES - 4, b' ');
    out.extend((model.triangles.len() as u32).to_le_bytes());
    for triangle in &model.triangles {
        // Readers compute the normal where it is 0.
        out.extend([0; 12]);
        let corners = triangle.iter().flat_map(|vertex| model.positions[*vertex as usize]);
        corners.for_each(|value| out.extend((value as f32).to_le_bytes()));
        out.extend([0; 2]);
    }
    out
}

/// The triangles of a binary STL. Many start with `solid` like a text: the size decides, then the word.
fn binary_triangles(bytes: &[u8]) -> Option<&[u8]> {
    let count = bytes.get(HEADER_BYTES - 4..HEADER_BYTES)?.try_into().ok().map(u32::from_le_bytes)?;
    let length = (count as usize).checked_mul(TRIANGLE_BYTES)?;
    let triangles = bytes.get(HEADER_BYTES..HEADER_BYTES.checked_add(length)?)?;
    let is_exact = bytes.len() == HEADER_BYTES + length;
    (is_exact || !is_text(bytes)).then_some(triangles)
}

/// Whether bytes start like a text STL.
fn is_text(bytes: &[u8]) -> bool {
    let start = bytes.trim_ascii_start();
    let starts_with_solid = start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let probe = String::from_utf8_lossy(&start[..start.len().min(PROBE_BYTES)]).to_ascii_lowercase();
    starts_with_solid && (probe.contains("facet") || probe.contains("endsolid"))
}

fn corners(triangle: &[u8]) -> [[f64; 3]; 3] {
    let value = |index: usize| {
        let bytes = triangle.get(12 + 4 * index..).and_then(<[u8]>::first_chunk).copied().unwrap_or_default();
        f64::from(f32::from_le_bytes(bytes))
    };
    [0, 3, 6].map(|start| [value(start), value(start + 1), value(start + 2)])
}

fn each_of_text(bytes: &[u8], mut add: impl FnMut([[f64; 3]; 3])) -> Result<(), ModelError> {
    let mut corners: Vec<[f64; 3]> = Vec::new();
    let mut is_open = false;
    let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    for (number, line) in bytes.split(|byte| *byte == end).enumerate() {
        let line = line.trim_ascii();
        let (word, rest) = line.split_at(line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len()));
        if word.eq_ignore_ascii_case(b"vertex") {
            let error = ModelError::Line { what: "a vertex is no three numbers", line: number + 1, format: "STL" };
            corners.push(vertex(rest).ok_or(error)?);
        } else if word.eq_ignore_ascii_case(b"facet") {
            is_open = true;
            corners.clear();
        } else if word.eq_ignore_ascii_case(b"endfacet") || word.eq_ignore_ascii_case(b"endloop") {
            is_open = false;
            if let Some((first, rest)) = corners.split_first() {
                rest.windows(2).for_each(|pair| add([*first, pair[0], pair[1]]));
            }
            corners.clear();
        }
    }
    if is_open {
        return Err(ModelError::Whole("the last facet of an STL file is cut short"));
    }
    Ok(())
}

fn vertex(text: &[u8]) -> Option<[f64; 3]> {
    let mut words = std::str::from_utf8(text).ok()?.split_ascii_whitespace().map(|word| word.parse().ok());
    Some([words.next()??, words.next()??, words.next()??])
}
