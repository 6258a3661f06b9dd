//! Rows of a frame, drawn in packets.
//!
//! Each pixel has a ray through its centre, or near it: [`cast_centres`]. With several rays a pixel, the others follow: of all pixels,
//! or of those that differ from a neighbour: [`finish_rows`]. The rays of a packet are those of one pixel or of neighbours.

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
    /// Column, and row of the frame.
    x: u32,
    y: u32,
    sample: u32,
}

/// What the ray through a pixel's centre has found.
#[derive(Debug, Clone, Copy)]
pub(in crate::cpu) struct CentreRay {
    airlight: Vec3,
    rgb: Vec3,
    normal: Vec3,
    distance_m: f32,
    node: u32,
    object: u32,
    is_outlined: bool,
}

/// The light of all rays of a pixel.
#[derive(Clone, Copy)]
struct PixelSum {
    rgb: Vec3,
    /// Number of its rays that hit an object with an outline.
    outlined: u32,
    /// Whether it has all rays, not only the one through its centre.
    is_refined: bool,
    /// Whether a neighbour's ray hit no object with an outline, in frames of one ray a pixel.
    is_beside_other: bool,
}

/// Rays in the lanes of a packet.
#[derive(Clone, Copy)]
struct RayPacket<S: Simd> {
    x: U<S>,
    y: U<S>,
    sample: U<S>,
    lanes: M<S>,
}

/// Consecutive rows of a frame's rays through the centres of pixels.
#[derive(Clone, Copy)]
pub(in crate::cpu) struct CentreRows<'a> {
    /// Number of the first row.
    pub first: u32,
    pub rays: &'a [CentreRay],
}

/// The rows that are needed for drawing the rows `begin` to `end`: neighbours decide with them which pixels get more rays.
pub(in crate::cpu) fn rows_around(frame: &FrameUniform, sampling: Sampling, [begin, end]: [u32; 2]) -> [u32; 2] {
    let border = match is_adaptive(frame, sampling) {
        true => 1 + u32::from(has_penumbrae(frame)),
        false => 0,
    };
    [begin.saturating_sub(border), end.saturating_add(border).min(frame.height_px)]
}

fn is_adaptive(frame: &FrameUniform, sampling: Sampling) -> bool {
    sampling == Sampling::Adaptive && frame.samples > 1
}

/// Whether shadows are soft. They begin a little beyond the pixels that show it.
fn has_penumbrae(frame: &FrameUniform) -> bool {
    frame.shadow_m > 0.0 && frame.sun_radius > 0.0
}

/// Calls a function for the instruction set of an [`InstructionSet`].
macro_rules! with_lanes {
    ($set:expr, |$simd:ident| $call:expr) => {
        // Some machines have one instruction set.
        #[allow(unreachable_patterns)]
        match $set.level() {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Level::Avx512($simd) => $call,
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Level::Avx2($simd) => $call,
            #[cfg(target_arch = "aarch64")]
            Level::Neon($simd) => $call,
            #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
            Level::WasmSimd128($simd) => $call,
            // An `InstructionSet` is none of the others.
            _ => {}
        }
    };
}

/// Draws rows from row `first` on this thread: as many as `out` has pixels for.
pub(in crate::cpu) fn render_rows(
    set: InstructionSet,
    scene: &SceneRef<'_>,
    sampling: Sampling,
    first: u32,
    out: &mut [Pixel],
) {
    let width = scene.frame.width_px.max(1);
    let [top, bottom] = rows_around(scene.frame, sampling, [first, first + out.len() as u32 / width]);
    let mut rays = vec![CentreRay::NOTHING; (width * bottom.saturating_sub(top)) as usize];
    cast_centres(set, scene, top, &mut rays);
    finish_rows(set, scene, sampling, CentreRows { first: top, rays: &rays }, first, out);
}

/// Casts the rays through the centres of the pixels of rows from row `first`, as many as `out` has rays for, on this thread.
pub(in crate::cpu) fn cast_centres(set: InstructionSet, scene: &SceneRef<'_>, first: u32, out: &mut [CentreRay]) {
    with_lanes!(set, |simd| draw_centres(simd, scene, first, out));
}

