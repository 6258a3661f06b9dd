//! Occlusion of a mesh on the GPU is that on the CPU, except where the rounding of a depth decides.

use anyhow::Result;
use insula_occlusion::{OccludedMesh, OcclusionSettings, cpu, gpu};
use insula_tests::gpu::Gpu;
use insula_tests::gpu_tests;
use insula_tests::trials::Trials;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(gpu_tests![gpu_and_cpu_give_the_same_occlusion]);
}

/// A difference that an image with 8 bits shows.
const STEP: f32 = 1.0 / 255.0;
/// Largest share of vertices that differ by more.
const MAX_OFF: f64 = 0.001;
/// Rows and columns of vertices.
const SIDE: u32 = 120;

/// A closed surface with bumps, rolled up from a square.
fn bumps() -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let place = |i: u32| {
        let [polar, turn] = [i / SIDE, i % SIDE].map(|k| f64::from(k) / f64::from(SIDE) * std::f64::consts::TAU);
        let tube = 0.4 + 0.12 * (7.0 * polar).sin() * (9.0 * turn).cos();
        let outer = 1.0 + tube * polar.cos();
        [400.0 + outer * turn.cos(), -30.0 + outer * turn.sin(), tube * polar.sin()]
    };
    let cell = |i: u32| {
        let at = |down: u32, right: u32| (i / SIDE + down) % SIDE * SIDE + (i % SIDE + right) % SIDE;
        [[at(0, 0), at(0, 1), at(1, 1)], [at(0, 0), at(1, 1), at(1, 0)]]
    };
    ((0..SIDE * SIDE).map(place).collect(), (0..SIDE * SIDE).flat_map(cell).collect())
}

fn gpu_and_cpu_give_the_same_occlusion(_: &Gpu) -> Result<()> {
    let (positions, triangles) = bumps();
    let mesh = OccludedMesh { positions: &positions, triangles: &triangles };
    // Ground that reaches farther than maps have depths.
    let ground = [[300.0, -200.0, -0.55], [600.0, -200.0, -0.55], [400.0, 300.0, -0.55]];
    for (occluders, map_px) in [(&[][..], 512), (&[ground][..], 512), (&[ground][..], 100)] {
        let settings = OcclusionSettings { views: 64, map_px, bent_normals: true };
        let (a, b) = (cpu(mesh, occluders, settings, &|_| true)?, gpu(mesh, occluders, settings, &|_| true)?);
        let off = a.share.iter().zip(&b.share).filter(|(a, b)| (**a - **b).abs() > STEP).count();
        let (a, b) = (a.bent_normals.unwrap_or_default(), b.bent_normals.unwrap_or_default());
        let bent = |(a, b): &(&[f32; 3], &[f32; 3])| (0..3).any(|k| (a[k] - b[k]).abs() > STEP);
        let bent_off = a.iter().zip(&b).filter(bent).count();
        println!("maps of {map_px}, {} occluders: {off} and {bent_off} of {} differ", occluders.len(), a.len());
        anyhow::ensure!(a.len() == b.len() && a.len() == positions.len(), "{} and {} bent normals", a.len(), b.len());
        anyhow::ensure!(off.max(bent_off) as f64 <= MAX_OFF * positions.len() as f64, "{off} and {bent_off} differ");
    }
    Ok(())
}
