//! Measures how much a frame changes when leaves switch from columns to meshes, compared with a camera motion of one pixel.
//!
//! `cargo run --release -p insula-measure --bin handover -- CITY_INPUTS... --city CITY`

use anyhow::Result;
use clap::Parser;
use glam::DVec3;
use insula_protocol::TileId;
use insula_shaders::{cpu::raycast::Pixels, layout::Shading};
use insula_tests::{
    baked::Baked,
    cameras,
    draw_list::DrawList,
    fidelity,
    truth::Truth,
    view::{Camera, FrameSpec},
};
use insula_viewer::frame::STILL_SAMPLES;
use std::{collections::HashSet, path::PathBuf};

/// Varies the projected error at which leaves switch from columns to meshes
#[derive(Debug, Parser)]
struct Args {
    /// City files
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// The same city, baked with meshes
    #[arg(long)]
    city: PathBuf,
    /// Projected errors of the V-BlockMap at which leaves switch, in pixels
    #[arg(long, value_delimiter = ',', default_value = "0.5,1,2,4")]
    at: Vec<f64>,
    /// Reach of shadows in metres, 0 for none
    #[arg(long, default_value_t = 0.0)]
    shadows: f32,
}

const FRAME: FrameSpec = FrameSpec { width_px: 640, height_px: 360, shading: Shading::Lit, samples: STILL_SAMPLES };
/// Largest ratio of a leaf's projected error to that of the switch.
const AROUND: f64 = 1.25;

/// Mean difference of the channels over the pixels `of`, in 255ths.
fn difference(a: &Pixels, b: &Pixels, of: &[usize]) -> f64 {
    let apart = |at: &usize| {
        let (a, b) = (a.colour[*at].to_le_bytes(), b.colour[*at].to_le_bytes());
        (0..3).map(|k| f64::from(a[k].abs_diff(b[k]))).sum::<f64>() / 3.0
    };
    of.iter().map(apart).sum::<f64>() / of.len().max(1) as f64
}

fn main() -> Result<()> {
    let args = Args::parse();
    let (truth, baked) = (Truth::new(fidelity::read(&args.inputs)?), Baked::open(&args.city)?);
    let draw = |draw_list: &DrawList, camera: &Camera| {
        let mut scene = draw_list.scene(camera, &FRAME);
        scene.frame.shadow_m = args.shadows;
        scene.render()
    };
    println!("passing at px | pixels | switch | motion of a pixel: columns, meshes (mean of the channels, 255ths)");
    for at_px in &args.at {
        let (mut pixels, mut sums) = (0, [0.0; 3]);
        for station in cameras::stations(&truth) {
            let camera = station.camera;
            let ids = baked.select(&camera, &FRAME, 1.0f64.min(*at_px));
            let passing: HashSet<TileId> = ids
                .iter()
                .copied()
                .filter(|id| baked.passes(*id, &camera, &FRAME, at_px / AROUND..at_px * AROUND))
                .collect();
            let before = baked.draw_list_with_meshes(&ids, |id| match passing.contains(&id) {
                true => None,
                false => baked.drawn_lod(id, &camera, &FRAME, *at_px),
            })?;
            let after = baked.draw_list_with_meshes(&ids, |id| match passing.contains(&id) {
                true => baked.drawn_lod(id, &camera, &FRAME, at_px / AROUND),
                false => baked.drawn_lod(id, &camera, &FRAME, *at_px),
            })?;
            let (columns, meshes) = (draw(&before, &camera), draw(&after, &camera));
            let of: Vec<usize> = (0..columns.hit.len())
                .filter(|at| before.id(columns.hit[*at]).is_some_and(|id| passing.contains(&id)))
                .collect();
            if of.is_empty() {
                continue;
            }
            let away_m = of.iter().map(|at| f64::from(columns.distance[*at])).sum::<f64>() / of.len() as f64;
            let step = camera.axes(&FRAME).right * (2.0 / f64::from(FRAME.width_px) * away_m);
            let moved = |v: [f64; 3]| (DVec3::from(v) + step).to_array();
            let moved = Camera { position: moved(camera.position), target: moved(camera.target), ..camera };
            let of_each = [
                difference(&columns, &meshes, &of),
                difference(&columns, &draw(&before, &moved), &of),
                difference(&meshes, &draw(&after, &moved), &of),
            ];
            println!(
                "  {:?} {at_px}: {} px, {:.2} | {:.2} {:.2}",
                station.kind,
                of.len(),
                of_each[0],
                of_each[1],
                of_each[2]
            );
            pixels += of.len();
            sums.iter_mut().zip(of_each).for_each(|(sum, value)| *sum += value * of.len() as f64);
        }
        let [switch, columns, meshes] = sums.map(|sum| sum / f64::from(pixels.max(1) as u32));
        println!("{at_px:>6} | {pixels} | {switch:.2} | {columns:.2}, {meshes:.2}");
    }
    Ok(())
}
