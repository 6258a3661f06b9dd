//! Words of neighbouring pixels as colours, and the meter's counts of them. The scalar code is [`tone`](crate::tone).

use super::lanes::{F, U, lane_numbers, once, splat, splat_u};
use crate::cpu::instruction_set::InstructionSet;
use crate::tone::{DisplayTables, METER_BINS, MeterCounts, decode_radiances, dithered, meter_bins};
use fearless_simd::prelude::*;

/// Colours of pixels from number `first` on, of rows of `width`, with radiances `words`: r, g, b, 255 in sRGB. With the tables stands
/// how much longer a graded picture is exposed. `shades` are factors of the radiances, if there are any.
pub(in crate::cpu) fn develop_pixels(
    set: InstructionSet,
    (width, first): (u32, usize),
    (exposure, tables): (f32, (&DisplayTables, Option<f32>)),
    (words, shades): (&[u32], Option<&[f32]>),
    colours: &mut [u32],
) {
    with_lanes!(set, |simd| develop_with(simd, (width, first), (exposure, tables), (words, shades), colours), ());
}

fn develop_with<S: Simd>(
    simd: S,
    (width, first): (u32, usize),
    (exposure, (tables, graded)): (f32, (&DisplayTables, Option<f32>)),
    (words, shades): (&[u32], Option<&[f32]>),
    colours: &mut [u32],
) {
    let lanes = F::<S>::LEN;
    simd.vectorize(once!(|| {
        let (first_x, first_y) = (first as u32 % width, first as u32 / width);
        let mut at = PixelPlaces { simd, width, x: lane_numbers(simd) + first_x, y: splat_u(simd, first_y) };
        for (chunk, (words, colours)) in words.chunks(lanes).zip(colours.chunks_mut(lanes)).enumerate() {
            at.wrap();
            let radiances = decode_radiances::<S>(words_of(simd, words));
            let mut factor = splat(simd, exposure);
            if let Some(shades) = shades.and_then(|shades| shades.get(chunk * lanes..)?.get(..words.len())) {
                factor *= words_of(simd, bytemuck::cast_slice(shades)).bitcast::<F<S>>();
            }
            let light = radiances.scale(factor);
            let dithered = dithered(tables.codes(simd, light, graded), at.x, at.y);
            if colours.len() == lanes {
                dithered.store_slice(colours);
            } else {
                colours.iter_mut().enumerate().for_each(|(lane, colour)| *colour = dithered[lane]);
            }
            at.x += lanes as u32;
        }
    }));
}

/// Columns and rows of neighbouring pixels, which may be of several rows.
struct PixelPlaces<S: Simd> {
    simd: S,
    width: u32,
    x: U<S>,
    y: U<S>,
}

impl<S: Simd> PixelPlaces<S> {
    /// Moves pixels beyond the end of a row to the next ones.
    #[inline(always)]
    fn wrap(&mut self) {
        let (width, zeros, one) = (splat_u(self.simd, self.width), splat_u(self.simd, 0), splat_u(self.simd, 1));
        loop {
            let beyond = self.x.simd_ge(width);
            if beyond.all_false() {
                return;
            }
            self.x -= beyond.select(width, zeros);
            self.y += beyond.select(one, zeros);
        }
    }
}

/// As many words as there are lanes; 0 in the others.
#[inline(always)]
fn words_of<S: Simd>(simd: S, words: &[u32]) -> U<S> {
    if words.len() == F::<S>::LEN {
        return U::<S>::from_slice(simd, words);
    }
    let mut all = splat_u(simd, 0);
    for (lane, word) in words.iter().enumerate() {
        all[lane] = *word;
    }
    all
}

/// Numbers of radiances in the meter's bins. The scalar code is `meter_bin`.
pub(in crate::cpu) fn count_radiances(set: InstructionSet, words: &[u32]) -> MeterCounts {
    with_lanes!(set, |simd| count_with(simd, words), [0; METER_BINS as usize])
}

/// Neighbouring pixels are mostly of one bin: they are counted apart, so that none waits for the one before.
const COUNTS_APART: usize = 4;

fn count_with<S: Simd>(simd: S, words: &[u32]) -> MeterCounts {
    let mut counts = [[0; METER_BINS as usize]; COUNTS_APART];
    simd.vectorize(once!(|| {
        for words in words.chunks(F::<S>::LEN) {
            let bins = meter_bins(simd, decode_radiances::<S>(words_of(simd, words)));
            for lane in 0..words.len() {
                counts[lane % COUNTS_APART][bins[lane] as usize % METER_BINS as usize] += 1;
            }
        }
    }));
    std::array::from_fn(|bin| counts.iter().map(|counts| counts[bin]).sum())
}
