//! Measures how much a slow pan flickers: the mean difference of consecutive frames, compared with supersampled frames.
//!
//! `cargo run --release -p insula-measure --bin flicker -- CITY... --report flicker.json`: each CITY is a baked folder. With few
//! rays per pixel, frames differ by what the rays happen to hit, in addition to the motion.

use anyhow::{Context, Result};
use clap::Parser;
use glam::{DQuat, DVec3};
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::cpu::shade::{encode_srgb, linear_of};
use insula_shaders::layout::{MAX_SAMPLES, Shading};
use insula_tests::baked::Baked;
use insula_tests::draw_list::DrawList;
use insula_tests::view::{Camera, FrameSpec};
use serde::Serialize;
use std::fs;
use std::path::PathBuf;

/// Rays along a pixel's side in the supersampled frames.
const TRUTH_RAYS: u32 = 8;

/// Compares slow pans with few and many rays per pixel
#[derive(Debug, Parser)]
struct Args {
    /// Baked cities
    #[arg(required = true)]
    cities: Vec<PathBuf>,
    /// Rays along a pixel's side to compare
    #[arg(long, value_delimiter = ',', default_value = "1,2,3,4")]
    rays: Vec<u32>,
    /// Width of a frame in pixels; its height is 9/16 of it
    #[arg(long, default_value_t = 640)]
    width: u32,
    /// Degrees between two frames
    #[arg(long, default_value_t = 0.1)]
    turn: f64,
    /// Frames of a pan
    #[arg(long, default_value_t = 4)]
    frames: usize,
    /// Reach of shadows in metres, 0 for none
    #[arg(long, default_value_t = 3000.0)]
    shadows: f32,
    /// Write all measures as JSON
    #[arg(long)]
    report: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct Row {
    city: String,
    view: &'static str,
    /// Mean absolute difference of consecutive supersampled frames over red, green and blue, in 255ths.
    truth: f64,
    /// The same for each number of rays along a side, and its ratio to `truth`.
    drawn: Vec<(u32, f64, f64)>,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let mut rows = Vec::new();
    for folder in &args.cities {
        let city = Baked::open(folder)?;
        for (view, [position, target]) in city.overviews().into_iter().skip(1) {
            let row = pan(&args, &city, view, Camera::looking(position, target))?;
            let drawn: Vec<String> = row.drawn.iter().map(|(n, d, r)| format!("{n} x {n}: {d:.2} ({r:.2})")).collect();
            println!("{:8} {:6}: truth {:.2}; {}", row.city, row.view, row.truth, drawn.join(", "));
            rows.push(row);
        }
    }
    for (i, rays) in args.rays.iter().enumerate() {
        let worst = rows.iter().map(|row| row.drawn[i].2).fold(0.0, f64::max);
        let mean = rows.iter().map(|row| row.drawn[i].2).sum::<f64>() / rows.len().max(1) as f64;
        println!("{rays} x {rays} rays: {mean:.2} times the truth's, {worst:.2} at worst");
    }
    if let Some(report) = &args.report {
        fs::write(report, serde_json::to_vec_pretty(&rows)?)?;
    }
    Ok(())
}

fn pan(args: &Args, city: &Baked, view: &'static str, camera: Camera) -> Result<Row> {
    let spec = FrameSpec { width_px: args.width, height_px: args.width * 9 / 16, shading: Shading::Lit, samples: 1 };
    // In all directions, so that the draw list does not change.
    let draw_list = city.draw_list(&city.select(&camera, &spec, 1.0))?;
    let turned: Vec<Camera> = (0..args.frames).map(|i| turn(&camera, args.turn * i as f64)).collect();
    let truth = apart(turned.iter().map(|camera| supersampled(args, &draw_list, camera, &spec, city)))?;
    let mut drawn = Vec::new();
    for rays in &args.rays {
        let spec = FrameSpec { samples: (*rays).min(MAX_SAMPLES), ..spec };
        let apart = apart(turned.iter().map(|camera| draw(args, &draw_list, camera, &spec, city)))?;
        drawn.push((*rays, apart, apart / truth));
    }
    Ok(Row { city: city.manifest().name.clone(), view, truth, drawn })
}

/// Rotates the camera around the vertical axis.
fn turn(camera: &Camera, degrees: f64) -> Camera {
    let position = DVec3::from(camera.position);
    let ahead = DQuat::from_rotation_z(degrees.to_radians()) * (DVec3::from(camera.target) - position);
    Camera { target: (position + ahead).into(), ..*camera }
}

fn draw(args: &Args, draw_list: &DrawList, camera: &Camera, spec: &FrameSpec, city: &Baked) -> Pixels {
    let mut scene = draw_list.scene(camera, spec);
    scene.frame.ground = 1;
    scene.frame.ground_z_m = (city.manifest().ground_z_m - camera.position[2]) as f32;
    scene.frame.shadow_m = args.shadows;
    scene.render()
}

/// A larger frame, averaged in linear light.
fn supersampled(args: &Args, draw_list: &DrawList, camera: &Camera, spec: &FrameSpec, city: &Baked) -> Pixels {
    let side = TRUTH_RAYS / MAX_SAMPLES;
    let (width_px, height_px) = (spec.width_px * side, spec.height_px * side);
    let large = FrameSpec { width_px, height_px, samples: MAX_SAMPLES, ..*spec };
    let large = draw(args, draw_list, camera, &large, city);
    let colour = (0..spec.width_px * spec.height_px).map(|i| {
        let (x, y) = (i % spec.width_px * side, i / spec.width_px * side);
        let part = (0..side * side).map(|k| large.colour[((y + k / side) * width_px + x + k % side) as usize]);
        encode_srgb(part.map(linear_of).sum::<glam::Vec3>() / (side * side) as f32)
    });
    Pixels { width_px: spec.width_px, height_px: spec.height_px, colour: colour.collect(), ..Pixels::default() }
}

/// Mean absolute difference of consecutive frames.
fn apart(frames: impl Iterator<Item = Pixels>) -> Result<f64> {
    let frames: Vec<Pixels> = frames.collect();
    let (mut sum, mut count) = (0u64, 0u64);
    for pair in frames.windows(2) {
        for (a, b) in pair[0].colour.iter().zip(&pair[1].colour) {
            let channels = a.to_le_bytes().into_iter().zip(b.to_le_bytes()).take(3);
            sum += channels.map(|(a, b)| u64::from(a.abs_diff(b))).sum::<u64>();
            count += 3;
        }
    }
    (count > 0).then(|| sum as f64 / count as f64).context("a pan has two frames at least")
}
