//! Bytes of a view in the street beside those of the source's own files.
//!
//! `cargo run --release -p insula-tests --bin street -- CITY_INPUTS... --city CITY`: of each camera that the bench of fidelity
//! has in the street, what a client that begins with nothing fetches until its picture cannot get better (manifest, subtrees,
//! columns of all levels, meshes), against what of the source's files belongs to the leaves that this picture shows: those
//! that a ray hits, and of a coarser node those below it. Which bytes belong to a leaf: `insula_tests::source_bytes`. Beside
//! it, plainly: all of the source's bytes times the share of its leaves.

use anyhow::{Context, Result};
use clap::Parser;
use glam::DVec3;
use insula_client::{
    camera::Camera,
    commands::snapshot::settle,
    render::Look,
    session::{Session, Shot},
};
use insula_protocol::{TileId, mesh_tile, route::Layer};
use insula_server::store::CityStore;
use insula_tests::{
    cameras::{self, Stand},
    fidelity,
    programs::Served,
    source_bytes::Source,
    truth::Truth,
    view,
    viewer::open,
};
use std::{
    collections::{BTreeSet, HashMap},
    path::{Path, PathBuf},
    time::Duration,
};

/// Compares what views in the street fetch with the source's files.
#[derive(Debug, Parser)]
struct Args {
    /// City files.
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// The same, baked.
    #[arg(long)]
    city: PathBuf,
    /// The pictures' width and height.
    #[arg(long, num_args = 2, default_values_t = [1280, 720])]
    size: Vec<u32>,
    /// Tolerated error in pixels.
    #[arg(long, default_value_t = 1.0)]
    tau: f64,
}

const TIMEOUT: Duration = Duration::from_secs(300);
const CACHE_MIB: u32 = 2048;

/// Bytes that a view fetched.
#[derive(Debug, Clone, Copy, Default)]
struct Fetched {
    all: u64,
    columns: u64,
    /// Those of them that are no leaves'.
    coarser: u64,
    meshes: u64,
    /// Leaves that the picture shows, and leaves drawn as meshes.
    leaves: usize,
    drawn_meshes: u32,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let truth = Truth::new(fidelity::read(&args.inputs)?);
    let store = CityStore::open(&args.city)?;
    let served = Served::start(&args.city, "127.0.0.1:0")?;
    let depth = store.manifest().depth;
    let leaves: BTreeSet<TileId> =
        store.blockmaps().lengths().map(|(id, _)| id).filter(|id| id.level() == depth).collect();
    let source = Source::read(&args.inputs, &truth.scene, store.manifest())?;
    let all = source.of(&leaves);
    println!(
        "source: {} kB; of its {} leaves {:.0} kB of text, {:.0} kB of pictures' area",
        source.whole_bytes / 1000,
        leaves.len(),
        all.text / 1e3,
        all.pictures / 1e3
    );
    println!(
        "| camera | fetched kB | columns | no leaves' | meshes | rest | leaves | as meshes | text kB | pictures kB | times | by used area | by leaves |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    for (number, station) in cameras::of(&truth).into_iter().enumerate().filter(|s| s.1.stand == Stand::Street) {
        let (fetched, shown) = look(&args, &station.camera, (&store, &served.address), &leaves)?;
        let of = source.of(&shown);
        let kb = |bytes: u64| bytes as f64 / 1e3;
        let times = |bytes: f64| bytes / fetched.all as f64;
        println!(
            "| {number} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {} | {} | {:.0} | {:.0} | {:.2} | {:.2} | {:.2} |",
            kb(fetched.all),
            kb(fetched.columns),
            kb(fetched.coarser),
            kb(fetched.meshes),
            kb(fetched.all - fetched.columns - fetched.meshes),
            fetched.leaves,
            fetched.drawn_meshes,
            of.text / 1e3,
            of.pictures / 1e3,
            times(of.text + of.pictures),
            times(of.text + of.pictures_used),
            times(source.whole_bytes as f64 * shown.len() as f64 / leaves.len().max(1) as f64),
        );
    }
    Ok(())
}

/// A cold client's view, and the leaves that it shows.
fn look(
    args: &Args,
    camera: &view::Camera,
    (store, address): (&CityStore, &str),
    leaves: &BTreeSet<TileId>,
) -> Result<(Fetched, BTreeSet<TileId>)> {
    let [position, target, up] = [camera.position, camera.target, camera.up].map(DVec3::from);
    let camera = Camera::look(position, target, up, camera.fov_y_deg.to_radians()).context("looks nowhere")?;
    let shot = Shot { camera, heading: None, size_px: [args.size[0], args.size[1]], tau_px: args.tau };
    let mut session = open(Path::new(&format!("http://{address}")), CACHE_MIB)?;
    settle(&mut session, &shot, TIMEOUT)?;
    let hit = hit(&mut session, &shot)?;
    let depth = store.manifest().depth;
    let shown: BTreeSet<TileId> = leaves
        .iter()
        .copied()
        .filter(|leaf| (0..=depth).any(|level| leaf.ancestor(level).is_some_and(|id| hit.contains(&id))))
        .collect();
    let lengths = |layer: Layer| -> HashMap<TileId, u32> {
        store.archive(layer).map(|archive| archive.lengths().collect()).unwrap_or_default()
    };
    let (columns, meshes) = (lengths(Layer::BlockMaps), lengths(Layer::Meshes));
    let report = session.report(args.tau);
    let mut fetched = Fetched {
        all: report.bytes_fetched,
        leaves: shown.len(),
        drawn_meshes: report.meshes_drawn,
        ..Fetched::default()
    };
    for node in session.tree().nodes() {
        let of = |lengths: &HashMap<TileId, u32>, id: Option<TileId>| {
            u64::from(id.and_then(|id| lengths.get(&id)).copied().unwrap_or(0))
        };
        if node.tile.is_resident() {
            let bytes = of(&columns, Some(node.id));
            fetched.columns += bytes;
            fetched.coarser += if node.id.level() < depth { bytes } else { 0 };
        }
        for (lod, _) in (0..).zip(&node.lods).filter(|(_, lod)| lod.tile.is_resident()) {
            fetched.meshes += of(&meshes, mesh_tile::place(node.id, lod));
        }
    }
    Ok((fetched, shown))
}

/// Nodes that a ray hits.
fn hit(session: &mut Session, shot: &Shot) -> Result<BTreeSet<TileId>> {
    let data = session.frame_data(shot, &Look::default());
    let squares: Vec<TileId> = session.selection().cut.iter().map(|item| session.tree().node(item.square).id).collect();
    let pixels = session.adapter_mut().draw(&data)?;
    Ok(pixels.hit.iter().filter_map(|at| squares.get(*at as usize).copied()).collect())
}
