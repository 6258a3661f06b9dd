//! Columns for walls too thin for vertical lines to meet: fences, parapets, the shells of houses without a floor.
//!
//! Visible wall surfels that no column covers are summed per cell and row. A row with enough wall area becomes full,
//! clipped at the wall's plane. What is no closed wall, such as the posts of a railing, is left to `thin_objects`.

use super::cell_grid::CellGrid;
use super::floor::Floor;
use super::local_block::LocalBlock;
use super::surfels::Surfel;
use super::thin_objects::{ProjectedAreas, is_free};
use crate::columns::clip::WallPlane;
use crate::columns::voxels::SolidRun;
use glam::{Vec2, Vec3, Vec3Swizzles};
use std::collections::{BTreeMap, BTreeSet};

/// Wall area in a row of a cell, in squares of the cell's side, from which on the row is full. Where a wall crosses the
/// border of two cells, at least one of them has half of its area. Masts and wires have less, and must not swell to a
/// cell.
const FULL_AREA: f32 = 0.45;
/// The same for a row that continues a full row of the same wall.
const CONTINUED_AREA: f32 = 0.03;
/// Least share of its plane in a cell that a closed wall fills.
const SHEET_SHARE: f32 = 0.8;
/// Least thickness of a wall, in cells. A wall on its cell's border would have none, and rays would slip through.
const MIN_THICKNESS: f32 = 0.125;
/// Least cosine between normals of pieces of the same wall.
const SAME_WALL_COSINE: f32 = 0.95;

/// A voxel: cell and row in the block's coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct VoxelPosition {
    x: i32,
    y: i32,
    row: i32,
}

impl VoxelPosition {
    fn containing(p: Vec3, cell_m: f32) -> Self {
        let index = |v: f32| (v / cell_m).floor() as i32;
        Self { x: index(p.x), y: index(p.y), row: index(p.z) }
    }
}

/// The uncovered wall in one row of a cell.
#[derive(Debug, Clone, Copy)]
struct WallRow {
    area_m2: f32,
    low_m: f32,
    high_m: f32,
    /// Sum of the horizontal normals, weighted by area.
    normal_sum: Vec2,
    /// Sum of the positions relative to the cell's centre, weighted by area.
    position_sum: Vec2,
    areas: ProjectedAreas,
}

impl WallRow {
    fn new(p: Vec3) -> Self {
        Self {
            area_m2: 0.0,
            low_m: p.z,
            high_m: p.z,
            normal_sum: Vec2::ZERO,
            position_sum: Vec2::ZERO,
            areas: ProjectedAreas::NONE,
        }
    }

    fn has_full_area(&self, cell_m: f32) -> bool {
        self.area_m2 >= FULL_AREA * cell_m * cell_m
    }

    /// Whether the row is a closed wall from side to side of its cell.
    fn is_sheet(&self, cell_m: f32) -> bool {
        let Some((area_m2, normal)) = self.areas.plane() else { return false };
        area_m2 >= SHEET_SHARE * self.areas.height_m(cell_m) * chord_m(self.position_sum / self.area_m2, normal, cell_m)
    }

    /// The mean plane of the wall; `None` if its normals differ too much.
    fn plane(&self) -> Option<WallPlane> {
        let normal = self.normal_sum.normalize_or_zero();
        let is_plane = self.normal_sum.length() > SAME_WALL_COSINE * self.area_m2;
        is_plane.then(|| WallPlane { normal, offset_m: normal.dot(self.position_sum) / self.area_m2 })
    }

    /// The mean plane, moved outwards where less than [`MIN_THICKNESS`] of the cell would be left behind it.
    fn thickened_plane(&self, cell_m: f32) -> Option<WallPlane> {
        let plane = self.plane()?;
        let min_offset_m = (MIN_THICKNESS - 0.5 * (plane.normal.x.abs() + plane.normal.y.abs())) * cell_m;
        Some(WallPlane { offset_m: plane.offset_m.max(min_offset_m), ..plane })
    }
}

/// Adds columns for visible walls that no column covers.
pub(super) fn add_columns(block: &LocalBlock, floor: &Floor, surfels: &[Surfel], cells: &mut CellGrid) {
    let rows = uncovered_rows(block, surfels, cells);
    let c = block.cell_m;
    let loose: BTreeSet<VoxelPosition> =
        rows.iter().filter(|(at, row)| is_loose(&rows, **at, row, cells)).map(|(at, _)| *at).collect();
    for (at, row) in rows.iter().filter(|(at, row)| !loose.contains(at) && is_full(&rows, **at, row, c)) {
        let run = SolidRun { bottom_m: row.low_m, top_m: row.high_m.max(row.low_m + 0.25 * c) };
        let floor_m = floor.at((at.x as f32 + 0.5) * c, (at.y as f32 + 0.5) * c);
        cells.insert(at.x, at.y, run, floor_m, row.thickened_plane(c));
    }
}

