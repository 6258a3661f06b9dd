//! Measures how the frame time depends on the size of the city, for the ray-caster and for a plain renderer of triangles.
//!
//! `cargo run --release -p insula-measure --bin flat -- --cities DIR`: DIR holds the cities `synth1k` to `synth1m` that the program
//! `synth` makes; missing ones are made. All sizes are drawn in turn, several rounds; the best round counts.

use anyhow::{Context, Result};
use clap::Parser;
use insula_bake::Silent;
use insula_shaders::cpu::raycast::{RayCounts, count, count_where};
use insula_shaders::gpu::{DeviceQueue, Raycaster};
use insula_shaders::layout::Shading;
use insula_tests::baked::Baked;
use insula_tests::draw_list::{DrawList, Scene};
use insula_tests::gpu::Gpu;
use insula_tests::synth::mesh::{Mesh, Target};
use insula_tests::synth::{City, Viewpoint};
use insula_tests::view::FrameSpec;
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Draws the same views of cities of growing size
#[derive(Debug, Parser)]
struct Args {
    /// Folder of the cities
    #[arg(long)]
    cities: PathBuf,
    /// Numbers of buildings
    #[arg(long, value_delimiter = ',', default_value = "1000,10000,100000,1000000")]
    sizes: Vec<u64>,
    /// Frame sizes
    #[arg(long, value_delimiter = ',', default_value = "640x360,1280x720")]
    frames: Vec<String>,
    /// Views
    #[arg(long, value_delimiter = ',', default_value = "street,roof,aerial", value_parser = Viewpoint::ALL.map(Viewpoint::word))]
    views: Vec<String>,
    /// Tolerated error in pixels
    #[arg(long, default_value_t = 1.0)]
    tau: f64,
    /// Number of rounds
    #[arg(long, default_value_t = 3)]
    rounds: usize,
    /// Measure the CPU time of all threads instead of elapsed time: more stable on a busy machine without a graphics card
    /// (Linux)
    #[arg(long)]
    processor: bool,
    /// Do not draw triangles
    #[arg(long)]
    no_triangles: bool,
    /// Do not draw with the CPU ray-caster
    #[arg(long)]
    no_cpu: bool,
    /// Folder for one frame of each view
    #[arg(long)]
    out: Option<PathBuf>,
    /// Write all measures as JSON
    #[arg(long)]
    report: Option<PathBuf>,
}

#[derive(Debug, Serialize, Clone)]
struct Row {
    viewpoint: &'static str,
    spec: String,
    buildings: u64,
    nodes_drawn: usize,
    grid_entries: usize,
    covered_share: f64,
    gpu_ms: f64,
    cpu_ms: Option<f64>,
    triangles_ms: Option<f64>,
    triangles: Option<u64>,
    nodes_per_ray: f64,
    steps_per_ray: f64,
    fetches_per_ray: f64,
    cells_per_ray: f64,
    /// Over the pixels that the smallest city covers; all cities have the same buildings there.
    common_steps_per_ray: f64,
    common_fetches_per_ray: f64,
}

/// Times that each frame is drawn per round.
const TIMES: usize = 5;

fn main() -> Result<()> {
    let args = Args::parse();
    let gpu = Gpu::open()?;
    println!("{}", gpu.name);
    let cities = args.sizes.iter().map(|n| open(&args.cities, *n)).collect::<Result<Vec<_>>>()?;
    let meshes = if args.no_triangles { Vec::new() } else { meshes(&gpu, &args.sizes)? };
    let mut rows = Vec::new();
    for spec in &args.frames {
        let spec = parse(spec)?;
        for viewpoint in
            Viewpoint::ALL.into_iter().filter(|viewpoint| args.views.iter().any(|word| word == viewpoint.word()))
        {
            rows.extend(measure_view(&args, &gpu, (&cities, &meshes), viewpoint, &spec)?);
        }
    }
    summary(&rows, &args.sizes);
    if let Some(report) = &args.report {
        fs::write(report, serde_json::to_vec_pretty(&rows)?)?;
    }
    Ok(())
}

fn open(folder: &Path, buildings: u64) -> Result<Baked> {
    let name = match buildings {
        n if n % 1_000_000 == 0 => format!("synth{}m", n / 1_000_000),
        n if n % 1000 == 0 => format!("synth{}k", n / 1000),
        n => format!("synth{n}"),
    };
    let path = folder.join(name);
    if !path.join("city.json").is_file() {
        eprintln!("making {}", path.display());
        City::new(buildings, 1.0)?.write(&path, None, &Silent)?;
    }
    Baked::open(&path)
}

