//! What columns look like: colours with a chosen loss, occlusion, coverage.
//!
//! In: a [`BitCoder`], a map with its shapes and the [`FacadeStep`]s along its facades. Out: roofs, outer roofs and strips; in the
//! writer's map too they become what a reader will see.
//!
//! Roofs are coded row by row, strips along the facades. A texel is guessed from three that are known: for roofs the western,
//! the southern and the one between; for strips the one below, the same row of the strip before, and the one below that.
//! The guess is LOCO-I's median; what is left is divided by a step and coded.

use super::{
    BlockMap, COLUMNS, STEPS_PER_CELL, flag,
    geometry::{self, WIDTH, median, neighbour, place},
    strip_rows,
    walls::FacadeStep,
};
use crate::{
    codec::range::{BitCoder, BitModel, NumberModel},
    texel::{ALPHA_MAX, AO_MAX, Texel},
};

/// How much may be lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loss {
    /// FacadeStep of the brightness, in quarters; 4 loses nothing.
    pub(super) colour: u16,
    /// FacadeStep of the occlusion; 1 loses nothing.
    pub(super) ao: u8,
}

impl Loss {
    /// Steps of one.
    pub(super) const NONE: Self = Self { colour: QUARTERS as u16, ao: 1 };
}

/// Most that an occlusion may be off where loss is allowed: a guess this near is taken as it is.
const AO_ERROR: i32 = 3;
/// Parts of a colour step of one.
const QUARTERS: i32 = 4;

/// Colours as brightness and two differences (YCoCg-R; Malvar and Sullivan 2003); in few bytes, as they are compared often.
type Colour = [i16; 3];

fn from_rgb(rgb: [u8; 3]) -> Colour {
    let [r, g, b] = rgb.map(i32::from);
    let orange = r - b;
    let t = b + (orange >> 1);
    let green = g - t;
    [t + (green >> 1), orange, green].map(|v| v as i16)
}

fn to_rgb(colour: Colour) -> [u8; 3] {
    let [y, orange, green] = colour.map(i32::from);
    let t = y - (green >> 1);
    let b = t - (orange >> 1);
    [b + orange, green + t, b].map(|v| v.clamp(0, 255) as u8)
}

/// What a texel is guessed from; where only some are known, they stand for the others.
#[derive(Debug, Clone, Copy, Default)]
struct ReconstructedTexel {
    colour: Colour,
    ao: i16,
}

/// Activity classes of a neighbourhood.
const CLASSES: usize = 8;

/// Largest activity that has a class of its own.
const ACTIVITY_MAX: i32 = 1023;

#[derive(Default)]
struct AppearanceModels {
    brightness: [NumberModel; CLASSES],
    /// By activity and by whether anything else of the texel was not as guessed.
    differences: [[NumberModel; 6]; 2],
    ao: [NumberModel; 8],
    alpha: [[BitModel; 3]; 4],
    /// Whether a colour is that of the first and of the second of its three neighbours.
    first: [BitModel; 3],
    second: BitModel,
    index: Vec<BitModel>,
}

struct TexelCoder<'a, C> {
    coder: &'a mut C,
    loss: Loss,
    ao: AoTables,
    models: Box<AppearanceModels>,
    /// Class of a neighbourhood by its activity; empty where there is a palette.
    classes: Vec<u8>,
    palette: Option<Vec<Colour>>,
}

/// Of 256 parts of a step, how many are rounded up: less than half, as what is nearly zero is cheaper as zero.
const ROUND_UP: i32 = 96;
/// Steps of the colour differences over steps of the brightness, in halves: errors of the former are seen less.
const DIFFERENCE_STEPS: i32 = 3;

/// `v` in steps of so many quarters.
fn quantise(v: i32, step: i32) -> i32 {
    let k = if step == QUARTERS { v.abs() } else { (v.abs() * QUARTERS * 256 + step * ROUND_UP) / (step * 256) };
    if v < 0 { -k } else { k }
}

/// Steps of the occlusion, as tables. Levels are the same in all nodes, so that what is equal on either side of a border stays equal.
struct AoTables {
    /// The level of an occlusion, and the occlusion of a level.
    levels: [u8; 64],
    looks: [u8; 64],
    /// Class of a neighbourhood by its activity, at most twice the largest occlusion.
    classes: [u8; 128],
}

