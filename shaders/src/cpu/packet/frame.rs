//! Rows of a frame, drawn in packets.
//!
//! Each pixel has a ray through its centre, or near it: [`cast_centres`]. With several rays a pixel, the others follow: of all pixels,
//! or of those that differ from a neighbour: [`finish_rows`]. The rays of a packet are those of one pixel or of neighbours.

use super::lanes::{F, Vec3s, always, once, splat_u};
use super::ray_packet::{FrameRay, PixelRows, RayPacket, blocks_of, in_blocks};
use super::trace::TracedRays;
use crate::cpu::instruction_set::InstructionSet;
use crate::cpu::ray::SceneRef;
use crate::cpu::raycast::{Pixel, Sampling, is_beside_other, pixel_word};
use crate::cpu::shade::airlight;
use crate::layout::{FrameUniform, MAX_SAMPLES, NO_NODE, Shading};
use crate::tone::encode_radiances;
use fearless_simd::prelude::*;
use glam::Vec3;

/// Squared length of the difference of normals from which neighbours differ: 8 degrees.
const NORMALS_DIFFER: f32 = 0.02;
/// Difference of radiances from which neighbours differ, as a share of the brighter one.
const RADIANCES_DIFFER: f32 = 0.03;

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

/// Draws rows from row `first` on this thread: as many as `out` has pixels for.
pub(in crate::cpu) fn render_rows(
    set: InstructionSet,
    scene: &SceneRef<'_>,
    sampling: Sampling,
    first: u32,
    out: &mut [Pixel],
) {
    let frame = scene.frame;
    if frame.samples <= 1 && frame.objects == 0 && frame.shading == Shading::Lit as u32 {
        with_lanes!(set, |simd| draw_single(simd, scene, first, out), ());
        return;
    }
    let width = frame.width_px.max(1);
    let [top, bottom] = rows_around(frame, sampling, [first, first + out.len() as u32 / width]);
    let mut rays = vec![CentreRay::NOTHING; (width * bottom.saturating_sub(top)) as usize];
    cast_centres(set, scene, top, &mut rays);
    finish_rows(set, scene, sampling, CentreRows { first: top, rays: &rays }, first, out);
}

/// Casts the rays through the centres of the pixels of rows from row `first`, as many as `out` has rays for, on this thread.
pub(in crate::cpu) fn cast_centres(set: InstructionSet, scene: &SceneRef<'_>, first: u32, out: &mut [CentreRay]) {
    with_lanes!(set, |simd| draw_centres(simd, scene, first, out), ());
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
        with_lanes!(set, |simd| band.refine(simd, refined.as_deref()), ());
    } else if scene.frame.objects != 0 {
        band.find_outlines();
    }
    with_lanes!(set, |simd| band.finish(simd, out), ());
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
    with_lanes!(set, |simd| band.finish(simd, out), ());
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

/// Draws rows of a lit frame of one ray a pixel.
fn draw_single<S: Simd>(simd: S, scene: &SceneRef<'_>, first: u32, out: &mut [Pixel]) {
    for_each_centre(
        simd,
        scene,
        first,
        out,
        always!(|rows: PixelRows, _: Vec3s<S>, traced: &TracedRays<S>, out: &mut [Pixel]| {
            let words = encode_radiances(traced.rgb);
            rows.write(
                out,
                always!(|lane: usize| Pixel {
                    word: words[lane],
                    distance_m: traced.distance_m[lane],
                    hit: traced.node[lane]
                }),
            );
        }),
    );
}

fn draw_centres<S: Simd>(simd: S, scene: &SceneRef<'_>, first: u32, out: &mut [CentreRay]) {
    for_each_centre(
        simd,
        scene,
        first,
        out,
        always!(|rows: PixelRows, air: Vec3s<S>, traced: &TracedRays<S>, out: &mut [CentreRay]| {
            let is_outlined = traced.is_outlined.to_bitmask();
            rows.write(
                out,
                always!(|lane: usize| CentreRay {
                    airlight: air.lane(lane),
                    rgb: traced.rgb.lane(lane),
                    normal: traced.normal.lane(lane),
                    distance_m: traced.distance_m[lane],
                    node: traced.node[lane],
                    object: traced.object[lane],
                    is_outlined: (is_outlined >> lane) & 1 != 0,
                }),
            );
        }),
    );
}

/// Casts the rays through the centres of the pixels of rows from row `first`, one for each of `out`, and writes what they find with
/// `write`, which gets the air's light and the rays.
#[inline(always)]
fn for_each_centre<S: Simd, T>(
    simd: S,
    scene: &SceneRef<'_>,
    first: u32,
    out: &mut [T],
    write: impl Fn(PixelRows, Vec3s<S>, &TracedRays<S>, &mut [T]),
) {
    let width = scene.frame.width_px;
    let samples = scene.frame.samples.clamp(1, MAX_SAMPLES);
    let centre = samples * samples / 2;
    let rows = out.len() as u32 / width.max(1);
    for block in blocks_of(width, out.len(), F::<S>::LEN as u32) {
        simd.vectorize(once!(|| {
            let packet = RayPacket::of_block(simd, block, (first, [width, rows]), (samples, centre));
            let dir = packet.direction(simd, scene.frame, None);
            let air = airlight(simd, scene.frame, dir);
            // The centre of a pixel is the place of the middle one of an odd number of rays.
            let dir = if samples % 2 == 1 { dir } else { packet.direction(simd, scene.frame, Some(samples)) };
            let traced = packet.trace(simd, scene, samples, (dir, air));
            write(PixelRows { block, width, rows }, air, &traced, out);
        }));
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
        simd.vectorize(once!(|| {
            let packet = RayPacket::new(simd, rays, self.samples);
            let mut air = Vec3s::splat(simd, Vec3::ZERO);
            for (lane, ray) in rays.iter().enumerate() {
                air.set_lane(lane, self.drawn[self.at(ray)].airlight);
            }
            let dir = packet.direction(simd, self.scene.frame, Some(self.samples));
            let traced = packet.trace(simd, self.scene, self.samples, (dir, air));
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
        }));
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
            simd.vectorize(once!(|| {
                let mut words = splat_u(simd, 0);
                if is_plain {
                    let mut rgb = Vec3s::splat(simd, Vec3::ZERO);
                    for lane in 0..out.len() {
                        rgb.set_lane(lane, self.sum_of_rays(at + lane));
                    }
                    words = encode_radiances(rgb / rays);
                }
                for (lane, target) in out.iter_mut().enumerate() {
                    let drawn = &self.drawn[at + lane];
                    let word = if is_plain { words[lane] } else { self.word(at + lane) };
                    *target = Pixel { word, distance_m: drawn.distance_m, hit: drawn.node };
                }
            }));
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
