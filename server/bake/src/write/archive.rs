//! Writes clustered PMTiles archives.

use crate::error::BakeError;
use crate::hash::{ShortHash, short_hash};
use insula_archive::city::ArchiveDigest;
use insula_archive::directory_writer::{DATA_AT, DirectoryWriter, WrittenFrame};
use insula_archive::joined::SHARED_AT;
use insula_archive::{Archive, ReadError};
use insula_protocol::TileId;
use pmtiles::{Compression, PmTilesWriter, PmtError, TileCoord, TileType};
use std::cell::RefCell;
use std::collections::{HashMap, HashSet};
use std::fs;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::rc::Rc;

/// Where a header has the start and the length of the tiles' bytes.
const DATA_FIELD: usize = 56;
/// Bytes before those of the tiles are fewer.
const MAX_HEAD_BYTES: usize = 1 << 16;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct WrittenArchive {
    /// Length of the file.
    pub(crate) bytes: u64,
    /// See [`ArchiveDigest`].
    pub(crate) digest: [u8; blake3::OUT_LEN],
}

/// Writes the tiles of `ids` in the archive's own order (along a Hilbert curve, root first) and synchronises the file. Equal tiles are
/// stored once. Those that `base` has as they are, are left there. Fails if the file cannot be written, or with the first error of `tile`.
pub(crate) fn write(
    path: &Path,
    base: Option<&Archive>,
    ids: &[TileId],
    mut tile: impl FnMut(TileId) -> Result<Vec<u8>, BakeError>,
) -> Result<WrittenArchive, BakeError> {
    let failed = |cause| archive_error(path, cause);
    let mut ordered = ids.to_vec();
    ordered.sort_by_cached_key(|id| archive_order(*id));
    if let Some(base) = base {
        return write_shared(path, base, ordered, tile);
    }
    let file = fs::File::create_new(path).map_err(|cause| BakeError::io(path, "written", cause))?;
    let mut writer = writer(ordered.iter().copied()).create(&file).map_err(failed)?;
    let mut tiles = DistinctTiles::default();
    for id in ordered {
        let bytes = tile(id)?;
        let hash = short_hash(&blake3::hash(&bytes));
        tiles.add_if_new(hash, true);
        writer.add_tile(coordinates(id).map_err(failed)?, &bytes, Some(hash)).map_err(failed)?;
    }
    writer.finalize().map_err(failed)?;
    let read = |cause| BakeError::io(path, "read", cause);
    file.sync_all().map_err(|cause| BakeError::io(path, "written", cause))?;
    let bytes = file.metadata().map_err(read)?.len();
    let mut file = fs::File::open(path).map_err(read)?;
    let mut head = vec![0; bytes.min(MAX_HEAD_BYTES as u64) as usize];
    file.read_exact(&mut head).map_err(read)?;
    let [start, end] = data_range(&head).ok_or_else(|| BakeError::Scratch { path: path.to_owned() })?;
    head.truncate(start as usize);
    let mut tail = Vec::new();
    file.seek(SeekFrom::Start(end)).and_then(|_| file.read_to_end(&mut tail)).map_err(read)?;
    Ok(WrittenArchive { bytes, digest: tiles.digest.finish(&head, &tail) })
}

/// Writes those of the tiles that `base` does not have under the same id, and directories of all. `ids` are in the archive's order.
fn write_shared(
    path: &Path,
    base: &Archive,
    ids: Vec<TileId>,
    mut tile: impl FnMut(TileId) -> Result<Vec<u8>, BakeError>,
) -> Result<WrittenArchive, BakeError> {
    let written = |cause| BakeError::io(path, "written", cause);
    let same = |id: TileId, bytes: &[u8]| -> Result<Option<u64>, ReadError> {
        let Some(place) = base.place(id)? else { return Ok(None) };
        let has_length = place.end - place.start == bytes.len() as u64;
        Ok((has_length && base.read(place.clone()).ready()? == bytes).then_some(SHARED_AT + place.start))
    };
    let file = fs::File::create_new(path).map_err(written)?;
    let mut out = BufWriter::new(&file);
    out.write_all(&[0; DATA_AT as usize]).map_err(written)?;
    let (mut directories, mut tiles) = (DirectoryWriter::default(), DistinctTiles::default());
    let (mut own, mut end) = (HashMap::new(), DATA_AT);
    for id in ids {
        let bytes = tile(id)?;
        let shared = same(id, &bytes).map_err(|cause| BakeError::io(path, "compared", io::Error::other(cause)))?;
        let at = match shared {
            Some(at) => at,
            None => {
                let hash = short_hash(&blake3::hash(&bytes));
                if tiles.add_if_new(hash, true) {
                    out.write_all(&bytes).map_err(written)?;
                    own.insert(hash, end);
                    end += bytes.len() as u64;
                }
                own.get(&hash).copied().unwrap_or(end)
            }
        };
        directories.add(id, at, bytes.len() as u32).map_err(written)?;
    }
    let WrittenFrame { head, tail } = directories.finish(end, SHARED_AT + base.end()).map_err(written)?;
    out.write_all(&tail).and_then(|()| out.seek(SeekFrom::Start(0))).map_err(written)?;
    out.write_all(&head).and_then(|()| out.flush()).map_err(written)?;
    drop(out);
    file.sync_all().map_err(written)?;
    let digest = tiles.digest.finish(&head, &tail);
    Ok(WrittenArchive { bytes: end + tail.len() as u64, digest })
}

