//! From radiance to the screen: storage of a pixel's radiance, exposure by the frame's mean, tone curve, dithering. GPU twin:
//! `wgsl/shared/tone.wgsl` and `wgsl/meter.wgsl`.

use crate::atmosphere::LUMINANCE;
use crate::compose::shades;
use crate::lanes::{F, LaneFloats, LaneInts, LaneMask, LaneWords, Lanes, OneLane, U, Vec3s, always};
use crate::layout::{FrameUniform, METER_READS, METER_THREADS, NO_NODE, Shading};
use crate::parallel::*;
use crate::srgb::{encode_srgb, encoded};
use glam::{Mat3, Vec3};
use std::sync::LazyLock;

/// Bits of a component's mantissa in a stored radiance, and the bias of the common exponent.
pub(crate) const MANTISSA_BITS: u32 = 9;
pub(crate) const EXPONENT_BIAS: i32 = 15;
pub(crate) const MAX_RADIANCE: f32 = 65_000.0;
/// Bins of the meter, per power of two, and the log2 of the lowest one.
pub(crate) const METER_BINS: u32 = 128;
pub(crate) const METER_BINS_PER_STOP: f32 = 6.0;
pub(crate) const METER_MIN_LOG2: f32 = -13.0;
/// Darkest and brightest share of the pixels whose light counts as that of the next ones: the sun's disc and black corners.
pub(crate) const METER_CUT: f32 = 0.01;
/// Light between these exponents of two is displayed (AgX).
pub(crate) const AGX_MIN_LOG2: f32 = -12.473_93;
pub(crate) const AGX_LOG2_RANGE: f32 = 16.5;
/// Contrast and saturation of the display.
pub(crate) const AGX_POWER: f32 = 1.2;
pub(crate) const AGX_SATURATION: f32 = 1.2;
/// AgX's primaries, columns, and their inverse (Sobotka; matrix and polynomial as approximated by Wrensch, "Minimal AgX
/// Implementation", 2023).
pub(crate) const AGX_IN: Mat3 = Mat3::from_cols(
    Vec3::new(0.842_479_06, 0.042_328_242, 0.042_375_655),
    Vec3::new(0.078_433_6, 0.878_468_64, 0.078_433_6),
    Vec3::new(0.079_223_745, 0.079_166_13, 0.879_143),
);
pub(crate) const AGX_OUT: Mat3 = Mat3::from_cols(
    Vec3::new(1.196_879, -0.052_896_85, -0.052_971_64),
    Vec3::new(-0.098_020_88, 1.151_903_1, -0.098_043_45),
    Vec3::new(-0.099_029_74, -0.098_961_17, 1.151_073_7),
);
/// Value of [`neutral`]'s input, without the longer exposure, at which half of that is left.
pub(crate) const ROLL_OFF: f32 = 0.5;
/// Where its shoulder begins, and how fast it takes the colour away.
pub(crate) const NEUTRAL_START: f32 = 0.76;
pub(crate) const NEUTRAL_DESATURATION: f32 = 0.15;
/// Exponent from AgX's output to linear light.
pub(crate) const AGX_GAMMA: f32 = 2.2;

/// A radiance in 32 bits: nine for each component and five for a common exponent, as in the texture format RGB9E5. Negative
/// values become 0.
pub fn encode_radiance(rgb: Vec3) -> u32 {
    encode_radiances(rgb.into())
}

/// The same of each ray.
#[inline(always)]
pub(crate) fn encode_radiances<S: Lanes>(rgb: Vec3s<S>) -> U<S> {
    let rgb = rgb.clamped(0.0, MAX_RADIANCE);
    // Half of the last bit, so that the largest component is not rounded up beyond its bits.
    let bits = rgb.max_element().to_bits() + (1 << (22 - MANTISSA_BITS + 1));
    let exponent = ((bits >> 23).to_ints() - 127).at_least(-1 - EXPONENT_BIAS);
    let scale = ((-exponent + (127 + MANTISSA_BITS as i32 - 1)).to_words() << 23).bits_to_floats();
    let mantissa = always!(|v: F<S>| (v * scale + 0.5).whole().at_most((1 << MANTISSA_BITS) - 1));
    let exponent = (exponent + (1 + EXPONENT_BIAS)).to_words() << 27;
    mantissa(rgb.x) | (mantissa(rgb.y) << 9) | (mantissa(rgb.z) << 18) | exponent
}

