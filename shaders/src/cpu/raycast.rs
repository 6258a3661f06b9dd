//! Casts the rays of a frame (Vacca 2008, 3.5). This defines the appearance of a V-BlockMap. GPU twin: `raycast.wgsl`.
//!
//! In: [`SceneRef`]. Out: [`Pixels`]. Next: [`hit_counts`](super::hit_counts), an image file, or the window.
//!
//! A ray has one segment from the eye to the visible surface and, in sunlight, one from there towards the sun. Surfaces
//! with holes are gathered on the way and lit once. The GPU has no `count`: a variant of its pipeline counts.

pub use super::ray::{RayCounts, SceneRef};

use super::{
    fast_math::floor,
    mesh::MIN_COSINE,
    night::lit_windows,
    ray::{NodeRay, Ray, RayHit, RaySegment, SUN_LIFT_M},
    shade::{Airlight, Radiance, SurfaceSample, apply_haze, background, encode_srgb, ground_distance, mirrored, shade},
    stone::stone_surface,
    translucency::{MapAxes, gathered},
    translucency_map::map_of,
    walk::walk_grid,
    ward::{StoneSide, reflect_stone},
};
use crate::{
    layout::{FrameUniform, MAX_SAMPLES, NO_NODE, OUTLINE_RGB, PALETTE_OUTLINED, Shading},
    mesh::ORIGINS_PER_M,
    tone::{develop, encode_radiance, gradient_noise},
};
use glam::{Vec2, Vec3};
use insula_protocol::blockmap::flag;
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Cosine and sine of the turn between neighbouring points of an even spiral over a disc: 137.5 degrees.
pub(crate) const GOLDEN_TURN: Vec2 = Vec2::new(-0.737_368_9, 0.675_490_3);

/// A finished frame, row by row from the top.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Pixels {
    pub width_px: u32,
    pub height_px: u32,
    /// r, g, b, 255 in sRGB, r lowest.
    pub colour: Vec<u32>,
    /// Metres along the pixel's ray, infinity where no node was hit.
    pub distance: Vec<f32>,
    /// Index of the node that was hit, or [`NO_NODE`].
    pub hit: Vec<u32>,
    /// Radiances of a lit frame ([`crate::tone::decode_radiance`]); empty with other shadings.
    pub radiance: Vec<u32>,
}

impl Pixels {
    /// Sets colours and radiances from the ray-caster's words.
    pub(crate) fn set_words(&mut self, frame: &FrameUniform, words: Vec<u32>) {
        self.colour = develop(frame, &words);
        self.radiance = if frame.shading == Shading::Lit as u32 { words } else { Vec::new() };
    }
}

/// A ray that has ended.
struct TracedRay {
    rgb: Vec3,
    distance_m: f32,
    node: u32,
    /// Address of its object's word in a palette, or 0.
    object: u32,
    is_outlined: bool,
    counts: RayCounts,
}

/// One pixel's part of [`Pixels`].
struct Pixel {
    /// Radiance of a lit frame, else colour.
    word: u32,
    distance_m: f32,
    hit: u32,
}

/// Renders the whole frame on all cores. Words that point outside of the arrays read as zero.
pub fn render(scene: &SceneRef<'_>) -> Pixels {
    let mut rows = RenderedRows::default();
    rows.render(scene, scene.frame.height_px);
    rows.develop(scene.frame)
}

/// The upper rows of a frame that is rendered in steps, so that a caller can do something else meanwhile.
#[derive(Debug, Default)]
pub struct RenderedRows {
    /// Number of rendered rows.
    rows: u32,
    words: Vec<u32>,
    distance: Vec<f32>,
    hit: Vec<u32>,
}

