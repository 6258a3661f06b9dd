//! Compares occlusion from depth maps with rays.
use glam::{DVec3, Vec3A};
use insula_bake::model::{ModelFormat, TriangleModel};
use insula_occlusion::{OccludedMesh, OcclusionSettings};
use obvhs::{BvhBuildParams, cwbvh::builder::build_cwbvh_from_tris, ray::Ray, triangle::Triangle};
use rayon::prelude::*;
use std::time::{Duration, Instant};

const RAYS: u32 = 4096;
fn reference(model: &TriangleModel) -> Vec<f32> {
    let p = |v: u32| DVec3::from(model.positions[v as usize]);
    let lo = model.positions.iter().fold(DVec3::INFINITY, |a, b| a.min(DVec3::from(*b)));
    let hi = model.positions.iter().fold(DVec3::NEG_INFINITY, |a, b| a.max(DVec3::from(*b)));
    let c = (lo + hi) / 2.0;
    let scale = 1.0 / (hi - lo).length();
    let tris: Vec<Triangle> = model
        .triangles
        .iter()
        .map(|t| {
            let [a, b, d] = t.map(|v| Vec3A::from(((p(v) - c) * scale).as_vec3()));
            Triangle { v0: a, v1: b, v2: d }
        })
        .collect();
    let bvh = build_cwbvh_from_tris(&tris, BvhBuildParams::medium_build(), &mut Duration::default());
    let mut sums = vec![DVec3::ZERO; model.positions.len()];
    for t in &model.triangles {
        let q = t.map(p);
        let n = (q[1] - q[0]).cross(q[2] - q[0]).normalize_or_zero();
        for k in 0..3 {
            let a = (q[(k + 1) % 3] - q[k]).normalize_or_zero();
            let b = (q[(k + 2) % 3] - q[k]).normalize_or_zero();
            sums[t[k] as usize] += n * a.dot(b).clamp(-1.0, 1.0).acos();
        }
    }
    (0..model.positions.len())
        .into_par_iter()
        .map(|v| {
            let n = Vec3A::from(sums[v].normalize_or_zero().as_vec3());
            if n == Vec3A::ZERO {
                return 1.0;
            }
            let (t, b) = n.any_orthonormal_pair();
            let o = Vec3A::from(((p(v as u32) - c) * scale).as_vec3()) + n * 1e-5;
            let spin = (v as f32 * 0.618034).fract();
            let mut open = 0u32;
            for i in 0..RAYS {
                let u = (i as f32 + 0.5) / RAYS as f32;
                let (s, co) = (std::f32::consts::TAU * ((i as f32 * 0.618_034 + spin).fract())).sin_cos();
                let r = u.sqrt();
                let d = (t * (r * co) + b * (r * s) + n * (1.0 - u).sqrt()).normalize();
                let mut hit = false;
                let ray = Ray::new(o, d, 0.0, f32::INFINITY);
                bvh.ray_traverse_anyhit(ray, |ray, id| {
                    if tris[bvh.primitive_indices[id] as usize].intersect(ray) < f32::INFINITY {
                        hit = true;
                    }
                });
                open += u32::from(!hit);
            }
            open as f32 / RAYS as f32
        })
        .collect()
}
fn main() {
    let bench = std::env::var("BENCH").is_ok();
    for path in std::env::args().skip(1) {
        let path = std::path::Path::new(&path);
        let mut model = TriangleModel::read(&std::fs::read(path).unwrap(), ModelFormat::of(path).unwrap()).unwrap();
        model.weld();
        let cache = format!("/tmp/aoref-{}", path.file_name().unwrap().display());
        let reference: Vec<f32> = if bench {
            vec![]
        } else if let Ok(b) = std::fs::read(&cache) {
            b.chunks(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect()
        } else {
            let start = Instant::now();
            let r = reference(&model);
            println!("reference {:.1}s", start.elapsed().as_secs_f64());
            std::fs::write(&cache, r.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
            r
        };
        let mesh = OccludedMesh { positions: &model.positions, triangles: &model.triangles };
        for (views, map_px) in [(64, 1024), (256, 512), (256, 1024), (256, 2048), (1024, 1024)] {
            let start = Instant::now();
            let found =
                insula_occlusion::cpu(mesh, &[], OcclusionSettings { views, map_px, bent_normals: false }, &|_| true)
                    .unwrap();
            let secs = start.elapsed().as_secs_f64();
            let d: Vec<f64> = found.share.iter().zip(&reference).map(|(a, b)| f64::from(a - b)).collect();
            let n = d.len().max(1) as f64;
            println!(
                "{} v={} t={} views {views} map {map_px}: rms {:.4} bias {:+.4} max {:.3} {secs:.3}s",
                path.display(),
                model.positions.len(),
                model.triangles.len(),
                (d.iter().map(|v| v * v).sum::<f64>() / n).sqrt(),
                d.iter().sum::<f64>() / n,
                d.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
            );
        }
    }
}
