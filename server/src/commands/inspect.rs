//! `inspect`: a city's statistics as text or JSON, one node's maps as an image, or its voxels as an image or a mesh.

use super::error::CommandError;
use super::output::{print, print_pretty, write};
use super::{map_image, volume};
use crate::args::InspectArgs;
use crate::store::{CityStore, StoreError};
use image::{ImageFormat, RgbImage};
use insula_archive::{CityError, ReadError};
use insula_command_line::output::{FileKind, Outputs};
use insula_protocol::blockmap::voxels::Voxels;
use insula_protocol::manifest::Attribution;
use insula_protocol::subtree::MeshLod;
use insula_protocol::text::{count, human_bytes, printable};
use insula_protocol::{BlockMap, Manifest, Subtree, TileId, TileKind};
use serde::Serialize;
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

/// A city's manifest with the totals of its archives.
#[derive(Debug, Serialize)]
pub(super) struct CityStats<'a> {
    pub(super) manifest: &'a Manifest,
    /// Size of all archives.
    pub(super) file_bytes: u64,
    pub(super) subtree_tiles: u64,
    /// Subtree tiles that cannot be read. The errors of their nodes and their meshes are not counted.
    pub(super) damaged_subtree_tiles: usize,
    /// Root first.
    pub(super) levels: Vec<LevelStats>,
    /// Finest level of detail first.
    pub(super) meshes: Vec<MeshLodStats>,
}

/// Totals of the meshes of one level of detail.
#[derive(Debug, Default, Serialize)]
pub(super) struct MeshLodStats {
    /// 0 for the finest.
    pub(super) lod: usize,
    pub(super) leaves: u64,
    pub(super) bytes: u64,
    pub(super) triangles: u64,
    pub(super) texture_px: u64,
    /// Largest error in metres.
    pub(super) error_m: f32,
}

/// Totals of one level of the quadtree.
#[derive(Debug, Default, Serialize)]
pub(super) struct LevelStats {
    pub(super) level: u8,
    /// Width of a column in metres.
    pub(super) cell_m: f64,
    pub(super) nodes: u64,
    /// Size of all V-BlockMaps; the other sizes are per node.
    pub(super) bytes: u64,
    pub(super) bytes_min: u64,
    pub(super) bytes_mean: f64,
    pub(super) bytes_max: u64,
    /// Smallest and largest geometric error of the nodes in metres; `None` if no subtree tile could be read.
    pub(super) error_m_min: Option<f64>,
    pub(super) error_m_max: Option<f64>,
}

impl<'a> CityStats<'a> {
    /// Fails if a directory of V-BlockMaps cannot be read.
    pub(super) fn collect(city: &'a CityStore) -> Result<Self, CityError> {
        let manifest = city.manifest();
        let empty_level = |level| LevelStats {
            level,
            cell_m: manifest.cell_m_at(level),
            bytes_min: u64::MAX,
            ..LevelStats::default()
        };
        let mut levels: Vec<LevelStats> = (0..=manifest.depth).map(empty_level).collect();
        for (id, length) in city.blockmaps().lengths() {
            let failed =
                |error: ReadError| CityError::Archive { location: city.location().into(), source: error.into() };
            let length = length.map_err(failed)?;
            if let Some(level) = levels.get_mut(usize::from(id.level())) {
                level.add_bytes(u64::from(length));
            }
        }
        let mut damaged_subtree_tiles = 0;
        let mut meshes: Vec<MeshLodStats> = Vec::new();
        for (_, bytes) in city.subtrees().tiles() {
            let Some(subtree) = bytes.ok().and_then(|bytes| Subtree::decode(&bytes).ok()) else {
                damaged_subtree_tiles += 1;
                continue;
            };
            for (lod, info) in subtree.meshes.iter().flat_map(|mesh| mesh.lods.iter().enumerate()) {
                if meshes.len() <= lod {
                    meshes.push(MeshLodStats { lod: meshes.len(), ..MeshLodStats::default() });
                }
                meshes[lod].add(info);
            }
            for node in &subtree.nodes {
                if let Some(level) = levels.get_mut(usize::from(node.id.level())) {
                    level.add_error(f64::from(node.error_m));
                }
            }
        }
        for level in &mut levels {
            level.finish();
        }
        let subtree_tiles = city.subtrees().len();
        Ok(Self { manifest, file_bytes: city.file_bytes(), subtree_tiles, damaged_subtree_tiles, levels, meshes })
    }
}

impl MeshLodStats {
    fn add(&mut self, info: &MeshLod) {
        self.leaves += 1;
        self.bytes += u64::from(info.bytes);
        self.triangles += u64::from(info.triangles);
        self.texture_px += u64::from(info.texture_px);
        self.error_m = self.error_m.max(info.error_m);
    }
}

impl LevelStats {
    fn add_bytes(&mut self, bytes: u64) {
        self.nodes += 1;
        self.bytes += bytes;
        self.bytes_min = self.bytes_min.min(bytes);
        self.bytes_max = self.bytes_max.max(bytes);
    }

    fn add_error(&mut self, error_m: f64) {
        self.error_m_min = Some(self.error_m_min.map_or(error_m, |min| min.min(error_m)));
        self.error_m_max = Some(self.error_m_max.map_or(error_m, |max| max.max(error_m)));
    }

    fn finish(&mut self) {
        if self.nodes == 0 {
            self.bytes_min = 0;
        } else {
            self.bytes_mean = self.bytes as f64 / self.nodes as f64;
        }
    }
}
