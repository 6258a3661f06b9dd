//! Radiances of neighbouring pixels as words, and those as colours. The scalar code is [`tone`](crate::tone).

use super::lanes::{F, U, Vec3s, always, float, float_u, splat, splat_i, splat_u, to_i};
use crate::{
    atmosphere::LUMINANCE,
    cpu::instruction_set::InstructionSet,
    tone::{
        AGX_IN, AGX_OUT, AGX_SATURATION, CODE_STEPS, CURVE_MIN, CURVE_SHIFT, DisplayTables, EXPONENT_BIAS,
        MANTISSA_BITS, MAX_RADIANCE, NOISE,
    },
};
use fearless_simd::{Level, prelude::*};
use glam::{Mat3, Vec3};

/// [`encode_radiance`](crate::tone::encode_radiance).
#[inline(always)]
pub(super) fn encode_radiances<S: Simd>(simd: S, rgb: Vec3s<S>) -> U<S> {
    let (zero, most) = (splat(simd, 0.0), splat(simd, MAX_RADIANCE));
    let rgb = rgb.map(
        #[inline(always)]
        |v| v.max(zero).min(most),
    );
    let bits = rgb.x.max(rgb.y).max(rgb.z).bitcast::<U<S>>() + (1 << (22 - MANTISSA_BITS + 1));
    let exponent = (to_i::<S>(bits >> 23) - 127).max(splat_i(simd, -1 - EXPONENT_BIAS));
    let scale = (-exponent + (127 + MANTISSA_BITS as i32 - 1)).bitcast::<U<S>>() << 23;
    let scale: F<S> = scale.bitcast();
    let largest = splat_u(simd, (1 << MANTISSA_BITS) - 1);
    let mantissa = always(
        #[inline(always)]
        |v: F<S>| (v * scale + 0.5).to_int::<U<S>>().min(largest),
    );
    let exponent = (exponent + (1 + EXPONENT_BIAS)).bitcast::<U<S>>() << 27;
    mantissa(rgb.x) | (mantissa(rgb.y) << 9) | (mantissa(rgb.z) << 18) | exponent
}

/// Colours of pixels from number `first` on, of rows of `width`, with radiances `words`: r, g, b, 255 in sRGB.
pub(in crate::cpu) fn develop_pixels(
    set: InstructionSet,
    (width, first): (u32, usize),
    (exposure, tables): (f32, &DisplayTables),
    words: &[u32],
    colours: &mut [u32],
) {
    // Some machines have one instruction set.
    #[allow(unreachable_patterns)]
    match set.level() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx512(simd) => develop_with(simd, (width, first), (exposure, tables), words, colours),
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx2(simd) => develop_with(simd, (width, first), (exposure, tables), words, colours),
        #[cfg(target_arch = "aarch64")]
        Level::Neon(simd) => develop_with(simd, (width, first), (exposure, tables), words, colours),
        #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
        Level::WasmSimd128(simd) => develop_with(simd, (width, first), (exposure, tables), words, colours),
        // An `InstructionSet` is none of the others.
        _ => {}
    }
}

fn develop_with<S: Simd>(
    simd: S,
    (width, first): (u32, usize),
    (exposure, tables): (f32, &DisplayTables),
    words: &[u32],
    colours: &mut [u32],
) {
    let lanes = F::<S>::LEN;
    simd.vectorize(
        #[inline(always)]
        || {
            for (chunk, (words, colours)) in words.chunks(lanes).zip(colours.chunks_mut(lanes)).enumerate() {
                let mut radiances = splat_u(simd, 0);
                for (lane, word) in words.iter().enumerate() {
                    radiances[lane] = *word;
                }
                let codes = codes_of(simd, tables, decode_radiances::<S>(radiances).scale(splat(simd, exposure)));
                let at = (first + chunk * lanes) as u32;
                // Pixels of a chunk may be of two rows.
                let (mut x, mut y) = (splat_u(simd, 0), splat_u(simd, 0));
                for lane in 0..lanes as u32 {
                    let (column, row) = ((at + lane) % width, (at + lane) / width);
                    (x[lane as usize], y[lane as usize]) = (column, row);
                }
                let dithered = dithered(simd, codes, x, y);
                for (lane, colour) in colours.iter_mut().enumerate() {
                    *colour = dithered[lane];
                }
            }
        },
    );
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
        |v| ((v - grey) * AGX_SATURATION + grey).max(zero),
    );
    product(AGX_OUT, saturated).map(
        #[inline(always)]
        |v| {
            let place = v.max(zero).min(one) * CODE_STEPS as f32;
            let whole: U<S> = place.to_int();
            between(simd, &tables.codes, whole, place - float_u::<S>(whole))
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
    let last = splat_u(simd, tables.curve.len() as u32 - 2);
    let above = v.max(splat(simd, CURVE_MIN)).bitcast::<U<S>>() - CURVE_MIN.to_bits();
    let part = float_u::<S>(above & ((1 << CURVE_SHIFT) - 1)) / (1 << CURVE_SHIFT) as f32;
    between(simd, &tables.curve, (above >> CURVE_SHIFT).min(last), part)
}

/// Between the entries `at` and the next ones of a table.
#[inline(always)]
fn between<S: Simd>(simd: S, table: &[f32], at: U<S>, part: F<S>) -> F<S> {
    let entry = always(
        #[inline(always)]
        |next: usize| {
            F::<S>::from_fn(
                simd,
                #[inline(always)]
                |lane| table.get(at[lane] as usize + next).copied().unwrap_or(0.0),
            )
        },
    );
    let (low, high) = (entry(0), entry(1));
    low + (high - low) * part
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
        |v: F<S>| (v + noise).min(most).to_int::<U<S>>(),
    );
    channel(codes.x) | (channel(codes.y) << 8) | (channel(codes.z) << 16) | (255 << 24)
}
