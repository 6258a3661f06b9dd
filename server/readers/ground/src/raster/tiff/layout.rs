//! How the pixels of one image of a TIFF file are stored.

use super::super::error::RasterError;
use super::super::facts::{RasterSize, SampleKind};
use super::directory::{Directory, Entry, TiffFile};
use super::unpack::{JPEG, NOT_COMPRESSED};

const IMAGE_WIDTH: u16 = 256;
const IMAGE_HEIGHT: u16 = 257;
const BITS_PER_SAMPLE: u16 = 258;
const COMPRESSION: u16 = 259;
const PHOTOMETRIC: u16 = 262;
const FILL_ORDER: u16 = 266;
const STRIP_OFFSETS: u16 = 273;
const SAMPLES_PER_PIXEL: u16 = 277;
const ROWS_PER_STRIP: u16 = 278;
const STRIP_BYTE_COUNTS: u16 = 279;
const PLANAR: u16 = 284;
const PREDICTOR: u16 = 317;
const COLOUR_MAP: u16 = 320;
const TILE_WIDTH: u16 = 322;
const TILE_HEIGHT: u16 = 323;
const TILE_OFFSETS: u16 = 324;
const TILE_BYTE_COUNTS: u16 = 325;
const EXTRA_SAMPLES: u16 = 338;
const SAMPLE_FORMAT: u16 = 339;
const JPEG_TABLES: u16 = 347;
const CHROMA_SUBSAMPLING: u16 = 530;

const BLACK_IS_ZERO: u64 = 1;
/// Numbers of [`Layout::photometric`] that stand for colours of a list.
pub(super) const PALETTE: u64 = 3;
pub(super) const YCBCR: u64 = 6;
/// An image in one strip without compression is read in pieces of about this size.
const PIECE_BYTES: u64 = 1 << 20;
/// Pixels that an image may have for each byte of the file if its tiles or strips lie upon each other.
const SHARED_PIXELS_PER_BYTE: u64 = 16;
/// Such an image may have as many in any case.
const SHARED_PIXELS: u64 = 1 << 26;
/// Offsets and sizes of tiles that are compared at once.
const PLACES_AT_ONCE: usize = 1 << 16;

/// How the pixels of one image are stored: in chunks, which are tiles or strips.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) size: RasterSize,
    /// Numbers of each pixel.
    pub(super) bands: u16,
    pub(super) sample: SampleKind,
    /// Bits of each number in the file.
    pub(super) bits: u16,
    /// What the numbers mean: grey, red-green-blue, palette.
    pub(super) photometric: u64,
    /// Meanings of the numbers after the colours: 1 and 2 are alpha.
    pub(super) extra_samples: Vec<u64>,
    pub(super) colour_map: Vec<u64>,
    pub(super) compression: u64,
    pub(super) predictor: u64,
    pub(super) has_reversed_bits: bool,
    pub(super) jpeg_tables: Vec<u8>,
    /// Each band has its own chunks.
    pub(super) is_planar: bool,
    is_tiled: bool,
    pub(super) chunk: RasterSize,
    offsets: Entry,
    byte_counts: Option<Entry>,
    /// The image is one strip that is read in pieces.
    is_in_pieces: bool,
}

