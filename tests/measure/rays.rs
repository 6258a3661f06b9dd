//! Measures the CPU ray-caster by itself: rays per second, with everything resident that a view needs.
//!
//! `cargo run --release -p insula-measure --bin rays -- --city DIR --camera FILE...`: DIR is a baked folder. All kinds of frames are
//! drawn in turn, several rounds; the best round counts.

use anyhow::{Context, Result};
use clap::Parser;
use glam::DVec3;
use insula_client::camera_files::read_camera;
use insula_client::commands::headless::settle;
use insula_client::image_files::write_png;
use insula_client::render::Adapter;
use insula_client::session::Session;
use insula_shaders::cpu::instruction_set::InstructionSet;
use insula_shaders::cpu::raycast::{Pixels, Sampling, SceneRef, count};
use insula_shaders::cpu::render::render_with;
use insula_shaders::layout::Shading;
use insula_tests::baked::Baked;
use insula_tests::viewer::open_drawn;
use insula_viewer::camera::Camera;
use insula_viewer::frame::{FrameData, MOVING_SAMPLES, STILL_SAMPLES};
use insula_viewer::streamer::FrameRequest;
use insula_viewer::sun::{Daylight, SunOptions};
use insula_viewer::switching::{SwitchDistances, SwitchVolume};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Measures the CPU ray-caster
#[derive(Debug, Parser)]
struct Args {
    /// Folder of the baked city
    #[arg(long)]
    city: PathBuf,
    /// Camera files (default: views over the city from its edges)
    #[arg(long, num_args = 1..)]
    camera: Vec<PathBuf>,
    /// Width and height of the frames
    #[arg(long, num_args = 2, default_values_t = [640, 360])]
    size: Vec<u32>,
    /// Kinds of frames: primary (one ray a pixel, no shadows), moving (2 x 2, no shadows), still (3 x 3, shadows)
    #[arg(long, value_delimiter = ',', default_value = "primary,moving,still", value_parser = ["primary", "moving", "still"])]
    frames: Vec<String>,
    /// What is drawn: columns only, the finest meshes wherever there are some (geometry), or both by their error
    #[arg(long, default_value = "both", value_parser = ["both", "columns", "geometry"])]
    draw: String,
    /// Number of rounds
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// Only the ways whose name has this text
    #[arg(long)]
    only: Option<String>,
    /// Write the frames into this folder
    #[arg(long)]
    out: Option<PathBuf>,
    /// Write what the frames are drawn of into folders in this one, for `tests/tools/wasm_rays/run`
    #[arg(long)]
    dump: Option<PathBuf>,
}

const TIMEOUT: Duration = Duration::from_secs(300);
const CACHE_MIB: u32 = 2048;
/// Geometry is drawn up to this distance.
const GEOMETRY_M: f64 = 100_000.0;

/// A way to draw a frame.
struct Way {
    name: String,
    set: Option<InstructionSet>,
    sampling: Sampling,
}

/// With each instruction set, and ray by ray, which is the definition.
fn ways(args: &Args, kind: &str) -> Vec<Way> {
    let mut ways = Vec::new();
    for set in InstructionSet::all() {
        ways.push(Way { name: set.name().to_owned(), set: Some(set), sampling: Sampling::Full });
        if kind != "primary" {
            let name = format!("{}, adaptive", set.name());
            ways.push(Way { name, set: Some(set), sampling: Sampling::Adaptive });
        }
    }
    ways.push(Way { name: "single rays".to_owned(), set: None, sampling: Sampling::Full });
    ways.retain(|way| args.only.as_deref().is_none_or(|only| way.name.contains(only)));
    ways
}

fn main() -> Result<()> {
    let args = Args::parse();
    let mut session = open_drawn(&args.city, CACHE_MIB, args.draw == "columns")?;
    println!(
        "view                   frame   way                         ms/frame  Mray/s  nodes  steps  fetches  cells  differs"
    );
    for (name, camera) in cameras(&args)? {
        for kind in &args.frames {
            measure(&args, &mut session, &name, camera, kind)?;
        }
    }
    Ok(())
}

fn cameras(args: &Args) -> Result<Vec<(String, Camera)>> {
    if args.camera.is_empty() {
        let views = Baked::open(&args.city)?.overviews();
        let look = |[from, to]: [DVec3; 2]| Camera::look_at(from, to, DVec3::Z, 60f64.to_radians()).context("view");
        return views.into_iter().map(|(name, ends)| Ok((name.to_owned(), look(ends)?))).collect();
    }
    let name = |path: &Path| path.file_stem().map_or(String::new(), |stem| stem.to_string_lossy().into_owned());
    args.camera.iter().map(|path| Ok((name(path), read_camera(path)?))).collect()
}