/// The radiance in such a word.
pub fn decode_radiance(word: u32) -> Vec3 {
    decode_radiances::<OneLane>(word).into()
}

/// The same of each ray.
#[inline(always)]
pub(crate) fn decode_radiances<S: Lanes>(word: U<S>) -> Vec3s<S> {
    let scale = (((word >> 27) + (127 - EXPONENT_BIAS as u32 - MANTISSA_BITS)) << 23).bits_to_floats();
    let mantissa = always!(|shift: u32| ((word >> shift) & ((1 << MANTISSA_BITS) - 1)).to_floats());
    Vec3s::new(mantissa(0), mantissa(9), mantissa(18)).scale(scale)
}

/// Colours of a frame's pixels: r, g, b, 255 in sRGB. `words` are radiances if the frame is [`Shading::Lit`], else colours; `hits` are
/// the nodes that the pixels show. Lines and shade need the `distances`, as many as pixels.
pub fn develop(frame: &FrameUniform, words: &[u32], hits: &[u32], distances: &[f32]) -> Vec<u32> {
    if frame.shading != Shading::Lit as u32 {
        return words.to_vec();
    }
    let (exposure, width) = (exposure(frame, words, hits), (frame.width_px as usize).max(1));
    let is_graded = frame.light.grade[0] > 0.0;
    let (tables, longer) = (DisplayTables::get(), longer(frame, exposure));
    let shades = shades(frame, distances);
    let develop = |(i, word): (usize, &u32)| {
        let shade = shades.as_ref().and_then(|shades| shades.get(i)).copied().unwrap_or(1.0);
        let light = decode_radiances::<OneLane>(*word) * (exposure * shade);
        let graded = is_graded.then_some(longer);
        dithered(tables.codes(OneLane, light, graded), (i % width) as u32, (i / width) as u32)
    };
    words.par_iter().enumerate().map(develop).collect()
}

/// How much longer than for sunlit plaster a graded frame with this exposure was exposed: 1 with an exposure of its own.
pub(crate) fn longer(frame: &FrameUniform, exposure: f32) -> f32 {
    if frame.exposure > 0.0 { 1.0 } else { exposure / frame.light.grade[0] }
}

/// Number of a frame's pixels in each of the meter's bins.
pub(crate) type MeterCounts = [u32; METER_BINS as usize];

/// Factor from radiance to display: the frame's own, or by the mean logarithm of its pixels' luminance. Graded frames are metered
/// by the pixels that show the city.
pub fn exposure(frame: &FrameUniform, words: &[u32], hits: &[u32]) -> f32 {
    exposure_with(frame, words, hits, |words| {
        let mut bins = [0; METER_BINS as usize];
        for word in words {
            bins[meter_bin(decode_radiance(*word))] += 1;
        }
        bins
    })
}

/// The same with another way to count.
pub(crate) fn exposure_with(
    frame: &FrameUniform,
    words: &[u32],
    hits: &[u32],
    count: impl Fn(&[u32]) -> MeterCounts + Sync + Send,
) -> f32 {
    if frame.exposure > 0.0 {
        return frame.exposure;
    }
    let [white, usual, power, longest] = frame.light.grade;
    if white <= 0.0 {
        let add = |a: MeterCounts, b: MeterCounts| std::array::from_fn(|i| a[i] + b[i]);
        let chunks: Vec<MeterCounts> = words.par_chunks(METER_PIXELS).map(count).collect();
        let bins = chunks.into_iter().fold([0; METER_BINS as usize], add);
        return frame.light.key / mean_of(&bins).exp2();
    }
    // An even choice, as on the GPU.
    let reads = words.len().min((METER_THREADS * METER_READS) as usize);
    let mut bins = [0; METER_BINS as usize];
    // In 64 bits: the product of a large frame's numbers does not fit a page's 32.
    for at in (0..reads as u64).map(|i| (i * words.len() as u64 / reads as u64) as usize) {
        if hits.get(at).is_some_and(|hit| *hit != NO_NODE) {
            bins[meter_bin(decode_radiance(words[at]))] += 1;
        }
    }
    let mean = if bins.iter().all(|count| *count == 0) { usual } else { mean_of(&bins) };
    white * ((usual - mean) * power).clamp(0.0, longest).exp2()
}

