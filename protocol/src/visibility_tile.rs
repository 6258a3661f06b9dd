//! Visibility tiles: which leaves can be seen from the streets of a part of a city.
//!
//! A tile is about the cells of one node, [`BLOCK_LEVELS`] above the leaves, and those around it, so that the cells around any eye
//! are in one tile. A cell is the space above a leaf up to the top of the highest layer. For each leaf within the tile's reach of a
//! cell, it says from which layer on the leaf may be seen. `insula-visibility` computes the sets.

use crate::codec::byte_reader::ByteReader;
use crate::codec::range::{BitCoder, BitModel, NumberModel, RangeDecoder, RangeEncoder};
use crate::error::{DecodeError, check_limit, invalid_if};
use crate::tile::{MAX_SECTION_BYTES, TileReader, TileWriter};
use crate::tile_id::MAX_LEVEL;
use crate::{TileId, TileKind};

const VERSION: u8 = 1;
/// Layers of eyes, by their height above the ground.
pub const LAYERS: usize = 3;
/// What a cell's set has for a leaf that no layer sees.
pub const UNSEEN: u8 = LAYERS as u8;
/// Levels between the leaves and the nodes that have visibility tiles.
pub const BLOCK_LEVELS: u8 = 3;
/// Scales of a set. The first is about leaves; the squares of each next one are four times as wide.
pub const SCALES: u8 = 3;
/// Levels of the quadtree between two scales.
pub const SCALE_LEVELS: u8 = 2;
/// Largest reach in squares.
pub const MAX_REACH: u8 = 16;
/// Maximum size of a tile in bytes: its values, uncompressed, and a header.
pub const MAX_BYTES: usize = 384 << 10;

const TAG_META: u8 = 1;
const TAG_SETS: u8 = 2;
const META_BYTES: usize = 3 + 2 * LAYERS;

/// What can be seen from one cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VisibleCell {
    /// Height of the cell's highest ground above the city's origin, in half metres, rounded up.
    pub ground: i16,
    /// For each scale, and for each square from `reach` to the south-west of the cell's square to `reach` to the north-east, row by
    /// row, the lowest layer that may see anything in it, or [`UNSEEN`].
    pub seen: Vec<u8>,
}

/// The sets of the cells of a node and of those around it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VisibilityTile {
    /// The node: [`block_of_leaf`] of its leaves.
    pub id: TileId,
    /// Level of the leaves.
    pub depth: u8,
    /// Sets are about this many squares of each scale on each side of a cell's.
    pub reach: u8,
    /// Top of each layer above a cell's ground in decimetres, ascending.
    pub layers_dm: [u16; LAYERS],
    /// Row by row from the leaf to the south-west of the node; `None` for leaves that do not exist.
    pub cells: Vec<Option<VisibleCell>>,
}

/// The node whose tile has the cell of a leaf of a city with `depth` levels.
pub fn block_of_leaf(leaf: TileId) -> TileId {
    leaf.ancestor(leaf.level().saturating_sub(BLOCK_LEVELS)).unwrap_or(leaf)
}

/// The set of one cell as seen by eyes of one layer.
#[derive(Debug, Clone, Copy)]
pub struct VisibleSet<'a> {
    cell: &'a VisibleCell,
    leaf: TileId,
    reach: u8,
    layer: u8,
}

impl VisibleSet<'_> {
    /// Whether an eye of the cell may see anything of a node. Nodes that do not lie within the reach are potentially visible.
    pub fn may_see(&self, node: TileId) -> bool {
        let (depth, reach) = (self.leaf.level(), i64::from(self.reach));
        if node.level() > depth {
            return true;
        }
        let levels = depth - node.level();
        let side = 2 * reach + 1;
        let is_seen = |i: i64| self.cell.seen.get(i as usize).is_none_or(|layer| *layer <= self.layer);
        for scale in 0..SCALES {
            let scale_levels = SCALE_LEVELS * scale;
            // Squares of this scale that the node covers, or the one that contains it.
            let range = |node: u32, leaf: u32| {
                let (finer, coarser) = (levels.saturating_sub(scale_levels), scale_levels.saturating_sub(levels));
                let first = (i64::from(node) << finer >> coarser) - (i64::from(leaf) >> scale_levels) + reach;
                (first, first + (1 << finer))
            };
            let (columns, rows) = (range(node.x(), self.leaf.x()), range(node.y(), self.leaf.y()));
            if columns.0 >= 0 && rows.0 >= 0 && columns.1 <= side && rows.1 <= side {
                let first = i64::from(scale) * side * side;
                return (rows.0..rows.1)
                    .any(|row| (columns.0..columns.1).any(|column| is_seen(first + row * side + column)));
            }
        }
        true
    }
}