fn measure(args: &Args, session: &mut Session, name: &str, camera: Camera, kind: &str) -> Result<()> {
    let size_px = [args.size[0], args.size[1]];
    let is_geometry = args.draw == "geometry";
    let switching = is_geometry.then(|| SwitchDistances::new(&[GEOMETRY_M], SwitchVolume::Box)).flatten();
    let request = FrameRequest { camera, heading: None, size_px, tau_px: 1.0, switching };
    let (samples, shadows) = match kind {
        "primary" => (1, false),
        "moving" => (MOVING_SAMPLES, false),
        _ => (STILL_SAMPLES, true),
    };
    let sun = SunOptions { shadows: Some(shadows), ..SunOptions::default() };
    let settings = Daylight::new(&sun, session.tree().manifest()).render_settings(Shading::Lit, samples);
    session.set_sun(settings.shadow_casting_sun());
    settle(session, &request, TIMEOUT)?;
    let data = session.frame_data(&request, &settings);
    let scene = scene_of(session, &data)?;
    if let Some(folder) = &args.dump {
        dump(&scene, &folder.join(format!("{name}-{kind}")))?;
    }
    let ways = ways(args, kind);
    let mut times = vec![Duration::MAX; ways.len()];
    let mut frames = Vec::new();
    for round in 0..args.rounds {
        for (way, time) in ways.iter().zip(&mut times) {
            let begin = Instant::now();
            let pixels = render_with(&scene, way.set, way.sampling);
            *time = (*time).min(begin.elapsed());
            if round == 0 {
                frames.push(pixels);
            }
        }
    }
    let counts = count(&scene);
    let per_ray = |n: u64| n as f64 / counts.rays.max(1) as f64;
    for (Way { name: way, .. }, (time, pixels)) in ways.iter().zip(times.iter().zip(&frames)) {
        let rays = f64::from(size_px[0] * size_px[1] * samples * samples);
        println!(
            "{name:22} {kind:7} {way:26} {:9.1} {:7.2} {:6.2} {:6.2} {:8.1} {:6.2}  {}",
            time.as_secs_f64() * 1e3,
            rays / time.as_secs_f64() / 1e6,
            per_ray(counts.nodes),
            per_ray(counts.steps),
            per_ray(counts.fetches),
            per_ray(counts.cells),
            frames.last().map_or(String::new(), |definition| difference(definition, pixels)),
        );
        if let Some(out) = &args.out {
            fs::create_dir_all(out)?;
            write_png(&out.join(format!("{name}-{kind}-{way}.png")), pixels)?;
        }
    }
    Ok(())
}

fn scene_of<'a>(session: &'a Session, data: &'a FrameData) -> Result<SceneRef<'a>> {
    let Adapter::Cpu(cpu) = session.adapter() else { anyhow::bail!("not the CPU ray-caster") };
    Ok(cpu.scene(&data.frame, &data.grid, &data.nodes))
}

/// Writes the arrays that a frame is drawn of, and the number of its pixels.
fn dump(scene: &SceneRef<'_>, folder: &Path) -> Result<()> {
    fs::create_dir_all(folder)?;
    let SceneRef { frame, grid, nodes, summaries, atlas } = scene;
    fs::write(folder.join("frame.bin"), bytemuck::bytes_of(*frame))?;
    fs::write(folder.join("grid.bin"), bytemuck::cast_slice(grid))?;
    fs::write(folder.join("nodes.bin"), bytemuck::cast_slice(nodes))?;
    fs::write(folder.join("summaries.bin"), bytemuck::cast_slice(summaries))?;
    fs::write(folder.join("atlas.bin"), bytemuck::cast_slice(atlas))?;
    let pixels = frame.width_px * frame.height_px;
    Ok(fs::write(folder.join("scene.json"), format!("{{\"pixels\": {pixels}}}"))?)
}

/// Root of the mean squared difference in codes of sRGB, the share of the pixels that differ by more than 2 of them, and the
/// share whose distance differs by more than a thousandth.
fn difference(definition: &Pixels, pixels: &Pixels) -> String {
    let (mut squares, mut apart, mut moved) = (0.0, 0usize, 0usize);
    for (a, b) in definition.colour.iter().zip(&pixels.colour) {
        let codes = a.to_le_bytes().into_iter().zip(b.to_le_bytes()).take(3).map(|(a, b)| f64::from(a.abs_diff(b)));
        squares += codes.clone().map(|d| d * d).sum::<f64>() / 3.0;
        apart += usize::from(codes.fold(0.0, f64::max) > 2.0);
    }
    for (a, b) in definition.distance.iter().zip(&pixels.distance) {
        let is_same = a == b || a.is_finite() && (a - b).abs() <= 1e-3 * a;
        moved += usize::from(!is_same);
    }
    let count = pixels.colour.len().max(1) as f64;
    format!(
        "rms {:.3}, {:.3}% beyond 2, {:.3}% moved",
        (squares / count).sqrt(),
        100.0 * apart as f64 / count,
        100.0 * moved as f64 / count
    )
}
