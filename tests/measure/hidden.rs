//! Measures how much is drawn and fetched that is occluded, and what is missing when the camera turns.
//!
//! `cargo run --release -p insula-measure --bin hidden -- --city DIR`: DIR is a baked folder, for example of `synth`. Compares with
//! a client that culls by the view frustum only.

use anyhow::Result;
use clap::Parser;
use insula_client::{
    commands::headless::settle,
    report::compare_frames,
    session::{PrefetchStep, Session},
    stream::simulated_link::SimulatedLink,
};
use insula_protocol::TileId;
use insula_shaders::cpu::raycast::Pixels;
use insula_tests::{
    synth::Viewpoint,
    viewer::{fetch_all, open, open_over},
};
use insula_viewer::{camera::Camera, frame::RenderSettings, scene::TileKey, select::DrawTile, streamer::FrameRequest};
use serde::Serialize;
use std::{
    collections::HashSet,
    path::PathBuf,
    time::{Duration, Instant},
};

/// Compares occlusion culling with frustum culling alone
#[derive(Debug, Parser)]
struct Args {
    /// Folder of the baked city
    #[arg(long)]
    city: PathBuf,
    /// Camera file (default: the street of the synthetic cities)
    #[arg(long)]
    camera: Option<PathBuf>,
    /// Number of directions, evenly distributed
    #[arg(long, default_value_t = 4)]
    directions: u32,
    /// Frame width in pixels
    #[arg(long, default_value_t = 1280)]
    width: u32,
    /// Frame height in pixels
    #[arg(long, default_value_t = 720)]
    height: u32,
    /// Tolerated error in pixels
    #[arg(long, default_value_t = 1.0)]
    tau: f64,
    /// Bandwidth of the simulated network in Mbit/s
    #[arg(long)]
    bandwidth: Option<f64>,
    /// Round-trip time of the simulated network in milliseconds
    #[arg(long, requires = "bandwidth")]
    rtt: Option<u64>,
    /// Write all measures as JSON
    #[arg(long)]
    report: Option<PathBuf>,
    /// Write the frames into this folder
    #[arg(long)]
    out: Option<PathBuf>,
}

const TIMEOUT: Duration = Duration::from_secs(60);
const CACHE_MIB: u32 = 2048;

#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Cost {
    drawn: usize,
    fetched: usize,
    unhit_share: f64,
    /// Of the drawn tiles only.
    drawn_unhit_share: f64,
    bytes: u64,
    requests: u64,
    secs: f64,
    /// Bytes of the tiles that rays hit, of their ancestors, and of the others.
    seen_bytes: u64,
    above_bytes: u64,
    occluded_bytes: u64,
}

#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Turn {
    degrees: f64,
    /// With all tiles resident: the cost of the selection alone.
    wrong_share: f64,
    holes_share: f64,
    /// With the tiles of the previous view.
    cold_wrong_share: f64,
    cold_holes_share: f64,
    /// With the tiles of the previous view and of idle prefetch.
    rested_wrong_share: f64,
    rested_holes_share: f64,
    rested_bytes: u64,
    rested_secs: f64,
}

