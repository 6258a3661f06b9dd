//! Writes `visibility.pmtiles`: what can be seen from the streets of a city.
//!
//! Works from a city's V-BlockMaps alone, so that an update and a bake in steps do the same as a whole bake.

use super::archive::{self, WrittenArchive};
use crate::error::BakeError;
use crate::progress::Progress;
use insula_archive::Archive;
use insula_protocol::{BlockMap, Manifest, TileId};
use insula_visibility::{CityExtent, CitySets, MAX_LEAF_SQUARES, NoSets, SWEEPS, Settings};
use std::path::Path;

/// Heights below a city's bounds that columns may reach down to, in metres.
const BELOW_BOUNDS_M: f64 = 100.0;

/// Describes a city. `terminals`: its nodes without children.
pub(super) fn extent(manifest: &Manifest, terminals: Vec<TileId>) -> CityExtent {
    let lowest_m = manifest.bounds[0][2] - manifest.origin[2] - BELOW_BOUNDS_M;
    CityExtent { depth: manifest.depth, cell_m: manifest.cell_m, lowest_m, terminals }
}

/// Writes the archive, and returns what it wrote. `None` if the city has no sets; the user is told if it is too large for them. `read`
/// gives the bytes of a node's V-BlockMap; for `base` see [`archive::write`]. Fails if a tile cannot be read or the file cannot be written.
pub(super) fn write_archive(
    (path, base): (&Path, Option<&Archive>),
    extent: CityExtent,
    read: impl Fn(TileId) -> Result<Vec<u8>, BakeError> + Sync,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Option<WrittenArchive>, BakeError> {
    if let Err(reason) = extent.check() {
        if reason == NoSets::TooLarge {
            progress.warn(&format!(
                "the city has no sets of what can be seen from streets: its leaves span more than {MAX_LEAF_SQUARES} squares"
            ));
        }
        return Ok(None);
    }
    let leaves = extent.terminals.iter().filter(|id| id.level() == extent.depth).count() as u64;
    progress.stage("streets", SWEEPS * leaves);
    let decode = |id: TileId| BlockMap::decode(id, &read(id)?).map_err(BakeError::tile(id, "read"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|cause| BakeError::Threads { threads, cause: cause.to_string() })?;
    let sets = pool.install(|| CitySets::compute(&extent, &Settings::default(), decode, || progress.advance(1)))?;
    let Some(sets) = sets else { return Ok(None) };
    archive::write(path, base, &sets.blocks(), |id| sets.tile(id).encode().map_err(BakeError::tile(id, "written")))
        .map(Some)
}
