//! Stone in WGSL agrees with the CPU.

use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec4, Vec4Swizzles};
use insula_shaders::cpu::night::scramble_cell;
use insula_shaders::cpu::noise::perlin;
use insula_shaders::cpu::stone::stone_surface;
use insula_shaders::cpu::ward::{StoneSide, reflect_stone};
use insula_shaders::gpu::{bind_group, compute_pipeline, read_words, shader_module};
use insula_shaders::layout::{FrameUniform, Light, binding};
use insula_shaders::light::Air;
use insula_shaders::stone::{MAX_STONES, PRESETS, Stone};
use insula_shaders::wgsl;
use insula_tests::gpu::Gpu;
use insula_tests::gpu_tests;
use insula_tests::rng::Rng;
use insula_tests::trials::Trials;
use std::f64::consts::TAU;
use wgpu::BufferUsages;
use wgpu::util::DeviceExt;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(gpu_tests![gpu_shows_the_same_stone_as_the_cpu]);
}

const KERNEL: &str = "
struct Point {
    p_m: vec3<f32>,
    footprint_m: f32,
    normal: vec3<f32>,
    ao: f32,
    dir: vec3<f32>,
    stone: u32,
}

@group(1) @binding(0) var<storage, read> points: array<Point>;
@group(1) @binding(1) var<uniform> stones: array<Stone, 16>;
@group(1) @binding(2) var<storage, read_write> samples: array<vec4<u32>>;

@compute @workgroup_size(64)
fn sample_stones(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&points) {
        return;
    }
    let point = points[id.x];
    let surface = stone_surface(stones[point.stone], point.p_m, point.normal, point.ao, point.footprint_m);
    let side = StoneSide(point.normal, point.ao, vec3<f32>(0.0), false);
    let light = reflect_stone(surface, side, point.dir);
    let hash = scramble_cell(vec3<i32>(floor(point.p_m * 100.0)));
    samples[id.x * 5u] = vec4<u32>(bitcast<vec3<u32>>(surface.albedo), bitcast<u32>(surface.alpha.x));
    samples[id.x * 5u + 1u] = vec4<u32>(bitcast<vec3<u32>>(surface.f0), bitcast<u32>(surface.alpha.y));
    samples[id.x * 5u + 2u] = vec4<u32>(bitcast<vec3<u32>>(light.sky), hash);
    samples[id.x * 5u + 3u] = vec4<u32>(bitcast<vec3<u32>>(light.sun), 0u);
    samples[id.x * 5u + 4u] = bitcast<vec4<u32>>(perlin(point.p_m * 10.0));
}
";

/// Where a stone is looked at.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Point {
    p_m: Vec3,
    footprint_m: f32,
    normal: Vec3,
    ao: f32,
    dir: Vec3,
    stone: u32,
}

/// Every stone from all sides, near and far.
fn points() -> Vec<Point> {
    let mut rng = Rng::new(21);
    let mut points = Vec::new();
    for stone in 0..PRESETS.len() as u32 {
        for k in 0..2000 {
            let mut unit = || {
                let (z, angle) = (rng.range(-1.0, 1.0) as f32, rng.range(0.0, TAU) as f32);
                let flat = (1.0 - z * z).sqrt();
                Vec3::new(flat * angle.cos(), flat * angle.sin(), z)
            };
            let (normal, side, place) = (unit(), unit(), unit());
            let dir = (side - normal * (side.dot(normal).abs() + side.dot(normal) + 0.05)).normalize_or(-normal);
            points.push(Point {
                p_m: place * rng.range(0.0, 8.0) as f32,
                footprint_m: 1e-4 * 10f32.powf(4.0 * (k % 50) as f32 / 50.0),
                normal,
                ao: rng.unit() as f32,
                dir,
                stone,
            });
        }
    }
    points
}

fn frame(sun: Vec3, shadow_m: f32) -> FrameUniform {
    let sun = sun.normalize_or(Vec3::Z);
    FrameUniform { sun: sun.into(), shadow_m, light: Light::of_sun(sun, Air::default()), ..FrameUniform::zeroed() }
}

