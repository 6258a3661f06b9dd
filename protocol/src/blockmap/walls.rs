//! Walls of exposed columns in facade order: flags, azimuths, gaps and clipping planes. All lossless.

use super::facades::{AROUND, FacadeStep};
use super::neighbours::{WIDTH, neighbour, rim_index};
use super::tops::ColumnTop;
use super::{
    BlockMap, CLIP_STEPS_PER_CELL, COLUMNS, ColumnClip, CornerWall, NODE_CELLS, OuterTop, STEPS_PER_CELL, Z_CODE_MAX,
    flag,
};
use crate::codec::range::{BitCoder, BitModel, GroupFlag, NumberModel};

/// A wall faces along an axis if its direction has at least this part of it, in 1/16384 (the cosine of 67.5 degrees).
const FACING: i32 = 6270;

#[derive(Default)]
struct WallModels {
    gap: [BitModel; 3],
    holes: [BitModel; 3],
    clipped: [BitModel; 6],
    azimuth: AzimuthModels,
    gap_height: [NumberModel; 2],
    offset: [NumberModel; 2],
    corner: [BitModel; 4],
    concave: BitModel,
    corner_offset: [NumberModel; 2],
    outer: [BitModel; 6],
    outer_height: [NumberModel; 3],
}

/// Writes or reads the flags `GAP`, `HOLES` and `CLIPPED`, azimuths, gaps and clipping planes of exposed columns.
pub(super) fn code<C: BitCoder>(coder: &mut C, map: &mut BlockMap, steps: &[FacadeStep]) {
    let mut models = Box::<WallModels>::default();
    let mut gaps = vec![[0u16; 2]; COLUMNS];
    let mut clips = vec![ColumnClip::default(); COLUMNS];
    if C::WRITES {
        scatter(map, flag::GAP, &map.gaps, &mut gaps);
        scatter(map, flag::CLIPPED, &map.clips, &mut clips);
    }
    let mut code_share = |bit: u8| {
        let exposed = map.flags.iter().filter(|f| **f & flag::EXPOSED != 0);
        let group = if C::WRITES { GroupFlag::of(exposed.map(|f| f & bit != 0)) } else { GroupFlag::Unset };
        group.code(coder, &mut [BitModel::NEW; 2])
    };
    let [with_gaps, with_holes, with_clips] = [flag::GAP, flag::HOLES, flag::CLIPPED].map(&mut code_share);
    let mut is_coded = vec![false; WIDTH * WIDTH];
    for &FacadeStep { column: i, predecessor } in steps {
        // 0 without a predecessor, 1 if it lacks the flag, 2 if it has it.
        let context = |bit: u8| predecessor.map_or(0, |j| 1 + usize::from(map.flags[j] & bit != 0));
        let is_set = |bit: u8| map.flags[i] & bit != 0;
        let gap = with_gaps.bit(coder, &mut models.gap[context(flag::GAP)], is_set(flag::GAP));
        let holes = with_holes.bit(coder, &mut models.holes[context(flag::HOLES)], is_set(flag::HOLES));
        let clipped = with_clips.bit(coder, &mut models.clipped[context(flag::CLIPPED)], is_set(flag::CLIPPED));
        if !C::WRITES {
            let bits = [(gap, flag::GAP), (holes, flag::HOLES), (clipped, flag::CLIPPED)];
            map.flags[i] |= bits.iter().filter(|(on, _)| *on).map(|(_, bit)| bit).sum::<u8>();
        }
        let nearby = NearbyWalls::new(map, &is_coded, &clips, i, predecessor);
        map.wall_azimuth[i] = models.azimuth.code(coder, azimuths(nearby.walls()), None, map.wall_azimuth[i]);
        let wall = WallContext { map, nearby: nearby.walls(), column: i, predecessor };
        if gap {
            gaps[i] = models.code_gap(coder, &wall, &gaps);
        }
        if clipped {
            clips[i] = models.code_clip(coder, &wall, &clips);
        }
        is_coded[rim_index(i)] = true;
    }
    if !C::WRITES {
        map.gaps = gather(map, flag::GAP, &gaps);
        map.clips = gather(map, flag::CLIPPED, &clips);
    }
}

