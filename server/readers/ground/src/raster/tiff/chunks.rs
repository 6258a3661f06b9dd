//! Reads tiles and strips, and visits the numbers of a window.

use super::super::cache::BlockCache;
use super::super::error::RasterError;
use super::super::facts::{RasterLimits, RasterSize, Window};
use super::directory::TiffFile;
use super::layout::{Layout, YCBCR};
use super::{numbers, picture_chunk, unpack};
use std::sync::Arc;

/// A file, the tiles and strips of it that were used last, and bounds of memory.
pub(super) struct Chunks {
    pub(super) file: TiffFile,
    pub(super) limits: RasterLimits,
    cache: BlockCache<u8>,
}

/// One image of a file, with a number that distinguishes it from the others.
pub(super) struct TiffImage {
    pub(super) number: usize,
    pub(super) layout: Layout,
}

impl Chunks {
    pub(super) fn new(file: TiffFile, limits: RasterLimits) -> Self {
        Self { file, limits, cache: BlockCache::new(limits.cache_bytes) }
    }

    /// Calls `visit` with each number of some bands of a window: the index of the band in `bands`, the index of the
    /// pixel in the window, and the number. Tiles that were left out of the file are full of `absent`.
    pub(super) fn visit(
        &mut self,
        image: &TiffImage,
        (bands, window): (&[u16], Window),
        absent: f64,
        mut visit: impl FnMut(usize, usize, f64),
    ) -> Result<(), RasterError> {
        let layout = &image.layout;
        let (chunk, across) = (layout.chunk, u64::from(layout.chunks_across()));
        let rows = window.y / chunk.height..=(window.y + window.height - 1) / chunk.height;
        for chunk_y in rows {
            for chunk_x in window.x / chunk.width..=(window.x + window.width - 1) / chunk.width {
                let part = part(window, chunk, chunk_x, chunk_y);
                for (slot, band) in bands.iter().enumerate() {
                    let plane = if layout.is_planar { u64::from(*band) } else { 0 };
                    let lane = if layout.is_planar { 0 } else { usize::from(*band) };
                    let index = plane * layout.chunks_of_plane() + u64::from(chunk_y) * across + u64::from(chunk_x);
                    let bytes = self.chunk(image, index)?;
                    let lanes = usize::from(layout.lanes());
                    for row in 0..part.rows {
                        let first = (part.chunk_start + row * chunk.width as usize) * lanes + lane;
                        let pixel = part.window_start + row * window.width as usize;
                        for column in 0..part.columns {
                            let number = |bytes: &Arc<Vec<u8>>| layout.sample.number(bytes, first + column * lanes);
                            visit(slot, pixel + column, bytes.as_ref().map_or(absent, number));
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// The little-endian numbers of a tile or strip; `None` if it was left out of the file.
    fn chunk(&mut self, image: &TiffImage, index: u64) -> Result<Option<Arc<Vec<u8>>>, RasterError> {
        if let Some(bytes) = self.cache.get((image.number, index)) {
            return Ok(Some(bytes));
        }
        let Some((offset, count)) = image.layout.place_of_chunk(&mut self.file, index)? else {
            return Ok(None);
        };
        let bytes = Arc::new(self.read(&image.layout, index, (offset, count))?);
        self.cache.put((image.number, index), Arc::clone(&bytes));
        Ok(Some(bytes))
    }

    fn read(&mut self, layout: &Layout, index: u64, (offset, count): (u64, u64)) -> Result<Vec<u8>, RasterError> {
        let (limit, rows) = (self.limits.max_chunk_bytes, u64::from(layout.rows_of_chunk(index)));
        let row_bytes = u64::from(layout.chunk.width) * u64::from(layout.lanes()) * layout.sample.bytes() as u64;
        if row_bytes.saturating_mul(u64::from(layout.chunk.height)) > limit || count > limit {
            return Err(RasterError::TooLarge { what: "the number of bytes of a tile or strip", limit });
        }
        let mut packed = self.file.source.read_at(offset, count)?;
        if layout.has_reversed_bits {
            packed.iter_mut().for_each(|byte| *byte = byte.reverse_bits());
        }
        let is_picture = matches!(layout.compression, unpack::JPEG | unpack::WEBP);
        if is_picture && layout.bits != 8 {
            return Err(RasterError::unsupported(format!("JPEG or WebP with numbers of {} bits", layout.bits)));
        }
        let mut bytes = match layout.compression {
            unpack::JPEG => picture_chunk::jpeg(&packed, &layout.jpeg_tables, layout.chunk, layout.lanes())?,
            unpack::WEBP => picture_chunk::webp(packed, layout.chunk, layout.lanes())?,
            compression => {
                let unpacked = unpack::unpack(compression, packed, (layout.packed_row_bytes() * rows) as usize)?;
                numbers::numbers(layout, self.file.is_big_endian, unpacked)?
            }
        };
        if (bytes.len() as u64) < row_bytes * rows {
            return Err(RasterError::damaged("a tile or strip has too few rows"));
        }
        if layout.photometric == YCBCR {
            picture_chunk::rgb_of_ycbcr(&mut bytes);
        }
        Ok(bytes)
    }
}

/// The pixels that a chunk and a window share.
struct Part {
    /// Index of the first pixel in the chunk.
    chunk_start: usize,
    /// Index of the first pixel in the window.
    window_start: usize,
    columns: usize,
    rows: usize,
}

fn part(window: Window, chunk: RasterSize, chunk_x: u32, chunk_y: u32) -> Part {
    let (left, top) = (chunk_x * chunk.width, chunk_y * chunk.height);
    let (x, y) = (window.x.max(left), window.y.max(top));
    let right = (window.x + window.width).min(left.saturating_add(chunk.width));
    let bottom = (window.y + window.height).min(top.saturating_add(chunk.height));
    Part {
        chunk_start: (y - top) as usize * chunk.width as usize + (x - left) as usize,
        window_start: (y - window.y) as usize * window.width as usize + (x - window.x) as usize,
        columns: (right - x) as usize,
        rows: (bottom - y) as usize,
    }
}
