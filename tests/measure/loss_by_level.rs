//! Prints the loss of colour quality per level of the quadtree.
//!
//! Parents are made from decoded children, so losses could add up. The arguments are a city baked with `--quality lossless`
//! and the same city baked with loss.
//!
//! `cargo run --release -p insula-measure --bin loss_by_level -- LOSSLESS CITY`

use anyhow::{Context, ensure};
use insula_protocol::BlockMap;
use insula_server::store::CityStore;
use std::{collections::BTreeMap, path::Path};

/// Colour errors of a level's nodes, as mean squared differences of 8-bit values.
#[derive(Default)]
struct LevelLoss {
    sum: f64,
    worst: f64,
    lossy_nodes: u32,
    lossless_nodes: u32,
}

fn main() -> anyhow::Result<()> {
    let mut names = std::env::args().skip(1);
    let mut next = || names.next().context("usage: loss_by_level LOSSLESS CITY");
    let (lossless, lossy) = (read_maps(&next()?)?, read_maps(&next()?)?);
    ensure!(lossless.keys().eq(lossy.keys()), "the cities differ: they have different nodes");
    let mut levels = BTreeMap::<u8, LevelLoss>::new();
    for (a, b) in lossless.values().zip(lossy.values()) {
        ensure!(a.z_max == b.z_max && a.flags == b.flags, "the cities differ: {} has another shape", a.id);
        let (level, error) = (levels.entry(a.id.level()).or_default(), a.colour_error(b));
        level.lossless_nodes += u32::from(error == 0.0);
        level.lossy_nodes += u32::from(error > 0.0);
        level.sum += error;
        level.worst = level.worst.max(error);
    }
    let db = |mean_square: f64| 10.0 * (255.0 * 255.0 / mean_square).log10();
    println!("{:>5} {:>12} {:>10} {:>9} {:>9}", "level", "lossless", "lossy", "mean dB", "worst dB");
    for (level, loss) in levels {
        let mean = db(loss.sum / f64::from(loss.lossy_nodes));
        println!("{level:>5} {:>12} {:>10} {mean:>9.1} {:>9.1}", loss.lossless_nodes, loss.lossy_nodes, db(loss.worst));
    }
    Ok(())
}

fn read_maps(city: &str) -> anyhow::Result<BTreeMap<(u8, u32, u32), BlockMap>> {
    let store = CityStore::open(Path::new(city))?;
    let tiles = store.blockmaps().tiles();
    let decoded = tiles.map(|(id, bytes)| Ok(((id.level(), id.x(), id.y()), BlockMap::decode(id, &bytes?)?)));
    decoded.collect()
}