/// Writes the values of the columns that have a flag to the columns' own indices.
fn scatter<T: Copy>(map: &BlockMap, bit: u8, values: &[T], by_column: &mut [T]) {
    let columns = (0..COLUMNS).filter(|i| map.flags[*i] & bit != 0);
    columns.zip(values).for_each(|(i, value)| by_column[i] = *value);
}

/// The inverse of [`scatter`].
fn gather<T: Copy>(map: &BlockMap, bit: u8, by_column: &[T]) -> Vec<T> {
    map.flags.iter().zip(by_column).filter(|(flags, _)| **flags & bit != 0).map(|(_, value)| *value).collect()
}

/// A wall of a neighbouring column, continued into a column.
#[derive(Debug, Clone, Copy)]
struct NearbyWall {
    azimuth: u8,
    /// Offset of the continued plane from the column's centre, if the wall has a plane.
    offset: Option<i32>,
}

fn azimuths(walls: &[NearbyWall]) -> impl Iterator<Item = u8> {
    walls.iter().map(|wall| wall.azimuth)
}

/// Walls of the coded neighbours of a column, one per azimuth.
struct NearbyWalls {
    walls: [NearbyWall; 2 * (AROUND.len() + 1)],
    count: usize,
}

impl NearbyWalls {
    /// Collects the walls around column `i`, those of the predecessor first.
    fn new(map: &BlockMap, is_coded: &[bool], clips: &[ColumnClip], i: usize, predecessor: Option<usize>) -> Self {
        let mut nearby = Self { walls: [NearbyWall { azimuth: 0, offset: None }; 2 * (AROUND.len() + 1)], count: 0 };
        if let Some(j) = predecessor {
            nearby.add_column(map, clips, i, j);
        }
        let at = rim_index(i);
        for [dx, dy] in AROUND {
            if is_coded[at.wrapping_add_signed((dy * WIDTH as i32 + dx) as isize)] {
                let j = i.wrapping_add_signed((dy * NODE_CELLS as i32 + dx) as isize);
                if Some(j) != predecessor {
                    nearby.add_column(map, clips, i, j);
                }
            }
        }
        nearby
    }

    /// Adds the walls of column `j`, continued into column `i`.
    fn add_column(&mut self, map: &BlockMap, clips: &[ColumnClip], i: usize, j: usize) {
        let azimuth = map.wall_azimuth[j];
        if map.flags[j] & flag::CLIPPED == 0 {
            self.add(NearbyWall { azimuth, offset: None });
            return;
        }
        let continued = |azimuth, offset| NearbyWall { azimuth, offset: Some(continued_offset(j, i, azimuth, offset)) };
        self.add(continued(azimuth, clips[j].offset));
        if let Some(corner) = clips[j].corner {
            self.add(continued(corner.azimuth, corner.offset));
        }
    }

    fn add(&mut self, wall: NearbyWall) {
        let count = self.count;
        match self.walls[..count].iter_mut().find(|w| w.azimuth == wall.azimuth) {
            Some(known) => known.offset = known.offset.or(wall.offset),
            None => {
                self.walls[count] = wall;
                self.count += 1;
            }
        }
    }

    fn walls(&self) -> &[NearbyWall] {
        &self.walls[..self.count]
    }
}

/// The offset from the centre of column `i` of the plane that has `offset` from the centre of column `j`.
fn continued_offset(j: usize, i: usize, azimuth: u8, offset: i8) -> i32 {
    let [nx, ny] = direction(azimuth);
    let (n, i, j) = (NODE_CELLS as i32, i as i32, j as i32);
    let along = nx * (j % n - i % n) + ny * (j / n - i / n);
    i32::from(offset) + ((along * CLIP_STEPS_PER_CELL + 8192) >> 14)
}

/// What the wall of a column is predicted from.
struct WallContext<'a> {
    map: &'a BlockMap,
    nearby: &'a [NearbyWall],
    column: usize,
    predecessor: Option<usize>,
}

