//! Measures the generated ground of a baked city against its source.
//!
//! `cargo run --release -p insula-measure --bin ground -- --city CITY SOURCE... [--without CITY]`: the share of buildings whose lowest
//! point is on or under the ground, of those that are sunk by more than a metre, and of the bytes that the ground costs, by a bake of
//! the same sources with `--ground none`.

use anyhow::{Context, Result, ensure};
use clap::Parser;
use glam::DVec3;
use insula_bake::read::{self, ReadOptions};
use insula_bake::scene::ObjectKind;
use insula_protocol::blockmap::{NodeGround, flag};
use insula_protocol::{BlockMap, TileId};
use insula_tests::baked::Baked;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Rounding of heights, in metres.
const TOLERANCE_M: f64 = 0.25;
/// Corners at least this far above the ground are not feet.
const HIGH_M: f64 = 4.0;

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
    ensure!(!city.manifest().has_terrain, "{}: buildings stand on terrain of the sources", args.city.display());
    let (scene, _) = read::read(&args.sources, &ReadOptions::default(), &|_| {}).context("read")?;
    let grounds = city.grounds()?;
    let leaves = city.leaves()?;
    let origin = DVec3::from(scene.origin) - DVec3::from(city.manifest().origin);
    let mut lowest: BTreeMap<u32, Vec<DVec3>> = BTreeMap::new();
    for triangle in scene.triangles.iter().filter(|t| scene.objects[t.object as usize].kind == ObjectKind::Building) {
        let base_m = scene.objects[triangle.object as usize].base_z_m;
        let feet = triangle.corners.iter().filter(|corner| corner[2] <= base_m + 0.01);
        lowest.entry(triangle.object).or_default().extend(feet.map(|p| DVec3::from(p.map(f64::from)) + origin));
    }
    let (mut feet, mut standing, mut buildings, mut sunk, mut roofs, mut air) = (0, 0, 0, 0, 0, 0);
    for corners in lowest.values() {
        // How far the ground is above each corner.
        let depth = |p: &DVec3| ground_at(&city, &grounds, *p) - p.z;
        let (high, low): (Vec<&DVec3>, Vec<&DVec3>) = corners.iter().partition(|p| depth(p) < -HIGH_M);
        let on_roofs = high.iter().filter(|p| has_building_below(&city, &leaves, ***p)).count();
        (roofs, air) = (roofs + on_roofs, air + high.len() - on_roofs);
        let mut depths: Vec<f64> = low.into_iter().map(depth).collect();
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
        "feet on or under the ground  {:.2} % of {feet}; {HIGH_M} m and more above it: {roofs} on roofs, {air} in the air",
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

/// Height of the ground at a position, both relative to the city's origin; the plane's where no ground is.
fn ground_at(city: &Baked, grounds: &BTreeMap<TileId, (f64, NodeGround)>, p: DVec3) -> f64 {
    let manifest = city.manifest();
    let [x, y] = [p.x, p.y].map(|v| v / manifest.node_side_m(manifest.depth));
    let plane_m = manifest.ground_z_m - manifest.origin[2];
    let leaf = TileId::new(manifest.depth, x as u32, y as u32).filter(|_| x >= 0.0 && y >= 0.0);
    let Some((base_m, ground)) = leaf.and_then(|leaf| grounds.get(&leaf)) else { return plane_m };
    let [x, y] = [x, y].map(|v| (v.fract() * f64::from(manifest.node_cells)) as f32);
    ground.surface().at(x, y).map_or(plane_m, |point| base_m + f64::from(point.z) * manifest.cell_m)
}

/// Whether a column next to a position is solid from the ground to within a metre of it. What hangs there itself has a gap.
fn has_building_below(city: &Baked, leaves: &BTreeMap<TileId, BlockMap>, p: DVec3) -> bool {
    let manifest = city.manifest();
    let [x, y] = [p.x, p.y].map(|v| (v / manifest.cell_m).floor() as i64);
    let side = i64::from(manifest.node_cells);
    (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy))).any(|(x, y)| {
        let [column, row] = [x, y].map(|v| u32::try_from(v.div_euclid(side)).ok());
        let leaf = column.zip(row).and_then(|(x, y)| TileId::new(manifest.depth, x, y));
        let Some(map) = leaf.and_then(|leaf| leaves.get(&leaf)) else { return false };
        let i = (y.rem_euclid(side) * side + x.rem_euclid(side)) as usize;
        let top_m = map.z_base_m() + f64::from(map.z_max[i]) * f64::from(map.z_step_m());
        map.flags[i] & (flag::OCCUPIED | flag::GAP) == flag::OCCUPIED && top_m > p.z - 1.0
    })
}

fn bytes_of(folder: &Path) -> Result<u64> {
    std::fs::read_dir(folder)?.map(|entry| Ok(entry?.metadata()?.len())).sum()
}
