//! Writes `visibility.pmtiles`: what can be seen from the streets of a city.
//!
//! Works from the archives of a written city alone, so that an update does the same as a whole bake.

use std::{path::Path, time::Instant};

use insula_archive::{Archive, limits::MAX_OPENING_TIME};
use insula_protocol::{BlockMap, DecodeError, Manifest, Subtree, TileId, TileKind};
use insula_visibility::{CityExtent, CitySets, Settings};

use super::archive::{self, WrittenArchive};
use crate::error::BakeError;

/// Heights below a city's bounds that columns may reach down to, in metres.
const BELOW_BOUNDS_M: f64 = 100.0;

/// Writes the archive into a city's folder, which has the archives of subtrees and V-BlockMaps, and returns its length. `None` if the
/// city has no leaves. Fails if a tile cannot be read or the file cannot be written.
pub fn write(folder: &Path, manifest: &Manifest, threads: usize) -> Result<Option<u64>, BakeError> {
    Ok(write_archive(folder, manifest, threads)?.map(|archive| archive.bytes))
}

/// Writes the archive into a city's folder, which has the archives of subtrees and V-BlockMaps, and returns what it wrote. `None` if
/// the city has no leaves. `manifest` needs no version. Fails if a tile cannot be read or the file cannot be written.
pub(super) fn write_archive(
    folder: &Path,
    manifest: &Manifest,
    threads: usize,
) -> Result<Option<WrittenArchive>, BakeError> {
    let path = folder.join(TileKind::Visibility.file_name());
    let open = |kind: TileKind| {
        let path = folder.join(kind.file_name());
        Archive::open(&path, Instant::now() + MAX_OPENING_TIME).map_err(|cause| damaged(&path, &cause.to_string()))
    };
    let (subtrees, blockmaps) = (open(TileKind::Subtree)?, open(TileKind::BlockMap)?);
    let mut terminals = Vec::new();
    for (root, bytes) in subtrees.tiles() {
        let bytes = bytes.map_err(|cause| damaged(folder, &cause.to_string()))?;
        let subtree = Subtree::decode(&bytes).map_err(BakeError::tile(root, "read"))?;
        let is_terminal = |id: TileId, child_mask: u8| child_mask == 0 || id.level() == manifest.depth;
        terminals.extend(subtree.nodes.iter().filter(|node| is_terminal(node.id, node.child_mask)).map(|node| node.id));
    }
    // A subtree's root is listed by the one above, too.
    terminals.sort_unstable();
    terminals.dedup();
    let lowest_m = manifest.bounds[0][2] - manifest.origin[2] - BELOW_BOUNDS_M;
    let extent = CityExtent { depth: manifest.depth, cell_m: manifest.cell_m, lowest_m, terminals };
    let read = |id: TileId| -> Result<BlockMap, BakeError> {
        let bytes = blockmaps.tile(id).map_err(|cause| damaged(folder, &cause.to_string()))?;
        let missing = || BakeError::tile(id, "read")(DecodeError::Invalid("a node has no V-BlockMap"));
        BlockMap::decode(id, &bytes.ok_or_else(missing)?).map_err(BakeError::tile(id, "read"))
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|cause| BakeError::Threads { threads, cause: cause.to_string() })?;
    let Some(sets) = pool.install(|| CitySets::compute(&extent, &Settings::default(), read, |_| true))? else {
        return Ok(None);
    };
    archive::write(&path, &sets.blocks(), |id| sets.tile(id).encode().map_err(BakeError::tile(id, "written"))).map(Some)
}

fn damaged(path: &Path, what: &str) -> BakeError {
    BakeError::Archive { path: path.to_owned(), what: what.to_owned() }
}