impl AoTables {
    fn new(step: u8) -> Self {
        let step = usize::from(step.max(1));
        Self {
            levels: std::array::from_fn(|v| ((v + step / 2) / step) as u8),
            looks: std::array::from_fn(|level| (level * step).min(usize::from(AO_MAX)) as u8),
            classes: std::array::from_fn(|activity| if activity == 0 { 0 } else { 1 + (activity / step).min(6) as u8 }),
        }
    }
}

impl<'a, C: BitCoder> TexelCoder<'a, C> {
    fn new(coder: &'a mut C, loss: Loss, palette: Option<Vec<Colour>>) -> Self {
        let step = u32::from(loss.colour);
        let class = |v: u32| match v * 8 / step {
            0 => 0,
            1..=2 => 1,
            3..=4 => 2,
            5..=7 => 3,
            8..=11 => 4,
            12..=18 => 5,
            19..=30 => 6,
            _ => 7,
        };
        let classes =
            if palette.is_none() { (0..=ACTIVITY_MAX as u32).map(|v| class(v) as u8).collect() } else { Vec::new() };
        let mut models = Box::<AppearanceModels>::default();
        if let Some(palette) = &palette {
            let digits = palette.len().next_power_of_two();
            models.index = vec![BitModel::default(); digits - 1];
        }
        Self { coder, loss, ao: AoTables::new(loss.ao), models, classes, palette }
    }

    /// One texel from the three that it is guessed from.
    #[inline]
    fn texel(&mut self, value: Texel, known: &[ReconstructedTexel; 3]) -> (Texel, ReconstructedTexel) {
        let colour = self.colour(value, known);
        let ao = self.ao(i32::from(value.ao()), known.map(|k| i32::from(k.ao)));
        (Texel::new(to_rgb(colour), ao as u8, ALPHA_MAX), ReconstructedTexel { colour, ao })
    }

    fn ao(&mut self, value: i32, [a, b, c]: [i32; 3]) -> i16 {
        let activity = (a - c).abs() + (b - c).abs();
        let class = usize::from(self.ao.classes[activity as usize & 127]);
        let look = |level: i32| i32::from(self.ao.looks[level.clamp(0, i32::from(AO_MAX)) as usize]);
        let level = |ao: i32| i32::from(self.ao.levels[ao as usize & 63]);
        let guess = level(median(a, b, c));
        let tolerance = if self.loss.ao == 1 { 0 } else { AO_ERROR };
        let k = match C::WRITES {
            true if (value - look(guess)).abs() > tolerance => level(value) - guess,
            _ => 0,
        };
        let k = self.coder.number(&mut self.models.ao[class], k);
        i16::from(self.ao.looks[(guess + k).clamp(0, i32::from(AO_MAX)) as usize])
    }

    fn colour(&mut self, value: Texel, known: &[ReconstructedTexel; 3]) -> Colour {
        if self.palette.is_some() {
            return self.indexed(value, known);
        }
        let target = if C::WRITES { from_rgb(value.rgb()).map(i32::from) } else { [0; 3] };
        let [a, b, c] = known.map(|k| k.colour.map(i32::from));
        let step = i32::from(self.loss.colour);
        let guess = median(a[0], b[0], c[0]);
        let activity = (a[0] - c[0]).abs() + (b[0] - c[0]).abs();
        let class = usize::from(self.classes[activity.min(ACTIVITY_MAX) as usize]);
        let k = if C::WRITES { quantise(target[0] - guess, step) } else { 0 };
        let k = self.coder.number(&mut self.models.brightness[class], k);
        let mut out = [(guess + ((k * step) / QUARTERS)).clamp(0, 255), 0, 0];
        let step = if step == QUARTERS { step } else { step * DIFFERENCE_STEPS / 2 };
        let mut context = usize::from(k != 0);
        for n in 1..3 {
            let guess = median(a[n], b[n], c[n]);
            let activity = ((a[n] - c[n]).abs() + (b[n] - c[n]).abs()) * QUARTERS;
            let class = usize::from(activity * 2 >= step) + usize::from(activity >= step * 2);
            let k = if C::WRITES { quantise(target[n] - guess, step) } else { 0 };
            let k = self.coder.number(&mut self.models.differences[n - 1][class * 2 + context], k);
            context |= usize::from(k != 0);
            out[n] = (guess + ((k * step) / QUARTERS)).clamp(-255, 255);
        }
        out.map(|v| v as i16)
    }

