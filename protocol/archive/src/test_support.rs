//! Archives and sources for the tests of this crate.

use crate::{RangeRead, RangeSource, ReadError};
use bytes::Bytes;
use insula_protocol::TileId;
use pmtiles::{Compression, PmTilesWriter, TileCoord, TileType};
use std::io::{Cursor, Write};
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// Polls before a response. Each caller that waits for a shared read polls it, so all of them ask before it responds.
const POLLS: usize = 1000;

pub(crate) fn id(level: u8, x: u32, y: u32) -> TileId {
    TileId::new(level, x, y).unwrap()
}

/// An archive as the bake writes it; tiles must be in the order of [`crate::directory::tile_number`].
pub(crate) fn archive(tiles: &[(TileId, Vec<u8>)]) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let mut writer =
        PmTilesWriter::new(TileType::Unknown).tile_compression(Compression::None).create(&mut file).unwrap();
    for (id, bytes) in tiles {
        writer.add_tile(TileCoord::new(id.level(), id.x(), id.y()).unwrap(), bytes).unwrap();
    }
    writer.finalize().unwrap();
    file.into_inner()
}

/// 16,384 tiles of irregular lengths: their directory does not fit into the root.
pub(crate) fn archive_with_leaves() -> (Vec<u8>, Vec<(TileId, Vec<u8>)>) {
    let ids = (0..1u32 << 14).map(|i| id(7, i % 128, i / 128));
    let bytes = |id: TileId| format!("{id} {}", "x".repeat((id.x() * 7919 + id.y() * 104_729) as usize % 97));
    let mut tiles: Vec<_> = ids.map(|id| (id, bytes(id).into_bytes())).collect();
    tiles.sort_by_key(|(id, _)| crate::directory::tile_number(*id));
    let file = archive(&tiles);
    assert_ne!(file[48..56], [0; 8], "there are no leaf directories: the tests test nothing");
    (file, tiles)
}

/// One entry of a made-up directory: the step to its number, run length, length, and offset plus one or 0.
pub(crate) type RawEntry = [u64; 4];

/// A directory as bytes, not packed.
pub(crate) fn directory(entries: &[RawEntry]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut varint = |mut value: u64| {
        while value >= 0x80 {
            bytes.push(value as u8 | 0x80);
            value >>= 7;
        }
        bytes.push(value as u8);
    };
    varint(entries.len() as u64);
    (0..4).flat_map(|field| entries.iter().map(move |entry| entry[field])).for_each(&mut varint);
    bytes
}

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// An archive of these sections.
pub(crate) fn raw_archive(root: &[u8], leaves: &[u8], data: &[u8]) -> Vec<u8> {
    let mut file = b"PMTiles\x03".to_vec();
    file.resize(127, 0);
    let mut offset = 127;
    for (at, section) in [(8, root), (40, leaves), (56, data)] {
        file[at..at + 8].copy_from_slice(&(offset as u64).to_le_bytes());
        file[at + 8..at + 16].copy_from_slice(&(section.len() as u64).to_le_bytes());
        offset += section.len();
    }
    file[97] = if root.starts_with(&[0x1f, 0x8b]) { 2 } else { 1 };
    file[98] = 1;
    [&file, root, leaves, data].concat()
}

/// Bytes in memory that count their reads.
#[derive(Debug, Default)]
pub(crate) struct MemorySource {
    pub(crate) bytes: Mutex<Bytes>,
    pub(crate) reads: Mutex<Vec<Range<u64>>>,
    pub(crate) invalidated: AtomicU64,
    /// Responds later, like a network.
    pub(crate) is_remote: bool,
    /// Number of further reads that fail.
    pub(crate) failures: AtomicU32,
}

impl MemorySource {
    pub(crate) fn local(bytes: Vec<u8>) -> Self {
        Self { bytes: Mutex::new(bytes.into()), ..Self::default() }
    }

    pub(crate) fn remote(bytes: Vec<u8>) -> Self {
        Self { is_remote: true, ..Self::local(bytes) }
    }

    pub(crate) fn take_reads(&self) -> Vec<Range<u64>> {
        std::mem::take(&mut self.reads.lock().unwrap())
    }
}

impl RangeSource for MemorySource {
    fn length(&self) -> Option<u64> {
        // As of a server: unknown until the first response.
        let is_known = !self.is_remote || !self.reads.lock().unwrap().is_empty();
        is_known.then(|| self.bytes.lock().unwrap().len() as u64)
    }

    fn read(&self, range: Range<u64>) -> RangeRead {
        self.reads.lock().unwrap().push(range.clone());
        let bytes = self.bytes.lock().unwrap();
        let failed = self.failures.try_update(Ordering::Relaxed, Ordering::Relaxed, |n| n.checked_sub(1)).is_ok();
        let result = if failed {
            Err(ReadError::Failed("on purpose".into()))
        } else {
            Ok(bytes.slice(range.start as usize..(range.end as usize).min(bytes.len())))
        };
        if !self.is_remote {
            return RangeRead::Ready(result);
        }
        RangeRead::Pending(Box::pin(async move {
            for _ in 0..POLLS {
                tokio::task::yield_now().await;
            }
            result
        }))
    }

    fn invalidate(&self, _: Range<u64>) -> crate::source::BoxFuture<'_, ()> {
        self.invalidated.fetch_add(1, Ordering::Relaxed);
        Box::pin(std::future::ready(()))
    }
}
