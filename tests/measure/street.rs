//! Compares the bytes that views in streets fetch with those of the source's files.
//!
//! `cargo run --release -p insula-measure --bin street -- CITY_INPUTS... --city CITY`. For each street camera of `fidelity`: the
//! bytes that a client with empty caches fetches until its frame is final, and the bytes of the source that belong to the visible
//! leaves. A leaf is visible if a ray hits it, or a node above it, when everything in the view frustum is resident. See
//! `insula_tests::source_bytes`. For comparison: the source's bytes times the fraction of visible leaves, and the bytes of whole
//! files with a visible part.

use anyhow::Result;
use clap::Parser;
use insula_client::{commands::headless::settle, image_files::write_png, report::compare_frames, session::Session};
use insula_protocol::{TileId, mesh_tile, tile::TileKind};
use insula_server::store::CityStore;
use insula_shaders::cpu::raycast::Pixels;
use insula_tests::{
    cameras::{self, StationKind},
    fidelity,
    programs::ServerProcess,
    source_bytes::Source,
    truth::Truth,
    view,
    viewer::{fetch_all, open},
};
use insula_viewer::{frame::RenderSettings, streamer::FrameRequest};
use std::{
    collections::{BTreeSet, HashMap},
    path::{Path, PathBuf},
    time::Duration,
};

/// Compares what views in streets fetch with the source's files
#[derive(Debug, Parser)]
struct Args {
    /// City files
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// The same city, baked
    #[arg(long)]
    city: PathBuf,
    /// Width and height of the frames
    #[arg(long, num_args = 2, default_values_t = [1280, 720])]
    size: Vec<u32>,
    /// Tolerated error in pixels
    #[arg(long, default_value_t = 1.0)]
    tau: f64,
    /// Write the frames, and those with everything in the view frustum, into this folder
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print how many columns of each level are fetched
    #[arg(long)]
    levels: bool,
}

const TIMEOUT: Duration = Duration::from_secs(300);
const CACHE_MIB: u32 = 2048;

#[derive(Debug, Clone, Copy, Default)]
struct Fetched {
    all: u64,
    columns: u64,
    /// Of nodes that are not leaves.
    coarser: u64,
    meshes: u64,
    /// Number of visible leaves, and of leaves drawn as meshes.
    leaves: usize,
    drawn_meshes: u32,
    /// Share of pixels that differ from those of a client that has everything in the view frustum.
    wrong_share: f64,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let truth = Truth::new(fidelity::read(&args.inputs)?);
    let store = CityStore::open(&args.city)?;
    let served = ServerProcess::serve(&args.city, "127.0.0.1:0")?;
    let depth = store.manifest().depth;
    let leaves: BTreeSet<TileId> =
        store.blockmaps().lengths().map(|(id, _)| id).filter(|id| id.level() == depth).collect();
    let source = Source::read(&args.inputs, &truth.scene, store.manifest())?;
    let all = source.bytes_of(&leaves);
    println!(
        "source: {} kB; of its {} leaves {:.0} kB of text, {:.0} kB of frames' area",
        source.whole_bytes / 1000,
        leaves.len(),
        all.text / 1e3,
        all.textures / 1e3
    );
    println!(
        "| camera | fetched kB | columns | no leaves' | meshes | rest | leaves | as meshes | text kB | frames kB | times | by used area | by leaves | by files | wrong % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    for (number, station) in
        cameras::stations(&truth).into_iter().enumerate().filter(|s| s.1.kind == StationKind::Street)
    {
        let (fetched, shown, levels) =
            measure_view(&args, (number, &station.camera), (&store, served.address), &leaves)?;
        let of = source.bytes_of(&shown);
        let kb = |bytes: u64| bytes as f64 / 1e3;
        let times = |bytes: f64| bytes / fetched.all as f64;
        println!(
            "| {number} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {} | {} | {:.0} | {:.0} | {:.2} | {:.2} | {:.2} | {:.1} | {:.4} |",
            kb(fetched.all),
            kb(fetched.columns),
            kb(fetched.coarser),
            kb(fetched.meshes),
            kb(fetched.all - fetched.columns - fetched.meshes),
            fetched.leaves,
            fetched.drawn_meshes,
            of.text / 1e3,
            of.textures / 1e3,
            times(of.text + of.textures),
            times(of.text + of.textures_used),
            times(source.whole_bytes as f64 * shown.len() as f64 / leaves.len().max(1) as f64),
            times(of.files),
            fetched.wrong_share * 100.0,
        );
        for (level, [all, hit, drawn]) in levels.iter().enumerate().filter(|_| args.levels) {
            println!("  level {level}: {all}; hit, or above what is hit: {hit}; drawn: {drawn}");
        }
    }
    Ok(())
}

/// Number and bytes of some tiles.
#[derive(Debug, Clone, Copy, Default)]
struct TileCount {
    tiles: usize,
    bytes: u64,
}

impl std::fmt::Display for TileCount {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {:.1} kB", self.tiles, self.bytes as f64 / 1e3)
    }
}

