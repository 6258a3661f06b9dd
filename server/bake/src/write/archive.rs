//! Writes clustered PMTiles archives.

use std::{fs, path::Path};

use insula_protocol::TileId;
use pmtiles::{Compression, PmTilesWriter, PmtError, TileCoord, TileType};

use crate::error::BakeError;

/// Writes the tiles of `ids` in the archive's own order (along a Hilbert curve, root first), synchronises the file and
/// returns its length. Equal tiles are stored once. Fails if the file cannot be written, or with the first error of
/// `tile`.
pub(crate) fn write(
    path: &Path,
    ids: &[TileId],
    mut tile: impl FnMut(TileId) -> Result<Vec<u8>, BakeError>,
) -> Result<u64, BakeError> {
    let failed = |cause| archive_error(path, cause);
    let mut ordered = Vec::with_capacity(ids.len());
    for id in ids {
        let coord = TileCoord::new(id.level(), id.x(), id.y()).map_err(failed)?;
        ordered.push((pmtiles::TileId::from(coord), coord, *id));
    }
    ordered.sort_unstable_by_key(|(order, ..)| *order);
    let file = fs::File::create_new(path).map_err(|cause| BakeError::io(path, "written", cause))?;
    let max_zoom = ids.iter().map(|id| id.level()).max().unwrap_or(0);
    let mut writer = PmTilesWriter::new(TileType::Unknown)
        .tile_compression(Compression::None)
        .min_zoom(0)
        .max_zoom(max_zoom)
        .create(&file)
        .map_err(failed)?;
    for (_, coord, id) in ordered {
        writer.add_tile(coord, &tile(id)?).map_err(failed)?;
    }
    writer.finalize().map_err(failed)?;
    let synced = file.sync_all().and_then(|()| file.metadata());
    Ok(synced.map_err(|cause| BakeError::io(path, "written", cause))?.len())
}

/// Position of a tile in an archive, by which its tiles are sorted.
pub(crate) fn archive_order(id: TileId) -> u64 {
    // All tiles of the levels above come first.
    let above = ((1_u64 << (2 * u32::from(id.level()))) - 1) / 3;
    above + fast_hilbert::xy2h(id.x(), id.y(), id.level())
}

fn archive_error(path: &Path, cause: PmtError) -> BakeError {
    match cause {
        PmtError::Reading(cause) => BakeError::io(path, "written", cause),
        other => BakeError::Archive { path: path.to_owned(), what: other.to_string() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;

    #[test]
    fn equal_tiles_are_stored_once_in_an_order_independent_of_the_ids() {
        let folder = TestFolder::new("archive");
        let path = |name: &str| folder.path.join(name);
        let mut ids: Vec<TileId> = (0..256).filter_map(|i| TileId::new(4, i % 16, i / 16)).collect();
        let big = vec![7u8; 10_000];
        let length = write(&path("big"), &ids, |_| Ok(big.clone())).unwrap();
        assert!((10_000..40_000).contains(&length), "{length}");
        let tile = |id: TileId| Ok(id.to_string().into_bytes());
        write(&path("first"), &ids, tile).unwrap();
        let first = fs::read(path("first")).unwrap();
        ids.reverse();
        write(&path("second"), &ids, tile).unwrap();
        assert_eq!(fs::read(path("second")).unwrap(), first);
        // Byte 96 of a PMTiles v3 header says "clustered".
        assert_eq!((&first[..8], first[96]), (&b"PMTiles\x03"[..], 1));
    }

    #[test]
    fn error_of_a_tile_ends_the_writing() {
        let folder = TestFolder::new("archive-fails");
        let error = write(&folder.path.join("a.pmtiles"), &[TileId::ROOT], |id| {
            Err(BakeError::tile(id, "read")(insula_protocol::DecodeError::Magic))
        });
        assert!(matches!(error, Err(BakeError::Tile { .. })));
    }
}
