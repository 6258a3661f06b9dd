//! Columns of thin objects: masts, railings, cables, and what else is too small for the vertical lines and for the walls between
//! them. Such a column covers a share of its cell (Vacca 2008, 3.4.2; docs/decisions/0013-coverage.md).
//!
//! The shares come from the areas of the surfels in a cell, projected along [`DIRECTIONS`] and from above. They count only where no
//! opaque column stands around them at their height: the edges of solid bodies stay opaque.

use super::cell_grid::CellGrid;
use super::floor::Floor;
use super::local_block::{LocalBlock, LocalTriangle};
use super::surfels::Surfel;
use crate::columns::voxels::{LEAST_THIN_RISE, SolidRun, ThinShares};
use glam::{Vec2, Vec3Swizzles};
use std::collections::BTreeMap;
use std::f32::consts::TAU;
use std::sync::LazyLock;

/// Horizontal directions of views, around the circle.
const DIRECTIONS: usize = 16;
/// Least length of the sum of the areas that face all directions, at double the angles, of one plane: it is 1/3 of their sum.
const SAME_PLANE: f32 = 0.27;
/// Least projected area of a thin object in a cell, in squares of the cell's side.
const LEAST_AREA: f32 = 0.01;
/// A surfel of an open surface is seen from both sides if one side is seen from at least this many times fewer directions.
const BOTH_SIDES: u16 = 4;

#[derive(Debug, Clone, Copy)]
pub(super) struct ProjectedAreas {
    /// Of the sides that face each of the directions.
    facing_m2: [f32; DIRECTIONS],
    /// Seen from above.
    top_m2: f32,
    low_m: f32,
    high_m: f32,
}

impl ProjectedAreas {
    pub(super) const NONE: Self =
        Self { facing_m2: [0.0; DIRECTIONS], top_m2: 0.0, low_m: f32::INFINITY, high_m: f32::NEG_INFINITY };

    /// Adds a visible surfel and what its area reaches of its triangle's heights.
    pub(super) fn add(&mut self, surfel: &Surfel, triangle: &LocalTriangle, cell_m: f32) {
        let side = surfel.visible_side();
        let is_sheet = !triangle.is_closed && surfel.sightings[1 - side] * BOTH_SIDES >= surfel.sightings[side];
        let outward = if side == 1 { -triangle.normal } else { triangle.normal };
        for (k, facing_m2) in self.facing_m2.iter_mut().enumerate() {
            let cosine = direction(k).dot(outward.xy());
            *facing_m2 += surfel.area_m2 * if is_sheet { cosine.abs() } else { cosine.max(0.0) };
        }
        self.top_m2 += surfel.area_m2 * if is_sheet { outward.z.abs() } else { outward.z.max(0.0) };
        self.low_m = self.low_m.min((surfel.position.z - 0.25 * cell_m).max(triangle.lowest_m()));
        self.high_m = self.high_m.max((surfel.position.z + 0.25 * cell_m).min(triangle.highest_m()));
    }

    /// The plane that nearly all of it is parallel to: the larger area that faces either way, and the normal.
    pub(super) fn plane(&self) -> Option<(f32, Vec2)> {
        // At double the angles, both sides of a plane agree and perpendicular planes cancel each other.
        let doubled: Vec2 = (0..DIRECTIONS).map(|k| direction(2 * k) * self.facing_m2[k]).sum();
        let all_m2: f32 = self.facing_m2.iter().sum();
        let (sin, cos) = libm::sincosf(0.5 * libm::atan2f(doubled.y, doubled.x));
        let largest_m2 = self.facing_m2.iter().fold(0.0, |most, m2| m2.max(most));
        (doubled.length() > SAME_PLANE * all_m2).then_some((largest_m2, Vec2::new(cos, sin)))
    }

    /// Area across a direction. The surface of a body is seen from two sides, and each may be in another cell.
    fn across_m2(&self, k: usize) -> f32 {
        0.5 * (self.facing_m2[k] + self.facing_m2[(k + DIRECTIONS / 2) % DIRECTIONS])
    }

    pub(super) fn height_m(&self, cell_m: f32) -> f32 {
        // A column has at least one code.
        (self.high_m - self.low_m).max(cell_m / 16.0)
    }

    /// `None` if it is too small.
    fn shares(&self, cell_m: f32) -> Option<ThinShares> {
        let directions = (0..DIRECTIONS / 2).map(|k| (self.across_m2(k), direction(k)));
        let (mut most_m2, mut side) = (0.0f32, 0.0f32);
        for (area_m2, direction) in directions {
            let width_m = cell_m * (direction.x.abs() + direction.y.abs());
            most_m2 = most_m2.max(area_m2);
            side = side.max(area_m2 / (width_m * self.height_m(cell_m)));
        }
        let cell_m2 = cell_m * cell_m;
        let shares = ThinShares { side: side.min(1.0), top: (self.top_m2 / cell_m2).min(1.0) };
        (most_m2 >= LEAST_AREA * cell_m2).then_some(shares)
    }
}

