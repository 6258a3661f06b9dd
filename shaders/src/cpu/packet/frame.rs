//! Rows of a frame, drawn in packets.
//!
//! Each pixel has a ray through its centre, or near it. With several rays a pixel, the others follow: of all pixels, or of those
//! that differ from a neighbour. The rays of a packet are those of one pixel or of neighbours.

use super::{
    lanes::{F, M, U, Vec2s, Vec3s, always, float, float_u, lanes_of, splat, splat_u, to_i},
    shade::normalize_or,
    sky::airlight,
    tone::encode_radiances,
    trace::{TracedRays, trace},
};
use crate::{
    cpu::{
        instruction_set::InstructionSet,
        ray::SceneRef,
        raycast::{GOLDEN_TURN, Pixel, Sampling, is_beside_other, pixel_word, sun_axes},
    },
    layout::{FrameUniform, MAX_SAMPLES, NO_NODE, Shading},
    tone::gradient_noise,
};
use fearless_simd::{Level, prelude::*};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// Squared length of the difference of normals from which neighbours differ: 8 degrees.
const NORMALS_DIFFER: f32 = 0.02;
/// Difference of radiances from which neighbours differ, as a share of the brighter one.
const RADIANCES_DIFFER: f32 = 0.03;

/// A ray of the frame: its pixel, and its number in that.
#[derive(Clone, Copy)]
struct FrameRay {
    /// Column, and row from the first of the band and its surroundings.
    x: u32,
    y: u32,
    sample: u32,
}

/// What the ray through a pixel's centre has found, and the sum of the light of the others.
#[derive(Clone, Copy)]
struct PixelState {
    airlight: Vec3,
    centre: Vec3,
    normal: Vec3,
    distance_m: f32,
    node: u32,
    object: u32,
    is_outlined: bool,
    /// Whether a neighbour's ray hit no object with an outline, in frames of one ray a pixel.
    is_beside_other: bool,
    /// Whether it has the other rays.
    is_refined: bool,
    sum: Vec3,
    /// Number of its rays that hit an object with an outline.
    outlined: u32,
}

/// Rays in the lanes of a packet.
#[derive(Clone, Copy)]
struct RayPacket<S: Simd> {
    x: U<S>,
    y: U<S>,
    sample: U<S>,
    lanes: M<S>,
}

/// Rows of a frame and of its surroundings while they are drawn.
struct Band<'a> {
    scene: &'a SceneRef<'a>,
    /// Rays along a pixel's side.
    samples: u32,
    /// The first row of `pixels` in the frame; below 0 above the frame.
    top: i32,
    pixels: Vec<PixelState>,
}

/// Draws rows from row `first` on this thread: as many as `out` has pixels for.
pub(in crate::cpu) fn render_rows(
    set: InstructionSet,
    scene: &SceneRef<'_>,
    sampling: Sampling,
    first: u32,
    out: &mut [Pixel],
) {
    // Some machines have one instruction set.
    #[allow(unreachable_patterns)]
    match set.level() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx512(simd) => draw(simd, scene, sampling, first, out),
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Level::Avx2(simd) => draw(simd, scene, sampling, first, out),
        #[cfg(target_arch = "aarch64")]
        Level::Neon(simd) => draw(simd, scene, sampling, first, out),
        #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
        Level::WasmSimd128(simd) => draw(simd, scene, sampling, first, out),
        // An `InstructionSet` is none of the others.
        _ => {}
    }
}