impl VisibilityTile {
    /// Leaves along the node's side.
    fn side(&self) -> u32 {
        1 << (self.depth - self.id.level())
    }

    fn cells_across(&self) -> usize {
        self.side() as usize + 2
    }

    /// South-western leaf of the tile's cells; it may lie outside of the city.
    fn corner(&self) -> [i64; 2] {
        [self.id.x(), self.id.y()].map(|v| i64::from(v) * i64::from(self.side()) - 1)
    }

    /// The position of a leaf's cell among [`Self::cells`], if it is one of the tile's.
    pub fn cell_index(&self, x: u32, y: u32) -> Option<usize> {
        let (corner, across) = (self.corner(), self.cells_across() as i64);
        let [column, row] = [i64::from(x) - corner[0], i64::from(y) - corner[1]];
        let is_inside = (0..across).contains(&column) && (0..across).contains(&row);
        is_inside.then_some((row * across + column) as usize)
    }

    /// What an eye above leaf `x`, `y` may see, at `z_m` metres above the city's origin. `None` if it is in no cell of the tile.
    pub fn set_at(&self, x: u32, y: u32, z_m: f64) -> Option<VisibleSet<'_>> {
        let cell = self.cells.get(self.cell_index(x, y)?)?.as_ref()?;
        let above_m = z_m - f64::from(cell.ground) / 2.0;
        let layer = self.layers_dm.iter().position(|top_dm| above_m <= f64::from(*top_dm) / 10.0)?;
        let leaf = TileId::new(self.depth, x, y)?;
        Some(VisibleSet { cell, leaf, reach: self.reach, layer: layer as u8 })
    }

    /// Fails if a rule of the format is broken.
    fn check(&self) -> Result<(), DecodeError> {
        let is_block = self.depth <= MAX_LEVEL && self.id.level() == self.depth.saturating_sub(BLOCK_LEVELS);
        invalid_if(!is_block || !self.layers_dm.is_sorted(), "a visibility tile's level or layers are wrong")?;
        check_limit("the reach of a visibility tile", usize::from(self.reach), usize::from(MAX_REACH))
    }

    /// The tile's bytes. Fails if a rule of the format is broken.
    pub fn encode(&self) -> Result<Vec<u8>, DecodeError> {
        self.check()?;
        let values = usize::from(SCALES) * (2 * usize::from(self.reach) + 1).pow(2);
        let is_wrong = |cell: &VisibleCell| cell.seen.len() != values || cell.seen.iter().any(|v| *v > UNSEEN);
        if self.cells.len() != self.cells_across().pow(2) || self.cells.iter().flatten().any(is_wrong) {
            return Err(DecodeError::Invalid("a visibility tile's cells are wrong"));
        }
        let mut writer = TileWriter::new(TileKind::Visibility, Some(self.id));
        let mut meta = vec![VERSION, self.depth, self.reach];
        self.layers_dm.iter().for_each(|top| meta.extend_from_slice(&top.to_le_bytes()));
        writer.add_raw_section(TAG_META, &meta)?;
        let mut coder = RangeEncoder::default();
        code(&mut coder, &mut self.clone())?;
        writer.add_raw_section(TAG_SETS, &coder.finish())?;
        writer.finish()
    }

    /// Decodes the tile of node `id`. Fails on any bytes that are not that tile.
    pub fn decode(id: TileId, bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, TileKind::Visibility)?;
        invalid_if(tile.id != Some(id), "the visibility tile is of another node")?;
        let meta = tile.section(TAG_META, META_BYTES)?;
        let mut reader = ByteReader::new(&meta);
        let found = reader.u8()?;
        if found != VERSION {
            return Err(DecodeError::Version { found: found.into(), known: VERSION.into() });
        }
        let (depth, reach) = (reader.u8()?, reader.u8()?);
        let layers_dm = [reader.u16()?, reader.u16()?, reader.u16()?];
        reader.finish()?;
        let mut tile_of_sets = Self { id, depth, reach, layers_dm, cells: Vec::new() };
        tile_of_sets.check()?;
        tile_of_sets.cells = vec![None; tile_of_sets.cells_across().pow(2)];
        let sets = tile.section(TAG_SETS, MAX_SECTION_BYTES as usize)?;
        let mut coder = RangeDecoder::new(&sets);
        code(&mut coder, &mut tile_of_sets)?;
        match coder.unread_bytes() {
            0 => Ok(tile_of_sets),
            rest => Err(DecodeError::TrailingBytes(rest)),
        }
    }
}

