//! Thin objects, such as masts, railings and cables: how much of its cell a column fills, in a section that only tiles with such
//! columns have.

use super::{BlockMap, COLUMNS, MapColumn, NODE_CELLS, STEPS_PER_CELL, flag, strip_rows};
use crate::codec::range::{BitCoder, BitModel, NumberModel};
use crate::error::{DecodeError, invalid_if};

/// How much of its cell a thin object covers (Vacca 2008, 3.4.2): of a column's only solid, or of the one above its gap. As codes, which
/// are finer where the share is small.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ThinShare {
    /// Of its sides, at least 1.
    pub side: u8,
    /// Of its top and its underside.
    pub top: u8,
}

impl ThinShare {
    /// From shares between 0 and 1.
    pub fn new(side: f32, top: f32) -> Self {
        // The cast saturates.
        let code = |share: f32| ((1.0 + share * 65536.0).sqrt() - 1.0).round() as u8;
        Self { side: code(side).max(1), top: code(top) }
    }

    /// The shares of sides and top, between 0 and 1.
    pub fn shares(self) -> [f32; 2] {
        [self.side, self.top].map(|code| f32::from(code) * (f32::from(code) + 2.0) / 65536.0)
    }
}

/// Flags of the columns that may be thin, and those that these must not have: planes and slopes tell shapes better.
const NEEDED: u8 = flag::EXPOSED | flag::HOLES;
const WITHOUT: u8 = flag::CLIPPED | flag::INCLINED;

/// Whether a column with these flags may be thin.
pub(super) fn may_be_thin(flags: u8) -> bool {
    flags & (NEEDED | WITHOUT) == NEEDED
}

/// Writes or reads which columns are thin, and their shares. Fails if none is.
pub(super) fn code<C: BitCoder>(coder: &mut C, map: &mut BlockMap) -> Result<(), DecodeError> {
    let written = std::mem::take(&mut map.thin);
    let mut given = written.iter().peekable();
    // By the number of thin columns to the west and south.
    let mut is_thin = [BitModel::NEW; 3];
    let mut shares: [NumberModel; 2] = Default::default();
    let mut known = vec![None; COLUMNS];
    let mut last = ThinShare { side: 0, top: 0 };
    for i in (0..COLUMNS).filter(|i| may_be_thin(map.flags[*i])) {
        let west = if i % NODE_CELLS > 0 { known[i - 1] } else { None };
        let south = if i >= NODE_CELLS { known[i - NODE_CELLS] } else { None };
        let value = given.next_if(|(column, _)| usize::from(*column) == i).map(|(_, share)| *share);
        let model = &mut is_thin[usize::from(west.is_some()) + usize::from(south.is_some())];
        if !coder.bit(model, value.is_some()) {
            continue;
        }
        let (expected, value) = (west.or(south).unwrap_or(last), value.unwrap_or(last));
        let mut code = |model: &mut NumberModel, expected: u8, value: u8| {
            let difference = coder.number(model, i32::from(value) - i32::from(expected));
            (i32::from(expected) + difference).clamp(0, i32::from(u8::MAX)) as u8
        };
        let [sides, tops] = &mut shares;
        last =
            ThinShare { side: code(sides, expected.side, value.side).max(1), top: code(tops, expected.top, value.top) };
        known[i] = Some(last);
        map.thin.push((i as u16, last));
    }
    invalid_if(map.thin.is_empty(), "a section of thin columns without any")
}

impl BlockMap {
    /// A thin column with the ground below what is thin. Fails with the column without its thin part if the rest hangs in the air: two
    /// gaps cannot be shown.
    pub(super) fn thin_on_ground(&self, mut column: MapColumn, ground: &MapColumn) -> Result<MapColumn, MapColumn> {
        let codes = STEPS_PER_CELL >> self.z_shift;
        let [top, foot] = column.gap.unwrap_or([column.z_min; 2]);
        if top > ground.z_max && column.gap.is_some() {
            let above = f32::from(column.z_min) - f32::from(ground.z_max);
            if above > 1.0 && column.suspended || above > self.max_foot() {
                let rows = strip_rows(column.z_min, top, self.z_shift).1;
                column.strip.iter_mut().for_each(|strip| strip.texels.truncate(usize::from(rows)));
                return Err(MapColumn { z_max: top, gap: None, thin: None, ..column });
            }
            let z_min = ground.z_min.min(column.z_min);
            self.lower(&mut column, z_min);
            return Ok(column);
        }
        let foot = foot.max(ground.z_max + 1);
        if column.z_max <= foot {
            return Ok(ground.clone());
        }
        let z_min = ground.z_min.min(column.z_min);
        self.lower(&mut column, z_min);
        let hidden = (ground.z_max - 1) / codes + 1 - column.z_min / codes;
        let texels = column.strip.iter_mut().flat_map(|strip| &mut strip.texels);
        texels.take(usize::from(hidden)).for_each(|texel| *texel = ground.roof);
        column.gap = Some([ground.z_max, foot]);
        Ok(column)
    }
}