    fn indexed(&mut self, value: Texel, known: &[ReconstructedTexel; 3]) -> Colour {
        let palette = self.palette.as_deref().unwrap_or_default();
        if let [one] = palette {
            return *one;
        }
        let target = if C::WRITES { from_rgb(value.rgb()) } else { [0; 3] };
        let [a, b, c] = known.map(|k| k.colour);
        let context = usize::from(a == b) + usize::from(b == c);
        if self.coder.bit(&mut self.models.first[context], target == a) {
            return a;
        }
        if a != b && self.coder.bit(&mut self.models.second, target == b) {
            return b;
        }
        let at = palette.iter().position(|colour| *colour == target).unwrap_or(0);
        let at = self.coder.choice(&mut self.models.index, at as u32) as usize;
        palette.get(at).copied().unwrap_or(a)
    }
}

/// Most colours that are named by number: a node with more is a picture.
const PALETTE: usize = 64;

/// Writes or reads all looks.
pub(super) fn code<C: BitCoder>(coder: &mut C, map: &mut BlockMap, steps: &[FacadeStep], loss: Loss) {
    let palette = palette(coder, map);
    let mut texels = TexelCoder::new(coder, loss, palette);
    let roofs = roofs(&mut texels, map);
    outers(&mut texels, map, &roofs);
    strips(&mut texels, map, steps, &roofs);
}

