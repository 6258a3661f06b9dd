//! Reads the points of a file in order, and classifies them as ground or not.

use super::super::error::RasterError;
use super::super::source::Source;
use super::header::{Header, Scaling};
use super::layout::{Chunk, Layout};
use super::packing::{Packing, unpack_sequential};
use rayon::prelude::*;
use std::io::{BufReader, Read, Seek, SeekFrom};

/// Chunks with more points are read on their own, without a list of their points. Writers make chunks of 50,000.
const MAX_LISTED_POINTS: u64 = 1 << 18;
/// Chunks for each thread that are read from the file before they are unpacked together.
const CHUNKS_OF_THREAD: usize = 2;
/// Packed bytes and points that are in memory at once, unless a single chunk has more.
const MAX_BATCH_BYTES: u64 = 1 << 26;
const MAX_BATCH_POINTS: u64 = 1 << 23;
/// Ground, its key points in early versions, water, and roads.
const GROUND_CLASSES: [u8; 4] = [2, 8, 9, 11];
/// Plants, buildings and noise; wires, towers, bridges, overlap, high noise, overhead structures, ignored
/// ground, snow, and temporary objects (ASPRS LAS 1.4, table 17).
const OTHER_CLASSES: [std::ops::RangeInclusive<u8>; 2] = [3..=7, 12..=22];

/// How well a point represents the ground, best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PointKind {
    Ground,
    /// It is on the ground, but was not measured, or is where two flights overlap.
    DoubtfulGround,
    /// It is the last reflection of a beam, and not known to be above the ground.
    LastReturn,
}

impl PointKind {
    pub(super) const ALL: [Self; 3] = [Self::Ground, Self::DoubtfulGround, Self::LastReturn];

    /// The kind of a record's point; `None` if it is not ground. Records have at least 20 bytes.
    fn of_record(record: &[u8], is_extended: bool) -> Option<Self> {
        let [returns, flags, class] = *record.get(14..)?.first_chunk()?;
        let (number, count, class, is_doubtful, is_withheld) = match is_extended {
            true => (returns & 15, returns >> 4, class, flags & 0b1001 != 0, flags & 0b100 != 0),
            // The flags are in the highest bits of the class.
            false => (returns & 7, returns >> 3 & 7, flags & 31, flags & 0x20 != 0, flags & 0x80 != 0),
        };
        if is_withheld {
            None
        } else if GROUND_CLASSES.contains(&class) {
            Some(if is_doubtful { Self::DoubtfulGround } else { Self::Ground })
        } else {
            let is_other = OTHER_CLASSES.iter().any(|classes| classes.contains(&class));
            (number >= count && !is_other).then_some(Self::LastReturn)
        }
    }
}

/// A point in the whole numbers of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct CloudPoint {
    pub(super) numbers: [i32; 3],
    pub(super) kind: PointKind,
}

pub(super) struct PointFilter {
    is_extended: bool,
    scaling: Scaling,
    bounds: [[f64; 2]; 2],
    /// Only points of this kind.
    kind: Option<PointKind>,
}

impl PointFilter {
    /// Points within the bounds in the header, which may have been rounded to the coordinates' scale.
    pub(super) fn new(header: &Header, kind: Option<PointKind>) -> Self {
        let scale = header.scaling.scale;
        let [low, high] = header.bounds;
        let bounds = [[low[0] - scale[0], low[1] - scale[1]], [high[0] + scale[0], high[1] + scale[1]]];
        Self { is_extended: header.is_extended, scaling: header.scaling, bounds, kind }
    }

    fn wanted(&self, record: &[u8]) -> Option<CloudPoint> {
        let kind = PointKind::of_record(record, self.is_extended)?;
        if self.kind.is_some_and(|wanted| wanted != kind) {
            return None;
        }
        let numbers: &[[u8; 4]; 3] = record.as_chunks().0.first_chunk()?;
        let numbers = numbers.map(i32::from_le_bytes);
        let [low, high] = self.bounds;
        let position = self.scaling.position(numbers);
        let is_inside = (0..2).all(|axis| (low[axis]..=high[axis]).contains(&position[axis]));
        is_inside.then_some(CloudPoint { numbers, kind })
    }
}

/// Calls `each` for the wanted points of a file, in its order. Fails if the file is damaged, or a chunk has more than
/// `max_chunk_bytes`.
pub(super) fn for_each(
    source: &mut Source,
    layout: &Layout,
    filter: &PointFilter,
    max_chunk_bytes: u64,
    each: &mut dyn FnMut(CloudPoint),
) -> Result<(), RasterError> {
    let mut rest = &layout.chunks[..];
    while let Some(first) = rest.first() {
        let (batch, left) = rest.split_at(batch_len(rest));
        if batch.is_empty() {
            read_large_chunk(source, layout, *first, max_chunk_bytes, &mut |record| {
                if let Some(point) = filter.wanted(record) {
                    each(point);
                }
            })?;
            rest = &rest[1..];
            continue;
        }
        let packed = batch.iter().map(|chunk| Ok((source.read_at(chunk.offset, chunk.bytes)?, chunk.points)));
        let packed = packed.collect::<Result<Vec<_>, RasterError>>()?;
        let lists = packed.par_iter().map(|(bytes, points)| {
            let mut list = Vec::new();
            let mut keep = |record: &[u8]| list.extend(filter.wanted(record));
            layout.packing.unpack(bytes, *points, layout.record_bytes, &mut keep)?;
            Ok(list)
        });
        for list in lists.collect::<Vec<Result<_, RasterError>>>() {
            list?.into_iter().for_each(&mut *each);
        }
        rest = left;
    }
    Ok(())
}

/// Number of the first chunks that are unpacked together; 0 if the first one is too large for that.
fn batch_len(chunks: &[Chunk]) -> usize {
    let (mut bytes, mut points) = (0, 0);
    let most = rayon::current_num_threads() * CHUNKS_OF_THREAD;
    let is_small = |chunk: &&Chunk| {
        bytes += chunk.bytes;
        points += chunk.points.min(MAX_BATCH_POINTS);
        chunk.points <= MAX_LISTED_POINTS && bytes <= MAX_BATCH_BYTES && points <= MAX_BATCH_POINTS
    };
    chunks.iter().take(most).take_while(is_small).count()
}

/// Calls `each` for the records of a chunk of any size.
fn read_large_chunk(
    source: &mut Source,
    layout: &Layout,
    chunk: Chunk,
    max_chunk_bytes: u64,
    each: &mut dyn FnMut(&[u8]),
) -> Result<(), RasterError> {
    if let Packing::Sequential(items) = &layout.packing {
        source.seek(SeekFrom::Start(chunk.offset))?;
        let input = BufReader::new(source.take(chunk.bytes));
        return unpack_sequential(items, input, chunk.points, layout.record_bytes, each);
    }
    if chunk.bytes > max_chunk_bytes {
        return Err(RasterError::TooLarge { what: "a chunk of points", limit: max_chunk_bytes });
    }
    let bytes = source.read_at(chunk.offset, chunk.bytes)?;
    layout.packing.unpack(&bytes, chunk.points, layout.record_bytes, each)
}
