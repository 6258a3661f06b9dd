//! Where the points of a file are, and how they are packed.

use super::super::error::RasterError;
use super::super::source::Source;
use super::header::Header;
use super::packing::{self, Packing};
use laz::LazVlr;
use laz::laszip::ChunkTable;
use std::io::{BufReader, Seek, SeekFrom};

/// Points of a chunk of a file that is not packed.
const PLAIN_POINTS: u64 = 1 << 16;
/// Kinds of packing in the file's own description: one run of points, chunks, and chunks of layers.
const ONE_RUN: u16 = 1;
const CHUNKS: [u16; 2] = [2, 3];
/// The place of the table of chunks is before the first chunk.
const TABLE_OFFSET_BYTES: u64 = 8;
/// Chunks with more points for each byte are damage. Of 50,000 equal points, each byte holds 500.
const MAX_POINTS_OF_BYTE: u64 = 1000;

/// The points of a file as chunks, each of which is read on its own.
pub(super) struct Layout {
    pub(super) packing: Packing,
    pub(super) record_bytes: usize,
    pub(super) chunks: Vec<Chunk>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Chunk {
    pub(super) offset: u64,
    pub(super) bytes: u64,
    pub(super) points: u64,
}

impl Chunk {
    /// A packed chunk. Fails if its bytes cannot hold its points.
    fn checked(offset: u64, bytes: u64, points: u64) -> Result<Self, RasterError> {
        if points / MAX_POINTS_OF_BYTE > bytes {
            return Err(RasterError::damaged("one of its chunks has more points than its bytes can hold"));
        }
        Ok(Self { offset, bytes, points })
    }
}

impl Layout {
    /// `description` is LASzip's, of packed files. Fails if the file has fewer points than its header says.
    pub(super) fn read(source: &mut Source, header: &Header, description: Option<&[u8]>) -> Result<Self, RasterError> {
        let record_bytes = usize::from(header.record_bytes);
        if !header.is_packed {
            let chunks = plain_chunks(header, source.len())?;
            return Ok(Self { packing: Packing::None, record_bytes, chunks });
        }
        let description = description.ok_or_else(|| RasterError::damaged("it has no record of its compression"))?;
        let table = LazVlr::from_buffer(description).map_err(packing::fault)?;
        let kind = description.first_chunk().copied().map_or(0, u16::from_le_bytes);
        let packing = Packing::new(table.items(), record_bytes)?;
        let chunks = match (kind, &packing) {
            (ONE_RUN, Packing::Sequential(_)) => {
                let bytes = source.len() - header.points_offset;
                vec![Chunk::checked(header.points_offset, bytes, header.points)?]
            }
            (kind, _) if CHUNKS.contains(&kind) => read_table(source, header, &table)?,
            _ => return Err(RasterError::unsupported(format!("points that are packed in way {kind}"))),
        };
        Ok(Self { packing, record_bytes, chunks })
    }
}

fn plain_chunks(header: &Header, file_bytes: u64) -> Result<Vec<Chunk>, RasterError> {
    let record_bytes = u64::from(header.record_bytes);
    if header.points > (file_bytes - header.points_offset) / record_bytes {
        return Err(too_few());
    }
    let firsts = (0..header.points.div_ceil(PLAIN_POINTS)).map(|index| index * PLAIN_POINTS);
    let chunk = |first: u64| {
        let points = PLAIN_POINTS.min(header.points - first);
        Chunk { offset: header.points_offset + first * record_bytes, bytes: points * record_bytes, points }
    };
    Ok(firsts.map(chunk).collect())
}

/// Reads the table of chunks, whose place is before the first chunk, or at the end of a file that was written in one
/// go.
fn read_table(source: &mut Source, header: &Header, description: &LazVlr) -> Result<Vec<Chunk>, RasterError> {
    if header.points == 0 {
        return Ok(Vec::new());
    }
    let first = header.points_offset + TABLE_OFFSET_BYTES;
    let last_place = source.len().saturating_sub(TABLE_OFFSET_BYTES);
    let place = [header.points_offset, last_place].into_iter().find_map(|offset| {
        let bytes = source.read_at(offset, TABLE_OFFSET_BYTES).ok()?;
        let place = u64::from_le_bytes(*bytes.first_chunk()?);
        (place >= first && place < source.len()).then_some(place)
    });
    let place = place.ok_or_else(|| RasterError::damaged("its table of chunks is missing"))?;
    let counts = source.read_at(place, 8)?;
    let count = counts[4..].first_chunk().copied().map_or(0, u32::from_le_bytes);
    // Each chunk has its first point unpacked.
    if u64::from(count) > (place - first) / u64::from(header.record_bytes) {
        return Err(RasterError::damaged("its table of chunks is too long"));
    }
    source.seek(SeekFrom::Start(place))?;
    let has_counts = description.uses_variable_size_chunks();
    let table = packing::guarded(|| Ok(ChunkTable::read(&mut BufReader::new(source), has_counts)?))?;
    chunks_of(&table, header.points, (!has_counts).then(|| description.chunk_size()), [first, place])
}

/// Chunks of a table that are between two offsets. `fixed` is the number of points of all but the last one.
fn chunks_of(
    table: &ChunkTable,
    points: u64,
    fixed: Option<u32>,
    [mut offset, end]: [u64; 2],
) -> Result<Vec<Chunk>, RasterError> {
    let mut chunks = Vec::with_capacity(table.len());
    let mut left = points;
    for entry in table {
        let points = fixed.map_or(entry.point_count, u64::from).min(left);
        // Numbers that are negative in the file are very large here.
        if entry.byte_count > end - offset {
            return Err(RasterError::damaged("one of its chunks is behind its table of chunks"));
        }
        if points > 0 {
            chunks.push(Chunk::checked(offset, entry.byte_count, points)?);
        }
        offset += entry.byte_count;
        left -= points;
    }
    if left > 0 { Err(too_few()) } else { Ok(chunks) }
}

fn too_few() -> RasterError {
    RasterError::damaged("it has fewer points than its header says")
}
