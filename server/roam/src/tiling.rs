//! Tiles of a grid: aligned squares that are read and drawn one at a time.

use super::diamond::Place;
use super::field::{HeightField, HeightSource, MAX_SIDE};
use super::tile::Tile;

/// How a grid is divided into tiles, and the largest error of its surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tiling {
    /// Number of samples along x and y.
    pub(super) size: [u32; 2],
    /// Steps along the side of a tile, a power of two.
    pub(super) side: u32,
    pub(super) limit_m: f64,
}

impl Tiling {
    /// Tiles with `side` steps, rounded up to a power of two, for a surface within `max_error_m` of all samples. Errors
    /// below zero and those that are not a number count as zero. Columns and rows from 2^28 on are left out.
    pub fn new(size: [u32; 2], side: u32, max_error_m: f32) -> Self {
        let limit_m = if max_error_m > 0.0 { f64::from(max_error_m).min(f64::MAX) } else { 0.0 };
        Self { size: size.map(|n| n.min(MAX_SIDE)), side: side.clamp(2, 1 << 15).next_power_of_two(), limit_m }
    }

    /// Columns and rows of all tiles, row by row.
    pub fn tiles(&self) -> impl Iterator<Item = [u32; 2]> + use<> {
        let [columns, rows] = self.counts();
        (0..rows).flat_map(move |y| (0..columns).map(move |x| [x, y]))
    }

    /// Steps along the side of a tile.
    pub fn side(&self) -> u32 {
        self.side
    }

    /// The places on its borders that a tile alone would halve.
    pub(super) fn survey<S: HeightSource>(&self, source: &S, tile: [u32; 2]) -> Result<Vec<Place>, S::Error> {
        let field = self.read(source, tile)?;
        let mut survey = Tile::new(&field, self.side, self.limit_m);
        survey.halve_upwards();
        Ok(self.border(tile).filter(|place| survey.is_halved(*place)).collect())
    }

    /// Number of tiles along x and y. A single row or column of samples has none.
    fn counts(&self) -> [u32; 2] {
        self.size.map(|n| n.saturating_sub(1).div_ceil(self.side))
    }

    /// Whether there is a tile with this column and row.
    pub(super) fn has_tile(&self, tile: [u32; 2]) -> bool {
        let counts = self.counts();
        (0..2).all(|axis| tile[axis] < counts[axis])
    }

    /// First and last place of a tile, both included.
    pub(super) fn ends(&self, tile: [u32; 2]) -> [Place; 2] {
        let min = tile.map(|n| n * self.side);
        [min, [0, 1].map(|axis| (min[axis] + self.side).min(self.size[axis] - 1))]
    }

    /// The samples of a tile with those on its borders.
    pub(super) fn read<S: HeightSource>(&self, source: &S, tile: [u32; 2]) -> Result<HeightField, S::Error> {
        let [min, max] = self.ends(tile);
        HeightField::from_source(source, min, max)
    }

    /// Places on a tile's borders, but not those at the end of a field that ends inside of a tile.
    pub(super) fn border(&self, tile: [u32; 2]) -> impl Iterator<Item = Place> + use<> {
        let ([min, max], side) = (self.ends(tile), self.side);
        let columns = [min[0], max[0]].into_iter().filter(move |x| x.is_multiple_of(side));
        let rows = [min[1], max[1]].into_iter().filter(move |y| y.is_multiple_of(side));
        let along_columns = columns.flat_map(move |x| (min[1]..=max[1]).map(move |y| [x, y]));
        along_columns.chain(rows.flat_map(move |y| (min[0]..=max[0]).map(move |x| [x, y])))
    }
}
