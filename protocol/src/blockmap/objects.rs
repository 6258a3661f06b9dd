//! Which object each column shows: numbers of the roof, the wall and the lower top (beyond the clip or below the gap), in a section of
//! its own.
//!
//! The section lists the node's objects once, ascending. A part of a column then names one of them: most often that of a neighbour,
//! else one that was named shortly before, else any of the list. How likely it is that a neighbour shows the same object depends on
//! the step in height between the two.

use super::neighbours::neighbour;
use super::{BlockMap, COLUMNS, NODE_CELLS, flag};
pub use crate::codec::object_names::NO_OBJECT;
use crate::codec::object_names::{Naming, code_list};
use crate::codec::range::BitCoder;
use crate::error::DecodeError;

/// The objects of a node's columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColumnObjects {
    /// Object of each column's top, [`COLUMNS`] of them; [`NO_OBJECT`] where there is no column.
    pub roof: Vec<u32>,
    /// Object of each wall strip; [`NO_OBJECT`] for columns that are not exposed.
    pub wall: Vec<u32>,
    /// Object of each column's lower top, beyond its clip or below its gap; [`NO_OBJECT`] for columns without one.
    pub lower: Vec<u32>,
}

impl Default for ColumnObjects {
    fn default() -> Self {
        let none = || vec![NO_OBJECT; COLUMNS];
        Self { roof: none(), wall: none(), lower: none() }
    }
}

impl ColumnObjects {
    /// The different numbers in ascending order, without [`NO_OBJECT`].
    pub fn distinct(&self) -> Vec<u32> {
        let all = [&self.roof, &self.wall, &self.lower].into_iter().flatten();
        let mut list: Vec<u32> = all.copied().filter(|object| *object != NO_OBJECT).collect();
        list.sort_unstable();
        list.dedup();
        list
    }

    /// Fails unless there is one number for each column.
    pub(super) fn check(&self) -> Result<(), DecodeError> {
        let is_whole = [&self.roof, &self.wall, &self.lower].into_iter().all(|part| part.len() == COLUMNS);
        if is_whole { Ok(()) } else { Err(DecodeError::Invalid("objects of other than 4096 columns")) }
    }

    /// Whether any part of a column has an object.
    pub(super) fn is_empty(&self) -> bool {
        [&self.roof, &self.wall, &self.lower].into_iter().flatten().all(|object| *object == NO_OBJECT)
    }
}

/// Writes or reads the objects of the parts that `map` has. Numbers of parts that it lacks are not written. Fails if the list of
/// objects is empty, longer than a node's parts, or not ascending.
pub(super) fn code<C: BitCoder>(
    coder: &mut C,
    map: &BlockMap,
    value: &ColumnObjects,
) -> Result<ColumnObjects, DecodeError> {
    let list = code_list(coder, if C::WRITES { value.distinct() } else { Vec::new() }, 3 * COLUMNS)?;
    let mut naming = Naming::new(coder, &list);
    let mut naming = ColumnNaming(&mut naming);
    let mut out = ColumnObjects::default();
    let lower_tops = lower_tops(map);
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
        out.roof[i] = naming.roof(map, &out.roof, i, value.roof[i]);
    }
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::EXPOSED != 0) {
        out.wall[i] = naming.wall(map, &out, i, value.wall[i]);
    }
    for i in 0..COLUMNS {
        if let Some(z) = lower_tops[i] {
            out.lower[i] = naming.lower(map, &out, i, z, value.lower[i]);
        }
    }
    Ok(out)
}

/// Height code of each column's lower top: beyond its clip, else below its gap.
pub fn lower_tops(map: &BlockMap) -> Vec<Option<u16>> {
    let (mut clips, mut gaps) = (map.clips.iter(), map.gaps.iter());
    let top = |flags: &u8| {
        let clip = if flags & flag::CLIPPED != 0 { clips.next() } else { None };
        let gap = if flags & flag::GAP != 0 { gaps.next() } else { None };
        clip.and_then(|clip| clip.outer).map(|outer| outer.z).or(gap.map(|gap| gap[0]))
    };
    map.flags.iter().map(top).collect()
}

