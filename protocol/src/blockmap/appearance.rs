//! The texels of a map: roofs row by row, outer tops, and wall strips in facade order.
//!
//! A roof texel is predicted from the western, southern and south-western one. A strip texel is predicted from the one
//! below, from the one in the same row of the predecessor's strip, and from the one below that.

use super::facades::FacadeStep;
use super::neighbours::{WIDTH, neighbour, rim_index};
use super::texel_coder::{Colour, QuantisationSteps, ReconstructedTexel, TexelCoder, from_rgb};
use super::{BlockMap, COLUMNS, STEPS_PER_CELL, flag, strip_rows};
use crate::codec::range::{BitCoder, BitModel};
use crate::texel::{AO_MAX, Texel};

/// Maximum number of colours of a palette. Maps with more colours have none.
const MAX_PALETTE: usize = 64;
/// Height of a cell without a column.
const EMPTY: i32 = i32::MIN / 2;

/// Writes or reads all texels. A writer's map also gets the texels that a reader will see.
pub(super) fn code<C: BitCoder>(coder: &mut C, map: &mut BlockMap, facade: &[FacadeStep], steps: QuantisationSteps) {
    let palette = code_palette(coder, map);
    let mut texels = TexelCoder::new(coder, steps, palette);
    let roofs = code_roofs(&mut texels, map);
    code_outer_tops(&mut texels, map, &roofs);
    code_strips(&mut texels, map, facade, &roofs);
}

/// Codes the map's colours, if they are few.
fn code_palette<C: BitCoder>(coder: &mut C, map: &BlockMap) -> Option<Vec<Colour>> {
    let mut list = if C::WRITES { distinct_colours(map) } else { Vec::new() };
    let count = coder.choice(&mut [BitModel::NEW; 127], list.len() as u32) as usize;
    if count > MAX_PALETTE {
        return None;
    }
    list.resize(count, [0; 3]);
    let mut models = [[BitModel::NEW; 255]; 3];
    let mut last = [0u8; 3];
    for rgb in &mut list {
        for k in 0..3 {
            let rise = coder.choice(&mut models[k], u32::from(rgb[k].wrapping_sub(last[k]))) as u8;
            rgb[k] = last[k].wrapping_add(rise);
        }
        last = *rgb;
    }
    Some(list.into_iter().map(from_rgb).collect())
}

/// The visible colours, ascending; any `MAX_PALETTE + 1` of them if there are more than [`MAX_PALETTE`].
fn distinct_colours(map: &BlockMap) -> Vec<[u8; 3]> {
    let roofs = (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0).map(|i| map.roof[i]);
    let strips = map.strips.iter().copied().filter(|t| !t.is_open());
    let outer_tops = map.clips.iter().filter_map(|c| Some(c.outer?.roof));
    let mut list = Vec::new();
    let mut last = None;
    for texel in roofs.chain(strips).chain(outer_tops) {
        let rgb = texel.rgb();
        if last.replace(rgb) != Some(rgb) && !list.contains(&rgb) {
            list.push(rgb);
            if list.len() > MAX_PALETTE {
                break;
            }
        }
    }
    list.sort_unstable();
    list
}

/// Codes all roofs and returns them on the grid with a rim.
fn code_roofs<C: BitCoder>(texels: &mut TexelCoder<'_, C>, map: &mut BlockMap) -> Vec<ReconstructedTexel> {
    let mut roofs = vec![ReconstructedTexel { colour: [128, 0, 0], ao: i16::from(AO_MAX) }; WIDTH * WIDTH];
    let mut heights = vec![EMPTY; WIDTH * WIDTH];
    let mut last = 0;
    let one_row = i32::from(STEPS_PER_CELL >> map.z_shift);
    for i in 0..COLUMNS {
        if map.flags[i] & flag::OCCUPIED == 0 {
            continue;
        }
        let at = rim_index(i);
        let height = i32::from(map.z_max[i]);
        let around = [at - 1, at - WIDTH, at - WIDTH - 1];
        let is_level = |j: usize| (heights[j] - height).abs() <= one_row;
        let mut known = around;
        if !(is_level(at - 1) && is_level(at - WIDTH) && is_level(at - WIDTH - 1)) {
            known = substitutes(&around, &heights, is_level).unwrap_or([last; 3]);
        }
        let known = known.map(|j| roofs[j]);
        let (texel, roof) = texels.code(map.roof[i], &known);
        map.roof[i] = texel;
        roofs[at] = roof;
        heights[at] = height;
        last = at;
    }
    roofs
}