/// Pixels that a thread meters at once.
const METER_PIXELS: usize = 1 << 13;
/// Mantissas at which the bins of a power of two begin, without the first.
pub(crate) const METER_EDGES: [f32; 5] = [1.122_462, 1.259_921, std::f32::consts::SQRT_2, 1.587_401, 1.781_797_4];

/// Least luminance that the meter tells from darkness.
pub(crate) const METER_LEAST: f32 = 1e-6;

/// The bin of a radiance's logarithm: by exponent and mantissa, because logarithms would take longer than drawing the sky.
fn meter_bin(rgb: Vec3) -> usize {
    meter_bins(OneLane, rgb.into()) as usize
}

/// The same of each ray.
#[inline(always)]
pub(crate) fn meter_bins<S: Lanes>(simd: S, rgb: Vec3s<S>) -> U<S> {
    let luminance = rgb.dot(Vec3s::splat(simd, LUMINANCE)).at_least(METER_LEAST);
    let bits = luminance.to_bits();
    let stops = (bits >> 23).to_ints() - (127 + METER_MIN_LOG2 as i32);
    let mantissa = ((bits & 0x7f_ffff) | 1.0f32.to_bits()).bits_to_floats();
    let mut bin = stops * METER_BINS_PER_STOP as i32;
    for edge in METER_EDGES {
        bin = bin + mantissa.below(edge).select_i(simd.splat_i(0), simd.splat_i(1));
    }
    bin.at_least(0).at_most(METER_BINS as i32 - 1).to_words()
}

/// Mean log2 of the luminances in the meter's bins.
fn mean_of(bins: &MeterCounts) -> f32 {
    let total: u32 = bins.iter().sum();
    let cut = (total as f32 * METER_CUT) as u32;
    let (mut passed, mut low, mut high) = (0, 0, 0);
    for (i, count) in bins.iter().enumerate() {
        if passed <= cut {
            low = i;
        }
        if passed < total - cut {
            high = i;
        }
        passed += count;
    }
    let sum: f32 = bins.iter().enumerate().map(|(i, count)| i.clamp(low, high.max(low)) as f32 * *count as f32).sum();
    METER_MIN_LOG2 + (sum / total.max(1) as f32 + 0.5) / METER_BINS_PER_STOP
}

/// AgX: bright colours lose saturation as on film, and keep their hue. Its functions of one value are read from tables, because
/// powers would take a tenth of a frame's time. An entry is a value and the step to the next one.
pub(crate) struct DisplayTables {
    /// AgX's curve by the value's exponent and the upper [`CURVE_MANTISSA_BITS`] of its mantissa, up to [`CURVE_LAST`].
    pub(crate) curve: DisplayTable<CURVE_PLACES>,
    /// Code in sRGB, 0 to 255, by AgX's output from 0 to 1, up to [`CODE_STEPS`].
    pub(crate) codes: DisplayTable<CODE_PLACES>,
    /// Code in sRGB, 0 to 255, by the root of linear light from 0 to 1, up to [`CODE_STEPS`].
    pub(crate) root_codes: DisplayTable<CODE_PLACES>,
}

/// A table whose length is a power of two, so that places in it need no test.
pub(crate) type DisplayTable<const PLACES: usize> = [[f32; 2]; PLACES];

/// Bits of the mantissa that address the curve: straight lines between the entries differ by 5e-6 at most.
const CURVE_MANTISSA_BITS: u32 = 8;
pub(crate) const CURVE_SHIFT: u32 = 23 - CURVE_MANTISSA_BITS;
/// Smallest value of the curve's table, where the curve is still flat: 2^-13.
pub(crate) const CURVE_MIN: f32 = 1.0 / 8192.0;
/// Powers of two that the curve's table covers.
const CURVE_STOPS: u32 = 18;
/// The last entry of the curve's table.
pub(crate) const CURVE_LAST: u32 = (CURVE_STOPS << CURVE_MANTISSA_BITS) - 1;
const CURVE_PLACES: usize = (CURVE_LAST as usize + 1).next_power_of_two();
/// Steps of the table of codes.
pub(crate) const CODE_STEPS: usize = 2048;
const CODE_PLACES: usize = (CODE_STEPS + 1).next_power_of_two();