/// For each level: V-BlockMaps that are fetched, those that are hit or above a hit one, and those that are drawn.
type Levels = Vec<[TileCount; 3]>;

/// Fetches a view with empty caches. Returns the leaves that it shows, too.
fn measure_view(
    args: &Args,
    (number, camera): (usize, &view::Camera),
    (store, address): (&CityStore, std::net::SocketAddr),
    leaves: &BTreeSet<TileId>,
) -> Result<(Fetched, BTreeSet<TileId>, Levels)> {
    let camera = camera.to_viewer()?;
    let request = FrameRequest {
        camera,
        heading: None,
        size_px: [args.size[0], args.size[1]],
        tau_px: args.tau,
        switching: None,
    };
    let server = format!("http://{address}");
    let mut all = open(Path::new(&server), CACHE_MIB)?;
    fetch_all(&mut all, &request, TIMEOUT)?;
    let (truth, hit) = draw(&mut all, &request)?;
    let mut session = open(Path::new(&server), CACHE_MIB)?;
    settle(&mut session, &request, TIMEOUT)?;
    let (seen, _) = draw(&mut session, &request)?;
    let apart = compare_frames(&seen, &truth);
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out)?;
        write_png(&out.join(format!("{number}.png")), &seen)?;
        write_png(&out.join(format!("{number}-all.png")), &truth)?;
    }
    let depth = store.manifest().depth;
    let shown: BTreeSet<TileId> = leaves
        .iter()
        .copied()
        .filter(|leaf| (0..=depth).any(|level| leaf.ancestor(level).is_some_and(|id| hit.contains(&id))))
        .collect();
    let lengths = |kind: TileKind| -> HashMap<TileId, u32> {
        let all = store.archive(kind).into_iter().flat_map(|archive| archive.lengths());
        all.filter_map(|(id, length)| Some((id, length.ok()?))).collect()
    };
    let (columns, meshes) = (lengths(TileKind::BlockMap), lengths(TileKind::Mesh));
    let report = session.report(args.tau);
    let mut fetched = Fetched {
        all: report.bytes_fetched,
        leaves: shown.len(),
        drawn_meshes: report.meshes_drawn,
        wrong_share: apart.wrong_share,
        ..Fetched::default()
    };
    let drawn: BTreeSet<TileId> =
        session.selection().draw_tiles.iter().map(|item| session.tree().node(item.source).id).collect();
    let mut levels = Levels::new();
    levels.resize(usize::from(depth) + 1, Default::default());
    for node in session.tree().nodes() {
        let of = |lengths: &HashMap<TileId, u32>, id: Option<TileId>| {
            u64::from(id.and_then(|id| lengths.get(&id)).copied().unwrap_or(0))
        };
        if node.tile.is_resident() {
            let bytes = of(&columns, Some(node.id));
            fetched.columns += bytes;
            fetched.coarser += if node.id.level() < depth { bytes } else { 0 };
            let of_hit = hit.iter().any(|id| id.ancestor(node.id.level()) == Some(node.id));
            let counts = &mut levels[usize::from(node.id.level())];
            for count in
                counts.iter_mut().zip([true, of_hit, drawn.contains(&node.id)]).filter(|of| of.1).map(|of| of.0)
            {
                (count.tiles, count.bytes) = (count.tiles + 1, count.bytes + bytes);
            }
        }
        for (lod, _) in (0..).zip(&node.lods).filter(|(_, lod)| lod.tile.is_resident()) {
            fetched.meshes += of(&meshes, mesh_tile::archive_id(node.id, lod));
        }
    }
    Ok((fetched, shown, levels))
}

/// A frame, and the nodes that its rays hit.
fn draw(session: &mut Session, request: &FrameRequest) -> Result<(Pixels, BTreeSet<TileId>)> {
    let data = session.frame_data(request, &RenderSettings::default());
    let squares: Vec<TileId> =
        session.selection().draw_tiles.iter().map(|item| session.tree().node(item.node).id).collect();
    let pixels = session.adapter_mut().draw(&data)?;
    let hit = pixels.hit.iter().filter_map(|at| squares.get(*at as usize).copied()).collect();
    Ok((pixels, hit))
}
