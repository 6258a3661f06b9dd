//! Which columns are of water or glass: one bit per column, in a section that only tiles with such columns have.
//!
//! Water comes in large patches with smooth shores, so a bit costs little when the columns before it agree.

use super::{BlockMap, COLUMNS, NODE_CELLS, flag};
use crate::codec::range::{BitCoder, BitModel, GroupFlag};
use crate::error::{DecodeError, invalid_if};

impl BlockMap {
    /// Whether a column is [`flag::REFLECTIVE`].
    pub(super) fn has_reflective(&self) -> bool {
        self.flags.iter().any(|flags| flags & flag::REFLECTIVE != 0)
    }
}

/// Writes or reads [`flag::REFLECTIVE`] of all columns that exist. Empty cells have no bit. Fails if no column has it.
pub(super) fn code<C: BitCoder>(coder: &mut C, map: &mut BlockMap) -> Result<(), DecodeError> {
    let is_set = |flags: &[u8], i: usize, bit: u8| flags[i] & bit != 0;
    let flags = &mut map.flags;
    let columns = flags.iter().filter(|flags| **flags & flag::OCCUPIED != 0);
    let group =
        if C::WRITES { GroupFlag::of(columns.map(|flags| flags & flag::REFLECTIVE != 0)) } else { GroupFlag::Unset };
    let group = group.code(coder, &mut [BitModel::NEW; 2]);
    // By the number of reflective columns to the west and south.
    let mut models = [BitModel::NEW; 3];
    for i in 0..COLUMNS {
        if !is_set(flags, i, flag::OCCUPIED) {
            continue;
        }
        let west = i % NODE_CELLS > 0 && is_set(flags, i - 1, flag::REFLECTIVE);
        let south = i >= NODE_CELLS && is_set(flags, i - NODE_CELLS, flag::REFLECTIVE);
        let model = &mut models[usize::from(west) + usize::from(south)];
        if group.bit(coder, model, is_set(flags, i, flag::REFLECTIVE)) {
            flags[i] |= flag::REFLECTIVE;
        }
    }
    invalid_if(!map.has_reflective(), "a section of reflective columns without any")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blockmap::MapColumn;
    use crate::blockmap::encode::{TAG_COLUMNS, TAG_META, TAG_REFLECTIVE};
    use crate::tile::{TileReader, TileWriter};
    use crate::{Texel, TileId, TileKind};

    /// Columns everywhere but in the north-western corner, reflective where `is_water`.
    fn map(is_water: impl Fn(i32, i32) -> bool) -> BlockMap {
        let column = |i: usize| {
            let (x, y) = ((i % NODE_CELLS) as i32, (i / NODE_CELLS) as i32);
            let roof = Texel::new([52, 78, 84], 63);
            let column = MapColumn { z_max: 20, roof, reflective: is_water(x, y), ..MapColumn::default() };
            (y - x < 32).then_some(column)
        };
        BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &(0..COLUMNS).map(column).collect::<Vec<_>>()).unwrap()
    }

    fn section(bytes: &[u8]) -> Vec<u8> {
        TileReader::new(bytes, TileKind::BlockMap).unwrap().section(TAG_REFLECTIVE, 4096).unwrap()
    }

    #[test]
    fn lakes_round_trip_and_are_small() {
        let lake = |x: i32, y: i32| (x - 30).pow(2) + (y - 20).pow(2) < 300;
        let corner = |x: i32, y: i32| (x, y) == (63, 0);
        for (map, most) in [(map(lake), 90), (map(|_, _| true), 1), (map(corner), 6)] {
            let bytes = map.encode().unwrap();
            let section = section(&bytes);
            assert!((1..=most).contains(&section.len()), "{} bytes", section.len());
            assert_eq!(BlockMap::decode(TileId::ROOT, &bytes).unwrap(), map);
        }
        assert!(section(&map(|_, _| false).encode().unwrap()).is_empty());
    }

    #[test]
    fn sections_without_reflective_columns_or_with_more_bytes_are_refused() {
        let decode = |columns: &BlockMap, mask: &[u8]| {
            let bytes = columns.encode().unwrap();
            let reader = TileReader::new(&bytes, TileKind::BlockMap).unwrap();
            let mut writer = TileWriter::new(TileKind::BlockMap, None);
            for tag in [TAG_META, TAG_COLUMNS] {
                writer.add_raw_section(tag, &reader.section(tag, 1 << 20).unwrap()).unwrap();
            }
            writer.add_raw_section(TAG_REFLECTIVE, mask).unwrap();
            BlockMap::decode(TileId::ROOT, &writer.finish().unwrap())
        };
        let (land, all) = (map(|_, _| false), section(&map(|_, _| true).encode().unwrap()));
        assert_eq!(decode(&land, &all).unwrap(), map(|_, _| true));
        // The first bit says that no column is reflective.
        assert!(matches!(decode(&land, &[0]), Err(DecodeError::Invalid(_))));
        let empty = BlockMap::empty(TileId::ROOT, 1.0, 0, 0);
        assert!(matches!(decode(&empty, &all), Err(DecodeError::Invalid(_))));
        let longer = [&all[..], &[0; 4]].concat();
        assert!(matches!(decode(&land, &longer), Err(DecodeError::TrailingBytes(_))));
    }

    #[test]
    fn empty_cells_cannot_be_reflective() {
        let mut map = map(|_, _| false);
        map.flags[COLUMNS - NODE_CELLS] = flag::REFLECTIVE;
        assert!(map.encode().is_err());
    }
}