/// Direction `k` of two turns.
fn direction(k: usize) -> Vec2 {
    static ALL: LazyLock<[Vec2; 2 * DIRECTIONS]> = LazyLock::new(|| {
        std::array::from_fn(|k| {
            let (sin, cos) = libm::sincosf(k as f32 / DIRECTIONS as f32 * TAU);
            Vec2::new(cos, sin)
        })
    });
    ALL[k]
}

/// Cuts columns of one cell that rise above all around them and fill little of the cell: a mast that many of the lines met.
pub(super) fn cut_swollen(block: &LocalBlock, surfels: &[Surfel], cells: &mut CellGrid) {
    let cell_m = block.cell_m;
    let mut areas: BTreeMap<[i32; 2], (f32, ProjectedAreas)> = BTreeMap::new();
    let [width, height] = block.cells.map(|n| n as i32);
    for at in (0..height).flat_map(|y| (0..width).map(move |x| [x, y])) {
        let Some(own) = cells.at(at[0], at[1]).and_then(|cell| cell.column.solids.last()) else { continue };
        let around_m = around(at).filter_map(|[x, y]| Some(cells.at(x, y)?.column.solids.last()?.top_m));
        let base_m = around_m.fold(f32::NEG_INFINITY, f32::max);
        if own.top_m - base_m.max(own.bottom_m) >= LEAST_THIN_RISE * cell_m {
            areas.insert(at, (base_m, ProjectedAreas::NONE));
        }
    }
    if areas.is_empty() {
        return;
    }
    for surfel in surfels.iter().filter(|surfel| surfel.is_visible()) {
        let triangle = &block.triangles[surfel.triangle as usize];
        let Some((base_m, areas)) = areas.get_mut(&cell_of(surfel, cell_m)) else { continue };
        if !triangle.is_terrain && surfel.position.z > *base_m {
            areas.add(surfel, triangle, cell_m);
        }
    }
    for (at, (base_m, areas)) in areas {
        if areas.shares(cell_m).is_some_and(ThinShares::is_thin) {
            cells.cut(at, base_m);
        }
    }
}

/// Adds columns for visible thin objects that no column shows.
pub(super) fn add_columns(block: &LocalBlock, floor: &Floor, surfels: &[Surfel], cells: &mut CellGrid) {
    let cell_m = block.cell_m;
    let mut areas: BTreeMap<[i32; 2], ProjectedAreas> = BTreeMap::new();
    for surfel in surfels.iter().filter(|surfel| surfel.is_visible()) {
        let triangle = &block.triangles[surfel.triangle as usize];
        let at = cell_of(surfel, cell_m);
        if !triangle.is_terrain && is_free(cells, at, surfel.position.z) {
            areas.entry(at).or_insert(ProjectedAreas::NONE).add(surfel, triangle, cell_m);
        }
    }
    for (at, areas) in areas {
        let Some(shares) = areas.shares(cell_m) else { continue };
        let run = SolidRun { bottom_m: areas.low_m, top_m: areas.low_m + areas.height_m(cell_m) };
        let [x, y] = at;
        let floor_m = floor.at((x as f32 + 0.5) * cell_m, (y as f32 + 0.5) * cell_m);
        if shares.is_thin() {
            cells.insert_thin(at, run, floor_m, shares);
        } else {
            cells.insert(x, y, run, floor_m, None);
        }
    }
}

fn cell_of(surfel: &Surfel, cell_m: f32) -> [i32; 2] {
    [surfel.position.x, surfel.position.y].map(|v| (v / cell_m).floor() as i32)
}

/// The eight cells around one.
fn around([x, y]: [i32; 2]) -> impl Iterator<Item = [i32; 2]> {
    let steps = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [dx, dy]));
    steps.filter(|step| *step != [0, 0]).map(move |[dx, dy]| [x + dx, y + dy])
}

/// Whether nothing opaque but a bar stands in the cell above a height, nor at that height in the cells around it.
pub(super) fn is_free(cells: &CellGrid, at: [i32; 2], z_m: f32) -> bool {
    let margin_m = 0.5 * cells.cell_m();
    let solids = |[x, y]: [i32; 2]| cells.at(x, y).map_or(&[][..], |cell| &cell.column.solids);
    let is_open = |run: &SolidRun| run.top_m + margin_m <= z_m || run.bottom_m > z_m && cells.has_bar(at);
    solids(at).iter().all(is_open)
        && around(at)
            .all(|at| solids(at).iter().all(|run| z_m <= run.bottom_m - margin_m || z_m >= run.top_m + margin_m))
}
