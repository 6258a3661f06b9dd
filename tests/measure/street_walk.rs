//! Measures how long a walking person waits for tiles, with and without the city's sets of what can be seen.
//!
//! `cargo run --release -p insula-measure --bin street_walk -- CITY`: each walk goes 200 m straight ahead from a random place in a street.
//! Tiles arrive over a simulated link in simulated time. The wait for a tile begins with the first frame that needs it, and ends when
//! the tile is resident or no longer needed. Tiles that are out of view or known to be occluded are not needed.

use anyhow::Result;
use clap::Parser;
use glam::DVec3;
use insula_archive::BakedCity;
use insula_protocol::TileKind;
use insula_shaders::cpu::hit_counts::hit_counts;
use insula_test_support::rng::Rng;
use insula_tests::street_people::{SIZE_PX, SimulatedLink, new_client, random_view};
use insula_viewer::{
    camera::Camera,
    frame::RenderSettings,
    scene::TileKey,
    select::priority::{PriorityGroup, TileRequest},
    streamer::{FEEDBACK_DOWNSCALE, FrameRequest},
};
use std::{cell::Cell, collections::HashMap, path::PathBuf, rc::Rc, time::Duration};

/// Measures how long a walking person waits for tiles
#[derive(Debug, Parser)]
struct Args {
    /// Folder of the baked city, with sets
    city: PathBuf,
    /// Number of walks
    #[arg(long, default_value_t = 4)]
    walks: u32,
    /// Metres per second
    #[arg(long, default_value_t = 4.0)]
    speed: f64,
    #[command(flatten)]
    link: SimulatedLink,
}

const LENGTH_M: f64 = 200.0;
/// Time of a frame.
const FRAME: Duration = Duration::from_millis(20);
/// Every so many frames, the rays of one are counted.
const FEEDBACK_FRAMES: u32 = 5;
/// The camera is expected to be where it will be so much later, as the viewer does.
const LOOKAHEAD: Duration = Duration::from_millis(500);
/// The walk begins after so long, when the first view is complete.
const ARRIVAL: Duration = Duration::from_secs(4);

/// What a walk needed.
#[derive(Debug, Default)]
struct Walk {
    bytes: usize,
    requests: usize,
    /// The wait for each tile, sorted.
    waits: Vec<Duration>,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let city = BakedCity::open(&args.city)?;
    let mut rng = Rng::new(5);
    let mut all = [Walk::default(), Walk::default()];
    for number in 0..args.walks {
        let start = random_view(&city, &mut rng)?;
        for (has_sets, sum) in [false, true].into_iter().zip(&mut all) {
            let walk = stream(&city, start, has_sets, &args);
            println!("{number} {}: {}", if has_sets { "with sets" } else { "without" }, described(&walk));
            sum.bytes += walk.bytes;
            sum.requests += walk.requests;
            sum.waits.extend(walk.waits);
        }
    }
    for (mut sum, name) in all.into_iter().zip(["without", "with sets"]) {
        sum.waits.sort_unstable();
        println!("all {name}: {}", described(&sum));
    }
    Ok(())
}

fn described(walk: &Walk) -> String {
    let count = walk.waits.len();
    let at = |share: f64| walk.waits.get((share * count as f64) as usize).copied().unwrap_or_default().as_secs_f64();
    let long = walk.waits.iter().filter(|wait| **wait > Duration::from_secs(1)).count();
    let longest = walk.waits.last().copied().unwrap_or_default().as_secs_f64();
    format!(
        "{} kB, {} requests, {count} tiles waited for: median {:.2} s, 95% {:.2} s, longest {longest:.2} s, {long} over 1 s",
        walk.bytes / 1000,
        walk.requests,
        at(0.5),
        at(0.95)
    )
}

/// Walks straight ahead from `start`.
fn stream(city: &BakedCity, start: Camera, has_sets: bool, args: &Args) -> Walk {
    let clock = Rc::new(Cell::new(Duration::ZERO));
    let (mut streamer, mut adapter) = new_client(city, has_sets, args.link, &clock);
    let along = DVec3::new(start.forward.x, start.forward.y, 0.0).normalize_or(DVec3::X);
    let camera = |now: Duration| {
        let way_m = (now.saturating_sub(ARRIVAL).as_secs_f64() * args.speed).min(LENGTH_M);
        Camera { position: start.position + along * way_m, ..start }
    };
    let end = ARRIVAL + Duration::from_secs_f64(LENGTH_M / args.speed);
    let small_px = SIZE_PX.map(|side| side / FEEDBACK_DOWNSCALE);
    let settings = RenderSettings::default();
    let mut walk = Walk::default();
    let mut lacking: HashMap<TileKey, Duration> = HashMap::new();
    let (mut now, mut frame) = (Duration::ZERO, 0u32);
    while now < end {
        clock.set(now);
        let heading = (now >= ARRIVAL).then(|| camera(now + LOOKAHEAD));
        let request = FrameRequest { camera: camera(now), heading, size_px: SIZE_PX, tau_px: 1.0, switching: None };
        streamer.update(&request, &mut adapter, now);
        let lacks = |w: &&TileRequest| {
            matches!(w.group, PriorityGroup::Urgent | PriorityGroup::Normal)
                && matches!(w.key.kind(), TileKind::BlockMap | TileKind::Mesh)
        };
        let mut still: HashMap<TileKey, Duration> = HashMap::new();
        for wanted in streamer.selection().requests.iter().filter(lacks) {
            still.insert(wanted.key, lacking.get(&wanted.key).copied().unwrap_or(now));
        }
        let ended = lacking.iter().filter(|(key, since)| !still.contains_key(key) && **since >= ARRIVAL);
        walk.waits.extend(ended.map(|(_, since)| now - *since));
        lacking = still;
        if frame % FEEDBACK_FRAMES == 0 && !streamer.selection().draw_tiles.is_empty() {
            let data = streamer.frame_data(&FrameRequest { size_px: small_px, ..request }, &settings);
            let pixels = adapter.draw(&data);
            streamer.report_hits(&data.query, &hit_counts(&pixels.hit, data.nodes.len()));
        }
        now += FRAME;
        frame += 1;
    }
    walk.waits.extend(lacking.values().filter(|since| **since >= ARRIVAL).map(|since| now - *since));
    walk.waits.sort_unstable();
    for (_, bytes) in &streamer.downloads().fetcher().fetched {
        (walk.bytes, walk.requests) = (walk.bytes + bytes, walk.requests + 1);
    }
    walk
}
