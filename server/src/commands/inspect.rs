//! `inspect`: what is in a city, for people or as JSON; one node's maps as a picture.
//!
//! In: a city's folder. Out: text, JSON or a PNG. Next: a person.

use super::{
    error::CommandError,
    map_image,
    output::{human_bytes, print, write},
    stats::{CityStats, LevelStats, MeshLodStats},
};
use crate::{args::InspectArgs, store::CityStore};
use image::ImageFormat;
use insula_protocol::{BlockMap, TileId, manifest::Attribution, route::Layer};
use std::{fmt::Write, io::Cursor, path::Path};

pub(super) fn run(args: &InspectArgs) -> Result<(), CommandError> {
    let city = CityStore::open(&args.city)?;
    if let (Some(tile), Some(png)) = (args.tile, &args.png) {
        return picture(&city, tile, png);
    }
    let stats = CityStats::take(&city);
    if args.json {
        let json = serde_json::to_string_pretty(&stats)
            .map_err(|error| CommandError::System { what: "make JSON", source: error.into() })?;
        print(&(json + "\n"));
    } else {
        print(&table(&stats));
    }
    Ok(())
}

fn picture(city: &CityStore, id: TileId, png: &Path) -> Result<(), CommandError> {
    let wrong = |reason: String| CommandError::Tile { tile: id.to_string(), reason };
    let bytes = city.tile(Layer::BlockMaps, id).map_err(|error| wrong(error.to_string()))?;
    let bytes = bytes.ok_or_else(|| wrong("the city has no such node".into()))?;
    let map = BlockMap::decode(id, &bytes).map_err(|error| wrong(error.to_string()))?;
    let mut out = Cursor::new(Vec::new());
    map_image::draw(&map)
        .write_to(&mut out, ImageFormat::Png)
        .map_err(|error| CommandError::Write { path: png.to_owned(), reason: error.to_string() })?;
    write(png, out.get_ref())?;
    print(&format!("{}: geometry, roofs and walls of {id}, {}\n", png.display(), human_bytes(bytes.len() as u64)));
    Ok(())
}

fn table(stats: &CityStats<'_>) -> String {
    let manifest = stats.manifest;
    let [[x0, y0, z0], [x1, y1, z1]] = manifest.bounds;
    let nodes: u64 = stats.levels.iter().map(|level| level.nodes).sum();
    let mut out = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(out, "{name:<12}{value}");
    };
    line("name", manifest.name.clone());
    line("title", manifest.title.clone());
    line("version", manifest.version.clone());
    line("CRS", manifest.crs.clone().unwrap_or_else(|| "local metres".into()));
    line("extent", format!("{:.1} x {:.1} x {:.1} m from {x0:.1}, {y0:.1}, {z0:.1}", x1 - x0, y1 - y0, z1 - z0));
    line(
        "cell",
        format!("{} m, {} columns a side, {} levels", manifest.cell_m, manifest.node_cells, manifest.depth + 1),
    );
    line("source", format!("{} objects, {} triangles", manifest.counts.objects, manifest.counts.triangles));
    line("terrain", if manifest.has_terrain { "yes".into() } else { "no".into() });
    line("size", format!("{nodes} nodes in {} subtree tiles, {}", human_bytes(stats.file_bytes), stats.subtree_tiles));
    for source in &manifest.attribution {
        line("attribution", credit(source));
    }
    if stats.damaged_subtree_tiles > 0 {
        line("DAMAGED", format!("{} subtree tiles: run `insula-server verify`", stats.damaged_subtree_tiles));
    }
    let _ = writeln!(
        out,
        "\n{:>5} {:>9} {:>9} {:>10} {:>9} {:>9} {:>9}   error m",
        "level", "cell m", "nodes", "bytes", "min", "mean", "max"
    );
    for level in &stats.levels {
        out.push_str(&row(level));
    }
    if !stats.meshes.is_empty() {
        out.push_str("\n mesh    leaves      bytes triangles    pixels   error m up to\n");
    }
    for lods in &stats.meshes {
        let MeshLodStats { lod, leaves, triangles, texture_px, error_m, .. } = lods;
        let bytes = human_bytes(lods.bytes);
        let _ = writeln!(out, "{lod:>5} {leaves:>9} {bytes:>10} {triangles:>9} {texture_px:>9}   {error_m:.3}");
    }
    out
}

fn row(level: &LevelStats) -> String {
    let error = match (level.error_m_min, level.error_m_max) {
        (Some(min), Some(max)) => format!("{min:.3} to {max:.3}"),
        _ => "unknown".into(),
    };
    format!(
        "{:>5} {:>9} {:>9} {:>10} {:>9} {:>9.0} {:>9}   {error}\n",
        level.level,
        level.cell_m,
        level.nodes,
        human_bytes(level.bytes),
        level.bytes_min,
        level.bytes_mean,
        level.bytes_max
    )
}

fn credit(source: &Attribution) -> String {
    let mut text = source.text.clone();
    for part in [&source.licence, &source.url].into_iter().flatten() {
        let _ = write!(text, ", {part}");
    }
    text
}