fn meshes(gpu: &Gpu, sizes: &[u64]) -> Result<Vec<Mesh>> {
    sizes.iter().map(|n| Mesh::new(&gpu.device, &gpu.queue, &City::new(*n, 1.0)?)).collect()
}

fn parse(text: &str) -> Result<FrameSpec> {
    let (width, height) = text.split_once('x').with_context(|| format!("{text}: write WIDTHxHEIGHT"))?;
    Ok(FrameSpec { width_px: width.parse()?, height_px: height.parse()?, shading: Shading::Lit, samples: 1 })
}

fn measure_view(
    args: &Args,
    gpu: &Gpu,
    (cities, meshes): (&[Baked], &[Mesh]),
    viewpoint: Viewpoint,
    spec: &FrameSpec,
) -> Result<Vec<Row>> {
    let camera = viewpoint.camera();
    let draw_lists: Vec<DrawList> = cities
        .iter()
        .map(|city| city.draw_list(&city.select_in_view(&camera, spec, args.tau)))
        .collect::<Result<_>>()?;
    let scenes: Vec<Scene<'_>> = draw_lists.iter().map(|draw_list| draw_list.scene(&camera, spec)).collect();
    let mut casters: Vec<Raycaster> = scenes.iter().map(|scene| gpu.raycaster(scene)).collect();
    let target = Target::new(&gpu.device, spec);
    let mut rows = Vec::new();
    let mut common = Vec::new();
    for (i, scene) in scenes.iter().enumerate() {
        cast(gpu, &mut casters[i], scene)?;
        let pixels = casters[i].read_back(&gpu.device, &gpu.queue)?;
        let counted = count(&scene.as_ref());
        compare_counts(gpu, &mut casters[i], scene, counted)?;
        if let Some(out) = &args.out {
            let name = format!("{}-{}-{}.png", viewpoint.word(), spec.height_px, args.sizes[i]);
            let bytes: Vec<u8> = pixels.colour.iter().flat_map(|word| word.to_le_bytes()).collect();
            let image = image::RgbaImage::from_raw(spec.width_px, spec.height_px, bytes).context("size")?;
            fs::create_dir_all(out)?;
            image.save(out.join(name))?;
        }
        let covered = pixels.distance.iter().filter(|d| d.is_finite()).count();
        if i == 0 {
            common = pixels.distance.iter().map(|d| d.is_finite()).collect();
        }
        let of_common = count_where(&scene.as_ref(), |pixel| common.get(pixel).copied().unwrap_or_default());
        let per_common = |n: u64| n as f64 / of_common.rays as f64;
        let per_ray = |n: u64| n as f64 / counted.rays as f64;
        rows.push(Row {
            viewpoint: viewpoint.word(),
            spec: format!("{}x{}", spec.width_px, spec.height_px),
            buildings: args.sizes[i],
            nodes_drawn: scene.nodes.len(),
            grid_entries: scene.grid.len(),
            covered_share: covered as f64 / pixels.distance.len() as f64,
            gpu_ms: f64::INFINITY,
            cpu_ms: None,
            triangles_ms: None,
            triangles: None,
            nodes_per_ray: per_ray(counted.nodes),
            steps_per_ray: per_ray(counted.steps),
            fetches_per_ray: per_ray(counted.fetches),
            cells_per_ray: per_ray(counted.cells),
            common_steps_per_ray: per_common(of_common.steps),
            common_fetches_per_ray: per_common(of_common.fetches),
        });
    }
    for _ in 0..args.rounds {
        for (i, row) in rows.iter_mut().enumerate() {
            row.gpu_ms = row.gpu_ms.min(time(args, || cast(gpu, &mut casters[i], &scenes[i]))?);
            if !args.no_cpu {
                let ms = time(args, || {
                    scenes[i].render();
                    Ok(())
                })?;
                row.cpu_ms = Some(row.cpu_ms.map_or(ms, |best: f64| best.min(ms)));
            }
            if let Some(mesh) = meshes.get(i) {
                let ms = time(args, || {
                    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                    row.triangles = Some(mesh.draw(&gpu.queue, &mut encoder, &target, &camera, spec));
                    finish(gpu, encoder)
                })?;
                row.triangles_ms = Some(row.triangles_ms.map_or(ms, |best: f64| best.min(ms)));
            }
        }
    }
    rows.iter().for_each(print);
    Ok(rows)
}

