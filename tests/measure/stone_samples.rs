//! Draws a sphere and a block of each stone under sun and sky: `stone_samples OUT.png [STONE]`.
//!
//! With the name of a stone, the picture shows it alone, and larger.

use bytemuck::Zeroable;
use glam::{Vec2, Vec3};
use insula_shaders::{
    cpu::{
        shade::{Airlight, Radiance, SurfaceSample, background, shade},
        stone::stone_surface,
        ward::{StoneSide, reflect_stone},
    },
    layout::{FrameUniform, Light},
    light::Air,
    stone::{PRESETS, Stone},
    tone::{develop, encode_radiance},
};
use rayon::prelude::*;
use std::error::Error;

/// Side of a sample in pixels, and rays along a pixel's side.
const SIDE_PX: u32 = 480;
const RAYS: u32 = 3;
/// Rays by which a point finds its visible share of the sky.
const SKY_RAYS: u32 = 48;
const EYE: Vec3 = Vec3::new(0.25, -3.3, 1.55);
const TARGET: Vec3 = Vec3::new(0.05, 0.0, 0.52);
const TAN_HALF_FOV: f32 = 0.245;
const SPHERE: (Vec3, f32) = (Vec3::new(-0.45, -0.1, 0.42), 0.42);
const BLOCK: (Vec3, Vec3) = (Vec3::new(0.1, 0.0, 0.0), Vec3::new(0.72, 0.6, 1.05));
const SUN: Vec3 = Vec3::new(-0.55, -0.62, 0.56);

/// Where a ray meets a solid, or the ground.
struct Hit {
    distance_m: f32,
    normal: Vec3,
    is_ground: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("usage: stone_samples OUT.png [STONE]")?;
    let chosen = arguments.next();
    let stones: Vec<Stone> = PRESETS
        .iter()
        .filter(|(name, _)| chosen.as_deref().is_none_or(|chosen| chosen == *name))
        .map(|p| p.1)
        .collect();
    let (columns, side) = if stones.len() == 1 { (1, SIDE_PX * 2) } else { (3, SIDE_PX) };
    let rows = (stones.len() as u32).div_ceil(columns);
    let (width, height) = (columns * side, rows * side);
    let sun = SUN.normalize_or(Vec3::Z);
    let frame = FrameUniform {
        width_px: width,
        height_px: height,
        sun: sun.into(),
        shadow_m: 100.0,
        exposure: 1.1,
        light: Light::of_sun(sun, Air::default()),
        ..FrameUniform::zeroed()
    };
    let pixel = |i: u32| {
        let (x, y) = (i % width, i / width);
        let stone = stones.get((y / side * columns + x / side) as usize).unwrap_or(&Stone::NONE);
        encode_radiance(radiance(&frame, stone, [x % side, y % side], side))
    };
    let words: Vec<u32> = (0..width * height).into_par_iter().map(pixel).collect();
    let rgb =
        develop(&frame, &words, &[]).iter().flat_map(|word| [0, 8, 16].map(|shift| (word >> shift) as u8)).collect();
    image::RgbImage::from_raw(width, height, rgb).ok_or("the picture has no pixels")?.save(path)?;
    Ok(())
}

/// Mean radiance of a pixel.
fn radiance(frame: &FrameUniform, stone: &Stone, pixel: [u32; 2], side: u32) -> Vec3 {
    let forward = (TARGET - EYE).normalize_or(Vec3::Y);
    let right = forward.cross(Vec3::Z).normalize_or(Vec3::X);
    let up = right.cross(forward);
    let mut sum = Vec3::ZERO;
    for k in 0..RAYS * RAYS {
        let offset = (Vec2::new((k % RAYS) as f32, (k / RAYS) as f32) + 0.5) / RAYS as f32;
        let at = (Vec2::new(pixel[0] as f32, pixel[1] as f32) + offset) / side as f32 * 2.0 - 1.0;
        let dir = (forward + (right * at.x - up * at.y) * TAN_HALF_FOV).normalize_or(forward);
        // A pixel's rays share its area.
        let ray_m = 2.0 * TAN_HALF_FOV / (side * RAYS) as f32;
        let light = ray_light(frame, stone, dir, ray_m);
        sum += light.sky + light.sun;
    }
    sum / (RAYS * RAYS) as f32
}

fn ray_light(frame: &FrameUniform, stone: &Stone, dir: Vec3, ray_m: f32) -> Radiance {
    let Some(hit) = trace(EYE, dir) else { return background(frame, dir, &Airlight::new(frame, dir)) };
    let (p, n) = (EYE + dir * hit.distance_m, hit.normal);
    let start = p + n * 1e-3;
    let ao = sky_share(start, n);
    let mut light = if hit.is_ground {
        let albedo = Vec3::new(0.30, 0.285, 0.26) * pavement(p * 1.6);
        shade(frame, &SurfaceSample { albedo, ao, normal: n, flags: 0, level: 0 })
    } else {
        let surface = stone_surface(stone, p, n, ao, hit.distance_m * ray_m);
        reflect_stone(frame, &surface, &StoneSide::opaque(n, ao), dir)
    };
    if trace(start, Vec3::from(frame.sun)).is_some() {
        light.sun = Vec3::ZERO;
    }
    light
}

/// Slabs with dark joints.
fn pavement(p: Vec3) -> f32 {
    let part = (p - p.floor() - 0.5).abs();
    if part.x.max(part.y) > 0.49 { 0.6 } else { 1.0 }
}

/// Share of the sky by directions on a spiral, denser towards the normal.
fn sky_share(p: Vec3, n: Vec3) -> f32 {
    let (a, b) = n.any_orthonormal_pair();
    let is_open = |k: u32| {
        let (height, angle) = ((k as f32 + 0.5) / SKY_RAYS as f32, k as f32 * 2.399_963);
        let dir = (a * angle.cos() + b * angle.sin()) * height.sqrt() + n * (1.0 - height).sqrt();
        dir.z > 0.0 && trace(p, dir).is_none()
    };
    (0..SKY_RAYS).filter(|k| is_open(*k)).count() as f32 / SKY_RAYS as f32
}

fn trace(from: Vec3, dir: Vec3) -> Option<Hit> {
    let ground = (dir.z < -1e-5).then(|| Hit { distance_m: -from.z / dir.z, normal: Vec3::Z, is_ground: true });
    let hits = [sphere(from, dir), block(from, dir), ground];
    hits.into_iter().flatten().filter(|hit| hit.distance_m > 0.0).min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}

fn sphere(from: Vec3, dir: Vec3) -> Option<Hit> {
    let (offset, radius) = (from - SPHERE.0, SPHERE.1);
    let along = offset.dot(dir);
    let root = along * along - offset.length_squared() + radius * radius;
    let distance_m = (root >= 0.0).then(|| -along - root.sqrt())?;
    Some(Hit { distance_m, normal: (offset + dir * distance_m) / radius, is_ground: false })
}

fn block(from: Vec3, dir: Vec3) -> Option<Hit> {
    let (low, high) = ((BLOCK.0 - from) / dir, (BLOCK.1 - from) / dir);
    let (enter, leave) = (low.min(high), low.max(high));
    let distance_m = enter.max_element();
    let is_hit = distance_m < leave.min_element() && distance_m > 0.0;
    let axis = [Vec3::X, Vec3::Y, Vec3::Z][enter.max_position()];
    is_hit.then(|| Hit { distance_m, normal: -axis * dir.dot(axis).signum(), is_ground: false })
}
