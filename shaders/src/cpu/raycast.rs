//! Casts the rays of a frame (Vacca 2008, 3.5). This defines the appearance of a V-BlockMap. GPU twin: `raycast.wgsl`.
//!
//! In: [`SceneRef`]. Out: [`Pixels`]. Next: [`hit_counts`](super::hit_counts), an image file, or the window.
//!
//! A ray has one segment from the eye to the visible surface and, in sunlight, one from there towards the sun. Surfaces
//! with holes are gathered on the way and lit once. The GPU has no `count`: a variant of its pipeline counts.

use super::fast_math::floor;
use super::mesh::MIN_COSINE;
use super::night::{lamp_light, lit_windows};
use super::ray::{NodeRay, Ray, RayHit, RaySegment, SUN_LIFT_M};
pub use super::ray::{RayCounts, SceneRef};
use super::sea::{sea_share, with_sea_albedo};
use super::shade::{
    Airlight, Radiance, SurfaceSample, apply_haze, background, coast, encode_srgb, ground_distance, lit_normal,
    mirrored, sea, shade,
};
use super::stone::{StoneSurface, stone_surface};
use super::translucency::{MapAxes, gathered, map_of};
use super::walk::walk_scene;
use super::ward::{StoneSide, reflect_stone};
use crate::lanes::{F, Lanes, OneLane, U, Vec3s, always};
use crate::layout::{FrameUniform, GOLDEN_TURN, MAX_SAMPLES, NO_NODE, OUTLINE_RGB, PALETTE_OUTLINED, Shading};
use crate::mesh::ORIGINS_PER_M;
use crate::parallel::*;
use crate::stone::Stone;
use crate::tone::{develop, encode_radiance, gradient_noise};
use glam::{Vec2, Vec3};
use insula_protocol::blockmap::flag;
use std::f32::consts::TAU;

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
        self.colour = develop(frame, &words, &self.hit, &self.distance);
        self.radiance = if frame.shading == Shading::Lit as u32 { words } else { Vec::new() };
    }
}

/// Steps to the neighbours of a pixel, to the right and down.
const NEIGHBOURS: [[i32; 2]; 4] = [[-1, 0], [1, 0], [0, -1], [0, 1]];

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

/// Which pixels get all their rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sampling {
    #[default]
    Full,
    /// Those that differ from a neighbour; the others get the ray through their centre. Without packets, as [`Self::Full`].
    Adaptive,
}

/// One pixel's part of [`Pixels`].
#[derive(Debug, Clone, Copy)]
pub struct Pixel {
    /// Radiance of a lit frame, else colour.
    pub word: u32,
    /// Metres along the pixel's ray, infinity where no node was hit.
    pub distance_m: f32,
    /// Index of the node that was hit, or [`NO_NODE`].
    pub hit: u32,
}

impl Pixel {
    pub(super) const NOTHING: Self = Self { word: 0, distance_m: f32::INFINITY, hit: NO_NODE };
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
    let mut sum = RayCounts::default();
    let rows: Vec<RayCounts> = (0..height).into_par_iter().map(row).collect();
    rows.into_iter().for_each(|counts| sum += counts);
    sum
}

/// WGSL's entry point.
pub(super) fn pixel(scene: &SceneRef<'_>, [x, y]: [u32; 2]) -> Pixel {
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
    // The outline of an object is where the rays of a pixel disagree about it.
    let is_outline = outlined > 0 && (outlined < n * n || n == 1 && is_beside_other(scene, [x, y]));
    Pixel { word: pixel_word(scene.frame, sum, is_outline, object), distance_m, hit }
}

/// Whether the ray through the centre of one of the four neighbours of a pixel hits no outlined object. Such pixels are the outline in
/// frames of one ray a pixel.
pub(super) fn is_beside_other(scene: &SceneRef<'_>, [x, y]: [u32; 2]) -> bool {
    NEIGHBOURS.iter().any(|[right, down]| {
        let neighbour = [x.wrapping_add_signed(*right), y.wrapping_add_signed(*down)];
        let centre = Vec2::new(x as f32 + *right as f32, y as f32 + *down as f32) + 0.5;
        let mut ray = Ray::from_eye(scene, ray_direction(scene.frame, centre), threshold_of(neighbour, 1, 0));
        walk_scene(&mut ray);
        !ray.is_outlined(ray.hit.object)
    })
}