/// Context of a value that is not known.
const UNKNOWN: usize = LAYERS + 1;
const CONTEXTS: usize = (UNKNOWN + 1) * (UNKNOWN + 1) * (UNKNOWN + 1);

/// Writes or reads all cells. Fails on a height that is out of range.
fn code<C: BitCoder>(coder: &mut C, tile: &mut VisibilityTile) -> Result<(), DecodeError> {
    let across = tile.cells_across();
    let mut exists = [BitModel::NEW; 3];
    let mut ground = NumberModel::default();
    let mut models = vec![[BitModel::NEW; LAYERS]; CONTEXTS * usize::from(SCALES)];
    let mut last_ground = 0i32;
    for i in 0..across * across {
        let known = |i: Option<usize>| i.is_some_and(|i| tile.cells[i].is_some());
        let west = (i % across > 0).then(|| i - 1);
        let south = i.checked_sub(across);
        let model = usize::from(known(west)) + usize::from(known(south));
        if !coder.bit(&mut exists[model], tile.cells[i].is_some()) {
            tile.cells[i] = None;
            continue;
        }
        let mut cell = tile.cells[i].take().unwrap_or(VisibleCell { ground: 0, seen: Vec::new() });
        last_ground += coder.number(&mut ground, i32::from(cell.ground).wrapping_sub(last_ground));
        cell.ground =
            i16::try_from(last_ground).map_err(|_| DecodeError::Invalid("a cell's ground is out of range"))?;
        let neighbour = |i: Option<usize>| i.and_then(|i| tile.cells[i].as_ref());
        let place = tile.corner().map(|v| v as i32);
        let place = [place[0] + (i % across) as i32, place[1] + (i / across) as i32];
        cell.seen.resize(usize::from(SCALES) * (2 * usize::from(tile.reach) + 1).pow(2), UNSEEN);
        for scale in 0..SCALES {
            let models = &mut models[usize::from(scale) * CONTEXTS..][..CONTEXTS];
            code_scale(coder, &mut cell, [neighbour(west), neighbour(south)], place, [scale, tile.reach], models);
        }
        tile.cells[i] = Some(cell);
    }
    Ok(())
}