impl RenderedRows {
    /// Renders the next `count` rows on all cores. Returns whether all rows are rendered. The scene must be the same in each step.
    pub fn render(&mut self, scene: &SceneRef<'_>, count: u32) -> bool {
        let (width_px, height_px) = (scene.frame.width_px, scene.frame.height_px);
        let end = self.rows.saturating_add(count).min(height_px);
        let row = |y: u32| (0..width_px).map(|x| pixel(scene, [x, y])).collect();
        let rows: Vec<Vec<Pixel>> = (self.rows..end).into_par_iter().map(row).collect();
        for pixel in rows.into_iter().flatten() {
            self.words.push(pixel.word);
            self.distance.push(pixel.distance_m);
            self.hit.push(pixel.hit);
        }
        self.rows = end;
        end == height_px
    }

    /// Appends rows that were rendered elsewhere: the words and hits that [`render_row`] gives. Distances are not known. Returns
    /// whether all rows of `frame` are there.
    pub fn append(&mut self, frame: &FrameUniform, words: &[u32], hit: &[u32]) -> bool {
        self.words.extend_from_slice(words);
        self.hit.extend_from_slice(hit);
        self.rows = self.words.len() as u32 / frame.width_px.max(1);
        self.rows >= frame.height_px
    }

    /// Number of rendered rows.
    pub fn rows(&self) -> u32 {
        self.rows
    }

    /// The pixels of `frame`, of which all rows were rendered.
    pub fn develop(self, frame: &FrameUniform) -> Pixels {
        let Self { words, distance, hit, .. } = self;
        let mut out =
            Pixels { width_px: frame.width_px, height_px: frame.height_px, distance, hit, ..Pixels::default() };
        out.set_words(frame, words);
        out
    }
}

/// Renders one row on this thread. Appends a word (radiance of a lit frame, else colour) and the node that was hit for each pixel.
pub fn render_row(scene: &SceneRef<'_>, y: u32, words: &mut Vec<u32>, hit: &mut Vec<u32>) {
    for x in 0..scene.frame.width_px {
        let pixel = pixel(scene, [x, y]);
        words.push(pixel.word);
        hit.push(pixel.hit);
    }
}

/// Work of the rays through the pixels' centres.
pub fn count(scene: &SceneRef<'_>) -> RayCounts {
    count_where(scene, |_| true)
}

/// The same for the pixels that `is_counted` selects by their number, row by row from the top.
pub fn count_where(scene: &SceneRef<'_>, is_counted: impl Fn(usize) -> bool + Sync) -> RayCounts {
    let (width, height) = (scene.frame.width_px, scene.frame.height_px);
    let row = |y: u32| {
        let mut sum = RayCounts::default();
        for x in (0..width).filter(|x| is_counted((y * width + x) as usize)) {
            let dir = ray_direction(scene.frame, Vec2::new(x as f32, y as f32) + 0.5);
            let light = PixelLight { sun: scene.frame.sun.into(), airlight: Airlight::new(scene.frame, dir) };
            sum += trace(scene, dir, &light, threshold_of([x, y], 1, 0)).counts;
        }
        sum
    };
    let add = |mut a: RayCounts, b: RayCounts| {
        a += b;
        a
    };
    (0..height).into_par_iter().map(row).reduce(RayCounts::default, add)
}