/// Draws rows from row `first`, as many as `out` has pixels for, on this thread. `centres` are the rows of [`rows_around`] or more.
pub(in crate::cpu) fn finish_rows(
    set: InstructionSet,
    scene: &SceneRef<'_>,
    sampling: Sampling,
    centres: CentreRows<'_>,
    first: u32,
    out: &mut [Pixel],
) {
    let width = scene.frame.width_px.max(1);
    let begin = (first.saturating_sub(centres.first) * width) as usize;
    let Some(drawn) = centres.rays.get(begin..begin + out.len()) else { return };
    let mut band = Band { scene, samples: scene.frame.samples.clamp(1, MAX_SAMPLES), first, drawn, sums: Vec::new() };
    band.sums =
        drawn.iter().map(|ray| PixelSum { outlined: u32::from(ray.is_outlined), ..PixelSum::NOTHING }).collect();
    if band.samples > 1 {
        let refined = is_adaptive(scene.frame, sampling).then(|| centres.refined(scene.frame, first, out.len()));
        with_lanes!(set, |simd| band.refine(simd, refined.as_deref()));
    } else if scene.frame.objects != 0 {
        band.find_outlines();
    }
    with_lanes!(set, |simd| band.finish(simd, out));
}

/// What a resting view shows of rows until all their rays are cast: the ray through the centre of each pixel.
pub(in crate::cpu) fn sketch_rows(
    set: InstructionSet,
    scene: &SceneRef<'_>,
    centres: CentreRows<'_>,
    first: u32,
    out: &mut [Pixel],
) {
    let begin = (first.saturating_sub(centres.first) * scene.frame.width_px) as usize;
    let Some(drawn) = centres.rays.get(begin..begin + out.len()) else { return };
    let sums = vec![PixelSum::NOTHING; drawn.len()];
    let band = Band { scene, samples: scene.frame.samples.clamp(1, MAX_SAMPLES), first, drawn, sums };
    with_lanes!(set, |simd| band.finish(simd, out));
}

impl CentreRows<'_> {
    /// Which pixels of rows from row `first`, `count` in all, get more rays: those that differ from one of their eight neighbours, and
    /// with soft shadows their neighbours too.
    fn refined(&self, frame: &FrameUniform, first: u32, count: usize) -> Vec<bool> {
        let width = frame.width_px.max(1) as usize;
        let border = usize::from(has_penumbrae(frame));
        let (rows, all) = (count / width, self.rays.len() / width);
        let begin = first.saturating_sub(self.first) as usize;
        let [top, bottom] = [begin.saturating_sub(border), (begin + rows + border).min(all)];
        let edges = self.edges(width, [top, bottom]);
        let inner = |edges: &[bool]| edges[(begin - top) * width..][..count].to_vec();
        if border == 0 { inner(&edges) } else { inner(&widened(&edges, width)) }
    }

    /// Which pixels of the rows `top` to `bottom` of these differ from one of their eight neighbours.
    fn edges(&self, width: usize, [top, bottom]: [usize; 2]) -> Vec<bool> {
        let all = self.rays.len() / width;
        let (above, below) = (top.saturating_sub(1), (bottom + 1).min(all));
        let mut edges = vec![false; (below - above) * width];
        let rays = &self.rays[above * width..below * width];
        for row in 0..below - above {
            for x in 0..width {
                let at = row * width + x;
                let mut compare = |other: usize| {
                    if rays[at].differs_from(&rays[other]) {
                        (edges[at], edges[other]) = (true, true);
                    }
                };
                if x + 1 < width {
                    compare(at + 1);
                }
                if row + 1 < below - above {
                    compare(at + width);
                    if x + 1 < width {
                        compare(at + width + 1);
                    }
                    if x > 0 {
                        compare(at + width - 1);
                    }
                }
            }
        }
        edges[(top - above) * width..][..(bottom - top) * width].to_vec()
    }
}

/// Pixels that are set, and their eight neighbours.
fn widened(set: &[bool], width: usize) -> Vec<bool> {
    let rows = set.len() / width;
    let mut across = set.to_vec();
    for (from, to) in set.chunks(width).zip(across.chunks_mut(width)) {
        for x in 0..width {
            to[x] = from[x] || x > 0 && from[x - 1] || x + 1 < width && from[x + 1];
        }
    }
    let is_set = |row: usize, x: usize| across[row * width + x];
    let mut out = across.clone();
    for (at, target) in out.iter_mut().enumerate() {
        let (row, x) = (at / width, at % width);
        *target |= row > 0 && is_set(row - 1, x) || row + 1 < rows && is_set(row + 1, x);
    }
    out
}