impl DisplayTables {
    pub(crate) fn get() -> &'static Self {
        static DISPLAY: LazyLock<DisplayTables> = LazyLock::new(DisplayTables::new);
        &DISPLAY
    }

    fn new() -> Self {
        let curve = |i: usize| agx_curve(f32::from_bits(CURVE_MIN.to_bits() + ((i as u32) << CURVE_SHIFT)));
        let code = |i: usize, gamma: f32| encoded((i as f32 / CODE_STEPS as f32).powf(gamma)) * 255.0;
        Self {
            curve: table_of(CURVE_LAST as usize, curve),
            codes: table_of(CODE_STEPS, |i| code(i, AGX_GAMMA)),
            root_codes: table_of(CODE_STEPS, |i| code(i, 2.0)),
        }
    }

    /// Codes in sRGB, 0 to 255, of exposed radiances. `graded` is how much longer a graded picture is exposed.
    #[inline(always)]
    pub(crate) fn codes<S: Lanes>(&self, simd: S, rgb: Vec3s<S>, graded: Option<f32>) -> Vec3s<S> {
        if let Some(longer) = graded {
            return neutral(simd, rgb, longer).map(always!(|v: F<S>| code_at(
                simd,
                &self.root_codes,
                v.clamped(0.0, 1.0).sqrt()
            )));
        }
        let curve = rgb.transformed(&AGX_IN).map(always!(|v: F<S>| self.curve(simd, v)));
        let grey = curve.dot(Vec3s::splat(simd, LUMINANCE));
        let saturated = curve.map(always!(|v: F<S>| ((v - grey) * AGX_SATURATION + grey).at_least(0.0)));
        saturated.transformed(&AGX_OUT).map(always!(|v: F<S>| code_at(simd, &self.codes, v.clamped(0.0, 1.0))))
    }

    #[inline(always)]
    fn curve<S: Lanes>(&self, simd: S, v: F<S>) -> F<S> {
        let above = v.at_least(CURVE_MIN).to_bits() - CURVE_MIN.to_bits();
        let part = (above & ((1 << CURVE_SHIFT) - 1)).to_floats() / (1 << CURVE_SHIFT) as f32;
        between(simd, &self.curve, (above >> CURVE_SHIFT).at_most(CURVE_LAST), part)
    }
}

/// The code at places from 0 to 1 in a table.
#[inline(always)]
fn code_at<S: Lanes>(simd: S, table: &DisplayTable<CODE_PLACES>, v: F<S>) -> F<S> {
    let place = v * CODE_STEPS as f32;
    between(simd, table, place.whole(), fraction::<S>(place))
}

/// Between the entries `at` and the next ones of a table.
#[inline(always)]
fn between<S: Lanes, const PLACES: usize>(simd: S, table: &DisplayTable<PLACES>, at: U<S>, part: F<S>) -> F<S> {
    let [value, step] = simd.pairs(always!(|lane: usize| bytemuck::cast(table[at.lane(lane) as usize % PLACES])));
    value.bits_to_floats() + step.bits_to_floats() * part
}

/// The table of a function of whole numbers up to `last`.
fn table_of<const PLACES: usize>(last: usize, value: impl Fn(usize) -> f32) -> DisplayTable<PLACES> {
    std::array::from_fn(|i| if i > last { [0.0; 2] } else { [value(i), value(i + 1) - value(i)] })
}

/// The tone curve of graded pictures: linear up to [`NEUTRAL_START`], then a shoulder, on which colours turn white. (Khronos PBR Neutral
/// Tone Mapper, 2024, without its offset for dark colours, which would grey them.) What a `longer` exposure adds fades towards bright
/// places, so that the sky above a street in shade does not burn out.
#[inline(always)]
fn neutral<S: Lanes>(simd: S, rgb: Vec3s<S>, longer: f32) -> Vec3s<S> {
    let peak = rgb.max_element();
    let bright = peak / (longer * ROLL_OFF);
    let share = (simd.splat(longer - 1.0) / (bright * bright + 1.0) + 1.0) / longer;
    let (rgb, peak) = (rgb.scale(share), peak * share);
    let range = 1.0 - NEUTRAL_START;
    let shown = (simd.splat(range * range) / (peak + range - NEUTRAL_START)).rest();
    let kept = simd.splat(1.0) / ((peak - shown) * NEUTRAL_DESATURATION + 1.0);
    let (is_bright, share) = (peak.above(NEUTRAL_START), shown / peak);
    rgb.map(always!(|v: F<S>| is_bright.select((v * share - shown) * kept + shown, v)))
}

