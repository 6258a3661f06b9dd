//! The version of a city, recomputed from its files.

use super::{MANIFEST_FILE, MAX_MANIFEST_BYTES, SEARCH_FILE, open_archive, read_manifest};
use crate::directory::HEADER_BYTES;
use crate::file::open_regular;
use crate::limits::MAX_OPENING_TIME;
use crate::mark::MARK_AT;
use insula_protocol::TileKind;
use insula_protocol::release::SharedCity;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;
use std::time::Instant;

const TILE_HASH_BYTES: usize = 16;

/// The hash of an archive: of the hashes of its tiles in the order of their bytes, equal ones once, and of what is before and after
/// the tiles. Who knows the hashes of the tiles need not read them.
#[derive(Debug, Default)]
pub struct ArchiveDigest {
    tiles: blake3::Hasher,
}

impl ArchiveDigest {
    /// Adds the next tile by the first 16 bytes of its BLAKE3 hash.
    pub fn add(&mut self, hash: &[u8; TILE_HASH_BYTES]) {
        self.tiles.update(hash);
    }

    /// The hash. `head` and `tail` are the bytes before and after those of the tiles, without a mark ([`crate::mark`]).
    pub fn finish(self, head: &[u8], tail: &[u8]) -> [u8; blake3::OUT_LEN] {
        let mut hasher = self.begin_end();
        for part in [head, tail] {
            hasher.update(&(part.len() as u64).to_le_bytes()).update(part);
        }
        hasher.finalize().into()
    }

    /// The hash of a file whose tiles lie at `data`. Fails if the rest of it cannot be read.
    fn finish_file(self, file: &mut File, data: Range<u64>, length: u64) -> io::Result<[u8; blake3::OUT_LEN]> {
        let mut hasher = self.begin_end();
        for part in [0..data.start, data.end..length] {
            let bytes = part.end - part.start;
            hasher.update(&bytes.to_le_bytes());
            file.seek(SeekFrom::Start(part.start))?;
            let mut start = vec![0; bytes.min(HEADER_BYTES) as usize];
            file.read_exact(&mut start)?;
            if part.start == 0 && start.len() >= MARK_AT.end {
                start[MARK_AT].fill(0);
            }
            hasher.update(&start);
            let rest = bytes - start.len() as u64;
            if io::copy(&mut file.take(rest), &mut hasher)? != rest {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
        }
        Ok(hasher.finalize().into())
    }

    fn begin_end(self) -> blake3::Hasher {
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.tiles.finalize().as_bytes());
        hasher
    }
}

/// The version of a city whose files have these hashes, in their order, and whose manifest has this text with an empty version.
pub fn version_of(hashes: &[[u8; blake3::OUT_LEN]], manifest: &[u8]) -> String {
    let mut hasher = blake3::Hasher::new();
    for hash in hashes {
        hasher.update(hash);
    }
    hasher.update(manifest);
    hasher.finalize().to_hex()[..16].to_owned()
}

/// The version that the files in a city's folder should have: the first 16 hexadecimal digits of the BLAKE3 hash of the hashes of the
/// archives ([`ArchiveDigest`]) and of the search index, that of visibility last, and of the manifest's text with an empty version.
/// `stated` is the version that the manifest has.
///
/// Of archives that share tiles with other cities, only their own count: the manifest has the versions of these.
///
/// It differs from `stated` if a file is of another bake or was changed. Fails if a file cannot be read.
pub fn content_version(folder: &Path, stated: &str) -> io::Result<String> {
    // A manifest that cannot be read has another version than it states.
    let shared = read_manifest(folder).map(|manifest| manifest.shared().to_vec()).unwrap_or_default();
    let archive_hash = |kind: TileKind| archive_hash(folder, &shared, kind);
    let mut hashes = Vec::new();
    let mut add = |hash: io::Result<[u8; blake3::OUT_LEN]>, is_required: bool| match hash {
        Err(error) if !is_required && error.kind() == io::ErrorKind::NotFound => Ok(()),
        hash => hash.map(|hash| hashes.push(hash)),
    };
    for kind in [TileKind::BlockMap, TileKind::Subtree, TileKind::Mesh, TileKind::Objects] {
        add(archive_hash(kind), kind.is_required())?;
    }
    add(open_regular(&folder.join(SEARCH_FILE)).and_then(|mut file| hash_rest(&mut file)), false)?;
    add(archive_hash(TileKind::Visibility), false)?;
    let mut text = String::new();
    open_regular(&folder.join(MANIFEST_FILE))?.take(MAX_MANIFEST_BYTES as u64).read_to_string(&mut text)?;
    // The text itself rather than the parsed manifest: numbers need not survive being parsed and written.
    let unversioned = text.replacen(&format!("\"version\": \"{stated}\""), "\"version\": \"\"", 1);
    Ok(version_of(&hashes, unversioned.as_bytes()))
}

/// The hash of an archive. One that cannot be opened has that of its bytes, which no version is made of.
fn archive_hash(folder: &Path, shared: &[SharedCity], kind: TileKind) -> io::Result<[u8; blake3::OUT_LEN]> {
    let mut file = open_regular(&folder.join(kind.file_name()))?;
    let opened = open_archive(folder, &folder.join(".."), shared, kind, Instant::now() + MAX_OPENING_TIME);
    let Ok(archive) = opened else { return hash_rest(&mut file) };
    let data = archive.data();
    let mut reader = BufReader::with_capacity(1 << 20, &mut file);
    reader.seek(SeekFrom::Start(data.start))?;
    let mut digest = ArchiveDigest::default();
    let mut position = data.start;
    let mut tile = Vec::new();
    for range in archive.distinct_tiles() {
        let range = range.map_err(io::Error::other)?;
        reader.seek_relative(range.start as i64 - position as i64)?;
        // No longer than a tile may be, and inside the file.
        tile.resize((range.end - range.start) as usize, 0);
        reader.read_exact(&mut tile)?;
        position = range.end;
        let hash = blake3::hash(&tile);
        digest.add(hash.as_bytes().first_chunk().unwrap_or(&[0; TILE_HASH_BYTES]));
    }
    digest.finish_file(&mut file, data, archive.file_bytes())
}

fn hash_rest(file: &mut File) -> io::Result<[u8; blake3::OUT_LEN]> {
    let mut hasher = blake3::Hasher::new();
    io::copy(file, &mut hasher)?;
    Ok(hasher.finalize().into())
}
