//! Writes every tile of a city to a file at its URL's path, so that a static web server can serve it (`tests/load/throughput.py`).
//! Also writes the list of paths, `paths.txt`.
//!
//! `cargo run --release -p insula-measure --bin tile_files -- CITY FOLDER`

use anyhow::{Context, bail};
use insula_protocol::route;
use insula_server::store::CityStore;
use std::fs;
use std::io::Write;
use std::path::Path;

fn main() -> anyhow::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [city, folder] = &args[..] else { bail!("usage: tile_files CITY FOLDER") };
    let (city, folder) = (CityStore::open(Path::new(city))?, Path::new(folder));
    fs::create_dir_all(folder)?;
    let mut list = std::io::BufWriter::new(fs::File::create(folder.join("paths.txt"))?);
    let manifest = city.manifest();
    for (layer, archive) in city.archives() {
        for (id, bytes) in archive.tiles() {
            let path = route::archive_tile(&manifest.name, &manifest.version, layer, id, manifest.depth);
            let path = path.context("the archive has a tile with an invalid id")?;
            let file = folder.join(path.trim_start_matches('/'));
            fs::create_dir_all(file.parent().context("a tile's path has no parent")?)?;
            fs::write(&file, bytes?)?;
            writeln!(list, "{path}")?;
        }
    }
    Ok(list.flush()?)
}