/// A tile of an archive, without its bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ListedTile {
    pub(crate) id: TileId,
    /// Number of its bytes.
    pub(crate) bytes: u32,
    pub(crate) hash: ShortHash,
}

/// An archive whose tiles are elsewhere.
#[derive(Debug)]
pub(crate) struct ArchiveLayout {
    /// The bytes before those of the tiles.
    pub(crate) head: Vec<u8>,
    /// The tiles whose bytes follow, by their numbers.
    pub(crate) distinct: Vec<u32>,
    /// The bytes after those of the tiles.
    pub(crate) tail: Vec<u8>,
    pub(crate) written: WrittenArchive,
}

/// What [`write()`] would write of these tiles, without their bytes. They must be in the archive's order. `path` is for messages. Fails if
/// the archive would be too large.
pub(crate) fn lay_out<T>(
    path: &Path,
    tiles: &[T],
    tile: impl Fn(&T) -> ListedTile,
) -> Result<ArchiveLayout, BakeError> {
    let failed = |cause| archive_error(path, cause);
    let repeated = repeated_hashes(tiles.iter().map(|listed| tile(listed).hash));
    let frame = Rc::new(RefCell::new(ArchiveFrame::default()));
    let writer = writer(tiles.iter().map(|listed| tile(listed).id));
    let mut writer = writer.create(FrameWriter(Rc::clone(&frame))).map_err(failed)?;
    let (mut known, mut distinct, mut data) = (DistinctTiles::default(), Vec::new(), 0);
    let mut blank = Vec::new();
    for (number, ListedTile { id, bytes, hash }) in (0..).zip(tiles.iter().map(&tile)) {
        // Keys and hashes of tiles that exist once would be most of the memory.
        let key = repeated.contains(&hash).then_some(hash);
        if known.add_if_new(hash, key.is_some()) {
            distinct.push(number);
            data += u64::from(bytes);
        }
        blank.resize((bytes as usize).max(blank.len()), 0);
        writer.add_tile(coordinates(id).map_err(failed)?, &blank[..bytes as usize], key).map_err(failed)?;
    }
    frame.borrow_mut().is_tail = true;
    writer.finalize().map_err(failed)?;
    let ArchiveFrame { mut head, tail, tail_start, .. } = std::mem::take(&mut *frame.borrow_mut());
    let invalid = || BakeError::Archive { path: path.to_owned(), what: "its header is invalid".to_owned() };
    let [start, end] = data_range(&head).ok_or_else(invalid)?;
    if end - start != data {
        return Err(invalid());
    }
    head.truncate(start as usize);
    // A buffer of the writer may hold the last tiles with the first directories.
    let skipped = end.checked_sub(tail_start.unwrap_or(end)).ok_or_else(invalid)?;
    let tail = tail.get(skipped as usize..).unwrap_or_default().to_vec();
    let written = WrittenArchive { bytes: end + tail.len() as u64, digest: known.digest.finish(&head, &tail) };
    Ok(ArchiveLayout { head, distinct, tail, written })
}

/// Hashes that occur more than once.
fn repeated_hashes(hashes: impl Iterator<Item = ShortHash>) -> HashSet<ShortHash> {
    let mut hashes: Vec<ShortHash> = hashes.collect();
    hashes.sort_unstable();
    hashes.windows(2).filter(|pair| pair[0] == pair[1]).map(|pair| pair[0]).collect()
}

/// The hashes of tiles, equal ones once.
#[derive(Default)]
struct DistinctTiles {
    known: HashSet<ShortHash>,
    digest: ArchiveDigest,
}

impl DistinctTiles {
    /// Adds a tile, which is new if it does not repeat. Returns whether it is.
    fn add_if_new(&mut self, hash: ShortHash, may_repeat: bool) -> bool {
        let is_new = !may_repeat || self.known.insert(hash);
        if is_new {
            self.digest.add(&hash);
        }
        is_new
    }
}

/// The writer of an archive of these tiles, which tells equal ones by their hashes.
fn writer(ids: impl Iterator<Item = TileId>) -> PmTilesWriter<pmtiles::CallerKey<ShortHash>> {
    let max_zoom = ids.map(|id| id.level()).max().unwrap_or(0);
    let writer = PmTilesWriter::new(TileType::Unknown).tile_compression(Compression::None).min_zoom(0);
    writer.max_zoom(max_zoom).dedup_by_key()
}