impl WallContext<'_> {
    /// The top of the first of the two columns in front of the wall that is lower by half a row, continued to here.
    fn lower_top(&self, facing: [i32; 2]) -> Option<u16> {
        let map = self.map;
        (1..=2).find_map(|k| {
            let [dx, dy] = facing.map(|v| v * k);
            let j = neighbour(self.column, [dx, dy]).filter(|j| map.flags[*j] & flag::OCCUPIED != 0)?;
            let top = ColumnTop::of(map, j).plane_at([-dx, -dy]).clamp(0, i32::from(Z_CODE_MAX));
            let half_row = i32::from(STEPS_PER_CELL >> map.z_shift) / 2;
            (top < i32::from(map.z_max[self.column]) - half_row).then_some(top as u16)
        })
    }
}

impl WallModels {
    fn code_gap<C: BitCoder>(&mut self, coder: &mut C, wall: &WallContext<'_>, gaps: &[[u16; 2]]) -> [u16; 2] {
        let WallContext { map, column: i, .. } = *wall;
        let predicted = wall.predecessor.map(|j| gaps[j]).filter(|gap| *gap != [0; 2]);
        let predicted = predicted.unwrap_or([map.z_min[i], map.z_max[i]]);
        let mut code_end = |k: usize| {
            let expected = i32::from(predicted[k]);
            let end = expected + coder.number(&mut self.gap_height[k], i32::from(gaps[i][k]) - expected);
            end.clamp(0, i32::from(u16::MAX)) as u16
        };
        [code_end(0), code_end(1)]
    }

    fn code_clip<C: BitCoder>(&mut self, coder: &mut C, wall: &WallContext<'_>, clips: &[ColumnClip]) -> ColumnClip {
        let azimuth = wall.map.wall_azimuth[wall.column];
        let value = clips[wall.column];
        let offset = code_offset(coder, &mut self.offset, wall.nearby, azimuth, value.offset);
        let corner = self.code_corner(coder, wall.nearby, azimuth, value.corner);
        let outer = self.code_outer(coder, wall, clips, value.outer);
        ColumnClip { offset, corner, outer }
    }

    /// Codes what lies beyond a wall in its cell. Most often it continues the column that the wall faces.
    fn code_outer<C: BitCoder>(
        &mut self,
        coder: &mut C,
        wall: &WallContext<'_>,
        clips: &[ColumnClip],
        value: Option<OuterTop>,
    ) -> Option<OuterTop> {
        let WallContext { map, column: i, .. } = *wall;
        let predecessor = wall.predecessor.filter(|j| map.flags[*j] & flag::CLIPPED != 0);
        let facing = direction(map.wall_azimuth[i]).map(|v| if v.abs() > FACING { v.signum() } else { 0 });
        let faced = neighbour(i, facing).filter(|j| map.flags[*j] & flag::OCCUPIED != 0);
        let context =
            predecessor.map_or(0, |j| 1 + usize::from(clips[j].outer.is_some())) * 2 + usize::from(faced.is_some());
        if !coder.bit(&mut self.outer[context], value.is_some()) {
            return None;
        }
        let of_predecessor = predecessor.and_then(|j| clips[j].outer).map(|outer| outer.z);
        let (expected, model) = match (wall.lower_top(facing), of_predecessor) {
            (Some(z), _) => (z, 0),
            (_, Some(z)) => (z, 1),
            _ => (map.z_min[i], 2),
        };
        let (low, high) = (i32::from(map.z_min[i]) + 1, i32::from(map.z_max[i]) - 1);
        let expected = i32::from(expected).clamp(low.min(high), high.max(low));
        let value = value.unwrap_or_default();
        let z = expected + coder.number(&mut self.outer_height[model], i32::from(value.z) - expected);
        Some(OuterTop { z: z.clamp(0, i32::from(Z_CODE_MAX)) as u16, roof: value.roof })
    }

    fn code_corner<C: BitCoder>(
        &mut self,
        coder: &mut C,
        nearby: &[NearbyWall],
        azimuth: u8,
        value: Option<CornerWall>,
    ) -> Option<CornerWall> {
        let has_other = nearby.iter().any(|wall| wall.azimuth != azimuth);
        let has_same = nearby.iter().any(|wall| wall.azimuth == azimuth);
        let context = usize::from(has_other) + 2 * usize::from(has_same);
        if !coder.bit(&mut self.corner[context], value.is_some()) {
            return None;
        }
        let value = value.unwrap_or_default();
        let concave = coder.bit(&mut self.concave, value.concave);
        let azimuth = self.azimuth.code(coder, azimuths(nearby), Some(azimuth), value.azimuth);
        let offset = code_offset(coder, &mut self.corner_offset, nearby, azimuth, value.offset);
        Some(CornerWall { azimuth, offset, concave })
    }
}