impl Layout {
    pub(super) fn read(file: &mut TiffFile, directory: &Directory) -> Result<Self, RasterError> {
        let mut number = |tag, default: u64| Ok::<_, RasterError>(file.integer(directory, tag)?.unwrap_or(default));
        let size = size(number(IMAGE_WIDTH, 0)?, number(IMAGE_HEIGHT, 0)?)?;
        let bands = number(SAMPLES_PER_PIXEL, 1)?;
        let bands = u16::try_from(bands).ok().filter(|bands| *bands > 0);
        let bands = bands.ok_or_else(|| RasterError::damaged("it has no numbers in its pixels"))?;
        let is_tiled = directory.entry(TILE_OFFSETS).is_some();
        let chunk = if is_tiled {
            self::size(number(TILE_WIDTH, 0)?, number(TILE_HEIGHT, 0)?)?
        } else {
            let rows = number(ROWS_PER_STRIP, u64::from(size.height))?.min(u64::from(size.height));
            self::size(u64::from(size.width), rows)?
        };
        let (compression, predictor) = (number(COMPRESSION, NOT_COMPRESSED)?, number(PREDICTOR, 1)?);
        let (photometric, planar) = (number(PHOTOMETRIC, 1)?, number(PLANAR, 1)?);
        let has_reversed_bits = number(FILL_ORDER, 1)? == 2;
        let bits = same(&file.integers(directory, BITS_PER_SAMPLE)?, 1)?;
        let format = same(&file.integers(directory, SAMPLE_FORMAT)?, 1)?;
        let sample = SampleKind::of_tiff(format, bits)?;
        let offsets = directory.entry(if is_tiled { TILE_OFFSETS } else { STRIP_OFFSETS });
        let offsets = offsets.ok_or_else(|| RasterError::damaged("it has no pixels"))?;
        let colour_map = file.integers(directory, COLOUR_MAP)?;
        // Writers that add the list of colours later leave the image grey.
        let is_palette = photometric == BLACK_IS_ZERO && bands == 1 && !colour_map.is_empty();
        let photometric = if is_palette { PALETTE } else { photometric };
        let mut layout = Self {
            size,
            bands,
            sample,
            bits: bits as u16,
            photometric,
            extra_samples: file.integers(directory, EXTRA_SAMPLES)?,
            colour_map,
            compression,
            predictor,
            has_reversed_bits,
            jpeg_tables: file.bytes(directory, JPEG_TABLES)?,
            is_planar: planar == 2 && bands > 1,
            is_tiled,
            chunk,
            offsets,
            byte_counts: directory.entry(if is_tiled { TILE_BYTE_COUNTS } else { STRIP_BYTE_COUNTS }),
            is_in_pieces: false,
        };
        if compression == NOT_COMPRESSED && predictor == 1 && !is_tiled && chunk.height == size.height {
            layout.is_in_pieces = true;
            let rows = (PIECE_BYTES / layout.packed_row_bytes()).clamp(1, u64::from(size.height));
            layout.chunk.height = rows as u32;
        }
        if photometric == YCBCR {
            // JPEG has its own subsampling.
            let subsampling = file.integers(directory, CHROMA_SUBSAMPLING)?;
            let is_plain = compression == JPEG || subsampling == [1, 1];
            if !is_plain || layout.lanes() != 3 || sample != SampleKind::U8 || layout.bits != 8 {
                return Err(RasterError::unsupported("YCbCr colours other than those of JPEG"));
            }
        }
        let chunks = if layout.is_in_pieces { 1 } else { layout.chunks_of_plane() };
        let planes = if layout.is_planar { u64::from(bands) } else { 1 };
        if layout.offsets.count < chunks.saturating_mul(planes) {
            return Err(RasterError::damaged("it has too few tiles or strips"));
        }
        if !layout.is_in_pieces {
            layout.check_shared(file, chunks.saturating_mul(planes))?;
        }
        Ok(layout)
    }

    /// Refuses small files of many pixels: tiles or strips at the same place take time each, and bytes once. They are together
    /// longer than the file. Those that were left out count for nothing.
    fn check_shared(&self, file: &mut TiffFile, chunks: u64) -> Result<(), RasterError> {
        let (len, chunk_pixels) = (file.source.len(), self.chunk.pixels());
        let limit = len.saturating_mul(SHARED_PIXELS_PER_BYTE).max(SHARED_PIXELS);
        if chunks.saturating_mul(chunk_pixels) <= limit {
            return Ok(());
        }
        let unpacked = self.packed_row_bytes().saturating_mul(u64::from(self.chunk.height));
        let (mut pixels, mut bytes) = (0_u64, 0_u64);
        for first in (0..chunks).step_by(PLACES_AT_ONCE) {
            let places = first..chunks.min(first + PLACES_AT_ONCE as u64);
            let offsets = file.integers_of(self.offsets, places.clone())?;
            let counts = match self.byte_counts {
                Some(counts) => file.integers_of(counts, places)?,
                None => vec![unpacked; offsets.len()],
            };
            for (_, count) in offsets.into_iter().zip(counts).filter(|(offset, count)| *offset > 0 && *count > 0) {
                pixels = pixels.saturating_add(chunk_pixels);
                bytes = bytes.saturating_add(count);
            }
        }
        if bytes > len && pixels > limit {
            let what = "the number of pixels of an image whose tiles or strips share places in the file";
            return Err(RasterError::TooLarge { what, limit });
        }
        Ok(())
    }