fn draw<S: Simd>(simd: S, scene: &SceneRef<'_>, sampling: Sampling, first: u32, out: &mut [Pixel]) {
    let frame = scene.frame;
    let width = frame.width_px;
    let rows = out.len() as u32 / width.max(1);
    let samples = frame.samples.clamp(1, MAX_SAMPLES);
    let is_adaptive = sampling == Sampling::Adaptive && samples > 1;
    // Soft shadows begin a little beyond the pixels that show it.
    let is_soft = frame.shadow_m > 0.0 && frame.sun_radius > 0.0;
    // Rows above and below that decide with the others which pixels get more rays.
    let border = u32::from(is_adaptive) * (1 + u32::from(is_soft));
    let top = first as i32 - border as i32;
    let pixels = vec![PixelState::NOTHING; (width * (rows + 2 * border)) as usize];
    let mut band = Band { scene, samples, top, pixels };
    let centre = samples * samples / 2;
    let mut rays = band.in_blocks(F::<S>::LEN as u32);
    rays.iter_mut().for_each(|ray| ray.sample = centre);
    for chunk in rays.chunks(F::<S>::LEN) {
        band.draw_centres(simd, chunk);
    }
    if samples > 1 {
        let others = |ray: FrameRay| {
            (0..samples * samples).filter(move |s| *s != centre).map(move |sample| FrameRay { sample, ..ray })
        };
        let is_drawn = |ray: &FrameRay| ray.y >= border && ray.y < rows + border;
        let edges = if is_adaptive { band.edges() } else { Vec::new() };
        let is_refined = |at: usize| !is_adaptive || edges[at] || is_soft && band.around(at).any(|other| edges[other]);
        rays.retain(|ray| is_drawn(ray) && is_refined(band.at(ray)));
        let rays: Vec<FrameRay> = rays.into_iter().flat_map(others).collect();
        for chunk in rays.chunks(F::<S>::LEN) {
            band.draw_others(simd, chunk, centre);
        }
    }
    if samples == 1 && frame.objects != 0 {
        band.find_outlines();
    }
    let drawn = band.pixels.get((width * border) as usize..).unwrap_or_default();
    for (target, pixels) in out.chunks_mut(F::<S>::LEN).zip(drawn.chunks(F::<S>::LEN)) {
        finish(simd, frame, pixels, target);
    }
}

/// What the pixels of a frame have become.
fn finish<S: Simd>(simd: S, frame: &FrameUniform, pixels: &[PixelState], out: &mut [Pixel]) {
    let is_plain = frame.shading == Shading::Lit as u32 && frame.objects == 0;
    simd.vectorize(
        #[inline(always)]
        || {
            let mut words = splat_u(simd, 0);
            if is_plain {
                let mut rgb = Vec3s::splat(simd, Vec3::ZERO);
                for (lane, pixel) in pixels.iter().enumerate() {
                    rgb.set_lane(lane, pixel.sum_of_rays(frame));
                }
                let rays = frame.samples.clamp(1, MAX_SAMPLES).pow(2) as f32;
                words = encode_radiances(
                    simd,
                    rgb.map(
                        #[inline(always)]
                        |v| v / rays,
                    ),
                );
            }
            for (lane, (target, pixel)) in out.iter_mut().zip(pixels).enumerate() {
                let word = if is_plain { words[lane] } else { pixel.word(frame) };
                *target = Pixel { word, distance_m: pixel.distance_m, hit: pixel.node };
            }
        },
    );
}