/// WGSL's entry point.
fn pixel(scene: &SceneRef<'_>, [x, y]: [u32; 2]) -> Pixel {
    let n = scene.frame.samples.clamp(1, MAX_SAMPLES);
    let mut sum = Vec3::ZERO;
    let (mut distance_m, mut hit, mut object) = (f32::INFINITY, NO_NODE, 0);
    let mut outlined = 0;
    let airlight = Airlight::new(scene.frame, ray_direction(scene.frame, Vec2::new(x as f32, y as f32) + 0.5));
    let sun_axes = sun_axes(scene.frame);
    let mut turn = Vec2::from_angle(TAU * gradient_noise(x, y));
    for s in 0..n * n {
        let offset = (Vec2::new((s % n) as f32, (s / n) as f32) + 0.5) / n as f32;
        let dir = ray_direction(scene.frame, Vec2::new(x as f32, y as f32) + offset);
        let sun = sun_direction(scene.frame, &sun_axes, (s as f32 + 0.5) / (n * n) as f32, turn);
        turn = turn.rotate(GOLDEN_TURN);
        let traced = trace(scene, dir, &PixelLight { sun, airlight }, threshold_of([x, y], n, s));
        sum += traced.rgb;
        outlined += u32::from(traced.is_outlined);
        if s == n * n / 2 {
            (distance_m, hit, object) = (traced.distance_m, traced.node, traced.object);
        }
    }
    if scene.frame.shading == Shading::Objects as u32 {
        return Pixel { word: object, distance_m, hit };
    }
    // The outline of an object is where the rays of a pixel disagree about it.
    let is_outline = outlined > 0 && outlined < n * n;
    let rgb = if is_outline { Vec3::from(OUTLINE_RGB) } else { sum / (n * n) as f32 };
    let is_lit = scene.frame.shading == Shading::Lit as u32;
    Pixel { word: if is_lit { encode_radiance(rgb) } else { encode_srgb(rgb) }, distance_m, hit }
}

/// Light that all rays of a pixel share: air changes little within it.
struct PixelLight {
    /// Towards a point of the sun's disc.
    sun: Vec3,
    airlight: Airlight,
}

/// The sun's disc: radii across and along its height. Zero for hard shadows.
fn sun_axes(frame: &FrameUniform) -> [Vec3; 2] {
    let across = Vec3::new(-frame.light.side[1], frame.light.side[0], 0.0) * frame.sun_radius;
    [across, across.cross(Vec3::from(frame.sun))]
}

/// A point of the sun's disc: the rays of a pixel go to points on a spiral (Vogel 1979), which is turned from pixel to pixel.
/// `area` is the share of the disc within the point.
fn sun_direction(frame: &FrameUniform, axes: &[Vec3; 2], area: f32, turn: Vec2) -> Vec3 {
    Vec3::from(frame.sun) + (axes[0] * turn.x + axes[1] * turn.y) * area.sqrt()
}

/// From 0 to 63, as even as possible: an ordered pattern of 8 x 8 rays (Bayer 1973). Of 2 x 2 rays per pixel, the one
/// that reports the pixel's hit has the lowest.
pub(super) fn threshold_of([x, y]: [u32; 2], samples: u32, sample: u32) -> u32 {
    let (x, y) = (x * samples + sample % samples, y * samples + sample / samples + samples / 2);
    let a = x ^ y;
    (a & 1) << 5 | (y & 1) << 4 | (a & 2) << 2 | (y & 2) << 1 | (a & 4) >> 1 | (y & 4) >> 2
}

fn ray_direction(frame: &FrameUniform, p_px: Vec2) -> Vec3 {
    let ndc = p_px / Vec2::new(frame.width_px as f32, frame.height_px as f32) * 2.0 - 1.0;
    (Vec3::from(frame.forward) + Vec3::from(frame.right) * ndc.x - Vec3::from(frame.up) * ndc.y).normalize_or(Vec3::X)
}