fn coordinates(id: TileId) -> Result<TileCoord, PmtError> {
    TileCoord::new(id.level(), id.x(), id.y())
}

/// Start and end of the tiles' bytes, by the first bytes of an archive.
fn data_range(head: &[u8]) -> Option<[u64; 2]> {
    let number = |at: usize| Some(u64::from_le_bytes(head.get(at..at + 8)?.try_into().ok()?));
    let start = number(DATA_FIELD)?;
    let end = start.checked_add(number(DATA_FIELD + 8)?)?;
    (start <= head.len() as u64).then_some([start, end])
}

/// What an archive has besides the bytes of its tiles.
#[derive(Debug, Default)]
struct ArchiveFrame {
    /// The first bytes, at least those before the tiles.
    head: Vec<u8>,
    /// All bytes that were written after the last tile was given.
    tail: Vec<u8>,
    tail_start: Option<u64>,
    is_tail: bool,
    position: u64,
    /// The furthest position so far.
    end: u64,
}

/// Keeps the frame of what is written.
struct FrameWriter(Rc<RefCell<ArchiveFrame>>);

impl Write for FrameWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let frame = &mut *self.0.borrow_mut();
        let start = frame.position;
        if start < MAX_HEAD_BYTES as u64 {
            let (start, end) = (start as usize, (start as usize + bytes.len()).min(MAX_HEAD_BYTES));
            frame.head.resize(frame.head.len().max(end), 0);
            frame.head[start..end].copy_from_slice(&bytes[..end - start]);
        }
        // The header is written in the end, at the start.
        if frame.is_tail && start == frame.end {
            frame.tail_start.get_or_insert(start);
            frame.tail.extend_from_slice(bytes);
        }
        frame.position += bytes.len() as u64;
        frame.end = frame.end.max(frame.position);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for FrameWriter {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let SeekFrom::Start(position) = to else { return Err(io::ErrorKind::Unsupported.into()) };
        self.0.borrow_mut().position = position;
        Ok(position)
    }
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
        let length = write(&path("big"), None, &ids, |_| Ok(big.clone())).unwrap().bytes;
        assert!((10_000..40_000).contains(&length), "{length}");
        let tile = |id: TileId| Ok(id.to_string().into_bytes());
        write(&path("first"), None, &ids, tile).unwrap();
        let first = fs::read(path("first")).unwrap();
        ids.reverse();
        write(&path("second"), None, &ids, tile).unwrap();
        assert_eq!(fs::read(path("second")).unwrap(), first);
        // Byte 96 of a PMTiles v3 header says "clustered".
        assert_eq!((&first[..8], first[96]), (&b"PMTiles\x03"[..], 1));
    }

    #[test]
    fn layout_without_bytes_is_that_of_the_written_archive() {
        let folder = TestFolder::new("archive-layout");
        // So many tiles that there are leaf directories; some equal, in runs and apart; lengths below and above a buffer.
        let mut ids: Vec<TileId> = (0..=6)
            .flat_map(|level| {
                let side = 1 << level;
                (0..side * side).filter_map(move |i| TileId::new(level, i % side, i / side))
            })
            .collect();
        ids.sort_by_cached_key(|id| archive_order(*id));
        let bytes = |id: &TileId| -> Vec<u8> {
            let number = archive_order(*id);
            if number % 5 < 2 { vec![7; 30] } else { (0..number * 37 % 4000 + 1).map(|i| (i ^ number) as u8).collect() }
        };
        for count in [1, 2, 40, ids.len()] {
            let (path, ids) = (folder.path.join(count.to_string()), &ids[..count]);
            let written = write(&path, None, ids, |id| Ok(bytes(&id))).unwrap();
            let tile = |id: &TileId| {
                let bytes = bytes(id);
                ListedTile { id: *id, bytes: bytes.len() as u32, hash: short_hash(&blake3::hash(&bytes)) }
            };
            let layout = lay_out(&path, ids, tile).unwrap();
            assert_eq!(layout.written, written);
            let data = layout.distinct.iter().flat_map(|number| bytes(&ids[*number as usize]));
            let joined: Vec<u8> = layout.head.iter().copied().chain(data).chain(layout.tail).collect();
            assert!(joined == fs::read(&path).unwrap(), "{count} tiles");
        }
    }

    #[test]
    fn error_of_a_tile_ends_the_writing() {
        let folder = TestFolder::new("archive-fails");
        let error = write(&folder.path.join("a.pmtiles"), None, &[TileId::ROOT], |id| {
            Err(BakeError::tile(id, "read")(insula_protocol::DecodeError::Magic))
        });
        assert!(matches!(error, Err(BakeError::Tile { .. })));
    }
}