/// Codes the offset of a plane. It is predicted from a nearby wall of the same azimuth, which is the same wall.
fn code_offset<C: BitCoder>(
    coder: &mut C,
    models: &mut [NumberModel; 2],
    nearby: &[NearbyWall],
    azimuth: u8,
    value: i8,
) -> i8 {
    let known = nearby.iter().find(|wall| wall.azimuth == azimuth).and_then(|wall| wall.offset);
    let expected = known.unwrap_or(0);
    let offset = expected + coder.number(&mut models[usize::from(known.is_none())], i32::from(value) - expected);
    offset.clamp(i32::from(i8::MIN), i32::from(i8::MAX)) as i8
}

/// Number of recent azimuths that can be referred to by their position in a list.
const RECENT: usize = 16;

/// Cosines of the first quarter turn of azimuths, in 1/16384. A table, so that all machines agree.
#[rustfmt::skip]
const COSINE: [i16; 65] = [
    16384, 16379, 16364, 16340, 16305, 16261, 16207, 16143, 16069, 15986, 15893, 15791, 15679,
    15557, 15426, 15286, 15137, 14978, 14811, 14635, 14449, 14256, 14053, 13842, 13623, 13395,
    13160, 12916, 12665, 12406, 12140, 11866, 11585, 11297, 11003, 10702, 10394, 10080, 9760,
    9434, 9102, 8765, 8423, 8076, 7723, 7366, 7005, 6639, 6270, 5897, 5520, 5139,
    4756, 4370, 3981, 3590, 3196, 2801, 2404, 2006, 1606, 1205, 804, 402, 0,
];

/// The unit vector of an azimuth in 1/16384.
fn direction(azimuth: u8) -> [i32; 2] {
    let cosine = |azimuth: u8| {
        let from_axis = if azimuth > 128 { 256 - usize::from(azimuth) } else { usize::from(azimuth) };
        if from_axis > 64 { -i32::from(COSINE[128 - from_axis]) } else { i32::from(COSINE[from_axis]) }
    };
    [cosine(azimuth), cosine(azimuth.wrapping_sub(64))]
}

/// Models of azimuths. Where there are two, the first is for a column's own wall and the second for a corner's.
#[derive(Default)]
pub(super) struct AzimuthModels {
    nearby: [[BitModel; 3]; 2],
    is_recent: [BitModel; 2],
    recent: [[BitModel; RECENT - 1]; 2],
    turn: [NumberModel; 2],
    /// Recent azimuths, the latest first.
    list: Vec<u8>,
}

impl AzimuthModels {
    /// Codes an azimuth: as one of `nearby`, else as a recent one, else as a turn from the latest. For a corner, `own`
    /// is the azimuth of the column's own wall, which the other wall cannot have.
    pub(super) fn code<C: BitCoder>(
        &mut self,
        coder: &mut C,
        nearby: impl Iterator<Item = u8>,
        own: Option<u8>,
        value: u8,
    ) -> u8 {
        let is_corner = usize::from(own.is_some());
        for (k, azimuth) in nearby.filter(|azimuth| Some(*azimuth) != own).enumerate() {
            if coder.bit(&mut self.nearby[is_corner][k.min(2)], value == azimuth) {
                return azimuth;
            }
        }
        let found = self.list.iter().position(|azimuth| *azimuth == value);
        if coder.bit(&mut self.is_recent[is_corner], found.is_some()) {
            let at = coder.choice(&mut self.recent[is_corner], found.unwrap_or(0) as u32) as usize;
            let at = at.min(self.list.len().saturating_sub(1));
            let azimuth = self.list.get(at).copied().unwrap_or_default();
            if let Some(front) = self.list.get_mut(..=at) {
                front.rotate_right(1);
            }
            return azimuth;
        }
        let latest = self.list.first().copied().unwrap_or(0);
        let turn = coder.number(&mut self.turn[is_corner], i32::from(value.wrapping_sub(latest) as i8));
        let azimuth = latest.wrapping_add(turn as u8);
        self.list.truncate(RECENT - 1);
        self.list.insert(0, azimuth);
        azimuth
    }
}
