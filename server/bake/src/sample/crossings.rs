//! Points where vertical lines, 4 x 4 in each cell, cross the surfaces.
//!
//! They are the samples of the geometry. A crossing whose upper side is visible starts a full run downwards, one whose
//! lower side is visible ends it (`solids`). Some sides need no visibility test, because their result follows from the
//! order of the crossings on their line.

use super::local_block::{LocalBlock, LocalTriangle};
use super::rasterise::rasterise;
use crate::columns::merge::LINES_PER_SIDE;
use glam::Vec3;
use rayon::slice::ParallelSliceMut;

/// Sum of sighting weights from which on a side counts as visible. One sighting alone may be the error of a map texel.
const VISIBLE_WEIGHT: u8 = 12;
/// Weight of a sighting whose map texels show the surface itself.
pub(super) const SURE_WEIGHT: u8 = 6;
/// Weight of a sighting whose map texels show other surfaces or nothing. At the tip of a corner, all texels around the
/// point may lie beside the building.
pub(super) const UNSURE_WEIGHT: u8 = 1;

/// Marks a side that is known to be invisible.
const INVISIBLE: u8 = u8::MAX;

#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    /// Number of the line: `y * lines[0] + x`.
    pub(super) line: u32,
    pub(super) z: f32,
    /// Index into the block's triangles.
    pub(super) triangle: u32,
    /// Sighting weight of the upper side, or [`INVISIBLE`].
    above: u8,
    /// Sighting weight of the lower side, or [`INVISIBLE`].
    below: u8,
}

impl Crossing {
    pub(super) fn is_visible_from_above(&self) -> bool {
        self.above == VISIBLE_WEIGHT
    }

    pub(super) fn is_visible_from_below(&self) -> bool {
        self.below == VISIBLE_WEIGHT
    }

    /// Whether it is still unknown if the upper (or lower) side is visible.
    pub(super) fn needs_sightings(&self, from_above: bool) -> bool {
        (if from_above { self.above } else { self.below }) < VISIBLE_WEIGHT
    }

    /// Whether either side still needs sightings.
    pub(super) fn is_pending(&self) -> bool {
        self.needs_sightings(true) || self.needs_sightings(false)
    }

    pub(super) fn add_sighting(&mut self, from_above: bool, weight: u8) {
        let side = if from_above { &mut self.above } else { &mut self.below };
        *side = side.saturating_add(weight).min(VISIBLE_WEIGHT);
    }
}

/// The crossings of all lines of a block.
#[derive(Debug)]
pub(super) struct Crossings {
    /// Sorted by line, then from the top down.
    pub(super) list: Vec<Crossing>,
    /// Number of lines along x and y: those of the block's cells and of one more cell on each side.
    pub(super) lines: [usize; 2],
    /// Distance of neighbouring lines.
    pub(super) step_m: f32,
    /// West and south border of the outermost cells, in the block's coordinates.
    offset_m: f32,
}

impl Crossings {
    pub(super) fn position(&self, crossing: &Crossing) -> Vec3 {
        let along = |i: usize| (i as f32 + 0.5) * self.step_m + self.offset_m;
        let line = crossing.line as usize;
        Vec3::new(along(line % self.lines[0]), along(line / self.lines[0]), crossing.z)
    }

    /// Index of the first crossing of each line, and the number of all.
    pub(super) fn starts(&self) -> Vec<u32> {
        let mut starts = vec![0u32; self.lines[0] * self.lines[1] + 1];
        for crossing in &self.list {
            starts[crossing.line as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        starts
    }

    /// Number of the line nearest to a place; `None` outside of the outermost cells.
    pub(super) fn line_at(&self, x_m: f32, y_m: f32) -> Option<usize> {
        let [x, y] = [x_m, y_m].map(|v| ((v - self.offset_m) / self.step_m).floor());
        let is_within = x >= 0.0 && y >= 0.0 && x < self.lines[0] as f32 && y < self.lines[1] as f32;
        is_within.then(|| y as usize * self.lines[0] + x as usize)
    }
}

/// Finds all crossings and decides those sides that need no sightings.
pub(super) fn find(block: &LocalBlock) -> Crossings {
    let lines = block.cells.map(|n| (n + 2) * LINES_PER_SIDE);
    let step_m = block.cell_m / LINES_PER_SIDE as f32;
    let offset_m = -block.cell_m;
    let mut list = Vec::new();
    for (index, triangle) in block.triangles.iter().enumerate() {
        let n = triangle.normal;
        if n.z.abs() < 1e-4 {
            continue;
        }
        let origin = triangle.corners[0];
        let corners = triangle.corners.map(|c| [c.x - offset_m, c.y - offset_m]);
        let (lowest_m, highest_m) = (triangle.lowest_m(), triangle.highest_m());
        rasterise(corners, step_m, lines, |row, first, end| {
            let y = (row as f32 + 0.5) * step_m + offset_m;
            for column in first..end {
                let x = (column as f32 + 0.5) * step_m + offset_m;
                let z = origin.z - (n.x * (x - origin.x) + n.y * (y - origin.y)) / n.z;
                let line = (row * lines[0] + column) as u32;
                let z = z.clamp(lowest_m, highest_m);
                list.push(Crossing { line, z, triangle: index as u32, above: 0, below: 0 });
            }
        });
    }
    list.par_sort_unstable_by(|a, b| a.line.cmp(&b.line).then(b.z.total_cmp(&a.z)).then(a.triangle.cmp(&b.triangle)));
    for line in list.chunk_by_mut(|a, b| a.line == b.line) {
        decide_known_sides(block, line);
    }
    Crossings { list, lines, step_m, offset_m }
}

/// Decides what needs no test: the highest crossing of a line is visible from above, terrain is never visible from
/// below, the inside of a closed solid is invisible, and a floor at its object's foot with nothing below it ends a run.
fn decide_known_sides(block: &LocalBlock, line: &mut [Crossing]) {
    let triangle_of = |c: &Crossing| -> &LocalTriangle { &block.triangles[c.triangle as usize] };
    if let Some(top) = line.first_mut() {
        top.above = VISIBLE_WEIGHT;
    }
    for i in 0..line.len() {
        if triangle_of(&line[i]).is_terrain {
            line[i].below = INVISIBLE;
        }
        let Some(next) = line.get(i + 1) else { continue };
        let (upper, lower) = (triangle_of(&line[i]), triangle_of(next));
        let is_solid_between =
            !upper.is_terrain && upper.object == lower.object && upper.normal.z > 0.0 && lower.normal.z < 0.0;
        if is_solid_between && line[i].z - line[i + 1].z > 1e-3 {
            line[i].below = INVISIBLE;
            line[i + 1].above = INVISIBLE;
        }
    }
    let is_alone = line.len() == 1;
    if let Some(floor) = line.iter_mut().rev().find(|c| !triangle_of(c).is_terrain) {
        let triangle = triangle_of(floor);
        if !is_alone && triangle.normal.z < 0.0 && floor.z - triangle.object_bottom_m < 1.5 * block.cell_m {
            floor.below = VISIBLE_WEIGHT;
        }
    }
}