/// Writes or reads one scale of the set of the cell at leaf `x`, `y`. The cells to the west and to the south see nearly the same.
fn code_scale<C: BitCoder>(
    coder: &mut C,
    cell: &mut VisibleCell,
    [west, south]: [Option<&VisibleCell>; 2],
    [x, y]: [i32; 2],
    [scale, reach]: [u8; 2],
    models: &mut [[BitModel; LAYERS]],
) {
    let side = 2 * usize::from(reach) + 1;
    let first = usize::from(scale) * side * side;
    // The same square lies as much further in a neighbour's set as the square of its cell lies before.
    let step = |v: i32| ((v >> (SCALE_LEVELS * scale)) - ((v - 1) >> (SCALE_LEVELS * scale))) as usize;
    let (to_east, to_north) = (step(x), step(y));
    for i in 0..side * side {
        let (column, row) = (i % side, i / side);
        let known = |cell: Option<&VisibleCell>, column: usize, row: usize| {
            let cell = cell.filter(|_| column < side && row < side);
            cell.map_or(UNKNOWN, |cell| usize::from(cell.seen[first + row * side + column]))
        };
        let (of_west, of_south) = (known(west, column + to_east, row), known(south, column, row + to_north));
        let left = if column > 0 { usize::from(cell.seen[first + i - 1]) } else { UNKNOWN };
        let below = if row > 0 { usize::from(cell.seen[first + i - side]) } else { UNKNOWN };
        let context = (of_west * (UNKNOWN + 1) + of_south) * (UNKNOWN + 1) + left.min(below);
        let value = cell.seen[first + i];
        let found = (0..UNSEEN).find(|layer| coder.bit(&mut models[context][usize::from(*layer)], value == *layer));
        cell.seen[first + i] = found.unwrap_or(UNSEEN);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> VisibilityTile {
        let id = TileId::new(2, 1, 3).unwrap();
        let cell = |i: usize| VisibleCell {
            ground: 40 + (i / 10) as i16,
            seen: (0..75).map(|k| ((k * k + i / 3) % 4) as u8).collect(),
        };
        let cells = (0..100).map(|i| (i % 7 != 3).then(|| cell(i))).collect();
        VisibilityTile { id, depth: 5, reach: 2, layers_dm: [30, 80, 200], cells }
    }

    #[test]
    fn tiles_round_trip_and_damaged_ones_are_refused() {
        let tile = sample();
        let bytes = tile.encode().unwrap();
        assert_eq!(VisibilityTile::decode(tile.id, &bytes).unwrap(), tile);
        assert!(VisibilityTile::decode(TileId::new(2, 1, 2).unwrap(), &bytes).is_err());
        assert!((0..bytes.len()).all(|end| VisibilityTile::decode(tile.id, &bytes[..end]).is_err()));
        for at in 0..bytes.len() {
            let mut wrong = bytes.clone();
            wrong[at] ^= 0x10;
            assert!(VisibilityTile::decode(tile.id, &wrong).is_err(), "{at}");
        }
    }

    #[test]
    fn tiles_that_break_a_rule_are_not_written() {
        let wrong = |change: fn(&mut VisibilityTile)| {
            let mut tile = sample();
            change(&mut tile);
            assert!(tile.encode().is_err());
        };
        wrong(|tile| tile.depth = 6);
        wrong(|tile| tile.reach = MAX_REACH + 1);
        wrong(|tile| tile.layers_dm = [30, 20, 200]);
        wrong(|tile| drop(tile.cells.pop()));
        wrong(|tile| tile.cells[0].as_mut().unwrap().seen[3] = UNSEEN + 1);
        wrong(|tile| {
            tile.cells[0].as_mut().unwrap().seen.pop();
        });
    }

    #[test]
    fn a_shallow_city_has_one_tile() {
        let cell = VisibleCell { ground: -3, seen: vec![0, 1, 3] };
        let cells = (0..16).map(|i| (i % 5 == 0).then(|| cell.clone())).collect();
        let tile = VisibilityTile { id: TileId::ROOT, depth: 1, reach: 0, layers_dm: [1, 2, 3], cells };
        assert_eq!(VisibilityTile::decode(TileId::ROOT, &tile.encode().unwrap()).unwrap(), tile);
    }

    #[test]
    fn sets_answer_for_nodes_of_all_levels() {
        let mut tile = sample();
        // Leaf 10/26 of the node's 8/24 to 15/31; its set spans 8/24 to 12/28.
        let at = tile.cell_index(10, 26).unwrap();
        let mut seen = vec![UNSEEN; 75];
        (seen[12], seen[2 * 5 + 4]) = (0, 1);
        // Of the second scale the square 0/5 to 4/9 around 2/6: its square 3/6 has leaf 13/26. Of the third, 0/1 around.
        seen[25 + 2 * 5 + 3] = 0;
        tile.cells[at] = Some(VisibleCell { ground: 10, seen });
        let id = |level: u8, x: u32, y: u32| TileId::new(level, x, y).unwrap();
        let low = tile.set_at(10, 26, 7.9).unwrap();
        let middle = tile.set_at(10, 26, 8.1).unwrap();
        assert!(low.may_see(id(5, 10, 26)) && !low.may_see(id(5, 11, 26)) && !low.may_see(id(5, 12, 26)));
        assert!(middle.may_see(id(5, 12, 26)) && !middle.may_see(id(5, 12, 25)));
        assert!(low.may_see(id(4, 5, 13)) && !low.may_see(id(4, 4, 12)) && !low.may_see(TileId::ROOT));
        assert!(low.may_see(id(5, 13, 26)) && low.may_see(id(3, 3, 6)), "beyond the first scale's reach");
        assert!(!low.may_see(id(5, 9, 29)) && !low.may_see(id(3, 1, 6)) && !low.may_see(id(4, 4, 14)));
        assert!(tile.set_at(10, 26, 25.1).is_none() && tile.set_at(40, 26, 6.0).is_none());
        assert_eq!(block_of_leaf(id(5, 10, 26)), tile.id);
    }
}