/// Rays for the pixels of rows from row `first`, `count` in all, in the order of blocks of `lanes` neighbours.
fn in_blocks(width: u32, first: u32, count: usize, lanes: u32) -> Vec<FrameRay> {
    let rows = count as u32 / width.max(1);
    let high = match (rows, lanes) {
        (1, _) => 1,
        (_, 16..) => 4,
        _ => 2,
    };
    let wide = lanes / high;
    let mut rays = Vec::with_capacity(count);
    for top in (0..rows).step_by(high as usize) {
        for left in (0..width).step_by(wide as usize) {
            for y in top..(top + high).min(rows) {
                let block = left..(left + wide).min(width);
                rays.extend(block.map(|x| FrameRay { x, y: first + y, sample: 0 }));
            }
        }
    }
    rays
}

fn draw_centres<S: Simd>(simd: S, scene: &SceneRef<'_>, first: u32, out: &mut [CentreRay]) {
    let width = scene.frame.width_px;
    let samples = scene.frame.samples.clamp(1, MAX_SAMPLES);
    let mut rays = in_blocks(width, first, out.len(), F::<S>::LEN as u32);
    rays.iter_mut().for_each(|ray| ray.sample = samples * samples / 2);
    for rays in rays.chunks(F::<S>::LEN) {
        simd.vectorize(
            #[inline(always)]
            || {
                let packet = RayPacket::new(simd, rays);
                let air = airlight(simd, scene.frame, packet.direction(simd, scene.frame, None));
                let traced = packet.trace(simd, scene, samples, air);
                for (lane, ray) in rays.iter().enumerate() {
                    let Some(target) = out.get_mut(((ray.y - first) * width + ray.x) as usize) else { continue };
                    *target = CentreRay {
                        airlight: air.lane(lane),
                        rgb: traced.rgb.lane(lane),
                        normal: traced.normal.lane(lane),
                        distance_m: traced.distance_m[lane],
                        node: traced.node[lane],
                        object: traced.object[lane],
                        is_outlined: traced.is_outlined.test(lane),
                    };
                }
            },
        );
    }
}

/// Rows of a frame while they are drawn.
struct Band<'a> {
    scene: &'a SceneRef<'a>,
    /// Rays along a pixel's side.
    samples: u32,
    /// The first row.
    first: u32,
    /// The rays through the centres of its pixels, and the sums of all rays.
    drawn: &'a [CentreRay],
    sums: Vec<PixelSum>,
}

