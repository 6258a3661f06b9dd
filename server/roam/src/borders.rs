//! How the borders of tiles are divided, so that neighbours share all vertices on their border.
//!
//! A tile must halve its own triangles where its neighbour halves the same diamond on their border, and that can force
//! further halving up to another border. So before any tile is drawn, each tile is surveyed once. A survey halves every
//! diamond in which a triangle of any size is too far from a sample, which is a superset of what the tile will need.
//! The union over all tiles, closed under forced halving, is therefore final on the borders: whatever a tile then does
//! inside changes no border. Only the borders are kept in memory, a byte for each sample on them.

use super::diamond::{Diamond, Place};
use super::field::{HeightField, HeightSource};
use super::tile::Tile;
use super::tiling::Tiling;
use std::collections::HashSet;

/// Which diamonds on the borders between tiles are halved.
#[derive(Debug, Clone)]
pub struct Borders {
    tiling: Tiling,
    /// For each row between tiles, whether the diamond at each sample is halved.
    rows: Vec<Vec<bool>>,
    /// The same for each column between tiles.
    columns: Vec<Vec<bool>>,
}

impl Borders {
    /// Surveys all tiles of a source, one after the other.
    pub fn survey<S: HeightSource>(source: &S, side: u32, max_error_m: f32) -> Result<Self, S::Error> {
        let tiling = Tiling::new(source.size(), side, max_error_m);
        let mut borders = Self::new(tiling);
        for tile in tiling.tiles() {
            for place in tiling.survey(source, tile)? {
                borders.set(place);
            }
        }
        borders.close();
        Ok(borders)
    }

    /// The tiles.
    pub fn tiling(&self) -> &Tiling {
        &self.tiling
    }

    /// A tile whose halved diamonds are those on its borders.
    pub(super) fn start<'a>(&self, field: &'a HeightField, tile: [u32; 2]) -> Tile<'a> {
        let mut started = Tile::new(field, self.tiling.side, self.tiling.limit_m);
        self.tiling.border(tile).filter(|place| self.is_halved(*place)).for_each(|place| started.set_halved(place));
        started
    }

    fn new(tiling: Tiling) -> Self {
        let Tiling { size, side, .. } = tiling;
        let lines = |axis: usize| vec![vec![false; size[1 - axis] as usize]; size[axis].div_ceil(side) as usize];
        Self { tiling, rows: lines(1), columns: lines(0) }
    }

    fn is_halved(&self, [x, y]: Place) -> bool {
        match x.is_multiple_of(self.tiling.side) {
            true => self.columns[(x / self.tiling.side) as usize][y as usize],
            false => self.rows[(y / self.tiling.side) as usize][x as usize],
        }
    }

    /// Halves a diamond on a border; whether it was not before. Those inside of tiles are not kept.
    fn set(&mut self, [x, y]: Place) -> bool {
        let side = self.tiling.side;
        let slot = if x.is_multiple_of(side) {
            self.columns.get_mut((x / side) as usize).and_then(|column| column.get_mut(y as usize))
        } else if y.is_multiple_of(side) {
            self.rows.get_mut((y / side) as usize).and_then(|row| row.get_mut(x as usize))
        } else {
            None
        };
        slot.is_some_and(|is_halved| !std::mem::replace(is_halved, true))
    }

    /// Halves the diamonds without which those on borders leave vertices inside of edges.
    fn close(&mut self) {
        let mut has_changed = true;
        while has_changed {
            has_changed = false;
            for tile in self.tiling.tiles() {
                has_changed |= self.close_tile(tile);
            }
        }
    }

    /// The same through the inside of one tile; whether a border has changed.
    fn close_tile(&mut self, tile: [u32; 2]) -> bool {
        let [min, max] = self.tiling.ends(tile);
        let is_inside = |p: &Place| (0..2).all(|axis| (min[axis]..=max[axis]).contains(&p[axis]));
        let mut waiting: Vec<Place> = self.tiling.border(tile).filter(|place| self.is_halved(*place)).collect();
        let mut seen = HashSet::new();
        let mut has_changed = false;
        while let Some(place) = waiting.pop() {
            let apexes = Diamond::at(place, self.tiling.side).into_iter().flat_map(|diamond| diamond.apexes);
            for apex in apexes.flatten().filter(is_inside) {
                if seen.insert(apex) {
                    has_changed |= self.set(apex);
                    waiting.push(apex);
                }
            }
        }
        has_changed
    }
}
