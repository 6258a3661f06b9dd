//! Radiances of neighbouring pixels as words, and those as colours. The scalar code is [`tone`](crate::tone).

use super::lanes::{
    F, FastExtremes, I, U, Vec3s, always, float, float_u, lane_numbers, pairs, splat, splat_i, splat_u, to_i, to_u,
    whole,
};
use crate::atmosphere::LUMINANCE;
use crate::cpu::instruction_set::InstructionSet;
use crate::tone::{
    AGX_IN, AGX_OUT, AGX_SATURATION, CODE_STEPS, CURVE_LAST, CURVE_MIN, CURVE_SHIFT, DisplayTable, DisplayTables,
    EXPONENT_BIAS, MANTISSA_BITS, MAX_RADIANCE, METER_BINS, METER_BINS_PER_STOP, METER_EDGES, METER_LEAST,
    METER_MIN_LOG2, MeterCounts, NEUTRAL_DESATURATION, NEUTRAL_START, NOISE, ROLL_OFF,
};
use fearless_simd::Level;
use fearless_simd::prelude::*;
use glam::{Mat3, Vec3};

/// [`encode_radiance`](crate::tone::encode_radiance).
#[inline(always)]
pub(super) fn encode_radiances<S: Simd>(simd: S, rgb: Vec3s<S>) -> U<S> {
    let (zero, most) = (splat(simd, 0.0), splat(simd, MAX_RADIANCE));
    let rgb = rgb.map(
        #[inline(always)]
        |v| v.fast_max(zero).fast_min(most),
    );
    let bits = rgb.x.fast_max(rgb.y).fast_max(rgb.z).bitcast::<U<S>>() + (1 << (22 - MANTISSA_BITS + 1));
    let exponent = (to_i::<S>(bits >> 23) - 127).max(splat_i(simd, -1 - EXPONENT_BIAS));
    let scale = (-exponent + (127 + MANTISSA_BITS as i32 - 1)).bitcast::<U<S>>() << 23;
    let scale: F<S> = scale.bitcast();
    let largest = splat_u(simd, (1 << MANTISSA_BITS) - 1);
    let mantissa = always(
        #[inline(always)]
        |v: F<S>| whole::<S>(v * scale + 0.5).min(largest),
    );
    let exponent = (exponent + (1 + EXPONENT_BIAS)).bitcast::<U<S>>() << 27;
    mantissa(rgb.x) | (mantissa(rgb.y) << 9) | (mantissa(rgb.z) << 18) | exponent
}

/// Colours of pixels from number `first` on, of rows of `width`, with radiances `words`: r, g, b, 255 in sRGB. With the tables stands
/// how much longer a graded picture is exposed. `shades` are factors of the radiances, if there are any.
pub(in crate::cpu) fn develop_pixels(
    set: InstructionSet,
    (width, first): (u32, usize),
    (exposure, tables): (f32, (&DisplayTables, Option<f32>)),
    (words, shades): (&[u32], Option<&[f32]>),
    colours: &mut [u32],
) {
    // Some machines have one instruction set.
    #[allow(unreachable_patterns)]
    match set.level() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx512(simd) => develop_with(simd, (width, first), (exposure, tables), (words, shades), colours),
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx2(simd) => develop_with(simd, (width, first), (exposure, tables), (words, shades), colours),
        #[cfg(target_arch = "aarch64")]
        Level::Neon(simd) => develop_with(simd, (width, first), (exposure, tables), (words, shades), colours),
        #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
        Level::WasmSimd128(simd) => develop_with(simd, (width, first), (exposure, tables), (words, shades), colours),
        // An `InstructionSet` is none of the others.
        _ => {}
    }
}