/// The node's colours, if they are few.
fn palette<C: BitCoder>(coder: &mut C, map: &BlockMap) -> Option<Vec<Colour>> {
    let mut list = if C::WRITES { colours(map) } else { Vec::new() };
    let count = coder.choice(&mut [BitModel::NEW; 127], list.len() as u32) as usize;
    if count > PALETTE {
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

/// The colours that are seen, in their order as numbers; one more than [`PALETTE`] stands for any number.
fn colours(map: &BlockMap) -> Vec<[u8; 3]> {
    let roofs = (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0).map(|i| map.roof[i]);
    let strips = map.strips.iter().copied().filter(|t| t.alpha() != 0);
    let outers = map.clips.iter().filter_map(|c| Some(c.outer?.roof));
    let mut list = Vec::new();
    let mut last = None;
    for texel in roofs.chain(strips).chain(outers) {
        let rgb = texel.rgb();
        if last.replace(rgb) != Some(rgb) && !list.contains(&rgb) {
            list.push(rgb);
            if list.len() > PALETTE {
                break;
            }
        }
    }
    list.sort_unstable();
    list
}

/// Height of a cell without a column.
const NOTHING: i32 = i32::MIN / 2;

fn roofs<C: BitCoder>(texels: &mut TexelCoder<'_, C>, map: &mut BlockMap) -> Vec<ReconstructedTexel> {
    let mut looks = vec![ReconstructedTexel { colour: [128, 0, 0], ao: i16::from(AO_MAX) }; WIDTH * WIDTH];
    let mut heights = vec![NOTHING; WIDTH * WIDTH];
    let mut last = 0;
    let near = i32::from(STEPS_PER_CELL >> map.z_shift);
    for i in 0..COLUMNS {
        if map.flags[i] & flag::OCCUPIED == 0 {
            continue;
        }
        let at = place(i);
        let own = i32::from(map.z_max[i]);
        let around = [at - 1, at - WIDTH, at - WIDTH - 1];
        let level = |j: usize| (heights[j] - own).abs() <= near;
        let mut known = around;
        if !(level(at - 1) && level(at - WIDTH) && level(at - WIDTH - 1)) {
            known = standing(&around, &heights, level).unwrap_or([last; 3]);
        }
        let known = known.map(|j| looks[j]);
        let (texel, look) = texels.texel(map.roof[i], &known);
        map.roof[i] = texel;
        looks[at] = look;
        heights[at] = own;
        last = at;
    }
    looks
}

/// Which of the neighbours stand for all three: those on the same level, else all that there are.
fn standing(around: &[usize; 3], heights: &[i32], level: impl Fn(usize) -> bool) -> Option<[usize; 3]> {
    let mut stands = around.map(level);
    if stands == [false; 3] {
        stands = around.map(|j| heights[j] != NOTHING);
    }
    let [a, b, c] = *around;
    match stands {
        [true, true, true] => Some([a, b, c]),
        [true, true, false] => Some([a, b, a]),
        [true, false, _] => Some([a; 3]),
        [false, true, _] => Some([b; 3]),
        [false, false, true] => Some([c; 3]),
        [false, false, false] => None,
    }
}

fn outers<C: BitCoder>(texels: &mut TexelCoder<'_, C>, map: &mut BlockMap, roofs: &[ReconstructedTexel]) {
    let columns: Vec<usize> = (0..COLUMNS).filter(|i| map.flags[*i] & flag::CLIPPED != 0).collect();
    let mut clips = std::mem::take(&mut map.clips);
    for (&i, clip) in columns.iter().zip(&mut clips) {
        if let Some(outer) = &mut clip.outer {
            // The neighbour whose top is nearest in height shows most likely the same surface.
            let near = |j: usize| (i32::from(map.z_max[j]) - i32::from(outer.z)).abs();
            let beside = [(1, 0), (0, 1), (-1, 0), (0, -1)].map(|step| neighbour(i, step));
            let occupied = |j: &usize| map.flags[*j] & flag::OCCUPIED != 0;
            let best = beside.into_iter().flatten().filter(occupied).min_by_key(|j| near(*j)).unwrap_or(i);
            let (texel, _) = texels.texel(outer.roof, &[roofs[place(best)]; 3]);
            outer.roof = texel;
        }
    }
    map.clips = clips;
}

/// Where a column's strip lies, and its first row.
#[derive(Debug, Clone, Copy, Default)]
struct StripPlacement {
    start: usize,
    first: i32,
    rows: usize,
}

fn strips<C: BitCoder>(
    texels: &mut TexelCoder<'_, C>,
    map: &mut BlockMap,
    steps: &[FacadeStep],
    roofs: &[ReconstructedTexel],
) {
    let mut places = vec![StripPlacement::default(); COLUMNS];
    let mut start = 0;
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::EXPOSED != 0) {
        let (first, rows) = strip_rows(map.z_min[i], map.z_max[i], map.z_shift);
        places[i] = StripPlacement { start, first: i32::from(first), rows: usize::from(rows) };
        start += usize::from(rows);
    }
    map.strips.resize(start, Texel::TRANSPARENT);
    let mut looks = vec![ReconstructedTexel::default(); start];
    for step in steps {
        let place = places[step.column];
        let before = step.before.map(|j| places[j]);
        let holes = map.flags[step.column] & flag::HOLES != 0;
        // Of the strip before, what stands beside the row below.
        let (mut below, mut beside_below) = (None, None);
        if let Some(before) = before {
            let at = place.first - 1 - before.first;
            beside_below = usize::try_from(at).ok().filter(|at| *at < before.rows).map(|at| looks[before.start + at]);
        }
        let mut alpha = ALPHA_MAX;
        for row in 0..place.rows {
            let beside = before.and_then(|before| {
                let at = (place.first - before.first) as isize + row as isize;
                ((at as usize) < before.rows).then(|| looks[before.start + at as usize])
            });
            let known = match (below, beside) {
                (Some(a), Some(b)) => [a, b, beside_below.unwrap_or(b)],
                (Some(a), None) => [a; 3],
                (None, Some(b)) => [b; 3],
                (None, None) => [roofs[geometry::place(step.column)]; 3],
            };
            beside_below = beside;
            let value = map.strips[place.start + row];
            if holes {
                alpha =
                    texels.coder.choice(&mut texels.models.alpha[usize::from(alpha)], u32::from(value.alpha())) as u8;
            }
            let (texel, look) = if alpha == 0 {
                (Texel::TRANSPARENT, known[0])
            } else {
                let (texel, look) = texels.texel(value, &known);
                (Texel::new(texel.rgb(), texel.ao(), alpha), look)
            };
            map.strips[place.start + row] = texel;
            looks[place.start + row] = look;
            below = Some(look);
        }
    }
}