impl Band<'_> {
    /// A ray for each pixel, in the order of blocks of `lanes` neighbours.
    fn in_blocks(&self, lanes: u32) -> Vec<FrameRay> {
        let width = self.scene.frame.width_px;
        let rows = self.pixels.len() as u32 / width.max(1);
        let high = match (rows, lanes) {
            (1, _) => 1,
            (_, 16..) => 4,
            _ => 2,
        };
        let wide = lanes / high;
        let mut rays = Vec::with_capacity(self.pixels.len());
        for top in (0..rows).step_by(high as usize) {
            for left in (0..width).step_by(wide as usize) {
                for y in top..(top + high).min(rows) {
                    let block = left..(left + wide).min(width);
                    rays.extend(block.map(|x| FrameRay { x, y, sample: 0 }));
                }
            }
        }
        rays
    }

    #[inline(always)]
    fn at(&self, ray: &FrameRay) -> usize {
        (ray.y * self.scene.frame.width_px + ray.x) as usize
    }

    /// Pixels that differ from one of their eight neighbours.
    fn edges(&self) -> Vec<bool> {
        let is_edge = |at| {
            let pixel = &self.pixels[at];
            self.around(at).any(|other| pixel.differs_from(&self.pixels[other]))
        };
        (0..self.pixels.len()).map(is_edge).collect()
    }

    /// Outlines of objects in frames of one ray a pixel.
    fn find_outlines(&mut self) {
        let width = self.scene.frame.width_px;
        for (at, pixel) in self.pixels.iter_mut().enumerate().filter(|(_, pixel)| pixel.is_outlined) {
            let (x, y) = (at as u32 % width, (at as u32 / width).wrapping_add_signed(self.top));
            pixel.is_beside_other = is_beside_other(self.scene, [x, y]);
        }
    }

    /// A pixel and its neighbours.
    fn around(&self, at: usize) -> impl Iterator<Item = usize> {
        let (width, len) = (self.scene.frame.width_px as usize, self.pixels.len());
        let (x, y) = (at % width, at / width);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let rows = y.saturating_sub(1)..(y + 2).min(len / width);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
    }

    fn draw_centres<S: Simd>(&mut self, simd: S, rays: &[FrameRay]) {
        simd.vectorize(
            #[inline(always)]
            || {
                let packet = RayPacket::new(simd, rays, self.top);
                let air = airlight(simd, self.scene.frame, packet.direction(simd, self.scene.frame, None));
                let traced = packet.trace(simd, self.scene, self.samples, air);
                for (lane, ray) in rays.iter().enumerate() {
                    let at = self.at(ray);
                    let Some(pixel) = self.pixels.get_mut(at) else { continue };
                    *pixel = PixelState {
                        airlight: air.lane(lane),
                        centre: traced.rgb.lane(lane),
                        normal: traced.normal.lane(lane),
                        distance_m: traced.distance_m[lane],
                        node: traced.node[lane],
                        object: traced.object[lane],
                        is_outlined: traced.is_outlined.test(lane),
                        ..PixelState::NOTHING
                    };
                }
            },
        );
    }

    /// Adds rays, which are in the order of their numbers for each pixel.
    fn draw_others<S: Simd>(&mut self, simd: S, rays: &[FrameRay], centre: u32) {
        simd.vectorize(
            #[inline(always)]
            || {
                let packet = RayPacket::new(simd, rays, self.top);
                let mut air = Vec3s::splat(simd, Vec3::ZERO);
                for (lane, ray) in rays.iter().enumerate() {
                    air.set_lane(lane, self.pixels[self.at(ray)].airlight);
                }
                let traced = packet.trace(simd, self.scene, self.samples, air);
                for (lane, ray) in rays.iter().enumerate() {
                    let at = self.at(ray);
                    let Some(pixel) = self.pixels.get_mut(at) else { continue };
                    // In the order of the numbers, so that the sum is that of the scalar code.
                    if ray.sample == centre + 1 {
                        pixel.sum += pixel.centre;
                        pixel.outlined += u32::from(pixel.is_outlined);
                    }
                    pixel.sum += traced.rgb.lane(lane);
                    pixel.outlined += u32::from(traced.is_outlined.test(lane));
                    pixel.is_refined = true;
                }
            },
        );
    }
}

impl PixelState {
    const NOTHING: Self = Self {
        airlight: Vec3::ZERO,
        centre: Vec3::ZERO,
        normal: Vec3::ZERO,
        distance_m: f32::INFINITY,
        node: NO_NODE,
        object: 0,
        is_outlined: false,
        is_beside_other: false,
        is_refined: false,
        sum: Vec3::ZERO,
        outlined: 0,
    };

    /// Whether there may be an edge between two pixels.
    fn differs_from(&self, other: &Self) -> bool {
        let brighter = self.centre.max(other.centre).max_element();
        (self.centre - other.centre).abs().max_element() > RADIANCES_DIFFER * brighter
            || (self.normal - other.normal).length_squared() > NORMALS_DIFFER
            || self.object != other.object
            || self.is_outlined != other.is_outlined
    }

    /// Light of all its rays.
    fn sum_of_rays(&self, frame: &FrameUniform) -> Vec3 {
        let rays = frame.samples.clamp(1, MAX_SAMPLES).pow(2) as f32;
        if self.is_refined { self.sum } else { self.centre * rays }
    }

    fn word(&self, frame: &FrameUniform) -> u32 {
        let rays = frame.samples.clamp(1, MAX_SAMPLES).pow(2);
        let is_outline = if self.is_refined { self.outlined > 0 && self.outlined < rays } else { self.is_beside_other };
        pixel_word(frame, self.sum_of_rays(frame), is_outline, self.object)
    }
}

impl<S: Simd> RayPacket<S> {
    /// `top`: row of the frame that the rays' rows are counted from.
    #[inline(always)]
    fn new(simd: S, rays: &[FrameRay], top: i32) -> Self {
        let mut packet = Self {
            x: splat_u(simd, 0),
            y: splat_u(simd, 0),
            sample: splat_u(simd, 0),
            lanes: M::<S>::splat(simd, true),
        };
        for (lane, ray) in rays.iter().enumerate().take(F::<S>::LEN) {
            packet.x[lane] = ray.x;
            packet.y[lane] = ray.y.wrapping_add_signed(top);
            packet.sample[lane] = ray.sample;
        }
        packet.lanes = M::<S>::from_bitmask(simd, (1u64 << rays.len().min(F::<S>::LEN)) - 1);
        packet
    }

