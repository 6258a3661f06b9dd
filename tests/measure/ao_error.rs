//! Measures occlusion from depth maps: its error against rays, its time, and how far CPU and GPU differ.
//!
//! `cargo run --release -p insula-measure --bin ao_error -- MESH... [--rays N] [--map PX]` prints a row
//! for each mesh (PLY, OFF, OBJ) and for a generated block of a city. Without the feature, the GPU's columns are empty.
//! `--truth FOLDER` keeps the traced values there, as f32.

use glam::{DVec3, Vec3A};
use insula_occlusion::{OccludedMesh, OcclusionSettings, cpu};
use insula_simplify::model::{ModelFormat, TriangleModel};
use obvhs::{BvhBuildParams, cwbvh::builder::build_cwbvh_from_tris, ray::Ray, triangle::Triangle};
use rayon::prelude::*;
use std::{
    error::Error,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// Where a ray starts above its vertex, in parts of the diagonal.
const LIFT: f32 = 1e-5;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut rays, mut map_px, mut truth_folder, mut paths) = (4096, 1024, None, Vec::new());
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--rays" => rays = value()?.parse()?,
            "--map" => map_px = value()?.parse()?,
            "--truth" => truth_folder = Some(PathBuf::from(value()?)),
            _ => paths.push(PathBuf::from(argument)),
        }
    }
    println!("{rays} rays a vertex, maps of {map_px} texels, {} threads", rayon::current_num_threads());
    println!(
        "mesh, vertices, triangles | views, RMS, mean, largest error, CPU s | GPU s, vertices beyond 1/255 of the CPU's"
    );
    for path in &paths {
        let format = ModelFormat::of(path).ok_or("expected PLY, OFF, OBJ or STL")?;
        let mut model = TriangleModel::read(&std::fs::read(path)?, format)?;
        model.weld();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        measure(&name, &model, rays, map_px, truth_folder.as_deref())?;
    }
    measure("city", &city(), rays, map_px, truth_folder.as_deref())
}

fn measure(
    name: &str,
    model: &TriangleModel,
    rays: u32,
    map_px: u32,
    truth_folder: Option<&Path>,
) -> Result<(), Box<dyn Error>> {
    let truth = trace(model, rays);
    if let Some(folder) = truth_folder {
        let bytes: Vec<u8> = truth.iter().flat_map(|share| share.to_le_bytes()).collect();
        std::fs::write(folder.join(format!("{name}.f32")), bytes)?;
    }
    let mesh = OccludedMesh { positions: &model.positions, triangles: &model.triangles };
    for views in [64, 256] {
        let settings = OcclusionSettings { views, map_px, bent_normals: false };
        let start = Instant::now();
        let found = cpu(mesh, &[], settings, &|_| true)?;
        let seconds = start.elapsed().as_secs_f64();
        let count = truth.len().max(1) as f64;
        let off = || found.share.iter().zip(&truth).map(|(a, b)| f64::from(a - b));
        println!(
            "{name}, {}, {} | {views}, {:.4}, {:+.4}, {:.3}, {seconds:.3} | {}",
            model.positions.len(),
            model.triangles.len(),
            (off().map(|v| v * v).sum::<f64>() / count).sqrt(),
            off().sum::<f64>() / count,
            off().fold(0.0, |most: f64, v| most.max(v.abs())),
            on_gpu(mesh, settings, &found.share)?
        );
    }
    Ok(())
}

fn on_gpu(mesh: OccludedMesh<'_>, settings: OcclusionSettings, share: &[f32]) -> Result<String, Box<dyn Error>> {
    let start = Instant::now();
    let found = insula_occlusion::gpu(mesh, &[], settings, &|_| true)?;
    let seconds = start.elapsed().as_secs_f64();
    let beyond = found.share.iter().zip(share).filter(|(a, b)| (**a - **b).abs() > 1.0 / 255.0).count();
    Ok(format!("{seconds:.3}, {beyond} ({:.4}%)", beyond as f64 * 100.0 / share.len().max(1) as f64))
}

