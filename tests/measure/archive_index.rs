//! Measures what an archive of many tiles takes: the time to open it, memory, reads.
//!
//! `cargo run --release -p insula-measure --bin archive_index -- FILE [--tiles N]`: writes an archive of N tiles of irregular lengths to
//! FILE, whose tiles are a hole, opens it as a server does, finds random tiles, and reads one as a client does.

use anyhow::{Context, Result, ensure};
use clap::Parser;
use flate2::{Compression, write::GzEncoder};
use futures_util::FutureExt;
use insula_archive::{Archive, LazyArchive, RangeRead, RangeSource, file_source::FileSource, limits::MAX_TILE_BYTES};
use insula_protocol::TileId;
use insula_test_support::rng::Rng;
use std::{
    fs,
    io::{BufWriter, Seek, SeekFrom, Write},
    ops::Range,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

/// Measures an archive of many tiles
#[derive(Debug, Parser)]
struct Args {
    file: PathBuf,
    #[arg(long, default_value_t = 100_000_000)]
    tiles: u64,
    /// Number of tiles that are found
    #[arg(long, default_value_t = 100_000)]
    finds: u64,
}

/// Leaf directories of the writer `pmtiles` have so many entries at least.
const LEAF_ENTRIES: u64 = 4096;
/// More would not fit into the first read of a client.
const MAX_LEAVES: u64 = 3500;
const HEADER_BYTES: u64 = 127;

fn main() -> Result<()> {
    let args = Args::parse();
    write_archive(&args.file, args.tiles)?;
    let written = peak_kb()?;
    let start = Instant::now();
    let archive = Archive::open(&args.file, start + Duration::from_secs(600))?;
    ensure!(archive.len() == args.tiles, "{} tiles", archive.len());
    let level = archive.deepest_level();
    println!("{} tiles: opened in {:.1} s", args.tiles, start.elapsed().as_secs_f64());
    let (mut random, start) = (Rng::new(7), Instant::now());
    for _ in 0..args.finds {
        // Most tiles are of the deepest full level.
        let [x, y] = [0; 2].map(|_| random.below(1 << (level - 1)) as u32);
        let id = TileId::new(level - 1, x, y).context("no such node")?;
        let found = archive.find(id).now_or_never().context("the file does not answer")??;
        ensure!(found.is_some(), "{id} is missing");
    }
    let seconds = start.elapsed().as_secs_f64();
    println!("{} random tiles found in {:.0} µs each", args.finds, 1e6 * seconds / args.finds as f64);
    println!("peak memory {} kB, of which the writer took {written} kB", peak_kb()?);
    let source = Arc::new(CountedSource { file: FileSource::open(&args.file)?, reads: AtomicU64::new(0) });
    let lazy = LazyArchive::new(source.clone(), MAX_TILE_BYTES);
    let id = TileId::new(level - 1, 5, 9).context("no such node")?;
    lazy.tile(id).now_or_never().context("the file does not answer")??.context("the tile is missing")?;
    println!("a client reads {} ranges for its first tile", source.reads.load(Relaxed));
    Ok(())
}

/// A file whose reads are counted.
#[derive(Debug)]
struct CountedSource {
    file: FileSource,
    reads: AtomicU64,
}

impl RangeSource for CountedSource {
    fn length(&self) -> Option<u64> {
        self.file.length()
    }

    fn read(&self, range: Range<u64>) -> RangeRead {
        self.reads.fetch_add(1, Relaxed);
        self.file.read(range)
    }
}

fn write_archive(path: &Path, tiles: u64) -> Result<()> {
    let per_leaf = tiles.div_ceil(MAX_LEAVES).max(LEAF_ENTRIES);
    let length = |number: u64| 1 + (number.wrapping_mul(2_654_435_761) >> 7) % 4096;
    let data_bytes: u64 = (0..tiles).map(length).sum();
    let (mut leaves, mut position) = (Vec::new(), 0);
    let mut file = BufWriter::new(fs::File::create(path)?);
    // The root directory gets its place before the tiles.
    let data_start = HEADER_BYTES + (1 << 20);
    file.seek(SeekFrom::Start(data_start + data_bytes))?;
    let mut offset = 0;
    for first in (0..tiles).step_by(per_leaf as usize) {
        let numbers = first..(first + per_leaf).min(tiles);
        let entries: Vec<[u64; 4]> = numbers.map(|n| [u64::from(n > first), 1, length(n), 0]).collect();
        let bytes: u64 = entries.iter().map(|entry| entry[2]).sum();
        let packed = pack(first, offset, entries)?;
        file.write_all(&packed)?;
        // As the writer does: a leaf that follows the one before has no offset.
        let [step, place] = if leaves.is_empty() { [0, 1] } else { [per_leaf, 0] };
        leaves.push([step, 0, packed.len() as u64, place]);
        position += packed.len() as u64;
        offset += bytes;
    }
    let root = gzip(&directory(&leaves))?;
    ensure!(root.len() < 1 << 20, "the root directory has {} bytes", root.len());
    let mut header = b"PMTiles\x03".to_vec();
    header.resize(HEADER_BYTES as usize, 0);
    let sections =
        [(8, HEADER_BYTES, root.len() as u64), (40, data_start + data_bytes, position), (56, data_start, data_bytes)];
    for (at, start, length) in sections {
        header[at..at + 8].copy_from_slice(&start.to_le_bytes());
        header[at + 8..at + 16].copy_from_slice(&length.to_le_bytes());
    }
    // Directories are packed by gzip, tiles are not.
    (header[97], header[98]) = (2, 1);
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&header)?;
    file.write_all(&root)?;
    println!("{} MB of directories in {} leaves, root {} bytes", position / 1_000_000, leaves.len(), root.len());
    Ok(file.flush()?)
}

/// A leaf directory of tiles that follow one another, the first of which has this number and offset.
fn pack(first: u64, offset: u64, mut entries: Vec<[u64; 4]>) -> Result<Vec<u8>> {
    if let Some(entry) = entries.first_mut() {
        (entry[0], entry[3]) = (first, offset + 1);
    }
    gzip(&directory(&entries))
}

/// Entries: step to the number, run, length, offset plus one or 0 if it follows.
fn directory(entries: &[[u64; 4]]) -> Vec<u8> {
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

fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?)
}

/// The highest resident memory of this process so far, as Linux tells it.
fn peak_kb() -> Result<u64> {
    let status = fs::read_to_string("/proc/self/status")?;
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse().ok());
    peak.context("the system does not tell it")
}
