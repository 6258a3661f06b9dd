//! Walls too thin for vertical lines to meet: fences, parapets, the shells of houses without a floor.
//!
//! In: [`Cells`] and the candidates that were seen. Out: the same cells, with a column where a wall was seen and nothing
//! stood. Next: `attributes`.

use super::{
    attributes::TOP_Z,
    candidates::Candidate,
    local::{Block, LocalTriangle},
    solids::Cells,
};
use crate::voxels::Solid;
use std::collections::BTreeMap;

/// Wall area in a cell's row, in squares of the cell's side, from which on the row is full. A wall that crosses a line of
/// cells has half of one in at least one of each two, so that no ray slips through; masts and wires have less, and do not
/// swell to a cell.
const FULL: f32 = 0.45;

/// A row of a cell in which wall was seen that no column shows.
#[derive(Debug, Clone, Copy)]
struct Row {
    area_m2: f32,
    low_m: f32,
    high_m: f32,
    base_z_m: f32,
}

/// Adds columns for walls that have none.
pub(super) fn add(block: &Block, candidates: &[Candidate], cells: &mut Cells) {
    let c = block.cell_m;
    let mut rows: BTreeMap<(i32, i32, i32), Row> = BTreeMap::new();
    for candidate in candidates {
        let triangle = &block.triangles[candidate.triangle as usize];
        let seen = candidate.sightings[0].max(candidate.sightings[1]) > 0;
        if !seen || triangle.terrain || triangle.normal.z.abs() > TOP_Z || is_shown(cells, candidate, triangle, c) {
            continue;
        }
        let p = candidate.p;
        let key = ((p.x / c).floor() as i32, (p.y / c).floor() as i32, (p.z / c).floor() as i32);
        let empty = Row { area_m2: 0.0, low_m: p.z, high_m: p.z, base_z_m: triangle.base_z_m };
        let row = rows.entry(key).or_insert(empty);
        row.area_m2 += candidate.area_m2;
        row.low_m = row.low_m.min(p.z - 0.25 * c).max(triangle.base_z_m);
        row.high_m = row.high_m.max(p.z + 0.25 * c);
    }
    rows.retain(|_, row| row.area_m2 >= FULL * c * c);
    for ((x, y, _), row) in rows {
        let solid = Solid { bottom_m: row.low_m, top_m: row.high_m.max(row.low_m + 0.25 * c) };
        cells.insert(x, y, solid, row.base_z_m);
    }
}

/// Whether a column at the candidate or next to it, on either side of its wall, is full at its height.
fn is_shown(cells: &Cells, candidate: &Candidate, triangle: &LocalTriangle, c: f32) -> bool {
    [0.02, 0.47, 0.92, 1.37, -0.43, -0.88].into_iter().any(|inwards: f32| {
        let p = candidate.p - triangle.normal * (inwards * c);
        let cell = cells.at((p.x / c).floor() as i32, (p.y / c).floor() as i32);
        let solids = cell.map_or(&[][..], |cell| &cell.column.solids);
        solids.iter().any(|s| candidate.p.z > s.bottom_m - 0.5 * c && candidate.p.z < s.top_m + 0.5 * c)
    })
}