fn gpu_shows_the_same_stone_as_the_cpu(gpu: &Gpu) -> Result<()> {
    let points = points();
    let mut largest = [0.0_f32; 5];
    for frame in [frame(Vec3::new(0.4, -0.5, 0.7), 100.0), frame(Vec3::new(-0.9, 0.3, 0.1), 0.0)] {
        let samples = sample(gpu, &frame, &points)?;
        for (point, found) in points.iter().zip(samples.as_chunks::<5>().0) {
            let (name, stone) = &PRESETS[point.stone as usize];
            let surface = stone_surface(stone, point.p_m, point.normal, point.ao, point.footprint_m);
            let light = reflect_stone(&frame, &surface, &StoneSide::opaque(point.normal, point.ao), point.dir);
            let cell = (point.p_m * 100.0).floor().as_ivec3();
            assert_eq!(found[2].w.to_bits(), scramble_cell(cell), "{cell}");
            let noise = perlin(point.p_m * 10.0);
            let wanted = [
                surface.albedo.extend(surface.alpha.x),
                surface.f0.extend(surface.alpha.y),
                light.sky.extend(0.0),
                light.sun.extend(0.0),
                noise,
            ];
            for (k, (found, wanted)) in found.iter().zip(wanted).enumerate() {
                let light_only = (2..4).contains(&k);
                let apart = if light_only { (found.xyz() - wanted.xyz()).extend(0.0) } else { found - wanted };
                // Highlights are much brighter than white.
                let off = (apart.abs() / wanted.abs().max(Vec4::ONE)).max_element();
                largest[k] = largest[k].max(off);
                let is_near = off < 1.0 / 255.0 && found.xyz().is_finite();
                ensure!(is_near, "row {k} of {name} at {point:?}: {found}, not {wanted}");
            }
        }
    }
    println!("{}: albedo, f0, sky, sun and noise differ by {largest:?} at most", gpu.name);
    Ok(())
}

/// The kernel's five rows for each point.
fn sample(gpu: &Gpu, frame: &FrameUniform, points: &[Point]) -> Result<Vec<Vec4>> {
    let device = &gpu.device;
    let module = shader_module(device, "stone", wgsl::stone_samples(KERNEL));
    let pipeline = compute_pipeline(device, &module, "sample_stones");
    let mut stones = [Stone::NONE; MAX_STONES];
    for (stone, (_, preset)) in stones.iter_mut().zip(PRESETS) {
        *stone = preset;
    }
    let buffer = |contents: &[u8], usage: BufferUsages| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
    };
    let frame = buffer(bytemuck::bytes_of(frame), BufferUsages::UNIFORM);
    let inputs = [
        buffer(bytemuck::cast_slice(points), BufferUsages::STORAGE),
        buffer(bytemuck::cast_slice(&stones), BufferUsages::UNIFORM),
    ];
    // What no lane writes is NaN.
    let unwritten = vec![u32::MAX; points.len() * 20];
    let output = buffer(bytemuck::cast_slice(&unwritten), BufferUsages::STORAGE | BufferUsages::COPY_SRC);
    let group = |index: u32, buffers: &[(u32, &wgpu::Buffer)]| {
        bind_group(device, "stone", &pipeline.get_bind_group_layout(index), buffers)
    };
    let groups = [group(0, &[(binding::FRAME, &frame)]), group(1, &[(0, &inputs[0]), (1, &inputs[1]), (2, &output)])];
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: None });
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: None, timestamp_writes: None });
    pass.set_pipeline(&pipeline);
    for (index, group) in groups.iter().enumerate() {
        pass.set_bind_group(index as u32, group, &[]);
    }
    pass.dispatch_workgroups((points.len() as u32).div_ceil(64), 1, 1);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    Ok(bytemuck::pod_collect_to_vec(&read_words(device, &gpu.queue, &output)?))
}