/// Traces a ray from the eye, and one towards the sun from what it hit.
fn trace(scene: &SceneRef<'_>, dir: Vec3, pixel: &PixelLight, threshold: u32) -> TracedRay {
    let frame = scene.frame;
    let segment = RaySegment { origin: Vec3::ZERO, dir, reach_m: f32::INFINITY, eye_m: 0.0, to_sun: false };
    let counts = RayCounts { rays: 1, ..RayCounts::default() };
    let mut ray = Ray { scene, segment, threshold, hit: RayHit::NOTHING, node: NodeRay::default(), counts };
    if frame.levels != 0 {
        walk_grid(&mut ray);
    }
    let mut seen = ray.hit;
    let airlight = &pixel.airlight;
    let (light, eye_m) = if seen.is_hit {
        (radiance_of(scene, &seen, dir, airlight), seen.distance_m)
    } else {
        let eye_m = ground_distance(frame, dir);
        seen.shadow_origin = dir * eye_m + Vec3::Z * SUN_LIFT_M;
        (background(frame, dir, airlight), eye_m)
    };
    let mut sun_share = 1.0;
    // Nothing shadows the sky.
    if frame.shadow_m > 0.0 && light.sun.max_element() > 0.0 && eye_m < f32::INFINITY {
        let origin = seen.shadow_origin.map(|v| floor(v * ORIGINS_PER_M + 0.5) as f32 / ORIGINS_PER_M);
        ray.segment = RaySegment { origin, dir: pixel.sun, reach_m: frame.shadow_m, eye_m, to_sun: true };
        ray.hit = RayHit::NOTHING;
        if frame.levels != 0 {
            walk_grid(&mut ray);
        }
        sun_share = if ray.hit.is_hit { 0.0 } else { 1.0 };
    }
    TracedRay {
        rgb: light.sky + light.sun * sun_share,
        distance_m: seen.distance_m,
        node: seen.node,
        object: seen.object,
        is_outlined: seen.object != 0 && ray.read_word(seen.object as usize) & PALETTE_OUTLINED != 0,
        counts: ray.counts,
    }
}

/// Light of a surface of stone; `None` if it is of none. Studies see the stone's colour as that of other surfaces.
fn stone_of(scene: &SceneRef<'_>, hit: &RayHit, surface: &SurfaceSample, dir: Vec3) -> Option<Radiance> {
    let frame = scene.frame;
    let stone = frame.stones.get(hit.stone.checked_sub(1)? as usize).filter(|stone| stone.kind != 0)?;
    let pixel = 2.0 * Vec3::from(frame.up).length() / (frame.height_px * frame.samples.max(1)) as f32;
    let cosine = surface.normal.dot(dir).abs().max(MIN_COSINE).sqrt();
    let footprint_m = hit.distance_m * pixel / cosine;
    let found = stone_surface(stone, hit.stone_point, surface.normal, surface.ao, footprint_m);
    if frame.shading == Shading::Lit as u32 {
        let side = StoneSide { normal: surface.normal, ao: surface.ao, through: light_through(scene, hit, dir) };
        Some(reflect_stone(frame, &found, &side, dir))
    } else {
        Some(shade(frame, &SurfaceSample { albedo: found.albedo, ..*surface }))
    }
}

/// Light of the sun that comes through the stone that was hit; `None` if there is no translucency map of it.
fn light_through(scene: &SceneRef<'_>, hit: &RayHit, dir: Vec3) -> Option<Vec3> {
    if scene.frame.translucent == 0 {
        return None;
    }
    let point = dir * hit.distance_m;
    let map = map_of(&scene.frame.translucency, point - hit.stone_point)?;
    let axes = MapAxes::new(scene.frame.sun.into(), Vec2::from(scene.frame.light.side));
    Some(gathered(scene.atlas, map, &axes, point))
}

/// Light of the surface that was hit.
fn radiance_of(scene: &SceneRef<'_>, hit: &RayHit, dir: Vec3, airlight: &Airlight) -> Radiance {
    let frame = scene.frame;
    let RayHit { albedo, ao, flags, level, distance_m, .. } = *hit;
    let surface = SurfaceSample { albedo, ao, normal: hit.normal.normalize_or(-dir), flags, level };
    let mut light = match stone_of(scene, hit, &surface, dir) {
        Some(light) => light,
        None => shade(frame, &surface),
    };
    if frame.shading == Shading::Lit as u32 {
        if surface.flags & u32::from(flag::REFLECTIVE) != 0 {
            light = mirrored(frame, light, &surface, dir);
        }
        if frame.light.window[3] > 0.0 {
            light.sky += lit_windows(frame, dir * distance_m, surface.normal, distance_m);
        }
    }
    apply_haze(frame, light, airlight, distance_m)
}