impl Band<'_> {
    #[inline(always)]
    fn at(&self, ray: &FrameRay) -> usize {
        ((ray.y - self.first) * self.scene.frame.width_px + ray.x) as usize
    }

    /// Casts the other rays of all pixels, or of those that `refined` names.
    fn refine<S: Simd>(&mut self, simd: S, refined: Option<&[bool]>) {
        let (samples, lanes) = (self.samples, F::<S>::LEN);
        let centre = samples * samples / 2;
        let others = |ray: FrameRay| {
            (0..samples * samples).filter(move |s| *s != centre).map(move |s| FrameRay { sample: s, ..ray })
        };
        let mut rays = in_blocks(self.scene.frame.width_px, self.first, self.drawn.len(), lanes as u32);
        rays.retain(|ray| refined.is_none_or(|refined| refined[self.at(ray)]));
        let rays: Vec<FrameRay> = rays.into_iter().flat_map(others).collect();
        for chunk in rays.chunks(lanes) {
            self.add_rays(simd, chunk, centre);
        }
    }

    /// Adds rays, which are in the order of their numbers for each pixel.
    fn add_rays<S: Simd>(&mut self, simd: S, rays: &[FrameRay], centre: u32) {
        simd.vectorize(
            #[inline(always)]
            || {
                let packet = RayPacket::new(simd, rays);
                let mut air = Vec3s::splat(simd, Vec3::ZERO);
                for (lane, ray) in rays.iter().enumerate() {
                    air.set_lane(lane, self.drawn[self.at(ray)].airlight);
                }
                let traced = packet.trace(simd, self.scene, self.samples, air);
                for (lane, ray) in rays.iter().enumerate() {
                    let at = self.at(ray);
                    let (Some(sum), Some(drawn)) = (self.sums.get_mut(at), self.drawn.get(at)) else { continue };
                    // In the order of the numbers, so that the sum is that of the scalar code.
                    if ray.sample == centre + 1 {
                        sum.rgb += drawn.rgb;
                    }
                    sum.rgb += traced.rgb.lane(lane);
                    sum.outlined += u32::from(traced.is_outlined.test(lane));
                    sum.is_refined = true;
                }
            },
        );
    }

    /// Outlines of objects in frames of one ray a pixel.
    fn find_outlines(&mut self) {
        let width = self.scene.frame.width_px;
        for (at, sum) in self.sums.iter_mut().enumerate().filter(|(_, sum)| sum.outlined > 0) {
            let (x, y) = (at as u32 % width, at as u32 / width + self.first);
            sum.is_beside_other = is_beside_other(self.scene, [x, y]);
        }
    }

    /// What its pixels have become.
    fn finish<S: Simd>(&self, simd: S, out: &mut [Pixel]) {
        let frame = self.scene.frame;
        let is_plain = frame.shading == Shading::Lit as u32 && frame.objects == 0;
        let lanes = F::<S>::LEN;
        let rays = (self.samples * self.samples) as f32;
        for (at, out) in (0..self.drawn.len()).step_by(lanes).zip(out.chunks_mut(lanes)) {
            simd.vectorize(
                #[inline(always)]
                || {
                    let mut words = splat_u(simd, 0);
                    if is_plain {
                        let mut rgb = Vec3s::splat(simd, Vec3::ZERO);
                        for lane in 0..out.len() {
                            rgb.set_lane(lane, self.sum_of_rays(at + lane));
                        }
                        words = encode_radiances(
                            simd,
                            rgb.map(
                                #[inline(always)]
                                |v| v / rays,
                            ),
                        );
                    }
                    for (lane, target) in out.iter_mut().enumerate() {
                        let drawn = &self.drawn[at + lane];
                        let word = if is_plain { words[lane] } else { self.word(at + lane) };
                        *target = Pixel { word, distance_m: drawn.distance_m, hit: drawn.node };
                    }
                },
            );
        }
    }

    /// Light of all rays of a pixel.
    fn sum_of_rays(&self, at: usize) -> Vec3 {
        let rays = (self.samples * self.samples) as f32;
        if self.sums[at].is_refined { self.sums[at].rgb } else { self.drawn[at].rgb * rays }
    }

    fn word(&self, at: usize) -> u32 {
        let (sum, rays) = (&self.sums[at], self.samples * self.samples);
        let is_outline = if sum.is_refined { sum.outlined > 0 && sum.outlined < rays } else { sum.is_beside_other };
        pixel_word(self.scene.frame, self.sum_of_rays(at), is_outline, self.drawn[at].object)
    }
}

impl PixelSum {
    const NOTHING: Self = Self { rgb: Vec3::ZERO, outlined: 0, is_refined: false, is_beside_other: false };
}

impl CentreRay {
    pub(in crate::cpu) const NOTHING: Self = Self {
        airlight: Vec3::ZERO,
        rgb: Vec3::ZERO,
        normal: Vec3::ZERO,
        distance_m: f32::INFINITY,
        node: NO_NODE,
        object: 0,
        is_outlined: false,
    };

    /// Whether there may be an edge between two pixels.
    #[inline]
    fn differs_from(&self, other: &Self) -> bool {
        let brighter = self.rgb.max(other.rgb).max_element();
        (self.rgb - other.rgb).abs().max_element() > RADIANCES_DIFFER * brighter
            || (self.normal - other.normal).length_squared() > NORMALS_DIFFER
            || self.object != other.object
            || self.is_outlined != other.is_outlined
    }
}

impl<S: Simd> RayPacket<S> {
    #[inline(always)]
    fn new(simd: S, rays: &[FrameRay]) -> Self {
        let mut packet = Self {
            x: splat_u(simd, 0),
            y: splat_u(simd, 0),
            sample: splat_u(simd, 0),
            lanes: M::<S>::splat(simd, true),
        };
        for (lane, ray) in rays.iter().enumerate().take(F::<S>::LEN) {
            packet.x[lane] = ray.x;
            packet.y[lane] = ray.y;
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