fn cast(gpu: &Gpu, caster: &mut Raycaster, scene: &Scene<'_>) -> Result<()> {
    let data = scene.as_ref();
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let on = DeviceQueue { device: &gpu.device, queue: &gpu.queue };
    caster.render(on, &mut encoder, data.frame, data.grid, data.nodes)?;
    finish(gpu, encoder)
}

fn finish(gpu: &Gpu, encoder: wgpu::CommandEncoder) -> Result<()> {
    gpu.queue.submit([encoder.finish()]);
    gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
    Ok(())
}

/// Milliseconds of the fastest of [`TIMES`] runs.
fn time(args: &Args, mut work: impl FnMut() -> Result<()>) -> Result<f64> {
    let begin = Instant::now();
    let now = || if args.processor { processor_time() } else { Ok(begin.elapsed()) };
    let mut best = Duration::MAX;
    for _ in 0..TIMES {
        let before = now()?;
        work()?;
        best = best.min(now()?.saturating_sub(before));
    }
    Ok(best.as_secs_f64() * 1e3)
}

/// CPU time of all threads of this process.
fn processor_time() -> Result<Duration> {
    let mut sum = Duration::ZERO;
    for thread in fs::read_dir("/proc/self/task").context("--processor wants Linux")? {
        // A thread may just have ended.
        let Ok(text) = fs::read_to_string(thread?.path().join("schedstat")) else { continue };
        sum += Duration::from_nanos(text.split_whitespace().next().context("no time in schedstat")?.parse()?);
    }
    Ok(sum)
}

/// Fails unless the GPU counts almost the same as the CPU; rays on edges may differ.
fn compare_counts(gpu: &Gpu, caster: &mut Raycaster, scene: &Scene<'_>, on_cpu: RayCounts) -> Result<()> {
    let data = scene.as_ref();
    let on = DeviceQueue { device: &gpu.device, queue: &gpu.queue };
    let on_gpu = caster.count(on, data.frame, data.grid, data.nodes)?;
    for (what, a, b) in [("nodes", on_cpu.nodes, on_gpu.nodes), ("steps", on_cpu.steps, on_gpu.steps)] {
        let apart = a.abs_diff(b) as f64 / a.max(1) as f64;
        anyhow::ensure!(apart < 0.01, "the device counts {b} {what}, the CPU {a}");
    }
    Ok(())
}

fn print(row: &Row) {
    let ms = |value: Option<f64>| value.map_or("-".into(), |ms| format!("{ms:.1}"));
    println!(
        "{:6} {:>9} {:>8}: device {:6.1} ms, cpu {:>6} ms, triangles {:>7} ms ({:>8}); covered {:.3}, draw list {:5}; a ray: {:.2} nodes, {:.2} steps, {:.1} fetches, {:.1} cells",
        row.viewpoint,
        row.spec,
        row.buildings,
        row.gpu_ms,
        ms(row.cpu_ms),
        ms(row.triangles_ms),
        row.triangles.unwrap_or(0),
        row.covered_share,
        row.nodes_drawn,
        row.nodes_per_ray,
        row.steps_per_ray,
        row.fetches_per_ray,
        row.cells_per_ray,
    );
}

/// Compares the largest city with the smallest, and with triangles.
fn summary(rows: &[Row], sizes: &[u64]) {
    println!(
        "\n| view | frame | device, largest / smallest | a covered pixel | cpu | fetches | steps | where the smallest covers: fetches | steps | against triangles, by size |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for rows in rows.chunks(sizes.len()) {
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { continue };
        let covered = first.covered_share / last.covered_share;
        let against: Vec<String> = rows
            .iter()
            .map(|row| row.triangles_ms.map_or("-".into(), |ms| format!("{:.2}", row.gpu_ms / ms)))
            .collect();
        let cpu = first.cpu_ms.zip(last.cpu_ms).map_or("-".into(), |(a, b)| format!("{:.2}", b / a));
        println!(
            "| {} | {} | {:.2} | {:.2} | {cpu} | {:.2} | {:+.2} | {:.2} | {:+.2} | {} |",
            first.viewpoint,
            first.spec,
            last.gpu_ms / first.gpu_ms,
            last.gpu_ms / first.gpu_ms * covered,
            last.fetches_per_ray / first.fetches_per_ray,
            last.steps_per_ray - first.steps_per_ray,
            last.common_fetches_per_ray / first.common_fetches_per_ray,
            last.common_steps_per_ray - first.common_steps_per_ray,
            against.join(", "),
        );
    }
}
