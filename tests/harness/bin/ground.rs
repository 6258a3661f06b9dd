//! Measures the generated ground of a baked city against its source.
//!
//! `cargo run --release -p insula-tests --bin ground -- --city CITY SOURCE... [--without CITY]`: the share of buildings whose lowest
//! point is on or under the ground, of those that are sunk by more than a metre, and of the bytes that the ground costs, by a bake of
//! the same sources with `--ground none`.

use anyhow::{Context, Result};
use clap::Parser;
use glam::DVec3;
use insula_bake::{
    read::{self, ReadOptions},
    scene::ObjectKind,
};
use insula_protocol::{BlockMap, TileId, blockmap::flag};
use insula_tests::baked::Baked;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Tops of generated ground are at most this thick, in cells.
const THICKNESS_CELLS: f32 = 0.8;
/// Rounding of heights and slopes within a cell, in metres.
const TOLERANCE_M: f64 = 0.25;
/// Distance from a building's corner, in cells, at which ground is looked for.
const REACH_CELLS: i64 = 2;

/// Measures generated ground
#[derive(Debug, Parser)]
struct Args {
    /// Sources of the city
    sources: Vec<PathBuf>,
    /// The baked city
    #[arg(long)]
    city: PathBuf,
    /// The same city without generated ground
    #[arg(long)]
    without: Option<PathBuf>,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let city = Baked::open(&args.city)?;
    let (scene, _) = read::read(&args.sources, &ReadOptions::default(), &|_| {}).context("read")?;
    let leaves = city.leaves()?;
    let origin = DVec3::from(scene.origin) - DVec3::from(city.manifest().origin);
    let mut lowest: BTreeMap<u32, Vec<DVec3>> = BTreeMap::new();
    for triangle in scene.triangles.iter().filter(|t| scene.objects[t.object as usize].kind == ObjectKind::Building) {
        let base_m = scene.objects[triangle.object as usize].base_z_m;
        let feet = triangle.corners.iter().filter(|corner| corner[2] <= base_m + 0.01);
        lowest.entry(triangle.object).or_default().extend(feet.map(|p| DVec3::from(p.map(f64::from)) + origin));
    }
    let (mut feet, mut standing, mut buildings, mut sunk, mut unknown) = (0, 0, 0, 0, 0);
    for corners in lowest.values() {
        // How far the ground is above each corner.
        let mut depths: Vec<f64> = corners.iter().filter_map(|p| Some(ground_at(&city, &leaves, *p)? - p.z)).collect();
        unknown += corners.len() - depths.len();
        feet += depths.len();
        standing += depths.iter().filter(|depth| **depth >= -TOLERANCE_M).count();
        depths.sort_unstable_by(f64::total_cmp);
        if let Some(depth) = depths.get(depths.len() / 2) {
            buildings += 1;
            sunk += usize::from(*depth > 1.0);
        }
    }
    let percent = |part: usize, all: usize| 100.0 * part as f64 / all.max(1) as f64;
    println!(
        "feet on or under the ground  {:.2} % of {feet}, {unknown} without ground nearby",
        percent(standing, feet)
    );
    println!("buildings sunk over a metre  {:.2} % of {buildings}", percent(sunk, buildings));
    if let Some(without) = &args.without {
        let [with, without] = [bytes_of(&args.city)?, bytes_of(without)?];
        println!(
            "bytes  {with} with ground, {without} without: {:+.1} %",
            100.0 * (with as f64 / without as f64 - 1.0)
        );
    }
    Ok(())
}

/// The highest ground around a position, both relative to the city's origin; the plane where no column is.
fn ground_at(city: &Baked, leaves: &BTreeMap<TileId, BlockMap>, p: DVec3) -> Option<f64> {
    let manifest = city.manifest();
    let [x, y] = [p.x, p.y].map(|v| (v / manifest.cell_m).floor() as i64);
    let around =
        (-REACH_CELLS..=REACH_CELLS).flat_map(|dy| (-REACH_CELLS..=REACH_CELLS).map(move |dx| (x + dx, y + dy)));
    let side = i64::from(manifest.node_cells);
    let height = |(x, y): (i64, i64)| {
        let id = TileId::new(manifest.depth, u32::try_from(x / side).ok()?, u32::try_from(y / side).ok()?)?;
        let plane = manifest.ground_z_m - manifest.origin[2];
        let Some(map) = leaves.get(&id) else { return Some(plane) };
        let i = (y % side * side + x % side) as usize;
        if map.flags[i] & flag::OCCUPIED == 0 {
            return Some(plane);
        }
        let (low, high) = (f32::from(map.z_min[i]), f32::from(map.z_max[i]));
        let is_ground = (high - low) * map.z_step_m() <= THICKNESS_CELLS * map.cell_m;
        is_ground.then(|| f64::from(map.z_base_m() as f32 + high * map.z_step_m()))
    };
    around.filter_map(height).reduce(f64::max)
}

fn bytes_of(folder: &Path) -> Result<u64> {
    std::fs::read_dir(folder)?.map(|entry| Ok(entry?.metadata()?.len())).sum()
}