    /// Directions of the rays, of `samples` along a pixel's side; without, those of the pixels' centres.
    #[inline(always)]
    fn direction(&self, simd: S, frame: &FrameUniform, samples: Option<u32>) -> Vec3s<S> {
        let (mut right, mut down) = (splat(simd, 0.5), splat(simd, 0.5));
        if let Some(n) = samples.filter(
            #[inline(always)]
            |n| *n > 1,
        ) {
            let offset = always(
                #[inline(always)]
                |place: u32| (place as f32 + 0.5) / n as f32,
            );
            right = F::<S>::from_fn(
                simd,
                #[inline(always)]
                |lane| offset(self.sample[lane] % n),
            );
            down = F::<S>::from_fn(
                simd,
                #[inline(always)]
                |lane| offset(self.sample[lane] / n),
            );
        }
        let ndc = always(
            #[inline(always)]
            |at: F<S>, offset: F<S>, size: u32| (at + offset) / size as f32 * 2.0 - 1.0,
        );
        let row = float::<S>(to_i::<S>(self.y));
        let (x, y) = (ndc(float_u::<S>(self.x), right, frame.width_px), ndc(row, down, frame.height_px));
        let along = always(
            #[inline(always)]
            |i: usize| (x * frame.right[i] + frame.forward[i]) - y * frame.up[i],
        );
        normalize_or(simd, Vec3s::<S> { x: along(0), y: along(1), z: along(2) }, Vec3s::splat(simd, Vec3::X))
    }

    #[inline(always)]
    fn trace(&self, simd: S, scene: &SceneRef<'_>, samples: u32, airlight: Vec3s<S>) -> TracedRays<S> {
        let dir = self.direction(simd, scene.frame, Some(samples));
        let sun = self.sun(simd, scene.frame, samples);
        trace(simd, scene, self.lanes, (dir, sun, airlight), self.threshold(simd, samples))
    }

    /// Points of the sun's disc.
    #[inline(always)]
    fn sun(&self, simd: S, frame: &FrameUniform, samples: u32) -> Vec3s<S> {
        let sun = Vec3s::splat(simd, frame.sun.into());
        if frame.shadow_m <= 0.0 || frame.sun_radius <= 0.0 {
            return sun;
        }
        let rays = (samples * samples) as f32;
        let mut turn = Vec2s::<S> { x: splat(simd, 0.0), y: splat(simd, 0.0) };
        let mut root = splat(simd, 0.0);
        for lane in lanes_of::<S>(self.lanes) {
            let mut point = Vec2::from_angle(TAU * gradient_noise(self.x[lane], self.y[lane]));
            for _ in 0..self.sample[lane] {
                point = point.rotate(GOLDEN_TURN);
            }
            (turn.x[lane], turn.y[lane]) = (point.x, point.y);
            root[lane] = ((self.sample[lane] as f32 + 0.5) / rays).sqrt();
        }
        let [across, up] = sun_axes(frame);
        let point = always(
            #[inline(always)]
            |across: f32, up: f32| (turn.x * across + turn.y * up) * root,
        );
        sun.add(Vec3s::<S> { x: point(across.x, up.x), y: point(across.y, up.y), z: point(across.z, up.z) })
    }

    /// As the scalar `threshold_of`.
    #[inline(always)]
    fn threshold(&self, simd: S, samples: u32) -> U<S> {
        let n = samples;
        let place = always(
            #[inline(always)]
            |lane: usize| (self.sample[lane] % n, self.sample[lane] / n + n / 2),
        );
        let x = U::<S>::from_fn(
            simd,
            #[inline(always)]
            |lane| self.x[lane].wrapping_mul(n).wrapping_add(place(lane).0),
        );
        let y = U::<S>::from_fn(
            simd,
            #[inline(always)]
            |lane| self.y[lane].wrapping_mul(n).wrapping_add(place(lane).1),
        );
        let a = x ^ y;
        ((a & 1) << 5) | ((y & 1) << 4) | ((a & 2) << 2) | ((y & 2) << 1) | ((a & 4) >> 1) | ((y & 4) >> 2)
    }
}