fn develop_with<S: Simd>(
    simd: S,
    (width, first): (u32, usize),
    (exposure, (tables, graded)): (f32, (&DisplayTables, Option<f32>)),
    (words, shades): (&[u32], Option<&[f32]>),
    colours: &mut [u32],
) {
    let lanes = F::<S>::LEN;
    simd.vectorize(
        #[inline(always)]
        || {
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
                let codes = match graded {
                    Some(longer) => neutral_codes(simd, tables, light, longer),
                    None => codes_of(simd, tables, light),
                };
                let dithered = dithered(simd, codes, at.x, at.y);
                if colours.len() == lanes {
                    dithered.store_slice(colours);
                } else {
                    colours.iter_mut().enumerate().for_each(|(lane, colour)| *colour = dithered[lane]);
                }
                at.x += lanes as u32;
            }
        },
    );
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
    // Some machines have one instruction set.
    #[allow(unreachable_patterns)]
    match set.level() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx512(simd) => count_with(simd, words),
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx2(simd) => count_with(simd, words),
        #[cfg(target_arch = "aarch64")]
        Level::Neon(simd) => count_with(simd, words),
        #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
        Level::WasmSimd128(simd) => count_with(simd, words),
        // An `InstructionSet` is none of the others.
        _ => [0; METER_BINS as usize],
    }
}

/// Neighbouring pixels are mostly of one bin: they are counted apart, so that none waits for the one before.
const COUNTS_APART: usize = 4;

fn count_with<S: Simd>(simd: S, words: &[u32]) -> MeterCounts {
    let mut counts = [[0; METER_BINS as usize]; COUNTS_APART];
    simd.vectorize(
        #[inline(always)]
        || {
            for words in words.chunks(F::<S>::LEN) {
                let bins = meter_bins(simd, decode_radiances::<S>(words_of(simd, words)));
                for lane in 0..words.len() {
                    counts[lane % COUNTS_APART][bins[lane] as usize % METER_BINS as usize] += 1;
                }
            }
        },
    );
    std::array::from_fn(|bin| counts.iter().map(|counts| counts[bin]).sum())
}

/// The bins of radiances.
#[inline(always)]
fn meter_bins<S: Simd>(simd: S, rgb: Vec3s<S>) -> U<S> {
    let luminance = rgb.dot(Vec3s::splat(simd, LUMINANCE)).fast_max(splat(simd, METER_LEAST));
    let bits = luminance.bitcast::<U<S>>();
    let stops = to_i::<S>(bits >> 23) - (127 + METER_MIN_LOG2 as i32);
    let mantissa: F<S> = ((bits & 0x7f_ffff) | 1.0f32.to_bits()).bitcast();
    let (zeros, one) = (splat_i(simd, 0), splat_i(simd, 1));
    let mut bin: I<S> = stops * METER_BINS_PER_STOP as i32;
    for edge in METER_EDGES {
        bin += mantissa.simd_ge(splat(simd, edge)).select(one, zeros);
    }
    to_u::<S>(bin.max(zeros).min(splat_i(simd, METER_BINS as i32 - 1)))
}

#[inline(always)]
fn decode_radiances<S: Simd>(words: U<S>) -> Vec3s<S> {
    let exponent = (words >> 27) + (127 - EXPONENT_BIAS as u32 - MANTISSA_BITS);
    let scale: F<S> = (exponent << 23).bitcast();
    let mantissa = always(
        #[inline(always)]
        |shift: u32| float_u::<S>((words >> shift) & ((1 << MANTISSA_BITS) - 1)) * scale,
    );
    Vec3s::<S> { x: mantissa(0), y: mantissa(9), z: mantissa(18) }
}

/// Codes in sRGB, 0 to 255, of exposed radiances.
#[inline(always)]
fn codes_of<S: Simd>(simd: S, tables: &DisplayTables, rgb: Vec3s<S>) -> Vec3s<S> {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let curve = product(AGX_IN, rgb).map(
        #[inline(always)]
        |v| curve_of(simd, tables, v),
    );
    let grey = curve.x * LUMINANCE.x + curve.y * LUMINANCE.y + curve.z * LUMINANCE.z;
    let saturated = curve.map(
        #[inline(always)]
        |v| ((v - grey) * AGX_SATURATION + grey).fast_max(zero),
    );
    product(AGX_OUT, saturated).map(
        #[inline(always)]
        |v| {
            let place = v.fast_max(zero).fast_min(one) * CODE_STEPS as f32;
            let at = whole::<S>(place);
            between(simd, &tables.codes, at, place - float_u::<S>(at))
        },
    )
}