    /// Numbers of a pixel in one chunk.
    pub(super) fn lanes(&self) -> u16 {
        if self.is_planar { 1 } else { self.bands }
    }

    pub(super) fn chunks_across(&self) -> u32 {
        self.size.width.div_ceil(self.chunk.width)
    }

    /// Chunks that cover the image once.
    pub(super) fn chunks_of_plane(&self) -> u64 {
        u64::from(self.chunks_across()) * u64::from(self.size.height.div_ceil(self.chunk.height))
    }

    /// Rows that are stored in a chunk: strips at the bottom have fewer, tiles all.
    pub(super) fn rows_of_chunk(&self, index: u64) -> u32 {
        let first = (index % self.chunks_of_plane()) / u64::from(self.chunks_across()) * u64::from(self.chunk.height);
        let left = u64::from(self.size.height).saturating_sub(first);
        if self.is_tiled { self.chunk.height } else { u64::from(self.chunk.height).min(left) as u32 }
    }

    /// Bytes of a row of a chunk before its bits become whole numbers.
    pub(super) fn packed_row_bytes(&self) -> u64 {
        (u64::from(self.chunk.width) * u64::from(self.lanes()) * u64::from(self.bits)).div_ceil(8)
    }

    /// Offset and bytes of a chunk in the file; `None` if it was left out because nothing is in it.
    pub(super) fn place_of_chunk(&self, file: &mut TiffFile, index: u64) -> Result<Option<(u64, u64)>, RasterError> {
        let unpacked = self.packed_row_bytes().saturating_mul(u64::from(self.rows_of_chunk(index)));
        if self.is_in_pieces {
            let (strip, piece) = (index / self.chunks_of_plane(), index % self.chunks_of_plane());
            let skipped = (piece * u64::from(self.chunk.height)).saturating_mul(self.packed_row_bytes());
            let start = file.integer_of(self.offsets, strip)?;
            return Ok((start > 0).then_some((start.saturating_add(skipped), unpacked)));
        }
        let offset = file.integer_of(self.offsets, index)?;
        let bytes = match self.byte_counts {
            Some(counts) => file.integer_of(counts, index)?,
            None if self.compression == NOT_COMPRESSED => unpacked,
            None => return Err(RasterError::damaged("it does not tell the size of its tiles or strips")),
        };
        Ok((offset > 0 && bytes > 0).then_some((offset, bytes)))
    }
}

fn size(width: u64, height: u64) -> Result<RasterSize, RasterError> {
    let valid = |length: u64| u32::try_from(length).ok().filter(|length| (1..=1 << 30).contains(length));
    match (valid(width), valid(height)) {
        (Some(width), Some(height)) => Ok(RasterSize { width, height }),
        _ => Err(RasterError::damaged("it has an invalid width or height")),
    }
}

/// The value of all bands; they must be equal.
fn same(values: &[u64], default: u64) -> Result<u64, RasterError> {
    let value = values.first().copied().unwrap_or(default);
    let are_same = values.iter().all(|other| *other == value);
    if are_same { Ok(value) } else { Err(RasterError::unsupported("bands of different types")) }
}

impl SampleKind {
    fn of_tiff(format: u64, bits: u64) -> Result<Self, RasterError> {
        match (format, bits) {
            (1 | 4, 1..=8) => Ok(Self::U8),
            (1 | 4, 9..=16) => Ok(Self::U16),
            (1 | 4, 17..=32) => Ok(Self::U32),
            (1 | 4, 64) => Ok(Self::U64),
            (2, 8) => Ok(Self::I8),
            (2, 16) => Ok(Self::I16),
            (2, 32) => Ok(Self::I32),
            (2, 64) => Ok(Self::I64),
            (3, 16) => Ok(Self::F16),
            (3, 32) => Ok(Self::F32),
            (3, 64) => Ok(Self::F64),
            (5 | 6, _) => Err(RasterError::unsupported("complex numbers")),
            _ => Err(RasterError::unsupported(format!("numbers of {bits} bits of format {format}"))),
        }
    }
}
