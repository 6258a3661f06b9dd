//! Walls too thin for vertical lines to meet: fences, parapets, the shells of houses without a floor.
//!
//! In: [`CellGrid`] and the candidates that were seen. Out: the same cells, with a column where a wall was seen and nothing
//! stood. Next: `attributes`.

use crate::columns::{clip::WallPlane, voxels::SolidRun};
use crate::sample::{
    local_block::{LocalBlock, LocalTriangle, TOP_Z},
    solids::CellGrid,
    surface_samples::SurfaceSample,
};
use glam::{Vec2, Vec3Swizzles};
use std::collections::BTreeMap;

/// WallPiece area in a cell's row, in squares of the cell's side, from which on the row is full. A wall that crosses a line of
/// cells has half of one in at least one of each two; masts and wires have less, and do not swell to a cell.
const FULL: f32 = 0.45;
/// The same for a row beside a full one of the same wall, which goes on there.
const REST: f32 = 0.03;
/// Thickness, in cells, that a wall has at least: on its cell's border it would have none, and rays would slip through.
const THICKNESS: f32 = 0.125;
/// Cosine of the normals of pieces of the same wall, at least.
const SAME_COSINE: f32 = 0.95;

/// A row of a cell in which wall was seen that no column shows.
#[derive(Debug, Clone, Copy)]
struct WallRow {
    area_m2: f32,
    low_m: f32,
    high_m: f32,
    base_z_m: f32,
    /// Sums over the area: normal out of the wall, place from the cell's centre.
    normal: Vec2,
    at: Vec2,
}

impl WallRow {
    /// The wall's plane, if it is one.
    fn plane(&self) -> Option<WallPlane> {
        let normal = self.normal.normalize_or_zero();
        let even = self.normal.length() > SAME_COSINE * self.area_m2;
        even.then(|| WallPlane { normal, offset_m: normal.dot(self.at) / self.area_m2 })
    }

    /// The wall's plane, with some of the cell behind it.
    fn thick_plane(&self, cell_m: f32) -> Option<WallPlane> {
        let plane = self.plane()?;
        let least_m = (THICKNESS - 0.5 * (plane.normal.x.abs() + plane.normal.y.abs())) * cell_m;
        Some(WallPlane { offset_m: plane.offset_m.max(least_m), ..plane })
    }
}

/// Adds columns for walls that have none.
pub(super) fn add(block: &LocalBlock, candidates: &[SurfaceSample], cells: &mut CellGrid) {
    let c = block.cell_m;
    let mut rows: BTreeMap<(i32, i32, i32), WallRow> = BTreeMap::new();
    for candidate in candidates {
        let triangle = &block.triangles[candidate.triangle as usize];
        let seen = candidate.sightings[0].max(candidate.sightings[1]) > 0;
        if !seen || triangle.terrain || triangle.normal.z.abs() > TOP_Z || is_shown(cells, candidate, triangle, c) {
            continue;
        }
        let p = candidate.p;
        let key = ((p.x / c).floor() as i32, (p.y / c).floor() as i32, (p.z / c).floor() as i32);
        let centre = (Vec2::new(key.0 as f32, key.1 as f32) + 0.5) * c;
        let (normal, at) = (Vec2::ZERO, Vec2::ZERO);
        let empty = WallRow { area_m2: 0.0, low_m: p.z, high_m: p.z, base_z_m: triangle.base_z_m, normal, at };
        let row = rows.entry(key).or_insert(empty);
        let out = if candidate.sightings[1] > candidate.sightings[0] { -triangle.normal } else { triangle.normal };
        row.area_m2 += candidate.area_m2;
        row.normal += out.xy().normalize() * candidate.area_m2;
        row.at += (p.xy() - centre) * candidate.area_m2;
        row.low_m = row.low_m.min(p.z - 0.25 * c).max(triangle.base_z_m);
        row.high_m = row.high_m.max(p.z + 0.25 * c);
    }
    for (&(x, y, _), row) in rows.iter().filter(|(key, row)| stands(&rows, **key, row, c)) {
        let solid = SolidRun { bottom_m: row.low_m, top_m: row.high_m.max(row.low_m + 0.25 * c) };
        cells.insert(x, y, solid, row.base_z_m, row.thick_plane(c));
    }
}

/// Whether enough of a wall is in a row: of its own, or of one that goes on beside it.
fn stands(rows: &BTreeMap<(i32, i32, i32), WallRow>, (x, y, z): (i32, i32, i32), row: &WallRow, c: f32) -> bool {
    let full = |row: &WallRow| row.area_m2 >= FULL * c * c;
    let goes_on = |plane: WallPlane, other: &WallRow| {
        full(other) && other.plane().is_some_and(|other| other.normal.dot(plane.normal) > SAME_COSINE)
    };
    let beside = |plane: WallPlane| {
        let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy, z)));
        around.filter_map(|key| rows.get(&key)).any(|other| goes_on(plane, other))
    };
    full(row) || (row.area_m2 >= REST * c * c && row.plane().is_some_and(beside))
}

/// Whether a column at the candidate or next to it, on either side of its wall, is full at its height.
fn is_shown(cells: &CellGrid, candidate: &SurfaceSample, triangle: &LocalTriangle, c: f32) -> bool {
    [0.02, 0.47, 0.92, 1.37, -0.43, -0.88].into_iter().any(|inwards: f32| {
        let p = candidate.p - triangle.normal * (inwards * c);
        let cell = cells.at((p.x / c).floor() as i32, (p.y / c).floor() as i32);
        let solids = cell.map_or(&[][..], |cell| &cell.column.solids);
        solids.iter().any(|s| candidate.p.z > s.bottom_m - 0.5 * c && candidate.p.z < s.top_m + 0.5 * c)
    })
}