/// The same of a graded picture.
#[inline(always)]
fn neutral_codes<S: Simd>(simd: S, tables: &DisplayTables, rgb: Vec3s<S>, longer: f32) -> Vec3s<S> {
    let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
    let peak = rgb.x.fast_max(rgb.y).fast_max(rgb.z);
    let bright = peak / (longer * ROLL_OFF);
    let share = (splat(simd, longer - 1.0) / (bright * bright + 1.0) + 1.0) / longer;
    let (rgb, peak) = (rgb.scale(share), peak * share);
    let range = 1.0 - NEUTRAL_START;
    let shown = one - splat(simd, range * range) / (peak + (range - NEUTRAL_START));
    let kept = one / ((peak - shown) * NEUTRAL_DESATURATION + 1.0);
    let (is_bright, share) = (peak.simd_gt(splat(simd, NEUTRAL_START)), shown / peak);
    rgb.map(
        #[inline(always)]
        |v| {
            let v = is_bright.select((v * share - shown) * kept + shown, v);
            let place = v.fast_max(zero).fast_min(one).sqrt() * CODE_STEPS as f32;
            let at = whole::<S>(place);
            between(simd, &tables.root_codes, at, place - float_u::<S>(at))
        },
    )
}

#[inline(always)]
fn product<S: Simd>(matrix: Mat3, v: Vec3s<S>) -> Vec3s<S> {
    let [x, y, z]: [Vec3; 3] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    Vec3s::<S> {
        x: v.x * x.x + v.y * y.x + v.z * z.x,
        y: v.x * x.y + v.y * y.y + v.z * z.y,
        z: v.x * x.z + v.y * y.z + v.z * z.z,
    }
}

#[inline(always)]
fn curve_of<S: Simd>(simd: S, tables: &DisplayTables, v: F<S>) -> F<S> {
    let above = v.fast_max(splat(simd, CURVE_MIN)).bitcast::<U<S>>() - CURVE_MIN.to_bits();
    let part = float_u::<S>(above & ((1 << CURVE_SHIFT) - 1)) / (1 << CURVE_SHIFT) as f32;
    between(simd, &tables.curve, (above >> CURVE_SHIFT).min(splat_u(simd, CURVE_LAST)), part)
}

/// Between the entries `at` and the next ones of a table.
#[inline(always)]
fn between<S: Simd, const PLACES: usize>(simd: S, table: &DisplayTable<PLACES>, at: U<S>, part: F<S>) -> F<S> {
    let [value, step] = pairs(
        simd,
        #[inline(always)]
        |lane| bytemuck::cast(table[at[lane] as usize % PLACES]),
    );
    value.bitcast::<F<S>>() + step.bitcast::<F<S>>() * part
}

/// As the scalar function, of the pixels at `x`, `y`.
#[inline(always)]
fn dithered<S: Simd>(simd: S, codes: Vec3s<S>, x: U<S>, y: U<S>) -> U<S> {
    let part = always(
        #[inline(always)]
        |v: F<S>| v - float::<S>(v.to_int()),
    );
    let noise = part(part(float_u::<S>(x) * NOISE[1] + float_u::<S>(y) * NOISE[2]) * NOISE[0]);
    let most = splat(simd, 255.0);
    let channel = always(
        #[inline(always)]
        |v: F<S>| whole::<S>((v + noise).fast_min(most)),
    );
    channel(codes.x) | (channel(codes.y) << 8) | (channel(codes.z) << 16) | (255 << 24)
}
