//! A city's PMTiles archives, wherever their bytes are.
//!
//! In: a way to read ranges ([`Ranges`]). Out: tiles. Next: `decode`.
//!
//! Each archive is opened at the first tile that is asked of it: one read has its header and its root directory. Leaf
//! directories are kept, and many who wait for one fetch it once.

use super::{Pending, Source};
use bytes::Bytes;
use insula_protocol::{mesh_tile, route::Layer};
use insula_viewer::{decode::limit_bytes, scene::TileKey, streamer::FetchError};
use pmtiles::{
    AsyncBackend, AsyncPmTilesReader, BackendResponse, Compression, MokaCache, PmtError, PmtResult, TileCoord,
};
use std::{
    future::Future,
    io::Read,
    sync::atomic::{AtomicU64, Ordering},
};
use tokio::sync::OnceCell;

/// Leaf directories that are kept, of each archive.
const DIRECTORY_BYTES: u64 = 32 << 20;
/// Longest packed directory, and longest unpacked one.
const PACKED_BYTES: usize = 4 << 20;
const UNPACKED_BYTES: u64 = 64 << 20;
/// What a header is long, and where it says where leaf directories lie.
const HEADER_BYTES: usize = 127;
const LEAVES_AT: usize = 40;

/// Something that ranges of bytes can be read of.
pub trait Ranges: Clone + Send + Sync + 'static {
    /// At most `length` bytes from `offset` on, fewer only where it ends; and what tells this version of it from another.
    fn read(
        &self,
        offset: u64,
        length: usize,
    ) -> impl Future<Output = Result<(Bytes, Option<String>), FetchError>> + Send;
}

/// A city's archives. That of meshes is opened only if there are any.
pub struct Archives<R: Ranges> {
    place: String,
    block_maps: Archive<R>,
    subtrees: Archive<R>,
    meshes: Archive<R>,
}

struct Archive<R: Ranges> {
    ranges: R,
    reader: OnceCell<AsyncPmTilesReader<Guarded<R>, MokaCache>>,
}

/// Checks what is read before it is unpacked.
struct Guarded<R> {
    ranges: R,
    /// Where leaf directories begin and end; 0 until the header was read.
    leaves: [AtomicU64; 2],
}

impl<R: Ranges> Archives<R> {
    /// `open` says how each archive is read; `place` is for people.
    pub fn new(place: String, open: impl Fn(Layer) -> R) -> Self {
        let archive = |layer| Archive { ranges: open(layer), reader: OnceCell::new() };
        let [block_maps, subtrees, meshes] = [Layer::BlockMaps, Layer::Subtrees, Layer::Meshes].map(archive);
        Self { place, block_maps, subtrees, meshes }
    }
}

impl<R: Ranges> Source for Archives<R> {
    fn tile(&self, key: TileKey) -> Pending<'_> {
        let archive = match key.layer() {
            Layer::BlockMaps => &self.block_maps,
            Layer::Subtrees => &self.subtrees,
            Layer::Meshes => &self.meshes,
        };
        Box::pin(archive.tile(key))
    }

    fn place(&self) -> &str {
        &self.place
    }
}

impl<R: Ranges> Archive<R> {
    async fn tile(&self, key: TileKey) -> Result<Bytes, FetchError> {
        let open = || {
            let guarded = Guarded { ranges: self.ranges.clone(), leaves: Default::default() };
            AsyncPmTilesReader::try_from_cached_source(guarded, MokaCache::with_max_bytes(DIRECTORY_BYTES))
        };
        let reader = self.reader.get_or_try_init(open).await.map_err(failed)?;
        if reader.get_header().tile_compression != Compression::None {
            return Err(FetchError::Archive("its tiles are packed".into()));
        }
        let place = match key.layer() {
            Layer::Meshes => mesh_tile::place(key.id, key.lod).ok_or(FetchError::Missing)?,
            Layer::BlockMaps | Layer::Subtrees => key.id,
        };
        let coord = TileCoord::new(place.level(), place.x(), place.y()).map_err(failed)?;
        let bytes = reader.get_tile(coord).await.map_err(failed)?.ok_or(FetchError::Missing)?;
        if bytes.len() > limit_bytes(key) { Err(FetchError::Missing) } else { Ok(bytes) }
    }
}

impl<R: Ranges> AsyncBackend for Guarded<R> {
    async fn read(&self, offset: u64, length: usize) -> PmtResult<BackendResponse> {
        self.guarded(offset, length).await.map_err(carry)
    }
}

impl<R: Ranges> Guarded<R> {
    async fn guarded(&self, offset: u64, length: usize) -> Result<BackendResponse, FetchError> {
        let [from, to] = [0, 1].map(|i| self.leaves[i].load(Ordering::Relaxed));
        let is_leaf = (from..to).contains(&offset);
        let most = if is_leaf { PACKED_BYTES } else { insula_viewer::decode::MAX_TILE_BYTES };
        if length > most {
            return Err(FetchError::Archive(format!("it asks for {length} bytes at once")));
        }
        let (bytes, version) = self.ranges.read(offset, length).await?;
        if offset == 0 && bytes.len() >= HEADER_BYTES {
            let number = |at: usize| bytes[at..at + 8].iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
            let start = number(LEAVES_AT);
            self.leaves[0].store(start, Ordering::Relaxed);
            self.leaves[1].store(start.saturating_add(number(LEAVES_AT + 8)), Ordering::Relaxed);
        }
        if is_leaf && !unpacks(&bytes) {
            return Err(FetchError::Archive("a directory is too large".into()));
        }
        Ok(match version {
            Some(version) => BackendResponse::new_with_version(bytes, version),
            None => BackendResponse::new(bytes),
        })
    }
}

/// Whether a directory, packed or not, stays within its limit.
fn unpacks(bytes: &[u8]) -> bool {
    if bytes.first_chunk() != Some(&[0x1f, 0x8b]) {
        return true;
    }
    let unpacked = flate2::read::GzDecoder::new(bytes).take(UNPACKED_BYTES);
    std::io::copy(&mut { unpacked }, &mut std::io::sink()).is_ok_and(|length| length < UNPACKED_BYTES)
}

/// Our errors on their way through the reader.
fn carry(error: FetchError) -> PmtError {
    PmtError::Reading(std::io::Error::other(error))
}

fn failed(error: PmtError) -> FetchError {
    match error {
        PmtError::Reading(error) if error.get_ref().is_some_and(|e| e.is::<FetchError>()) => {
            match error.into_inner().map(|inner| inner.downcast::<FetchError>()) {
                Some(Ok(ours)) => *ours,
                _ => FetchError::Archive("it cannot be read".into()),
            }
        }
        PmtError::SourceModified => FetchError::Unusable("the city was replaced meanwhile: open it again".into()),
        other => FetchError::Archive(other.to_string()),
    }
}