/// Names the objects of columns.
struct ColumnNaming<'a, 'b, C>(&'b mut Naming<'a, C>);

/// Class of a step between two heights, in height codes: none, up to half a cell, up to two cells, more.
fn step_class(a: u16, b: u16) -> usize {
    match a.abs_diff(b) {
        0 => 0,
        1..=8 => 1,
        9..=32 => 2,
        _ => 3,
    }
}

impl<C: BitCoder> ColumnNaming<'_, '_, C> {
    fn roof(&mut self, map: &BlockMap, roofs: &[u32], i: usize, value: u32) -> u32 {
        let west = if !i.is_multiple_of(NODE_CELLS) { occupied(map, i - 1) } else { None };
        let south = if i >= NODE_CELLS { occupied(map, i - NODE_CELLS) } else { None };
        let class = |j: Option<usize>| j.map_or(3, |j| step_class(map.z_max[i], map.z_max[j]));
        let (first, second) = if class(south) < class(west) { (south, west) } else { (west, south) };
        let agree = first.zip(second).is_some_and(|(a, b)| roofs[a] == roofs[b]);
        let exposed = map.flags[i] & flag::EXPOSED != 0;
        let context = class(first) + if agree { 4 } else { 0 } + if exposed && agree { 4 } else { 0 };
        let candidates = [first, second].into_iter().flatten().map(|j| roofs[j]);
        self.0.name(0, context, candidates, value)
    }

    fn wall(&mut self, map: &BlockMap, known: &ColumnObjects, i: usize, value: u32) -> u32 {
        let before = [[-1, 0], [0, -1]].into_iter().filter_map(|step| neighbour(i, step));
        let mut before = before.filter(|j| map.flags[*j] & flag::EXPOSED != 0);
        let own = known.roof[i];
        let habit = before.next().map_or(0, |j| 1 + usize::from(known.wall[j] == known.roof[j]));
        let is_clipped = usize::from(map.flags[i] & flag::CLIPPED != 0);
        // A wall that is not the roof's belongs to a higher neighbour of which the column is a part.
        let around = Around::of(map, i, |j| u32::from(u16::MAX - map.z_max[j]));
        let candidates = std::iter::once(own).chain(around.iter().map(|j| known.roof[j]));
        self.0.name(1, habit * 2 + is_clipped, candidates, value)
    }

    fn lower(&mut self, map: &BlockMap, known: &ColumnObjects, i: usize, z: u16, value: u32) -> u32 {
        let around = Around::of(map, i, |j| u32::from(map.z_max[j].abs_diff(z)));
        let class = around.iter().next().map_or(3, |j| step_class(map.z_max[j], z));
        let candidates = around.iter().map(|j| known.roof[j]).chain([known.roof[i]]);
        self.0.name(2, class, candidates, value)
    }
}

/// The up to four columns beside a column, in the order of a key.
struct Around {
    columns: [usize; 4],
    count: usize,
}

impl Around {
    fn of(map: &BlockMap, i: usize, key: impl Fn(usize) -> u32) -> Self {
        let mut around = Self { columns: [0; 4], count: 0 };
        for j in [[1, 0], [0, 1], [-1, 0], [0, -1]].into_iter().filter_map(|step| neighbour(i, step)) {
            if map.flags[j] & flag::OCCUPIED != 0 {
                around.columns[around.count] = j;
                around.count += 1;
            }
        }
        around.columns[..around.count].sort_by_key(|j| key(*j));
        around
    }

    fn iter(&self) -> impl Iterator<Item = usize> {
        self.columns[..self.count].iter().copied()
    }
}