#[derive(Debug, Serialize)]
struct Row {
    direction: u32,
    frustum: Cost,
    occlusion: Cost,
    bytes_share: f64,
    wrong_share: f64,
    holes_share: f64,
    turns: Vec<Turn>,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let camera = match &args.camera {
        Some(path) => insula_client::camera_files::read_camera(path)?,
        None => Viewpoint::Street.camera().to_viewer()?,
    };
    let mut rows = Vec::new();
    for direction in 0..args.directions {
        let degrees = 360.0 * f64::from(direction) / f64::from(args.directions);
        let row = measure_direction(&args, &camera.turned(degrees), direction)?;
        let Row { frustum: f, occlusion: o, .. } = &row;
        println!(
            "{degrees:5.0} degrees: drawn {} of {}, fetched {} of {}, hit by no ray {:.1} % (frustum alone {:.1} %), of those drawn {:.1} % ({:.1} %), \
             {} of {} KiB = {:.1} %, {} of {} requests, {:.1} s; wrong {:.4} %, city in one frame only {:.4} %",
            o.drawn,
            f.drawn,
            o.fetched,
            f.fetched,
            o.unhit_share * 100.0,
            f.unhit_share * 100.0,
            o.drawn_unhit_share * 100.0,
            f.drawn_unhit_share * 100.0,
            o.bytes >> 10,
            f.bytes >> 10,
            row.bytes_share * 100.0,
            o.requests,
            f.requests,
            o.secs,
            row.wrong_share * 100.0,
            row.holes_share * 100.0,
        );
        println!(
            "      of the tiles: {} KiB are seen, {} lie above those, {} are occluded = {:.1} % of what is seen (frustum alone: {}, {}, {})",
            o.seen_bytes >> 10,
            o.above_bytes >> 10,
            o.occluded_bytes >> 10,
            o.occluded_bytes as f64 / o.seen_bytes.max(1) as f64 * 100.0,
            f.seen_bytes >> 10,
            f.above_bytes >> 10,
            f.occluded_bytes >> 10,
        );
        for t in &row.turns {
            println!(
                "      turned by {:4}: wrong {:.4} %, city in one only {:.4} %; with nothing new fetched: {:.3} %, {:.4} %; after a rest ({} KiB, {:.1} s): {:.3} %, {:.4} %",
                t.degrees,
                t.wrong_share * 100.0,
                t.holes_share * 100.0,
                t.cold_wrong_share * 100.0,
                t.cold_holes_share * 100.0,
                t.rested_bytes >> 10,
                t.rested_secs,
                t.rested_wrong_share * 100.0,
                t.rested_holes_share * 100.0
            );
        }
        rows.push(row);
    }
    let most = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).fold(0.0, f64::max) * 100.0;
    let turn = |i: usize| most(&|row: &Row| row.turns[i].wrong_share);
    println!(
        "worst: hit by no ray {:.1} %, bytes {:.1} %, wrong after 3 degrees {:.4} %, after 30 {:.4} %, city in one only {:.4} %",
        most(&|row| row.occlusion.unhit_share),
        most(&|row| row.bytes_share),
        turn(0),
        turn(1),
        most(&|row| row.turns.iter().map(|t| t.holes_share).fold(row.holes_share, f64::max)),
    );
    if let Some(path) = &args.report {
        std::fs::write(path, serde_json::to_vec_pretty(&rows)?)?;
    }
    Ok(())
}

fn request(args: &Args, camera: &Camera) -> FrameRequest {
    FrameRequest {
        camera: *camera,
        heading: None,
        size_px: [args.width, args.height],
        tau_px: args.tau,
        switching: None,
    }
}

/// Draws without occlusion feedback.
fn draw(session: &mut Session, request: &FrameRequest) -> Result<(Pixels, Vec<DrawTile>)> {
    let data = session.frame_data(request, &RenderSettings::default());
    let draw_list = session.selection().draw_tiles.clone();
    Ok((session.adapter_mut().draw(&data)?, draw_list))
}

fn cost(session: &Session, pixels: &Pixels, draw_list: &[DrawTile], secs: f64) -> Cost {
    let tree = session.tree();
    let key = |item: &DrawTile| match item.mesh_lod {
        Some(lod) => TileKey::mesh(tree.node(item.node).id, lod),
        None => TileKey::block_map(tree.node(item.source).id),
    };
    let hits: HashSet<u32> = pixels.hit.iter().copied().collect();
    let hit: Vec<&DrawTile> = (0..).zip(draw_list).filter(|(i, _)| hits.contains(i)).map(|(_, item)| item).collect();
    let seen: HashSet<TileKey> = hit.iter().map(|item| key(item)).collect();
    let ids = hit.iter().map(|item| tree.node(item.node).id);
    let above: HashSet<TileId> =
        ids.flat_map(|id| (0..id.level()).filter_map(move |level| id.ancestor(level))).collect();
    let drawn: HashSet<TileKey> = draw_list.iter().map(key).collect();
    let mut fetched = Vec::new();
    for node in tree.nodes() {
        fetched.extend(node.tile.is_resident().then_some((TileKey::block_map(node.id), node.bytes)));
        let meshes = (0..).zip(&node.lods).filter(|(_, mesh)| mesh.tile.is_resident());
        fetched.extend(meshes.map(|(lod, mesh)| (TileKey::mesh(node.id, lod), mesh.bytes)));
    }
    let bytes = |is: &dyn Fn(&TileKey) -> bool| {
        fetched.iter().filter(|(key, _)| is(key)).map(|(_, bytes)| u64::from(*bytes)).sum::<u64>()
    };
    let is_above = |key: &TileKey| !seen.contains(key) && *key == TileKey::block_map(key.id) && above.contains(&key.id);
    let share = |unhit: usize, all: usize| unhit as f64 / all.max(1) as f64;
    let report = session.report(1.0);
    Cost {
        drawn: drawn.len(),
        fetched: fetched.len(),
        unhit_share: share(fetched.iter().filter(|(key, _)| !seen.contains(key)).count(), fetched.len()),
        drawn_unhit_share: share(drawn.difference(&seen).count(), drawn.len()),
        bytes: report.bytes_fetched,
        requests: report.requests,
        secs,
        seen_bytes: bytes(&|key| seen.contains(key)),
        above_bytes: bytes(&is_above),
        occluded_bytes: bytes(&|key| !seen.contains(key) && !is_above(key)),
    }
}

