//! Hit counts: the GPU counts what the CPU counts.

use anyhow::{Context, Result};
use insula_shaders::cpu::hit_counts::hit_counts;
use insula_shaders::gpu::{DeviceQueue, HitCounts, Raycaster};
use insula_shaders::layout::{NO_NODE, Shading};
use insula_tests::draw_list::Scene;
use insula_tests::gpu::Gpu;
use insula_tests::gpu_tests;
use insula_tests::programs::wait_until;
use insula_tests::random::{self, Pose};
use insula_tests::rng::Rng;
use insula_tests::trials::Trials;
use insula_tests::view::FrameSpec;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(gpu_tests![gpu_counts_the_same_hits_as_the_cpu, one_count_is_in_flight_at_a_time]);
}

/// Frames whose sides are multiples of the blocks that a thread counts, and frames whose sides are not.
const SIZES_PX: [[u32; 2]; 4] = [[64, 32], [241, 135], [7, 3], [1, 9]];

fn gpu_counts_the_same_hits_as_the_cpu(gpu: &Gpu) -> Result<()> {
    let mut counted = 0;
    for seed in 0..4 {
        let city = random::city(seed)?;
        let mut rng = Rng::new(9000 + seed);
        for (pose, [width_px, height_px]) in Pose::ALL.into_iter().zip(SIZES_PX.into_iter().cycle()) {
            let spec = FrameSpec { width_px, height_px, shading: Shading::Lit, samples: 1 };
            let scene = city.draw_list.scene(&random::camera(&mut rng, &city, pose), &spec);
            let mut raycaster = gpu.raycaster(&scene);
            let mut pass = HitCounts::new(&gpu.device, scene.nodes.len() as u32);
            anyhow::ensure!(encode(gpu, &mut raycaster, &mut pass, &scene)?, "nothing was recorded");
            let on_gpu = wait(gpu, &mut pass)?;
            let hit = raycaster.read_back(&gpu.device, &gpu.queue)?.hit;
            anyhow::ensure!(
                on_gpu == hit_counts(&hit, scene.nodes.len()),
                "city {seed}, {pose:?}, {width_px} x {height_px}"
            );
            let hits = hit.iter().filter(|node| **node != NO_NODE).count();
            anyhow::ensure!(on_gpu.iter().sum::<u32>() as usize == hits, "city {seed}, {pose:?}: lost hits");
            counted += hits;
        }
    }
    anyhow::ensure!(counted > 10_000, "only {counted} hits");
    Ok(())
}

fn one_count_is_in_flight_at_a_time(gpu: &Gpu) -> Result<()> {
    let city = random::city(1)?;
    let spec = FrameSpec { width_px: 32, height_px: 32, shading: Shading::Lit, samples: 1 };
    let scene = city.draw_list.scene(&random::camera(&mut Rng::new(3), &city, Pose::Above), &spec);
    let mut raycaster = gpu.raycaster(&scene);
    let mut pass = HitCounts::new(&gpu.device, scene.nodes.len() as u32);
    anyhow::ensure!(pass.take(&gpu.device).is_none(), "a count that was not requested");
    anyhow::ensure!(encode(gpu, &mut raycaster, &mut pass, &scene)?, "nothing was recorded");
    anyhow::ensure!(!encode(gpu, &mut raycaster, &mut pass, &scene)?, "two counts are in flight");
    let first = wait(gpu, &mut pass)?;
    anyhow::ensure!(encode(gpu, &mut raycaster, &mut pass, &scene)?, "no second count");
    anyhow::ensure!(wait(gpu, &mut pass)? == first, "counts are not reset");
    let mut small = HitCounts::new(&gpu.device, scene.nodes.len() as u32 - 1);
    anyhow::ensure!(!encode(gpu, &mut raycaster, &mut small, &scene)?, "more nodes than the pass was made for");
    Ok(())
}

/// Records and submits a frame and its count.
fn encode(gpu: &Gpu, raycaster: &mut Raycaster, pass: &mut HitCounts, scene: &Scene<'_>) -> Result<bool> {
    let (data, on) = (scene.as_ref(), DeviceQueue { device: &gpu.device, queue: &gpu.queue });
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    raycaster.render(on, &mut encoder, data.frame, data.grid, data.nodes)?;
    let recorded = pass.encode(on, &mut encoder, raycaster, data.nodes.len());
    gpu.queue.submit([encoder.finish()]);
    if recorded {
        pass.submitted();
    }
    Ok(recorded)
}

fn wait(gpu: &Gpu, pass: &mut HitCounts) -> Result<Vec<u32>> {
    gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
    // Another thread that waits for the device may be the one that is told.
    let mut counts = None;
    wait_until("the count", || {
        counts = pass.take(&gpu.device);
        counts.is_some()
    });
    counts.context("no count")
}
