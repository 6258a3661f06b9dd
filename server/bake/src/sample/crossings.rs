//! Where vertical lines, 4 x 4 in each cell, cross the surfaces: the geometry samples (design 5, step 1).
//!
//! In: [`LocalBlock`]. Out: [`Crossings`]. Next: `visibility` says from which side each is seen, `solids` makes runs of them.

use crate::columns::merge::LINES;
use crate::sample::{local_block::LocalBlock, rasterise::scan};
use rayon::slice::ParallelSliceMut;

/// Weight of sightings from which on a side counts as seen: one alone may be the error of a single map texel.
pub(super) const SIGHTINGS: u8 = 12;
/// A sighting whose texels show the surface itself.
pub(super) const SURE: u8 = 6;
/// A sighting past which the texels show other things, or nothing: at the tip of a corner all may lie beside the building.
pub(super) const UNSURE: u8 = 1;

/// Not to be tested: its outcome follows from its place.
const NEVER: u8 = u8::MAX;

/// One crossing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    /// Which line: `y * lines_x + x`.
    pub(super) line: u32,
    pub(super) z: f32,
    /// Into the block's triangles.
    pub(super) triangle: u32,
    /// Sightings of the upper side, or [`NEVER`].
    above: u8,
    /// Sightings of the lower side, or [`NEVER`].
    below: u8,
}

impl Crossing {
    pub(super) fn seen_above(&self) -> bool {
        self.above != NEVER && self.above >= SIGHTINGS
    }

    pub(super) fn seen_below(&self) -> bool {
        self.below != NEVER && self.below >= SIGHTINGS
    }

    /// Whether sightings of the upper (or lower) side are still wanted.
    pub(super) fn wants(&self, above: bool) -> bool {
        (if above { self.above } else { self.below }) < SIGHTINGS
    }

    pub(super) fn sighted(&mut self, above: bool, weight: u8) {
        let side = if above { &mut self.above } else { &mut self.below };
        *side = side.saturating_add(weight).min(SIGHTINGS);
    }
}

/// All crossings, by line and then from the top down.
#[derive(Debug)]
pub(super) struct Crossings {
    pub(super) list: Vec<Crossing>,
    /// Lines along x: the block's cells and one more on either side.
    pub(super) lines: [usize; 2],
    /// Distance of two lines.
    pub(super) step_m: f32,
    /// Position of line 0 less half a step: the block's corner lies one cell inside.
    pub(super) offset_m: f32,
}

/// Finds all crossings and settles those that need no look.
pub(super) fn find(block: &LocalBlock) -> Crossings {
    let lines = block.cells.map(|n| (n + 2) * LINES);
    let step_m = block.cell_m / LINES as f32;
    let offset_m = -block.cell_m;
    let mut list = Vec::new();
    for (index, triangle) in block.triangles.iter().enumerate() {
        let n = triangle.normal;
        if n.z.abs() < 1e-4 {
            continue;
        }
        let origin = triangle.corners[0];
        let corners = triangle.corners.map(|c| [c.x - offset_m, c.y - offset_m]);
        let z_low = triangle.corners.iter().fold(f32::INFINITY, |m, c| m.min(c.z));
        let z_high = triangle.corners.iter().fold(f32::NEG_INFINITY, |m, c| m.max(c.z));
        scan(corners, step_m, lines, |row, first, end| {
            let y = (row as f32 + 0.5) * step_m + offset_m;
            for column in first..end {
                let x = (column as f32 + 0.5) * step_m + offset_m;
                let z = origin.z - (n.x * (x - origin.x) + n.y * (y - origin.y)) / n.z;
                let line = (row * lines[0] + column) as u32;
                list.push(Crossing { line, z: z.clamp(z_low, z_high), triangle: index as u32, above: 0, below: 0 });
            }
        });
    }
    list.par_sort_unstable_by(|a, b| a.line.cmp(&b.line).then(b.z.total_cmp(&a.z)).then(a.triangle.cmp(&b.triangle)));
    for line in list.chunk_by_mut(|a, b| a.line == b.line) {
        settle(block, line);
    }
    Crossings { list, lines, step_m, offset_m }
}

/// What follows without a look: the highest crossing is seen from above; a floor at its object's foot with nothing under it
/// from below; terrain never from below; the inside of a closed solid never.
fn settle(block: &LocalBlock, line: &mut [Crossing]) {
    let of = |c: &Crossing| &block.triangles[c.triangle as usize];
    if let Some(top) = line.first_mut() {
        top.above = SIGHTINGS;
    }
    for i in 0..line.len() {
        if of(&line[i]).terrain {
            line[i].below = NEVER;
        }
        let Some(next) = line.get(i + 1) else { continue };
        let (upper, lower) = (of(&line[i]), of(next));
        let solid = !upper.terrain && upper.object == lower.object && upper.normal.z > 0.0 && lower.normal.z < 0.0;
        if solid && line[i].z - line[i + 1].z > 1e-3 {
            line[i].below = NEVER;
            line[i + 1].above = NEVER;
        }
    }
    let alone = line.len() == 1;
    if let Some(floor) = line.iter_mut().rev().find(|c| !of(c).terrain) {
        let triangle = of(floor);
        if !alone && triangle.normal.z < 0.0 && floor.z - triangle.base_z_m < 1.5 * block.cell_m {
            floor.below = SIGHTINGS;
        }
    }
}