/// A pixel's word: the sum of the light of its rays, whether it belongs to an outline, and the object of its centre.
pub(super) fn pixel_word(frame: &FrameUniform, sum: Vec3, is_outline: bool, object: u32) -> u32 {
    let rays = frame.samples.clamp(1, MAX_SAMPLES).pow(2);
    if frame.shading == Shading::Objects as u32 {
        return object;
    }
    let rgb = if is_outline { Vec3::from(OUTLINE_RGB) } else { sum / rays as f32 };
    if frame.shading == Shading::Lit as u32 { encode_radiance(rgb) } else { encode_srgb(rgb) }
}

/// Light that all rays of a pixel share: air changes little within it.
struct PixelLight {
    /// Towards a point of the sun's disc.
    sun: Vec3,
    airlight: Airlight,
}

/// The sun's disc: radii across and along its height. Zero for hard shadows.
pub(super) fn sun_axes(frame: &FrameUniform) -> [Vec3; 2] {
    let across = Vec3::new(-frame.light.side[1], frame.light.side[0], 0.0) * frame.sun_radius;
    [across, across.cross(Vec3::from(frame.sun))]
}

/// A point of the sun's disc: the rays of a pixel go to points on a spiral (Vogel 1979), which is turned from pixel to pixel.
/// `area` is the share of the disc within the point.
pub(super) fn sun_direction(frame: &FrameUniform, axes: &[Vec3; 2], area: f32, turn: Vec2) -> Vec3 {
    Vec3::from(frame.sun) + (axes[0] * turn.x + axes[1] * turn.y) * area.sqrt()
}

/// From 0 to 4,095, as even as possible: an ordered pattern of 64 x 64 rays (Bayer 1973). Of 2 x 2 rays per pixel, the one
/// that reports the pixel's hit has the lowest.
pub(super) fn threshold_of([x, y]: [u32; 2], samples: u32, sample: u32) -> u32 {
    thresholds::<OneLane>([x, y], [sample % samples, sample / samples], samples)
}

/// The same of rays in columns and rows of their pixels.
#[inline(always)]
pub(super) fn thresholds<S: Lanes>([x, y]: [U<S>; 2], [column, row]: [U<S>; 2], samples: u32) -> U<S> {
    let (x, y) = (x * samples + column, y * samples + row + samples / 2);
    (order_of::<S>(x, y) << 6) | order_of::<S>(x >> 3, y >> 3)
}

/// The order of a place in a pattern of 8 x 8.
#[inline(always)]
fn order_of<S: Lanes>(x: U<S>, y: U<S>) -> U<S> {
    let a = x ^ y;
    ((a & 1) << 5) | ((y & 1) << 4) | ((a & 2) << 2) | ((y & 2) << 1) | ((a & 4) >> 1) | ((y & 4) >> 2)
}

fn ray_direction(frame: &FrameUniform, p_px: Vec2) -> Vec3 {
    ray_directions(OneLane, frame, [p_px.x, p_px.y]).into()
}

/// The same of rays through some places of the frame.
#[inline(always)]
pub(super) fn ray_directions<S: Lanes>(simd: S, frame: &FrameUniform, [x, y]: [F<S>; 2]) -> Vec3s<S> {
    let (x, y) = (x / frame.width_px as f32 * 2.0 - 1.0, y / frame.height_px as f32 * 2.0 - 1.0);
    let axis = always!(|v: [f32; 3]| Vec3s::splat(simd, v.into()));
    let dir = axis(frame.forward) + axis(frame.right).scale(x) - axis(frame.up).scale(y);
    dir.normalize_or(simd, Vec3s::splat(simd, Vec3::X))
}

/// Traces a ray from the eye, and one towards the sun from what it hit.
fn trace(scene: &SceneRef<'_>, dir: Vec3, pixel: &PixelLight, threshold: u32) -> TracedRay {
    let frame = scene.frame;
    let mut ray = Ray::from_eye(scene, dir, threshold);
    walk_scene(&mut ray);
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
        walk_scene(&mut ray);
        sun_share = if ray.hit.is_hit { 0.0 } else { 1.0 };
    }
    TracedRay {
        rgb: light.sky + light.sun * sun_share,
        distance_m: seen.distance_m,
        node: seen.node,
        object: seen.object,
        is_outlined: ray.is_outlined(seen.object),
        counts: ray.counts,
    }
}

