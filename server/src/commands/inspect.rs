//! `inspect`: a city's statistics as text or JSON, one node's maps as an image, or its voxels as an image or a mesh.

use super::error::CommandError;
use super::output::{print, print_pretty, write};
use super::stats::{CityStats, LevelStats, MeshLodStats};
use super::{map_image, volume};
use crate::args::InspectArgs;
use crate::store::{CityStore, StoreError};
use image::{ImageFormat, RgbImage};
use insula_command_line::output::{FileKind, Outputs};
use insula_protocol::blockmap::voxels::Voxels;
use insula_protocol::manifest::Attribution;
use insula_protocol::text::{count, human_bytes, printable};
use insula_protocol::{BlockMap, TileId, TileKind};
use std::fmt::Write;
use std::io::Cursor;
use std::path::Path;

/// Runs `inspect`. Fails if the city cannot be opened, the tile is missing or damaged, or the image cannot be written.
pub(super) fn run(args: &InspectArgs) -> Result<(), CommandError> {
    #[cfg(feature = "bake")]
    if super::survey::is_input(&args.city) {
        return super::survey::run(args);
    }
    let city = CityStore::open(&args.city)?;
    let mut outputs = Outputs::new(args.overwrite).reading([&args.city]);
    for (path, kind) in [(&args.png, FileKind::PNG), (&args.ply, FileKind::PLY)] {
        path.as_ref().map_or(Ok(()), |path| outputs.file(path, kind)).map_err(CommandError::Usage)?;
    }
    match (args.tile, args.volume) {
        (Some(tile), _) => return write_maps(&city, tile, args),
        (None, Some(node)) => return write_voxels(&city, node, args),
        (None, None) => {}
    }
    let stats = CityStats::collect(&city).map_err(StoreError::from)?;
    if args.json {
        return print_pretty(&stats);
    }
    print(&to_table(&stats));
    Ok(())
}

fn write_maps(city: &CityStore, id: TileId, args: &InspectArgs) -> Result<(), CommandError> {
    let (map, bytes) = read_map(city, id)?;
    let Some(png) = &args.png else { return Ok(()) };
    write_png(png, &map_image::draw(&map.stand_on_ground()))?;
    print(&format!("{}: geometry, roof and wall maps of {id}, {}\n", png.display(), human_bytes(bytes)));
    Ok(())
}

/// Writes the voxels of a node. A mesh that would be too large is an error before anything is written.
fn write_voxels(city: &CityStore, id: TileId, args: &InspectArgs) -> Result<(), CommandError> {
    let (map, _) = read_map(city, id)?;
    let z_base_m = map.z_base_m();
    let voxels = Voxels::of(map);
    if let Some(path) = &args.ply {
        let Some((file, faces)) = volume::write_ply(&voxels, id, z_base_m, city.manifest()) else {
            let reason = "it has more than 2,000,000 visible faces; `--png` draws it, or take a node of another level";
            return Err(CommandError::Tile { tile: id.to_string(), reason: reason.into() });
        };
        write(path, &file)?;
        print(&format!("{}: {faces} faces of voxels of {id}\n", path.display()));
    }
    if let Some(png) = &args.png {
        write_png(png, &volume::draw(&voxels))?;
        let rows = count(voxels.rows() as u64, "row");
        print(&format!("{}: voxels of {id} from the south-west and the north-east, {rows}\n", png.display()));
    }
    Ok(())
}

/// The V-BlockMap of a node, and its bytes in the city.
fn read_map(city: &CityStore, id: TileId) -> Result<(BlockMap, u64), CommandError> {
    let tile_error = |reason: String| CommandError::Tile { tile: id.to_string(), reason };
    let bytes = city.tile(TileKind::BlockMap, id).map_err(|error| tile_error(error.to_string()))?;
    let bytes = bytes.ok_or_else(|| tile_error("the city has no such node".into()))?;
    let map = BlockMap::decode(id, &bytes).map_err(|error| tile_error(error.to_string()))?;
    Ok((map, bytes.len() as u64))
}

fn write_png(path: &Path, image: &RgbImage) -> Result<(), CommandError> {
    let mut out = Cursor::new(Vec::new());
    image.write_to(&mut out, ImageFormat::Png).map_err(|error| CommandError::write(path, error))?;
    write(path, out.get_ref())
}

fn to_table(stats: &CityStats<'_>) -> String {
    let manifest = stats.manifest;
    let [[x0, y0, z0], [x1, y1, z1]] = manifest.bounds;
    let nodes: u64 = stats.levels.iter().map(|level| level.nodes).sum();
    let mut out = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(out, "{name:<12}{}", printable(&value));
    };
    line("name", manifest.name.clone());
    line("title", manifest.title.clone());
    line("version", manifest.version.clone());
    line("CRS", manifest.crs.clone().unwrap_or_else(|| "local metres".into()));
    line("extent", format!("{:.1} x {:.1} x {:.1} m from {x0:.1}, {y0:.1}, {z0:.1}", x1 - x0, y1 - y0, z1 - z0));
    line(
        "cell",
        format!("{} m, {} columns per side, {} levels", manifest.cell_m, manifest.node_cells, manifest.depth + 1),
    );
    line("source", format!("{}, {}", manifest.counts.words(), count(manifest.counts.triangles, "triangle")));
    line("terrain", if manifest.has_terrain { "yes".into() } else { "no".into() });
    if manifest.generated_facades {
        line("facades", "generated windows".into());
    }
    line(
        "size",
        format!("{nodes} nodes in {}, {}", count(stats.subtree_tiles, "subtree tile"), human_bytes(stats.file_bytes)),
    );
    for source in &manifest.attribution {
        line("attribution", credit(source));
    }
    if stats.damaged_subtree_tiles > 0 {
        line("DAMAGED", count(stats.damaged_subtree_tiles as u64, "subtree tile") + ": run `insula-server verify`");
    }
    let _ = writeln!(
        out,
        "\n{:>5} {:>9} {:>9} {:>10} {:>9} {:>9} {:>9}   error m",
        "level", "cell m", "nodes", "bytes", "min", "mean", "max"
    );
    out.extend(stats.levels.iter().map(level_row));
    if !stats.meshes.is_empty() {
        out.push_str("\n mesh    leaves      bytes triangles    pixels   max error m\n");
    }
    for lods in &stats.meshes {
        let MeshLodStats { lod, leaves, triangles, texture_px, error_m, .. } = lods;
        let bytes = human_bytes(lods.bytes);
        let _ = writeln!(out, "{lod:>5} {leaves:>9} {bytes:>10} {triangles:>9} {texture_px:>9}   {error_m:.3}");
    }
    out
}

fn level_row(level: &LevelStats) -> String {
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