/// For each vertex the share of cosine-weighted rays that hit nothing.
fn trace(model: &TriangleModel, rays: u32) -> Vec<f32> {
    let corners = || model.positions.iter().map(|p| DVec3::from(*p));
    let (low, high) = (corners().fold(DVec3::INFINITY, DVec3::min), corners().fold(DVec3::NEG_INFINITY, DVec3::max));
    let (centre, diagonal) = ((low + high) / 2.0, low.distance(high).max(f64::MIN_POSITIVE));
    let places: Vec<DVec3> = corners().map(|p| (p - centre) / diagonal).collect();
    let mut normals = vec![DVec3::ZERO; places.len()];
    for triangle in &model.triangles {
        let p = triangle.map(|vertex| places[vertex as usize]);
        let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
        for k in 0..3 {
            let [a, b] = [p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]];
            normals[triangle[k] as usize] +=
                normal * a.normalize_or_zero().dot(b.normalize_or_zero()).clamp(-1.0, 1.0).acos();
        }
    }
    let local = |vertex: u32| places[vertex as usize].as_vec3a();
    let boxed = |t: &[u32; 3]| Triangle { v0: local(t[0]), v1: local(t[1]), v2: local(t[2]) };
    let all: Vec<Triangle> = model.triangles.iter().map(boxed).collect();
    let bvh = build_cwbvh_from_tris(&all, BvhBuildParams::medium_build(), &mut Duration::default());
    let share = |vertex: usize| {
        let Some(normal) = normals[vertex].try_normalize().map(|normal| normal.as_vec3a()) else { return 1.0 };
        let (right, up) = normal.any_orthonormal_pair();
        let start = local(vertex as u32) + normal * LIFT;
        // Each vertex turns the rays by another angle, so that errors of neighbours do not agree.
        let turn = vertex as f32 * 0.754_877_7 % 1.0;
        let is_open = |i: &u32| {
            let height = (*i as f32 + 0.5) / rays as f32;
            let (sin, cos) = ((*i as f32 * 0.618_034 + turn) % 1.0 * std::f32::consts::TAU).sin_cos();
            let direction: Vec3A = (right * cos + up * sin) * height.sqrt() + normal * (1.0 - height).sqrt();
            let mut is_hit = false;
            bvh.ray_traverse_anyhit(Ray::new_inf(start, direction.normalize()), |ray, at| {
                is_hit |= all[bvh.primitive_indices[at] as usize].intersect(ray) < f32::INFINITY;
            });
            !is_hit
        };
        (0..rays).filter(is_open).count() as f32 / rays as f32
    };
    (0..places.len()).into_par_iter().map(share).collect()
}

/// 36 buildings of 6 to 40 m on ground, with a vertex each 2 m or so. Walls reach below the ground.
fn city() -> TriangleModel {
    let mut model = TriangleModel::default();
    add_grid(&mut model, DVec3::new(-15.0, -15.0, 0.0), DVec3::X * 210.0, DVec3::Y * 210.0);
    for i in 0..36u32 {
        let corner = DVec3::new(f64::from(i % 6) * 30.0, f64::from(i / 6) * 30.0, -1.0);
        let size = DVec3::new(f64::from(12 + i * 7 % 11), f64::from(12 + i * 5 % 9), f64::from(7 + i * 13 % 35));
        let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
        add_grid(&mut model, corner, x, z);
        add_grid(&mut model, corner + x, y, z);
        add_grid(&mut model, corner + x + y, -x, z);
        add_grid(&mut model, corner + y, -y, z);
        add_grid(&mut model, corner + z, x, y);
    }
    model
}

/// A rectangle between two edges, which does not share vertices with others.
fn add_grid(model: &mut TriangleModel, corner: DVec3, a: DVec3, b: DVec3) {
    let [n, m] = [a, b].map(|edge| (edge.length() / 2.0).ceil() as u32);
    let first = model.positions.len() as u32;
    for j in 0..=m {
        let row = |i: u32| (corner + a * f64::from(i) / f64::from(n) + b * f64::from(j) / f64::from(m)).to_array();
        model.positions.extend((0..=n).map(row));
    }
    for (i, j) in (0..m).flat_map(|j| (0..n).map(move |i| (i, j))) {
        let at = first + j * (n + 1) + i;
        model.triangles.extend([[at, at + 1, at + n + 2], [at, at + n + 2, at + n + 1]]);
    }
}
