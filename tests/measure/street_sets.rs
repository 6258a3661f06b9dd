//! Compares what street views fetch with and without the city's sets of what can be seen, over a simulated link in simulated time.
//!
//! `cargo run --release -p insula-measure --bin street_sets -- CITY`: random eyes 1.7 m above the ground look along random directions.
//! Each view is streamed from an empty cache to its final frame, once as if the city had no sets. A frame takes 2 ms and decoding
//! no time, so that the results do not depend on the machine.

use anyhow::{Result, ensure};
use clap::Parser;
use insula_archive::BakedCity;
use insula_protocol::{TileId, TileKind};
use insula_shaders::cpu::{hit_counts::hit_counts, raycast::Pixels};
use insula_test_support::rng::Rng;
use insula_tests::street_people::{SIZE_PX, SimulatedLink, new_client, random_view};
use insula_viewer::{
    camera::Camera,
    frame::RenderSettings,
    streamer::{FEEDBACK_DOWNSCALE, FrameRequest},
};
use std::{cell::Cell, collections::BTreeSet, path::PathBuf, rc::Rc, time::Duration};

/// Compares street views with and without sets
#[derive(Debug, Parser)]
struct Args {
    /// Folder of the baked city, with sets
    city: PathBuf,
    /// Number of views
    #[arg(long, default_value_t = 12)]
    views: u32,
    #[command(flatten)]
    link: SimulatedLink,
}

const STEP: Duration = Duration::from_millis(2);
const MAX_FULL_FRAMES: u32 = 24;
/// A view that takes longer than this will never be complete.
const STREAM_LIMIT: Duration = Duration::from_secs(60);

/// What a view took.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    bytes: usize,
    requests: usize,
    /// V-BlockMaps and meshes, and those of them of which no ray of the final frame hits anything.
    tiles: usize,
    unhit: usize,
    unhit_bytes: usize,
    secs: f64,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let city = BakedCity::open(&args.city)?;
    let mut rng = Rng::new(11);
    let mut sums = [[0.0; 6]; 2];
    let mut wrong = 0.0f64;
    for number in 0..args.views {
        let camera = random_view(&city, &mut rng)?;
        let (before, pixels) = stream(&city, camera, false, &args)?;
        let (after, with_sets) = stream(&city, camera, true, &args)?;
        let apart = pixels.colour.iter().zip(&with_sets.colour).filter(|(a, b)| differ(**a, **b)).count();
        wrong = wrong.max(apart as f64 / pixels.colour.len() as f64);
        for (name, cost, sum) in [("before", before, 0), ("with sets", after, 1)] {
            println!(
                "{number} {name}: {} kB, {} requests, {} tiles, {} hit by no ray of {} kB, {:.2} s",
                cost.bytes / 1000,
                cost.requests,
                cost.tiles,
                cost.unhit,
                cost.unhit_bytes / 1000,
                cost.secs
            );
            let values = [cost.bytes, cost.requests, cost.tiles, cost.unhit, cost.unhit_bytes].map(|v| v as f64);
            for (total, value) in sums[sum].iter_mut().zip(values.into_iter().chain([cost.secs])) {
                *total += value;
            }
        }
        println!("{number} pixels that differ: {:.4} %", 100.0 * apart as f64 / pixels.colour.len() as f64);
    }
    let views = f64::from(args.views);
    for (name, sum) in ["before", "with sets"].into_iter().zip(sums) {
        println!(
            "{name}, mean: {:.0} kB, {:.0} requests, {:.0} tiles, {:.1} % hit by no ray ({:.1} % of the bytes), {:.2} s",
            sum[0] / views / 1e3,
            sum[1] / views,
            sum[2] / views,
            100.0 * sum[3] / sum[2],
            100.0 * sum[4] / sum[0],
            sum[5] / views
        );
    }
    println!(
        "with sets: {:.2} of the bytes, {:.2} of the requests, {:.2} of the time; most pixels that differ {:.4} %",
        sums[1][0] / sums[0][0],
        sums[1][1] / sums[0][1],
        sums[1][5] / sums[0][5],
        wrong * 100.0
    );
    Ok(())
}

/// Whether two colours differ by more than 8 of 255 in a channel.
fn differ(a: u32, b: u32) -> bool {
    (0..3).any(|channel| (a >> (8 * channel) & 255).abs_diff(b >> (8 * channel) & 255) > 8)
}

/// Streams a view to its end. Returns the final frame, too.
fn stream(city: &BakedCity, camera: Camera, has_sets: bool, args: &Args) -> Result<(Cost, Pixels)> {
    let clock = Rc::new(Cell::new(Duration::ZERO));
    let (mut streamer, mut adapter) = new_client(city, has_sets, args.link, &clock);
    let request = FrameRequest { camera, heading: None, size_px: SIZE_PX, tau_px: 1.0, switching: None };
    let small_px = SIZE_PX.map(|side| side / FEEDBACK_DOWNSCALE);
    let settings = RenderSettings::default();
    let (mut now, mut full_frames) = (Duration::ZERO, 0);
    let mut last_arrival = Duration::ZERO;
    loop {
        clock.set(now);
        let arrived = streamer.downloads().fetcher().fetched.len();
        streamer.update(&request, &mut adapter, now);
        ensure!(
            now < STREAM_LIMIT,
            "not complete after {STREAM_LIMIT:?}: {:?}",
            streamer.selection().requests.iter().take(4).collect::<Vec<_>>()
        );
        if streamer.downloads().fetcher().fetched.len() > arrived {
            last_arrival = now;
        }
        let size_px = if !streamer.is_fetched() {
            // Every frame takes a step of time: what two frames in turn find visible may never be the same before tiles arrive.
            now += STEP;
            if streamer.selection().draw_tiles.is_empty() || streamer.has_feedback(small_px) {
                continue;
            }
            small_px
        } else if !streamer.has_feedback(SIZE_PX) && full_frames < MAX_FULL_FRAMES {
            full_frames += 1;
            SIZE_PX
        } else {
            break;
        };
        let data = streamer.frame_data(&FrameRequest { size_px, ..request }, &settings);
        let pixels = adapter.draw(&data);
        streamer.report_hits(&data.query, &hit_counts(&pixels.hit, data.nodes.len()));
    }
    let data = streamer.frame_data(&request, &settings);
    let pixels = adapter.draw(&data);
    let selection = streamer.selection();
    let squares: Vec<TileId> = selection.draw_tiles.iter().map(|item| streamer.tree().node(item.node).id).collect();
    let hit: BTreeSet<TileId> = pixels.hit.iter().filter_map(|at| squares.get(*at as usize).copied()).collect();
    let mut cost = Cost { secs: last_arrival.as_secs_f64(), ..Cost::default() };
    for (key, bytes) in &streamer.downloads().fetcher().fetched {
        (cost.bytes, cost.requests) = (cost.bytes + bytes, cost.requests + 1);
        if matches!(key.kind(), TileKind::BlockMap | TileKind::Mesh) {
            let is_hit = hit.iter().any(|id| id.ancestor(key.id.level()) == Some(key.id));
            cost.tiles += 1;
            cost.unhit += usize::from(!is_hit);
            cost.unhit_bytes += if is_hit { 0 } else { *bytes };
        }
    }
    Ok((cost, pixels))
}