/// Which neighbours stand in for all three: those on the same level, or else all that exist.
fn substitutes(around: &[usize; 3], heights: &[i32], is_level: impl Fn(usize) -> bool) -> Option<[usize; 3]> {
    let mut usable = around.map(is_level);
    if usable == [false; 3] {
        usable = around.map(|j| heights[j] != EMPTY);
    }
    let [a, b, c] = *around;
    match usable {
        [true, true, true] => Some([a, b, c]),
        [true, true, false] => Some([a, b, a]),
        [true, false, _] => Some([a; 3]),
        [false, true, _] => Some([b; 3]),
        [false, false, true] => Some([c; 3]),
        [false, false, false] => None,
    }
}

/// Codes outer tops, each predicted from the neighbouring roof that is nearest in height: probably the same surface.
fn code_outer_tops<C: BitCoder>(texels: &mut TexelCoder<'_, C>, map: &mut BlockMap, roofs: &[ReconstructedTexel]) {
    let columns: Vec<usize> = (0..COLUMNS).filter(|i| map.flags[*i] & flag::CLIPPED != 0).collect();
    let mut clips = std::mem::take(&mut map.clips);
    for (&i, clip) in columns.iter().zip(&mut clips) {
        if let Some(outer) = &mut clip.outer {
            let distance = |j: usize| (i32::from(map.z_max[j]) - i32::from(outer.z)).abs();
            let neighbours = [[1, 0], [0, 1], [-1, 0], [0, -1]].map(|step| neighbour(i, step));
            let is_occupied = |j: &usize| map.flags[*j] & flag::OCCUPIED != 0;
            let nearest =
                neighbours.into_iter().flatten().filter(is_occupied).min_by_key(|j| distance(*j)).unwrap_or(i);
            (outer.roof, _) = texels.code(outer.roof, &[roofs[rim_index(nearest)]; 3]);
        }
    }
    map.clips = clips;
}

/// Where a column's strip lies.
#[derive(Debug, Clone, Copy, Default)]
struct StripPlacement {
    /// Index of the first texel.
    start: usize,
    /// Row of the first texel, in cells above height code 0.
    first_row: i32,
    rows: usize,
}

impl StripPlacement {
    /// The index of the texel in a row, if the strip reaches it.
    fn texel_in(&self, row: i32) -> Option<usize> {
        let at = usize::try_from(row - self.first_row).ok().filter(|at| *at < self.rows)?;
        Some(self.start + at)
    }
}

/// Where all strips lie, by column, and the number of their texels.
fn place_strips(map: &BlockMap) -> (Vec<StripPlacement>, usize) {
    let mut placements = vec![StripPlacement::default(); COLUMNS];
    let mut start = 0;
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::EXPOSED != 0) {
        let (first_row, rows) = strip_rows(map.z_min[i], map.z_max[i], map.z_shift);
        placements[i] = StripPlacement { start, first_row: i32::from(first_row), rows: usize::from(rows) };
        start += usize::from(rows);
    }
    (placements, start)
}

fn code_strips<C: BitCoder>(
    texels: &mut TexelCoder<'_, C>,
    map: &mut BlockMap,
    facade: &[FacadeStep],
    roofs: &[ReconstructedTexel],
) {
    let (placements, count) = place_strips(map);
    map.strips.resize(count, Texel::OPEN);
    let mut coded = vec![ReconstructedTexel::default(); count];
    for step in facade {
        let strip = placements[step.column];
        let predecessor = step.predecessor.map(|j| placements[j]);
        let has_holes = map.flags[step.column] & flag::HOLES != 0;
        let beside_row = |row: i32| predecessor.and_then(|strip| strip.texel_in(row));
        let mut below = None;
        let mut beside_below = beside_row(strip.first_row - 1).map(|at| coded[at]);
        let mut is_open = false;
        for row in 0..strip.rows {
            let beside = beside_row(strip.first_row + row as i32).map(|at| coded[at]);
            let known = match (below, beside) {
                (Some(a), Some(b)) => [a, b, beside_below.unwrap_or(b)],
                (Some(a), None) => [a; 3],
                (None, Some(b)) => [b; 3],
                (None, None) => [roofs[rim_index(step.column)]; 3],
            };
            beside_below = beside;
            let value = map.strips[strip.start + row];
            if has_holes {
                is_open = texels.code_coverage(is_open, value.is_open());
            }
            let (texel, reconstructed) = if is_open { (Texel::OPEN, known[0]) } else { texels.code(value, &known) };
            map.strips[strip.start + row] = texel;
            coded[strip.start + row] = reconstructed;
            below = Some(reconstructed);
        }
    }
}
