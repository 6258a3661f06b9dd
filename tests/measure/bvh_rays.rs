//! Casts one ray a pixel with the crate obvhs: a hierarchy of eight wide boxes over triangles, single rays.
//!
//! `bvh_rays TRIANGLES WIDTH HEIGHT ROUNDS THREADS CAMERA`: as `tests/tools/embree/rays.cpp`, beside which `run.py` runs it.

use anyhow::{Context, Result, bail, ensure};
use glam::Vec3A;
use obvhs::{
    BvhBuildParams,
    cwbvh::{CwBvh, builder::build_cwbvh_from_tris},
    ray::{Ray, RayHit},
    triangle::Triangle,
};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Nine floats.
const TRIANGLE_BYTES: usize = 36;
const BAND_ROWS: usize = 16;

struct Camera {
    eye: Vec3A,
    forward: Vec3A,
    /// To the right and upper edge of the picture, at a distance of one.
    right: Vec3A,
    up: Vec3A,
}

struct Scene {
    triangles: Vec<Triangle>,
    bvh: CwBvh,
    sun: Vec3A,
}

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [file, width, height, rounds, threads, camera] = &args[..] else {
        bail!("usage: bvh_rays TRIANGLES WIDTH HEIGHT ROUNDS THREADS NAME,X,Y,Z,TARGET_X,TARGET_Y,TARGET_Z,FOV_DEGREES")
    };
    let (width, height): (usize, usize) = (width.parse()?, height.parse()?);
    let (rounds, threads): (usize, usize) = (rounds.parse()?, threads.parse()?);
    let camera = parse_camera(camera, width as f32 / height as f32)?;
    let triangles = read_triangles(file)?;
    let begin = Instant::now();
    let bvh = build_cwbvh_from_tris(&triangles, BvhBuildParams::slow_build(), &mut Duration::default());
    let build_s = begin.elapsed().as_secs_f64();
    let scene = Scene { triangles, bvh, sun: Vec3A::new(-0.45, -0.55, 0.71).normalize() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let mut image = vec![0.0; width * height];
    let mut best_s = f64::INFINITY;
    for _ in 0..rounds {
        let begin = Instant::now();
        pool.install(|| draw(&scene, &camera, [width, height], &mut image));
        best_s = best_s.min(begin.elapsed().as_secs_f64());
    }
    let hit = image.iter().filter(|light| **light != 0.0).count();
    ensure!(hit > 0, "nothing was drawn");
    let mrays = (width * height) as f64 / best_s / 1e6;
    println!("{{\"triangles\":{},\"build_s\":{build_s:.2},\"single_mrays\":{mrays:.2}}}", scene.triangles.len());
    Ok(())
}

fn parse_camera(text: &str, aspect: f32) -> Result<Camera> {
    let numbers = text.split(',').skip(1).map(str::parse).collect::<Result<Vec<f32>, _>>()?;
    let [x, y, z, to_x, to_y, to_z, fov_deg] = numbers[..] else {
        bail!("a camera is a name and seven numbers: {text}")
    };
    let eye = Vec3A::new(x, y, z);
    let forward = (Vec3A::new(to_x, to_y, to_z) - eye).try_normalize().context("the camera looks nowhere")?;
    let right = forward.cross(Vec3A::Z).try_normalize().context("the camera looks straight up or down")?;
    let tan = (fov_deg.to_radians() / 2.0).tan();
    Ok(Camera { eye, forward, right: right * tan * aspect, up: right.cross(forward) * tan })
}

fn read_triangles(file: &str) -> Result<Vec<Triangle>> {
    let bytes = std::fs::read(file).with_context(|| file.to_owned())?;
    let (all, rest) = bytes.as_chunks::<TRIANGLE_BYTES>();
    ensure!(rest.is_empty(), "{file} has no whole number of triangles");
    let corner = |bytes: &[u8; TRIANGLE_BYTES], corner: usize| {
        let (numbers, _) = bytes.as_chunks::<4>();
        Vec3A::from_array([0, 1, 2].map(|axis| f32::from_le_bytes(numbers[3 * corner + axis])))
    };
    Ok(all.iter().map(|t| Triangle { v0: corner(t, 0), v1: corner(t, 1), v2: corner(t, 2) }).collect())
}

/// Bands of rows, which threads take as they become free.
fn draw(scene: &Scene, camera: &Camera, [width, height]: [usize; 2], image: &mut [f32]) {
    image.par_chunks_mut(width * BAND_ROWS).enumerate().for_each(|(band, rows)| {
        for (i, pixel) in rows.iter_mut().enumerate() {
            let (x, y) = (i % width, band * BAND_ROWS + i / width);
            let right = (x as f32 + 0.5) / width as f32 * 2.0 - 1.0;
            let down = (y as f32 + 0.5) / height as f32 * 2.0 - 1.0;
            let direction = (camera.forward + camera.right * right - camera.up * down).normalize();
            *pixel = light(scene, Ray::new_inf(camera.eye, direction));
        }
    });
}

/// One product for what is hit; the sky is as bright as its height.
fn light(scene: &Scene, ray: Ray) -> f32 {
    let triangle = |id: usize| &scene.triangles[scene.bvh.primitive_indices[id] as usize];
    let mut hit = RayHit::none();
    if !scene.bvh.ray_traverse(ray, &mut hit, |ray, id| triangle(id).intersect(ray)) {
        return 0.5 + 0.5 * ray.direction.z;
    }
    let normal = triangle(hit.primitive_id as usize).compute_normal();
    let towards = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
    0.2 + 0.8 * towards.dot(scene.sun).max(0.0)
}