/// Colour, r, g, b, 255 in sRGB, of an exposed radiance in a graded picture.
pub fn graded_colour(exposed: Vec3) -> u32 {
    encode_srgb(neutral(OneLane, exposed.into(), 1.0).into())
}

/// AgX's curve with the contrast of [`AGX_POWER`]: Wrensch's polynomial in the logarithm.
fn agx_curve(v: f32) -> f32 {
    let x = ((v.max(1e-10).log2() - AGX_MIN_LOG2) / AGX_LOG2_RANGE).clamp(0.0, 1.0);
    let contrast = (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.002_32;
    contrast.max(0.0).powf(AGX_POWER)
}

/// A pixel in sRGB, rounded up or down by a pattern that has no visible structure, so that skies have no bands.
#[inline(always)]
pub(crate) fn dithered<S: Lanes>(codes: Vec3s<S>, x: U<S>, y: U<S>) -> U<S> {
    let noise = gradient_noises::<S>(x, y);
    let channel = always!(|v: F<S>| (v + noise).at_most(255.0).whole());
    channel(codes.x) | (channel(codes.y) << 8) | (channel(codes.z) << 16) | (255 << 24)
}

/// From 0 to 1, as different as possible in pixels next to each other (Jimenez, "Next Generation Post Processing in Call of
/// Duty", 2014: interleaved gradient noise).
pub(crate) fn gradient_noise(x: u32, y: u32) -> f32 {
    gradient_noises::<OneLane>(x, y)
}

#[inline(always)]
fn gradient_noises<S: Lanes>(x: U<S>, y: U<S>) -> F<S> {
    let [scale, across, down] = NOISE;
    fraction::<S>(fraction::<S>(x.to_floats() * across + y.to_floats() * down) * scale)
}

/// What is beyond the whole parts, of values in the range of `i32`.
#[inline(always)]
fn fraction<S: Lanes>(v: F<S>) -> F<S> {
    v - v.to_ints().to_floats()
}

/// Factors of [`gradient_noise`].
pub(crate) const NOISE: [f32; 3] = [52.982_918, 0.067_110_56, 0.005_837_15];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Light;
    use bytemuck::Zeroable;

    #[test]
    fn radiances_are_stored_with_nine_bits() {
        for exponent in -13..15 {
            for factor in [1.0, 1.37, 1.9999, 1.996, 1.5] {
                let v = factor * 2f32.powi(exponent);
                let rgb = decode_radiance(encode_radiance(Vec3::new(v, v * 0.5, 0.0)));
                assert!((rgb.x / v - 1.0).abs() < 1.0 / 400.0 && (rgb.y / v - 0.5).abs() < 1.0 / 400.0, "{v}: {rgb}");
                assert_eq!(rgb.z, 0.0);
            }
        }
        assert_eq!(decode_radiance(encode_radiance(Vec3::new(-1.0, 0.0, 0.0))), Vec3::ZERO);
        assert!((decode_radiance(encode_radiance(Vec3::splat(1e9))).x / MAX_RADIANCE - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_tone_curve_keeps_order_and_greys() {
        let tables = DisplayTables::new();
        let codes = |rgb: Vec3| Vec3::from(tables.codes(OneLane, rgb.into(), None));
        let grey = |stops: f32| codes(Vec3::splat(stops.exp2()));
        let greys: Vec<Vec3> = (-20..60).map(|i| grey(i as f32 / 6.0)).collect();
        assert!(greys.windows(2).all(|pair| pair[0].x <= pair[1].x + 0.01));
        assert!(greys.iter().all(|v| v.max_element() - v.min_element() < 1.5), "{greys:?}");
        assert!(grey(-2.5).x > 90.0 && greys[79].x > 243.0, "{} {}", grey(-2.5), greys[79]);
        assert!(codes(Vec3::ZERO).max_element() < 1.0);
    }

    #[test]
    fn the_tables_agree_with_their_functions() {
        let tables = DisplayTables::new();
        for i in -1500..500 {
            let v = (i as f32 / 97.0).exp2();
            let (found, expected) = (tables.curve(OneLane, v), agx_curve(v));
            assert!((found - expected).abs() < 5e-6, "{v}: {found}, not {expected}");
        }
        assert_eq!(tables.curve(OneLane, f32::INFINITY), tables.curve(OneLane, 1e5));
    }

    #[test]
    fn bins_of_the_meter_are_even_in_the_logarithm() {
        for i in 0..20_000 {
            let v = (i as f32 / 500.0 - 20.0).exp2();
            let place = (v.max(1e-6).log2() - METER_MIN_LOG2) * METER_BINS_PER_STOP;
            let bin = meter_bin(Vec3::splat(v)) as f32;
            let place = place.clamp(0.0, (METER_BINS - 1) as f32);
            assert!(bin <= place + 1e-3 && place < bin + 1.001, "{v}: {bin}, not {place}");
        }
    }

    #[test]
    fn a_frame_is_exposed_by_its_mean_without_extremes() {
        let mut frame = FrameUniform { width_px: 100, height_px: 10, ..FrameUniform::zeroed() };
        frame.light = Light { key: 0.3, ..Light::zeroed() };
        let mut words = vec![encode_radiance(Vec3::splat(0.1)); 1000];
        let found = exposure(&frame, &words, &[]);
        assert!((found / 3.0 - 1.0).abs() < 0.07, "{found}");
        words[..5].fill(encode_radiance(Vec3::splat(60_000.0)));
        assert!((exposure(&frame, &words, &[]) / 3.0 - 1.0).abs() < 0.08);
        frame.exposure = 0.7;
        assert_eq!(exposure(&frame, &words, &[]), 0.7);
    }

    #[test]
    fn a_graded_frame_is_exposed_by_the_city_and_longer_in_shade() {
        let mut frame = FrameUniform { width_px: 100, height_px: 10, ..FrameUniform::zeroed() };
        // White at 1.4, usual mean 2^-2, half of the difference, at most twice as long.
        frame.light = Light { key: 0.3, grade: [1.4, -2.0, 0.5, 1.0], ..Light::zeroed() };
        let words = |v: f32| vec![encode_radiance(Vec3::splat(v)); 1000];
        let city = vec![0; 1000];
        let at = |v: f32, hits: &[u32]| exposure(&frame, &words(v), hits) / 1.4;
        assert_eq!(at(0.5, &city), 1.0);
        assert!((at(2f32.powi(-3), &city) / 0.5f32.exp2() - 1.0).abs() < 0.03, "{}", at(2f32.powi(-3), &city));
        assert!((at(1e-3, &city) - 2.0).abs() < 1e-3);
        // The sky alone does not count.
        assert_eq!(at(1e-3, &vec![NO_NODE; 1000]), 1.0);
    }

    #[test]
    fn the_neutral_curve_is_linear_and_then_turns_white() {
        let tables = DisplayTables::new();
        let neutral = |rgb: Vec3, longer: f32| Vec3::from(neutral(OneLane, rgb.into(), longer));
        assert_eq!(neutral(Vec3::new(0.7, 0.2, 0.1), 1.0), Vec3::new(0.7, 0.2, 0.1));
        // By hand: range 0.24, 1 - 0.0576 / 0.48 = 0.88.
        assert!((neutral(Vec3::ONE, 1.0) - 0.88).abs().max_element() < 1e-6);
        let red = neutral(Vec3::new(8.0, 0.5, 0.5), 1.0);
        assert!(red.x < 1.0 && red.y > 0.4, "{red}");
        // What twice the time adds: nearly all of it in the dark, little in the sky. Brighter light stays brighter.
        let longer = |v: f32| neutral(Vec3::splat(2.0 * v), 2.0).x;
        assert!(
            longer(0.05) > 0.098 && longer(0.75) < 0.98 && longer(0.75) > 0.75,
            "{} {}",
            longer(0.05),
            longer(0.75)
        );
        assert!((0..400).all(|i| longer(i as f32 / 100.0) < longer((i + 1) as f32 / 100.0)));
        let code = |v: f32| tables.codes(OneLane, Vec3::splat(v).into(), Some(1.0)).x;
        // sRGB of 0.2140 is 0.5.
        assert!((code(0.214_04) - 127.5).abs() < 0.1);
        assert!(code(0.001) - 3.3 < 0.1);
    }
}