impl<'a> Ray<'a> {
    fn from_eye(scene: &'a SceneRef<'a>, dir: Vec3, threshold: u32) -> Self {
        let segment = RaySegment { origin: Vec3::ZERO, dir, reach_m: f32::INFINITY, eye_m: 0.0, to_sun: false };
        let counts = RayCounts { rays: 1, ..RayCounts::default() };
        Ray { scene, segment, threshold, hit: RayHit::NOTHING, node: NodeRay::default(), counts }
    }

    /// Whether the object of this address of its word in a palette has an outline; 0 is no object.
    fn is_outlined(&mut self, object: u32) -> bool {
        object != 0 && self.read_word(object as usize) & PALETTE_OUTLINED != 0
    }
}

/// The stone with a number, from 1; `None` if there is none.
pub(super) fn stone_numbered(frame: &FrameUniform, number: u32) -> Option<&Stone> {
    frame.stones.get(number.checked_sub(1)? as usize).filter(|stone| stone.kind != 0)
}

/// Side of what a ray covers at a distance of one metre, in metres.
pub(super) fn pixel_m(frame: &FrameUniform) -> f32 {
    2.0 * Vec3::from(frame.up).length() / (frame.height_px * frame.samples.max(1)) as f32
}

/// What a stone shows where it was hit.
fn stone_at(frame: &FrameUniform, stone: &Stone, hit: &RayHit, surface: &SurfaceSample, dir: Vec3) -> StoneSurface {
    let cosine = surface.normal.dot(dir).abs().max(MIN_COSINE).sqrt();
    let footprint_m = hit.distance_m * pixel_m(frame) / cosine;
    stone_surface(stone, hit.stone_point, surface.normal, surface.ao, footprint_m)
}

/// Light of a surface of stone. Studies see the stone's colour as that of other surfaces.
fn light_of_stone(
    scene: &SceneRef<'_>,
    hit: &RayHit,
    surface: &SurfaceSample,
    dir: Vec3,
    found: &StoneSurface,
) -> Radiance {
    let frame = scene.frame;
    if frame.shading == Shading::Lit as u32 {
        let side = StoneSide { normal: surface.normal, ao: surface.ao, through: translucent_light(scene, hit, dir) };
        reflect_stone(frame, found, &side, dir)
    } else {
        shade(frame, &SurfaceSample { albedo: found.albedo, ..*surface })
    }
}

/// Light of the sun that comes through the stone that was hit; `None` if there is no translucency map of it.
fn translucent_light(scene: &SceneRef<'_>, hit: &RayHit, dir: Vec3) -> Option<Vec3> {
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
    radiance_with(scene, hit, dir, airlight, |stone, surface| stone_at(frame, stone, hit, surface, dir))
}

/// The same, with another way to evaluate a stone at a surface, whose normal has unit length.
pub(super) fn radiance_with(
    scene: &SceneRef<'_>,
    hit: &RayHit,
    dir: Vec3,
    airlight: &Airlight,
    evaluate: impl FnOnce(&Stone, &SurfaceSample) -> StoneSurface,
) -> Radiance {
    let frame = scene.frame;
    let RayHit { albedo, flags, level, distance_m, .. } = *hit;
    let ao = hit.ao.max(frame.light.sky_up[3]);
    let normal = hit.normal.normalize_or(-dir);
    let share = sea_share(frame, Some((albedo, normal)), dir * distance_m);
    if share >= 1.0 {
        return sea(frame, (dir, airlight), distance_m);
    }
    let stone = stone_numbered(frame, hit.stone);
    let normal = if stone.is_none() { lit_normal(frame, albedo, normal) } else { normal };
    let surface = SurfaceSample { albedo: with_sea_albedo(frame, albedo, normal, flags), ao, normal, flags, level };
    let mut light = match stone {
        Some(stone) => light_of_stone(scene, hit, &surface, dir, &evaluate(stone, &surface)),
        None => shade(frame, &surface),
    };
    if frame.shading == Shading::Lit as u32 {
        light.sky += lamp_light(scene, hit.node, &surface, dir * distance_m);
        if surface.flags & u32::from(flag::REFLECTIVE) != 0 {
            light = mirrored(frame, light, &surface, (dir, distance_m));
        }
        if frame.light.window[3] > 0.0 {
            light.sky += lit_windows(frame, dir * distance_m, surface.normal, distance_m);
        }
    }
    let land = apply_haze(frame, light, (dir, airlight), distance_m);
    coast(frame, land, share, (dir, airlight), distance_m)
}
