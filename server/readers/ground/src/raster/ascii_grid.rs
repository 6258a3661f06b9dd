//! ESRI ASCII grids: a header of words, then heights as text from the top row to the bottom row.

use super::cache::BlockCache;
use super::error::RasterError;
use super::facts::{RasterFacts, RasterLimits, RasterSize, SampleKind, Window};
use super::place::GeoPlace;
use super::source::Source;
use super::words::{Words, number_of};
use std::sync::Arc;

/// The mark of missing heights of files that do not tell it, by Esri's definition of the format.
const DEFAULT_NODATA: f64 = -9999.0;
const MAX_SIDE: f64 = (1 << 30) as f64;
/// Heights are read and kept in blocks of rows with about this many.
const BLOCK_HEIGHTS: u32 = 1 << 18;

/// A grid, and where its blocks of rows are in the file.
pub(super) struct AsciiGrid {
    source: Source,
    size: RasterSize,
    nodata: f64,
    /// The mark of missing heights that the user gives.
    pub(super) nodata_by_hand: Option<f64>,
    rows_of_block: u32,
    /// Offset of the first height of each block.
    blocks: Vec<u64>,
    cache: BlockCache<f32>,
}

/// Words of the header with their numbers.
#[derive(Default)]
struct Header {
    columns: f64,
    rows: f64,
    /// Of the left, lower corner, or of the centre of the cell there; `None` if the header does not tell.
    x: Option<f64>,
    y: Option<f64>,
    /// From there to the centre of the cell, in cells.
    to_centre: [f64; 2],
    width: f64,
    height: f64,
    nodata: Option<f64>,
}

pub(super) fn is_ascii_grid(start: &[u8]) -> bool {
    let start = start.trim_ascii_start();
    start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"ncols") || word.eq_ignore_ascii_case(b"nrows"))
}

impl AsciiGrid {
    /// Reads the whole file once to find its rows.
    pub(super) fn open(mut source: Source, limits: RasterLimits) -> Result<(Self, RasterFacts), RasterError> {
        let mut words = Words::new(&mut source, 0);
        let (header, first) = Header::read(&mut words)?;
        let size = header.size()?;
        let too_few = || RasterError::damaged("it has fewer heights than its header says");
        // Each height has a digit and a space at least.
        if size.pixels() > words.file_len() {
            return Err(too_few());
        }
        if u64::from(size.width) * 4 > limits.max_chunk_bytes {
            return Err(RasterError::TooLarge { what: "the number of columns", limit: limits.max_chunk_bytes / 4 });
        }
        let rows_of_block = (BLOCK_HEIGHTS / size.width).clamp(1, size.height);
        let block_len = u64::from(rows_of_block) * u64::from(size.width);
        let (mut offset, mut blocks) = (first, Vec::new());
        for index in 0..size.pixels() {
            if index > 0 {
                offset = words.next()?.ok_or_else(too_few)?.0;
            }
            if index % block_len == 0 {
                blocks.push(offset);
            }
        }
        // Rows of another length would be read askew.
        if words.next()?.is_some_and(|(_, word)| number_of(word).is_some()) {
            return Err(RasterError::damaged("it has more heights than its header says"));
        }
        let mut facts = RasterFacts::new(size, SampleKind::F32);
        facts.place = header.place();
        let nodata = SampleKind::F32.rounded(header.nodata.unwrap_or(DEFAULT_NODATA));
        facts.nodata = Some(nodata);
        let cache = BlockCache::new(limits.cache_bytes);
        Ok((Self { source, size, nodata, nodata_by_hand: None, rows_of_block, blocks, cache }, facts))
    }

    pub(super) fn read_heights(&mut self, window: Window, len: usize) -> Result<Vec<f32>, RasterError> {
        let mut heights = Vec::with_capacity(len);
        for row in window.y..window.y + window.height {
            let block = self.block(row / self.rows_of_block)?;
            let first = (row % self.rows_of_block) as usize * self.size.width as usize + window.x as usize;
            heights.extend_from_slice(&block[first..first + window.width as usize]);
        }
        Ok(heights)
    }

    /// Heights of a block of rows.
    fn block(&mut self, index: u32) -> Result<Arc<Vec<f32>>, RasterError> {
        let key = (0, u64::from(index));
        if let Some(block) = self.cache.get(key) {
            return Ok(block);
        }
        let damaged = || RasterError::damaged("one of its heights is not a number");
        let rows = self.rows_of_block.min(self.size.height - index * self.rows_of_block);
        let mut words = Words::new(&mut self.source, self.blocks[index as usize]);
        let mut heights = Vec::new();
        for _ in 0..u64::from(rows) * u64::from(self.size.width) {
            let (_, word) = words.next()?.ok_or_else(damaged)?;
            let height = number_of(word).ok_or_else(damaged)? as f32;
            let marks = [Some(self.nodata), self.nodata_by_hand];
            let is_mark = |mark: f64| SampleKind::F32.is_mark(f64::from(height), mark);
            let is_missing = !height.is_finite() || marks.into_iter().flatten().any(is_mark);
            heights.push(if is_missing { f32::NAN } else { height });
        }
        let block = Arc::new(heights);
        self.cache.put(key, Arc::clone(&block));
        Ok(block)
    }
}

impl Header {
    /// Reads the header. Returns the offset of the first height too.
    fn read(words: &mut Words<'_>) -> Result<(Self, u64), RasterError> {
        let mut header = Self::default();
        let ends_early = || RasterError::damaged("its header ends early");
        loop {
            let (offset, word) = words.next()?.ok_or_else(ends_early)?;
            let name = word.to_ascii_lowercase();
            let is_name = name.starts_with(|first: char| first.is_ascii_alphabetic()) && number_of(&name).is_none();
            if !is_name {
                return Ok((header, offset));
            }
            let (_, word) = words.next()?.ok_or_else(ends_early)?;
            let number = number_of(word).ok_or_else(|| RasterError::damaged(format!("{name} is not a number")))?;
            match &name[..] {
                "ncols" => header.columns = number,
                "nrows" => header.rows = number,
                "xllcorner" => (header.x, header.to_centre[0]) = (Some(number), 0.5),
                "yllcorner" => (header.y, header.to_centre[1]) = (Some(number), 0.5),
                "xllcenter" => (header.x, header.to_centre[0]) = (Some(number), 0.0),
                "yllcenter" => (header.y, header.to_centre[1]) = (Some(number), 0.0),
                "cellsize" => (header.width, header.height) = (number, number),
                "dx" => header.width = number,
                "dy" => header.height = number,
                "nodata_value" | "nodata" => header.nodata = Some(number),
                _ => return Err(RasterError::damaged("its header has an unknown word")),
            }
        }
    }

    fn size(&self) -> Result<RasterSize, RasterError> {
        let is_valid = |number: f64| (1.0..=MAX_SIDE).contains(&number) && number.fract() == 0.0;
        if !is_valid(self.columns) || !is_valid(self.rows) {
            return Err(RasterError::damaged("its number of columns or rows is invalid"));
        }
        Ok(RasterSize { width: self.columns as u32, height: self.rows as u32 })
    }

    fn place(&self) -> Option<GeoPlace> {
        let [right, up] = self.to_centre;
        let origin = [self.x? + right * self.width, self.y? + (self.rows - 1.0 + up) * self.height];
        GeoPlace::checked(origin, [self.width, 0.0], [0.0, -self.height])
            .filter(|_| self.width > 0.0 && self.height > 0.0)
    }
}
