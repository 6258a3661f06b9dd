//! Triangles of a polygon whose holes touch its outer ring, between the corners that it has.

use super::clean::clean;
use earcut::Earcut;

/// Corners this near to a corner of the polygon are that one.
const NEAR_M: f64 = 0.01;
/// Polygons with more corners stay as they are: each corner is compared with each.
const MAX_CORNERS: usize = 4096;

/// Triples of corners of a flat polygon whose holes begin at `hole_starts`, after its rings are cleaned. `None` if there is nothing to
/// clean, or if the cleaned rings have corners that the polygon does not have.
pub(super) fn triangles(flat: &[[f64; 2]], hole_starts: &[u32]) -> Option<Vec<u32>> {
    if flat.len() > MAX_CORNERS {
        return None;
    }
    let mut rings: Vec<&[[f64; 2]]> = Vec::with_capacity(hole_starts.len() + 1);
    let mut start = 0;
    for end in hole_starts.iter().map(|start| *start as usize).chain([flat.len()]) {
        rings.push(flat.get(start..end)?);
        start = end;
    }
    let mut found = Vec::new();
    for polygon in clean(&rings)? {
        let (mut corners, mut starts) = (Vec::new(), Vec::new());
        for (number, ring) in polygon.iter().enumerate() {
            let mut own: Vec<u32> = ring.iter().map(|position| corner_near(flat, *position)).collect::<Option<_>>()?;
            own.dedup();
            if own.len() > 1 && own.first() == own.last() {
                own.pop();
            }
            if own.len() < 3 {
                // Nothing remains of an outer ring, nor of its holes.
                if number == 0 {
                    break;
                }
                continue;
            }
            if number > 0 {
                starts.push(corners.len() as u32);
            }
            corners.append(&mut own);
        }
        let positions: Option<Vec<[f64; 2]>> =
            corners.iter().map(|corner| flat.get(*corner as usize).copied()).collect();
        let mut indices: Vec<u32> = Vec::new();
        Earcut::new().earcut_slice(&positions?, &starts, &mut indices);
        found.extend(indices.into_iter().filter_map(|index| corners.get(index as usize)));
    }
    Some(found)
}

/// Number of the corner nearest to a position; `None` if none is near.
fn corner_near(flat: &[[f64; 2]], [x, y]: [f64; 2]) -> Option<u32> {
    let distance = |corner: &[f64; 2]| libm::hypot(corner[0] - x, corner[1] - y);
    let distances = (0..).zip(flat).map(|(number, corner)| (number, distance(corner)));
    let nearest = distances.min_by(|(_, a), (_, b)| a.total_cmp(b));
    nearest.filter(|(_, distance)| *distance < NEAR_M).map(|(number, _)| number)
}
