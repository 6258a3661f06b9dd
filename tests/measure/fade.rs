//! Measures how much frames jump while a city loads in front of a fixed camera: the difference of consecutive frames at 60 per
//! second, with and without cross-fades, compared with that of a slow pan.
//!
//! `cargo run --release -p insula-measure --bin fade -- CITY... --report fade.json`: each CITY is a baked folder. Differences are
//! also measured in blocks of 16 x 16 pixels, because refinement changes parts of a frame.

use anyhow::{Context, Result};
use clap::Parser;
use glam::{DQuat, DVec3};
use insula_client::image_files::write_png;
use insula_shaders::cpu::raycast::Pixels;
use insula_tests::{baked::Baked, stepped_client::SteppedClient};
use insula_viewer::{
    camera::{Camera, View},
    frame::{MOVING_SAMPLES, RenderSettings},
};
use serde::Serialize;
use std::{fs, path::PathBuf};

const FRAME_SECS: f64 = 1.0 / 60.0;
/// Side of the blocks that are measured separately.
const BLOCK_PX: u32 = 16;
/// Most frames per city.
const FRAMES: usize = 20_000;

/// Measures the differences of consecutive frames while cities load
#[derive(Debug, Parser)]
struct Args {
    /// Baked cities.
    #[arg(required = true)]
    cities: Vec<PathBuf>,
    /// Tiles that are loaded per frame: two are about 20 Mbit/s
    #[arg(long, default_value_t = 2)]
    tiles: usize,
    /// Width of a frame in pixels; its height is 9/16 of it
    #[arg(long, default_value_t = 320)]
    width: u32,
    /// Rays along a pixel's side
    #[arg(long, default_value_t = MOVING_SAMPLES)]
    rays: u32,
    /// Rotation of the pan per frame in degrees: 0.1 is 6 per second
    #[arg(long, default_value_t = 0.1)]
    turn: f64,
    /// Reach of shadows in metres, 0 for none
    #[arg(long, default_value_t = 0.0)]
    shadows: f64,
    /// Only this view
    #[arg(long)]
    view: Option<String>,
    /// Write every frame of a cross-fade into this folder
    #[arg(long)]
    frames: Option<PathBuf>,
    /// Write all measures as JSON
    #[arg(long)]
    report: Option<PathBuf>,
}

/// Differences of consecutive frames, in 255ths of a channel.
#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Differences {
    frames: usize,
    /// Largest mean difference of a frame.
    frame: f64,
    /// Largest mean difference of a block, and the largest that one in a hundred blocks of a frame exceeds.
    block: f64,
    block_99: f64,
}

impl Differences {
    fn add(&mut self, a: &Pixels, b: &Pixels) {
        let across = a.width_px.div_ceil(BLOCK_PX);
        let mut sums = vec![(0.0, 0.0); (across * a.height_px.div_ceil(BLOCK_PX)) as usize];
        for (i, (a, c)) in a.colour.iter().zip(&b.colour).enumerate() {
            let (x, y) = (i as u32 % b.width_px, i as u32 / b.width_px);
            let channels = a.to_le_bytes().into_iter().zip(c.to_le_bytes()).take(3);
            let block = &mut sums[(y / BLOCK_PX * across + x / BLOCK_PX) as usize];
            block.0 += channels.map(|(a, b)| f64::from(a.abs_diff(b))).sum::<f64>() / 3.0;
            block.1 += 1.0;
        }
        let (sum, count) = sums.iter().fold((0.0, 0.0), |(s, n), block| (s + block.0, n + block.1));
        let mut means: Vec<f64> = sums.iter().map(|(sum, count)| sum / count).collect();
        means.sort_by(f64::total_cmp);
        self.frames += 1;
        self.frame = self.frame.max(sum / count);
        self.block = self.block.max(means.last().copied().unwrap_or(0.0));
        self.block_99 = self.block_99.max(means[(means.len() - 1) * 99 / 100]);
    }
}

#[derive(Debug, Serialize)]
struct Row {
    city: String,
    view: &'static str,
    without_fades: Differences,
    with_fades: Differences,
    pan: Differences,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let mut rows: Vec<Row> = Vec::new();
    println!("largest difference of consecutive frames: frame, 1 in 100 blocks, worst block (255ths of a channel)");
    for folder in &args.cities {
        let city = Baked::open(folder)?;
        for (view, camera) in
            city.overviews().into_iter().take(3).filter(|(view, _)| args.view.as_deref().is_none_or(|v| v == *view))
        {
            let (without_fades, _) = refine(&args, &city, view, camera, false)?;
            let (with_fades, pan) = refine(&args, &city, view, camera, true)?;
            let text = |l: &Differences| format!("{:5.2} {:5.1} {:5.1}", l.frame, l.block_99, l.block);
            println!(
                "{:8} {:6}: at once {} ({} frames); fading {} ({}); pan {}",
                city.manifest().name,
                view,
                text(&without_fades),
                without_fades.frames,
                text(&with_fades),
                with_fades.frames,
                text(&pan)
            );
            rows.push(Row { city: city.manifest().name.clone(), view, without_fades, with_fades, pan });
        }
    }
    if let Some(report) = &args.report {
        fs::write(report, serde_json::to_vec_pretty(&rows)?)?;
    }
    Ok(())
}

/// Loads a city. Returns the differences of its frames, and of a slow pan at the end.
fn refine(
    args: &Args,
    city: &Baked,
    name: &str,
    [position, target]: [DVec3; 2],
    transitions: bool,
) -> Result<(Differences, Differences)> {
    let mut client = SteppedClient::new(city, transitions)?;
    let size_px = [args.width, args.width * 9 / 16];
    let view = |turn_deg: f64| {
        let ahead = DQuat::from_rotation_z(turn_deg.to_radians()) * (target - position);
        let camera = Camera::look_at(position, position + ahead, DVec3::Z, 1.0).context("no valid view direction")?;
        let [width_px, height_px] = size_px;
        Ok::<_, anyhow::Error>(View {
            camera,
            width_px,
            height_px,
            tau_px: 1.0,
            switching: None,
            budget_pages: 24_000,
            budget_nodes: 6000,
        })
    };
    let look = RenderSettings { samples: args.rays, shadow_m: args.shadows, ..RenderSettings::default() };
    let mut differences = Differences::default();
    let mut last: Option<Pixels> = None;
    for frame in 0..FRAMES {
        let (data, changed) = client.frame(&view(0.0)?, &look, args.tiles, FRAME_SECS)?;
        if data.nodes.is_empty() {
            continue;
        }
        if !changed && client.is_at_rest(size_px) {
            break;
        }
        if !changed && last.is_some() {
            // The hits of its rays may not be known yet.
            client.draw(&data);
            continue;
        }
        let pixels = client.draw(&data);
        if let (Some(folder), true) = (&args.frames, transitions) {
            let path = folder.join(format!("{}-{name}-{frame:04}.png", city.manifest().name));
            write_png(&path, &pixels)?;
        }
        if let Some(last) = &last {
            differences.add(last, &pixels);
        }
        last = Some(pixels);
    }
    let mut pan = Differences::default();
    for i in 1..if transitions { 4 } else { 1 } {
        let (data, _) = client.frame(&view(args.turn * f64::from(i))?, &look, usize::MAX, 1.0)?;
        let pixels = client.draw(&data);
        if let Some(last) = &last {
            pan.add(last, &pixels);
        }
        last = Some(pixels);
    }
    Ok((differences, pan))
}