fn measure_direction(args: &Args, camera: &Camera, direction: u32) -> Result<Row> {
    let (ahead, city) = (request(args, camera), &args.city);
    let mut all = open(city, CACHE_MIB)?;
    let begin = Instant::now();
    fetch_all(&mut all, &ahead, TIMEOUT)?;
    let secs = begin.elapsed().as_secs_f64();
    let (truth, draw_list) = draw(&mut all, &ahead)?;
    let frustum = cost(&all, &truth, &draw_list, secs);

    let link = |mbit| SimulatedLink::new(Some(mbit), Duration::from_millis(args.rtt.unwrap_or(0)), 0.0);
    let mut few = open_over(args.bandwidth.map(link), city, CACHE_MIB)?;
    let begin = Instant::now();
    settle(&mut few, &ahead, TIMEOUT)?;
    let secs = begin.elapsed().as_secs_f64();
    let (seen, draw_list) = draw(&mut few, &ahead)?;
    let occlusion = cost(&few, &seen, &draw_list, secs);
    let apart = compare_frames(&seen, &truth);
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out)?;
        insula_client::image_files::write_png(&out.join(format!("{direction}-frustum.png")), &truth)?;
        insula_client::image_files::write_png(&out.join(format!("{direction}-occlusion.png")), &seen)?;
    }

    let mut turns = Vec::new();
    for degrees in [3.0, 30.0] {
        let beside = request(args, &camera.turned(degrees));
        let mut reference = open(city, CACHE_MIB)?;
        fetch_all(&mut reference, &beside, TIMEOUT)?;
        fetch_all(&mut reference, &ahead, TIMEOUT)?;
        fetch_all(&mut reference, &beside, TIMEOUT)?;
        let (truth, _) = draw(&mut reference, &beside)?;
        // The same client settles ahead, then turns.
        settle(&mut reference, &ahead, TIMEOUT)?;
        reference.update(&beside);
        let warm = compare_frames(&draw(&mut reference, &beside)?.0, &truth);
        let mut cold = open(city, CACHE_MIB)?;
        settle(&mut cold, &ahead, TIMEOUT)?;
        cold.update(&beside);
        let cold_px = draw(&mut cold, &beside)?.0;
        if let Some(out) = &args.out {
            insula_client::image_files::write_png(&out.join(format!("{direction}-{degrees}-cold.png")), &cold_px)?;
            insula_client::image_files::write_png(&out.join(format!("{direction}-{degrees}-truth.png")), &truth)?;
        }
        let cold = compare_frames(&cold_px, &truth);
        let mut rested = open_over(args.bandwidth.map(link), city, CACHE_MIB)?;
        settle(&mut rested, &ahead, TIMEOUT)?;
        let begin = Instant::now();
        while rested.prefetch(&ahead)? != PrefetchStep::Done {
            rested.wait(Duration::from_millis(5));
            settle(&mut rested, &ahead, TIMEOUT)?;
        }
        let rested_secs = begin.elapsed().as_secs_f64();
        rested.update(&beside);
        let rested_bytes = rested.report(1.0).bytes_fetched;
        let rested = compare_frames(&draw(&mut rested, &beside)?.0, &truth);
        turns.push(Turn {
            degrees,
            wrong_share: warm.wrong_share,
            holes_share: warm.holes_share,
            cold_wrong_share: cold.wrong_share,
            cold_holes_share: cold.holes_share,
            rested_wrong_share: rested.wrong_share,
            rested_holes_share: rested.holes_share,
            rested_bytes,
            rested_secs,
        });
    }
    Ok(Row {
        direction,
        frustum,
        occlusion,
        bytes_share: occlusion.bytes as f64 / frustum.bytes.max(1) as f64,
        wrong_share: apart.wrong_share,
        holes_share: apart.holes_share,
        turns,
    })
}
