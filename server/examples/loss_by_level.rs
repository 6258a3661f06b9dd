//! How much of the colours is lost from level to level: parents are made from their children as a reader sees them.
//!
//! In: a city baked with `--quality lossless`, the same city baked otherwise. Out: a line a level. Next: a person.
//!
//! `cargo run --release -p insula-server --example loss_by_level -- LOSSLESS CITY`

use anyhow::{Context, ensure};
use insula_protocol::BlockMap;
use insula_server::store::CityStore;
use std::{collections::BTreeMap, path::Path};

/// What a level sums up: squared error of the nodes with colours that can be lost, the worst of them, their number.
#[derive(Default)]
struct Level {
    sum: f64,
    worst: f64,
    nodes: u32,
    exact: u32,
}

fn main() -> anyhow::Result<()> {
    let mut names = std::env::args().skip(1);
    let mut next = || names.next().context("two cities are needed: lossless, other");
    let (meant, coded) = (maps(&next()?)?, maps(&next()?)?);
    ensure!(meant.keys().eq(coded.keys()), "these are not the same city: their nodes differ");
    let mut levels = BTreeMap::<u8, Level>::new();
    for (a, b) in meant.values().zip(coded.values()) {
        ensure!(a.z_max == b.z_max && a.flags == b.flags, "shapes of {} differ", a.id);
        let (level, error) = (levels.entry(a.id.level()).or_default(), a.colour_error(b));
        level.exact += u32::from(error == 0.0);
        level.nodes += u32::from(error > 0.0);
        level.sum += error;
        level.worst = level.worst.max(error);
    }
    let db = |squares: f64| 10.0 * (255.0 * 255.0 / squares).log10();
    println!("{:>5} {:>12} {:>10} {:>9} {:>9}", "level", "without loss", "with loss", "mean dB", "worst dB");
    for (level, of) in levels {
        let mean = db(of.sum / f64::from(of.nodes));
        println!("{level:>5} {:>12} {:>10} {mean:>9.1} {:>9.1}", of.exact, of.nodes, db(of.worst));
    }
    Ok(())
}

fn maps(city: &str) -> anyhow::Result<BTreeMap<(u8, u32, u32), BlockMap>> {
    let store = CityStore::open(Path::new(city))?;
    let tiles = store.blockmaps().tiles();
    let decoded = tiles.map(|(id, bytes)| Ok(((id.level(), id.x(), id.y()), BlockMap::decode(id, &bytes?)?)));
    decoded.collect()
}