fn occupied(map: &BlockMap, j: usize) -> Option<usize> {
    (map.flags[j] & flag::OCCUPIED != 0).then_some(j)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blockmap::encode::TAG_OBJECTS;
    use crate::blockmap::{ColumnClip, MapColumn, OuterTop, WallStrip, strip_rows};
    use crate::tile::TileReader;
    use crate::{Texel, TileId, TileKind};
    use insula_test_support::rng::Rng;

    /// Terrain (object 7) with houses of 12 x 12 columns, each of its own height and object, with clipped walls.
    fn town() -> BlockMap {
        let mut objects = ColumnObjects::default();
        let house = |i: usize| {
            let (x, y) = (i % NODE_CELLS, i / NODE_CELLS);
            (x % 16 < 12 && y % 16 < 12).then_some((x / 16 + y / 16 * 4, x % 16 == 0 || y % 16 == 0))
        };
        let columns: Vec<Option<MapColumn>> = (0..COLUMNS)
            .map(|i| {
                let Some((number, is_wall)) = house(i) else {
                    objects.roof[i] = 7;
                    return Some(MapColumn { z_max: 20, ..MapColumn::default() });
                };
                objects.roof[i] = 1000 + number as u32 * 3;
                let z_max = 100 + 16 * number as u16;
                if !is_wall {
                    return Some(MapColumn { z_max, ..MapColumn::default() });
                }
                (objects.wall[i], objects.lower[i]) = (objects.roof[i], 7);
                let texels = vec![Texel::new([9, 8, 7], 63); usize::from(strip_rows(0, z_max, 0).1)];
                let clip = ColumnClip { outer: Some(OuterTop { z: 20, roof: Texel(0) }), ..ColumnClip::default() };
                let strip = Some(WallStrip { texels, azimuth: 0 });
                Some(MapColumn { z_max, strip, clip: Some(clip), ..MapColumn::default() })
            })
            .collect();
        let mut map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap();
        map.objects = Some(Box::new(objects));
        map
    }

    fn section(map: &BlockMap) -> Vec<u8> {
        TileReader::new(&map.encode().unwrap(), TileKind::BlockMap).unwrap().section(TAG_OBJECTS, 1 << 20).unwrap()
    }

    #[test]
    fn houses_round_trip_and_are_small() {
        let map = town();
        let bytes = section(&map);
        assert!(bytes.len() < 130, "{} bytes", bytes.len());
        assert!(BlockMap::decode(TileId::ROOT, &map.encode().unwrap()).unwrap().objects == map.objects);
    }

    #[test]
    fn any_objects_round_trip() {
        let mut rng = Rng::new(3);
        for kinds in [1, 2, 300, u32::MAX] {
            let mut map = town();
            let objects = map.objects.as_mut().unwrap();
            for part in [&mut objects.roof, &mut objects.wall, &mut objects.lower] {
                for object in part.iter_mut().filter(|object| **object != NO_OBJECT) {
                    *object = if rng.one_in(9) { NO_OBJECT } else { rng.bits() as u32 % kinds };
                }
            }
            assert!(BlockMap::decode(TileId::ROOT, &map.encode().unwrap()).unwrap().objects == map.objects);
        }
    }

    #[test]
    fn a_map_without_objects_has_no_section() {
        let mut map = town();
        map.objects = Some(Box::default());
        assert!(section(&map).is_empty());
        map.objects = Some(Box::new(ColumnObjects { roof: vec![1], ..ColumnObjects::default() }));
        assert!(map.encode().is_err());
    }

    #[test]
    fn damaged_sections_are_refused_or_give_any_objects() {
        let (map, mut rng) = (town(), Rng::new(5));
        let good = section(&map);
        for _ in 0..2000 {
            let mut bytes = good.clone();
            let at = rng.below(bytes.len());
            bytes[at] ^= 1 << rng.below(8);
            bytes.truncate(1 + rng.below(bytes.len()));
            let mut coder = crate::codec::range::RangeDecoder::new(&bytes);
            if let Ok(objects) = code(&mut coder, &map, &ColumnObjects::default()) {
                assert!(objects.check().is_ok());
            }
        }
    }
}