/// Checks that the thin columns ascend and may be thin.
pub(super) fn check(map: &BlockMap) -> Result<(), DecodeError> {
    let ascends = map.thin.windows(2).all(|pair| pair[0].0 < pair[1].0);
    let may_be = |(column, share): &(u16, ThinShare)| {
        share.side > 0 && map.flags.get(usize::from(*column)).is_some_and(|flags| may_be_thin(*flags))
    };
    let is_wrong = !ascends || !map.thin.iter().all(may_be);
    invalid_if(is_wrong, "a thin column has no wall strip, or is clipped or inclined")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blockmap::encode::TAG_THIN;
    use crate::blockmap::{ColumnClip, NodeGround, WallStrip};
    use crate::tile::TileReader;
    use crate::{Texel, TileId, TileKind};

    fn walled(z_min: u16, z_max: u16) -> MapColumn {
        let rows = strip_rows(z_min, z_max, 0).1;
        let texels = (0..rows).map(|row| Texel::new([90, 90, row as u8], 50)).collect();
        let roof = Texel::new([200; 3], 63);
        MapColumn { z_min, z_max, roof, strip: Some(WallStrip { texels, azimuth: 64 }), ..MapColumn::default() }
    }

    fn thin(z_min: u16, z_max: u16, side: u8, top: u8) -> MapColumn {
        MapColumn { thin: Some(ThinShare { side, top }), ..walled(z_min, z_max) }
    }

    /// A railing with a mast at its end, another mast on a house, and a column with holes that is not thin.
    fn map() -> BlockMap {
        let mut columns = vec![None; COLUMNS];
        for x in 5..40 {
            columns[20 * NODE_CELLS + x] = Some(thin(0, 24, 33 + (x % 3) as u8, 14));
        }
        columns[20 * NODE_CELLS + 40] = Some(thin(0, 192, 51, 10));
        columns[30 * NODE_CELLS] = Some(MapColumn { gap: Some([100, 101]), ..thin(0, 292, 255, 0) });
        let mut holes = walled(0, 100);
        holes.strip.as_mut().unwrap().texels[2] = Texel::OPEN;
        columns[31 * NODE_CELLS] = Some(holes);
        BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap()
    }

    #[test]
    fn thin_columns_round_trip_and_are_small() {
        let map = map();
        assert_eq!(map.thin.len(), 37);
        let bytes = map.encode().unwrap();
        assert_eq!(BlockMap::decode(TileId::ROOT, &bytes).unwrap(), map);
        let section = TileReader::new(&bytes, TileKind::BlockMap).unwrap().section(TAG_THIN, 4096).unwrap();
        assert!((1..60).contains(&section.len()), "{} bytes", section.len());
        // Readers that do not know the section see an opaque column.
        let without = BlockMap { thin: Vec::new(), ..map };
        let bytes = without.encode().unwrap();
        assert_eq!(BlockMap::decode(TileId::ROOT, &bytes).unwrap(), without);
    }

    #[test]
    fn frozen_thin_columns_are_read_and_written() {
        let bytes = include_bytes!("../../tests/vectors/v4_thin_blockmap.bin");
        assert_eq!(BlockMap::decode(TileId::ROOT, bytes).unwrap(), map());
        assert_eq!(map().encode().unwrap(), bytes);
    }

    #[test]
    #[ignore = "writes the frozen file: only for a new format version"]
    fn write_vector() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors/v4_thin_blockmap.bin");
        std::fs::write(path, map().encode().unwrap()).unwrap();
    }

    #[test]
    fn clipped_inclined_and_plain_columns_cannot_be_thin() {
        let share = Some(ThinShare { side: 9, top: 9 });
        let good = thin(0, 24, 9, 9);
        let bad = [
            MapColumn { clip: Some(ColumnClip::default()), ..good.clone() },
            MapColumn { inclined: true, ..good.clone() },
            MapColumn { strip: None, ..good.clone() },
            MapColumn { thin: Some(ThinShare { side: 0, top: 9 }), ..good.clone() },
        ];
        let check = |column: MapColumn| {
            let mut columns = vec![None; COLUMNS];
            columns[7] = Some(column);
            BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns)
        };
        assert_eq!(check(good).unwrap().columns()[7].as_ref().unwrap().thin, share);
        assert!(bad.into_iter().all(|column| check(column).is_err()));
    }

    #[test]
    fn ground_lies_below_what_is_thin() {
        let mut columns = vec![None; COLUMNS];
        // A mast from a code below the ground on, one on a foundation, one on a deck in the air, and one below the ground.
        columns[70] = Some(thin(159, 300, 40, 4));
        columns[75] = Some(MapColumn { gap: Some([200, 201]), ..thin(150, 300, 40, 4) });
        columns[80] = Some(MapColumn { suspended: true, gap: Some([340, 341]), ..thin(320, 400, 40, 4) });
        columns[85] = Some(thin(100, 160, 40, 4));
        let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap();
        let mut ground = NodeGround { squares: u64::MAX, ..NodeGround::default() };
        ground.heights = std::array::from_fn(|i| if ground.corners >> i & 1 == 1 { 40 } else { 0 });
        let columns = BlockMap { ground: Some(Box::new(ground)), ..map }.stand_on_ground().columns();
        let column = |i: usize| columns[i].clone().unwrap();
        let mast = column(70);
        assert_eq!((mast.gap, mast.z_max, mast.thin), (Some([160, 161]), 300, Some(ThinShare { side: 40, top: 4 })));
        let ground_roof = column(85).roof;
        let texels = mast.strip.unwrap().texels;
        assert!(texels[0] == ground_roof && texels[1] != ground_roof);
        assert_eq!((column(75).gap, column(75).thin.is_some()), (Some([200, 201]), true));
        assert_eq!((column(80).gap, column(80).z_max, column(80).thin), (Some([160, 320]), 340, None));
        assert_eq!((column(85).z_max, column(85).strip), (160, None));
    }
}