/// Sums up the wall surfels that no column covers.
fn uncovered_rows(block: &LocalBlock, surfels: &[Surfel], cells: &CellGrid) -> BTreeMap<VoxelPosition, WallRow> {
    let c = block.cell_m;
    let mut rows: BTreeMap<VoxelPosition, WallRow> = BTreeMap::new();
    for surfel in surfels {
        let triangle = &block.triangles[surfel.triangle as usize];
        let p = surfel.position;
        if !surfel.is_visible() || !triangle.is_wall() || is_covered(cells, p, triangle.normal, c) {
            continue;
        }
        let at = VoxelPosition::containing(p, c);
        let centre = (Vec2::new(at.x as f32, at.y as f32) + 0.5) * c;
        let row = rows.entry(at).or_insert(WallRow::new(p));
        let outward = if surfel.visible_side() == 1 { -triangle.normal } else { triangle.normal };
        row.areas.add(surfel, triangle, c);
        row.area_m2 += surfel.area_m2;
        row.normal_sum += outward.xy().normalize() * surfel.area_m2;
        row.position_sum += (p.xy() - centre) * surfel.area_m2;
        row.low_m = row.low_m.min(p.z - 0.25 * c).max(triangle.object_bottom_m);
        row.high_m = row.high_m.max(p.z + 0.25 * c);
    }
    rows
}

/// Whether a row has enough wall of its own, or continues a full row of the same wall.
fn is_full(rows: &BTreeMap<VoxelPosition, WallRow>, at: VoxelPosition, row: &WallRow, cell_m: f32) -> bool {
    let continues = |plane: WallPlane, other: &WallRow| {
        other.has_full_area(cell_m)
            && other.plane().is_some_and(|other| other.normal.dot(plane.normal) > SAME_WALL_COSINE)
    };
    let continues_any = |plane: WallPlane| rows_around(rows, at).any(|other| continues(plane, other));
    row.has_full_area(cell_m)
        || (row.area_m2 >= CONTINUED_AREA * cell_m * cell_m && row.plane().is_some_and(continues_any))
}

/// Whether a row is part of a thin object, not of a wall.
fn is_loose(rows: &BTreeMap<VoxelPosition, WallRow>, at: VoxelPosition, row: &WallRow, cells: &CellGrid) -> bool {
    let middle_m = 0.5 * (row.low_m + row.high_m);
    let is_wall = |row: &WallRow| row.has_full_area(cells.cell_m()) && row.is_sheet(cells.cell_m());
    let own = row.is_sheet(cells.cell_m());
    !own && !rows_around(rows, at).any(is_wall) && is_free(cells, [at.x, at.y], middle_m)
}

/// A row, and those beside it.
fn rows_around(rows: &BTreeMap<VoxelPosition, WallRow>, at: VoxelPosition) -> impl Iterator<Item = &WallRow> {
    let around =
        (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| VoxelPosition { x: at.x + dx, y: at.y + dy, row: at.row }));
    around.filter_map(|key| rows.get(&key))
}

/// Length inside a cell of the plane through a point, which is relative to the cell's centre.
fn chord_m(p: Vec2, normal: Vec2, cell_m: f32) -> f32 {
    let (along, p) = (normal.perp(), p.clamp(Vec2::splat(-0.5 * cell_m), Vec2::splat(0.5 * cell_m)));
    let ends = |p: f32, along: f32| {
        if along.abs() < 1e-3 {
            return [f32::NEG_INFINITY, f32::INFINITY];
        }
        let reach = |side: f32| (side * 0.5 * cell_m - p) / along;
        [reach(-1.0).min(reach(1.0)), reach(-1.0).max(reach(1.0))]
    };
    let (x, y) = (ends(p.x, along.x), ends(p.y, along.y));
    (x[1].min(y[1]) - x[0].max(y[0])).max(0.0)
}

/// Whether a column at the point, or next to it on either side of its wall, is full at its height.
fn is_covered(cells: &CellGrid, p: Vec3, normal: Vec3, cell_m: f32) -> bool {
    // Distances behind the wall, in cells; negative ones are in front.
    [0.02, 0.47, 0.92, 1.37, -0.43, -0.88].into_iter().any(|depth: f32| {
        let q = p - normal * (depth * cell_m);
        let cell = cells.at((q.x / cell_m).floor() as i32, (q.y / cell_m).floor() as i32);
        let solids = cell.map_or(&[][..], |cell| &cell.column.solids);
        solids.iter().any(|run| p.z > run.bottom_m - 0.5 * cell_m && p.z < run.top_m + 0.5 * cell_m)
    })
}
