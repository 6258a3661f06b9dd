//! The tiles that exist, by the names of the files.

use super::super::error::RasterError;
use super::layer::Layer;
use super::template::{NamedTile, Template};
use super::tiling::{MAX_LEVEL, TileId};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// A terrain with more tiles is refused.
const MAX_TILES: usize = 1 << 26;
/// A raster reaches as far as tiles without finer ones, if these are at most this many levels coarser than its pixels.
/// The coarsest tiles have all of the world.
const MAX_COARSER_LEVELS: u8 = 4;
/// Names of bad tiles that are kept.
const MAX_BAD_NAMES: usize = 16;

/// All tiles.
pub(super) struct Pyramid {
    tiles: BTreeMap<TileId, TileFile>,
    templates: Vec<Template>,
    is_tms: bool,
    bad_names: Vec<String>,
    bad_count: usize,
}

/// How a tile's file is named, and whether it was found to be bad.
struct TileFile {
    template: u8,
    is_bad: bool,
}

/// A rectangle of tiles of a level, all of which count whether they exist or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TileRange {
    pub(super) level: u8,
    /// The north-western tile.
    pub(super) first: TileId,
    /// Columns and rows.
    pub(super) size: [u32; 2],
}

impl Pyramid {
    /// Finds the tiles among the names of all files. Fails if there is none, or if there are too many.
    pub(super) fn new(names: &[String], layer: Layer) -> Result<Self, RasterError> {
        let Layer { projection, is_tms, templates } = layer;
        let mut tiles = BTreeMap::new();
        for name in names {
            let found = (0..).zip(&templates).find_map(|(index, template)| Some((index, template.tile(name)?)));
            let Some((template, NamedTile { level, column, row })) = found else { continue };
            let Some(level) = u8::try_from(level).ok().filter(|level| *level <= MAX_LEVEL) else { continue };
            let rows = projection.rows(level);
            if row >= rows || column >= projection.columns(level) {
                continue;
            }
            let row = if is_tms { rows - 1 - row } else { row };
            tiles.entry(TileId { level, row, column }).or_insert(TileFile { template, is_bad: false });
            if tiles.len() > MAX_TILES {
                return Err(RasterError::TooLarge { what: "the number of its tiles", limit: MAX_TILES as u64 });
            }
        }
        if tiles.is_empty() {
            return Err(RasterError::damaged("it has none of the tiles that its layer.json names"));
        }
        Ok(Self { tiles, templates, is_tms, bad_names: Vec::new(), bad_count: 0 })
    }

    /// Tiles of the finest level whose range has no side with more than `max_tiles` tiles. Fails if there is no such
    /// level.
    pub(super) fn finest_range(&self, max_tiles: u32) -> Result<TileRange, RasterError> {
        let ranges = (0..=MAX_LEVEL).rev().filter_map(|level| self.range(level));
        let found = ranges.into_iter().find(|range| range.size.iter().all(|tiles| *tiles <= max_tiles));
        found.ok_or(RasterError::TooLarge { what: "the number of tiles in a row", limit: max_tiles.into() })
    }

    /// The range of a level; `None` if it has no tiles.
    fn range(&self, level: u8) -> Option<TileRange> {
        self.of_level(level).next()?;
        let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
        let mut add = |first: [u32; 2], last: [u32; 2]| {
            low = [0, 1].map(|axis: usize| low[axis].min(first[axis]));
            high = [0, 1].map(|axis: usize| high[axis].max(last[axis]));
        };
        for tile in self.of_level(level) {
            add([tile.column, tile.row], [tile.column, tile.row]);
        }
        for finer in 1..=MAX_COARSER_LEVELS.min(level) {
            let is_finest = |tile: &TileId| !tile.children().any(|child| self.tiles.contains_key(&child));
            for tile in self.of_level(level - finer).filter(is_finest) {
                let first = [tile.column << finer, tile.row << finer];
                add(first, first.map(|number| number + ((1 << finer) - 1)));
            }
        }
        let first = TileId { level, column: low[0], row: low[1] };
        Some(TileRange { level, first, size: [0, 1].map(|axis: usize| high[axis] - low[axis] + 1) })
    }

    /// The tiles of a level by row.
    pub(super) fn of_level(&self, level: u8) -> impl Iterator<Item = TileId> {
        self.tiles.range(tiles_of(level)).map(|(tile, _)| *tile)
    }

    /// The name of a tile's file; `None` if the tile does not exist, or is bad.
    pub(super) fn name(&self, tile: TileId) -> Option<String> {
        let file = self.tiles.get(&tile).filter(|file| !file.is_bad)?;
        let row = if self.is_tms { (1 << tile.level) - 1 - tile.row } else { tile.row };
        let named = NamedTile { level: tile.level.into(), column: tile.column, row };
        self.templates.get(usize::from(file.template)).map(|template| template.name(named))
    }

    /// Leaves out a tile from now on.
    pub(super) fn set_bad(&mut self, tile: TileId, name: String) {
        if let Some(file) = self.tiles.get_mut(&tile).filter(|file| !file.is_bad) {
            file.is_bad = true;
            self.bad_count += 1;
            if self.bad_names.len() < MAX_BAD_NAMES {
                self.bad_names.push(name);
            }
        }
    }

    /// Names of the first tiles that were found to be bad.
    pub(super) fn bad_names(&self) -> &[String] {
        &self.bad_names
    }

    /// Number of the tiles that were found to be bad.
    pub(super) fn bad_count(&self) -> usize {
        self.bad_count
    }
}

fn tiles_of(level: u8) -> RangeInclusive<TileId> {
    TileId { level, row: 0, column: 0 }..=TileId { level, row: u32::MAX, column: u32::MAX }
}
