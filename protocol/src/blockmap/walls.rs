//! Which columns are walls, and how they follow each other along a facade.
//!
//! In: a [`BitCoder`] and a map with its columns' shapes. Out: flags, azimuths, gaps and planes; the [`Facade`] order.
//! Next: `looks`.

use super::{
    BlockMap, CLIP_STEPS_PER_CELL, COLUMNS, ColumnClip, CornerWall, NODE_CELLS, OuterTop, STEPS_PER_CELL, Z_CODE_MAX,
    flag,
    geometry::{self, WIDTH, neighbour},
};
use crate::codec::range::{BitCoder, BitModel, GroupFlag, NumberModel};

/// Neighbours in the order in which a facade is followed: along the grid first.
const AROUND: [(i32, i32); 8] = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)];

/// One step along a facade.
#[derive(Debug, Clone, Copy)]
pub(super) struct FacadeStep {
    /// An exposed column.
    pub(super) column: usize,
    /// The exposed column beside it that came before; `None` where a facade begins.
    pub(super) before: Option<usize>,
}

/// Whether columns are exposed: nearly always, those whose sides are open by more than a cell.
pub(super) fn exposed<C: BitCoder>(coder: &mut C, map: &mut BlockMap) {
    let classes = openness(map);
    let mut shares = [GroupFlag::Unset; CLASSES];
    let mut models = [[BitModel::NEW; 2]; CLASSES];
    for class in 0..CLASSES {
        let members = (0..COLUMNS).filter(|i| usize::from(classes[*i]) == class);
        let share = if C::WRITES {
            GroupFlag::of(members.map(|i| map.flags[i] & flag::EXPOSED != 0))
        } else {
            GroupFlag::Unset
        };
        shares[class] = share.code(coder, &mut models[class]);
    }
    let mut models = [BitModel::NEW; CLASSES];
    for (i, class) in classes.into_iter().enumerate().filter(|(_, class)| *class != NOTHING) {
        let class = usize::from(class);
        let exposed = shares[class].bit(coder, &mut models[class], map.flags[i] & flag::EXPOSED != 0);
        if exposed && !C::WRITES {
            map.flags[i] |= flag::EXPOSED;
        }
    }
}

/// Classes of [`openness`].
const CLASSES: usize = 20;
/// Class of a cell without a column.
const NOTHING: u8 = CLASSES as u8;

/// Where the ten classes of [`openness`] end but for the last, in sixteenths of a row more than one row.
const ENDS: [i16; 9] = [-12, -6, -3, -1, 0, 2, 5, 12, 32];

/// How far the side that is most open is open, in ten classes; ten more on the node's rim.
fn openness(map: &BlockMap) -> Vec<u8> {
    let most = most_open(map);
    let mut classes = vec![0u8; COLUMNS];
    // Bound by bound over all columns: loops that a compiler makes wide.
    for end in ENDS {
        let bound = (STEPS_PER_CELL >> map.z_shift) as i16 + (end >> map.z_shift);
        classes.iter_mut().zip(&most).for_each(|(class, most)| *class += u8::from(*most > bound));
    }
    for k in 0..NODE_CELLS {
        let last = NODE_CELLS - 1;
        for (x, y) in [(k, 0), (k, last), (0, k), (last, k)] {
            let class = &mut classes[y * NODE_CELLS + x];
            *class = *class % 10 + 10;
        }
    }
    let empty = |(class, flags): (&mut u8, &u8)| *class = if flags & flag::OCCUPIED == 0 { NOTHING } else { *class };
    classes.iter_mut().zip(&map.flags).for_each(empty);
    classes
}

/// How many codes of each column's height stand free on the side where most do; nothing is beyond the node.
fn most_open(map: &BlockMap) -> Vec<i16> {
    // From lowest to highest on the grid with its rim, which hides everything. Codes have twelve bits.
    let (mut low, mut high) = (vec![0i16; WIDTH * WIDTH], vec![i16::MAX; WIDTH * WIDTH]);
    let code = |z: &u16| (*z).min(Z_CODE_MAX) as i16;
    for y in 0..NODE_CELLS {
        let (row, at) = (y * NODE_CELLS..(y + 1) * NODE_CELLS, geometry::place(y * NODE_CELLS));
        low[at..].iter_mut().zip(&map.z_min[row.clone()]).for_each(|(low, z)| *low = code(z));
        high[at..].iter_mut().zip(&map.z_max[row]).for_each(|(high, z)| *high = code(z));
    }
    let mut most = vec![0i16; COLUMNS];
    for (y, most) in most.chunks_exact_mut(NODE_CELLS).enumerate() {
        let at = geometry::place(y * NODE_CELLS);
        let part = |from: usize| (&low[from..from + NODE_CELLS], &high[from..from + NODE_CELLS]);
        let (own_low, own_high) = part(at);
        for from in [at - 1, at + 1, at - WIDTH, at + WIDTH] {
            let (low, high) = part(from);
            for x in 0..NODE_CELLS {
                let cover = high[x].min(own_high[x]) - low[x].max(own_low[x]);
                most[x] = most[x].max(own_high[x] - own_low[x] - cover.max(0));
            }
        }
    }
    most
}

/// The exposed columns, each after one that stands beside it.
pub(super) fn facades(map: &BlockMap) -> Vec<FacadeStep> {
    // Exposed and not met yet, on the grid with its rim.
    let mut left = vec![false; WIDTH * WIDTH];
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::EXPOSED != 0) {
        left[geometry::place(i)] = true;
    }
    let mut steps = Vec::with_capacity(COLUMNS);
    let mut open: Vec<FacadeStep> = Vec::with_capacity(256);
    for start in 0..COLUMNS {
        if !left[geometry::place(start)] {
            continue;
        }
        open.push(FacadeStep { column: start, before: None });
        while let Some(step) = open.pop() {
            let at = geometry::place(step.column);
            if !std::mem::replace(&mut left[at], false) {
                continue;
            }
            steps.push(step);
            for (dx, dy) in AROUND.iter().rev() {
                if left[at.wrapping_add_signed((dy * WIDTH as i32 + dx) as isize)] {
                    let column = step.column.wrapping_add_signed((dy * NODE_CELLS as i32 + dx) as isize);
                    open.push(FacadeStep { column, before: Some(step.column) });
                }
            }
        }
    }
    steps
}

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

/// Flags, azimuths, gaps and planes of the exposed columns, along the facades.
pub(super) fn walls<C: BitCoder>(coder: &mut C, map: &mut BlockMap, steps: &[FacadeStep]) {
    let mut models = Box::<WallModels>::default();
    let mut gaps = vec![[0u16; 2]; COLUMNS];
    let mut clips = vec![ColumnClip::default(); COLUMNS];
    if C::WRITES {
        spread(map, flag::GAP, &map.gaps, &mut gaps);
        spread(map, flag::CLIPPED, &map.clips, &mut clips);
    }
    let mut shared = |bit: u8| {
        let exposed = map.flags.iter().filter(|f| **f & flag::EXPOSED != 0);
        let share = if C::WRITES { GroupFlag::of(exposed.map(|f| f & bit != 0)) } else { GroupFlag::Unset };
        share.code(coder, &mut [BitModel::NEW; 2])
    };
    let [with_gaps, with_holes, with_clips] = [flag::GAP, flag::HOLES, flag::CLIPPED].map(&mut shared);
    let mut done = vec![false; WIDTH * WIDTH];
    for &FacadeStep { column: i, before } in steps {
        let with = |map: &BlockMap, bit: u8| before.map_or(0, |j| 1 + usize::from(map.flags[j] & bit != 0));
        let context = with(map, flag::GAP);
        let gap = with_gaps.bit(coder, &mut models.gap[context], map.flags[i] & flag::GAP != 0);
        let context = with(map, flag::HOLES);
        let holes = with_holes.bit(coder, &mut models.holes[context], map.flags[i] & flag::HOLES != 0);
        let context = with(map, flag::CLIPPED);
        let clipped = with_clips.bit(coder, &mut models.clipped[context], map.flags[i] & flag::CLIPPED != 0);
        if !C::WRITES {
            let bits = [(gap, flag::GAP), (holes, flag::HOLES), (clipped, flag::CLIPPED)];
            map.flags[i] |= bits.iter().filter(|(on, _)| *on).map(|(_, bit)| bit).sum::<u8>();
        }
        let near = NearbyWalls::new(map, &done, &clips, i, before);
        let near = near.walls();
        map.wall_azimuth[i] = code_azimuth(coder, &mut models.azimuth, near, None, map.wall_azimuth[i]);
        if gap {
            gaps[i] = code_gap(coder, &mut models.gap_height, map, i, before.map(|j| gaps[j]), gaps[i]);
        }
        if clipped {
            clips[i] = code_clip(coder, &mut models, map, near, i, before, &clips);
        }
        done[geometry::place(i)] = true;
    }
    if !C::WRITES {
        map.gaps = gather(map, flag::GAP, &gaps);
        map.clips = gather(map, flag::CLIPPED, &clips);
    }
}

fn spread<T: Copy>(map: &BlockMap, bit: u8, list: &[T], places: &mut [T]) {
    let columns = (0..COLUMNS).filter(|i| map.flags[*i] & bit != 0);
    columns.zip(list).for_each(|(i, value)| places[i] = *value);
}

fn gather<T: Copy>(map: &BlockMap, bit: u8, places: &[T]) -> Vec<T> {
    map.flags.iter().zip(places).filter(|(flags, _)| **flags & bit != 0).map(|(_, place)| *place).collect()
}

/// A wall that goes on from a neighbour: its azimuth and where its plane would be here.
#[derive(Debug, Clone, Copy)]
struct NearbyWall {
    azimuth: u8,
    offset: Option<i32>,
}

/// Walls nearby, no two of one azimuth.
struct NearbyWalls {
    walls: [NearbyWall; 18],
    count: usize,
}

impl NearbyWalls {
    /// The walls of the neighbours that are done, first those of the column before.
    fn new(map: &BlockMap, done: &[bool], clips: &[ColumnClip], i: usize, before: Option<usize>) -> Self {
        let mut near = Self { walls: [NearbyWall { azimuth: 0, offset: None }; 18], count: 0 };
        if let Some(j) = before {
            near.add_column(map, clips, i, j);
        }
        let at = geometry::place(i);
        for (dx, dy) in AROUND {
            if done[at.wrapping_add_signed((dy * WIDTH as i32 + dx) as isize)] {
                let j = i.wrapping_add_signed((dy * NODE_CELLS as i32 + dx) as isize);
                if Some(j) != before {
                    near.add_column(map, clips, i, j);
                }
            }
        }
        near
    }

    fn add_column(&mut self, map: &BlockMap, clips: &[ColumnClip], i: usize, j: usize) {
        let [first, corner] = planes(map, clips, j);
        let here = |(azimuth, offset): WallPlane| NearbyWall { azimuth, offset: Some(carried(j, i, azimuth, offset)) };
        self.add(first.map_or(NearbyWall { azimuth: map.wall_azimuth[j], offset: None }, here));
        if let Some(corner) = corner {
            self.add(here(corner));
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

/// The offset in column `i` of the plane that has `offset` in column `j`.
fn carried(j: usize, i: usize, azimuth: u8, offset: i8) -> i32 {
    let [nx, ny] = direction(azimuth);
    let (n, i, j) = (NODE_CELLS as i32, i as i32, j as i32);
    let along = nx * (j % n - i % n) + ny * (j / n - i / n);
    i32::from(offset) + ((along * CLIP_STEPS_PER_CELL + 8192) >> 14)
}

/// How many azimuths are remembered.
const RECENT: usize = 16;

#[derive(Default)]
struct AzimuthModels {
    near: [[BitModel; 3]; 2],
    listed: [BitModel; 2],
    recent: [[BitModel; RECENT - 1]; 2],
    turn: [NumberModel; 2],
    /// AzimuthModels, the one that came up last in front.
    list: Vec<u8>,
}

/// An azimuth: that of a wall nearby, else one that came up lately, else by how much it turns. `but` is not looked for.
fn code_azimuth<C: BitCoder>(
    coder: &mut C,
    models: &mut AzimuthModels,
    near: &[NearbyWall],
    but: Option<u8>,
    value: u8,
) -> u8 {
    let kind = usize::from(but.is_some());
    let near = near.iter().map(|wall| wall.azimuth).filter(|azimuth| Some(*azimuth) != but);
    for (k, azimuth) in near.enumerate() {
        if coder.bit(&mut models.near[kind][k.min(2)], value == azimuth) {
            return azimuth;
        }
    }
    let found = models.list.iter().position(|azimuth| *azimuth == value);
    if coder.bit(&mut models.listed[kind], found.is_some()) {
        let place = coder.choice(&mut models.recent[kind], found.unwrap_or(0) as u32) as usize;
        let place = place.min(models.list.len().saturating_sub(1));
        let azimuth = models.list.get(place).copied().unwrap_or_default();
        models.list.get_mut(..=place).into_iter().for_each(|front| front.rotate_right(1));
        return azimuth;
    }
    let guess = models.list.first().copied().unwrap_or(0);
    let turn = coder.number(&mut models.turn[kind], i32::from(value.wrapping_sub(guess) as i8));
    let azimuth = guess.wrapping_add(turn as u8);
    models.list.truncate(RECENT - 1);
    models.list.insert(0, azimuth);
    azimuth
}

fn code_gap<C: BitCoder>(
    coder: &mut C,
    models: &mut [NumberModel; 2],
    map: &BlockMap,
    i: usize,
    before: Option<[u16; 2]>,
    gap: [u16; 2],
) -> [u16; 2] {
    let before = before.filter(|gap| *gap != [0; 2]).unwrap_or([map.z_min[i], map.z_max[i]]);
    let mut part = |k: usize| {
        let guess = i32::from(before[k]);
        (guess + coder.number(&mut models[k], i32::from(gap[k]) - guess)).clamp(0, i32::from(u16::MAX)) as u16
    };
    [part(0), part(1)]
}

/// Cosines of the first quarter of the azimuths, in parts of 16384: a table, so that all machines agree.
#[rustfmt::skip]
const COSINE: [i16; 65] = [
    16384, 16379, 16364, 16340, 16305, 16261, 16207, 16143, 16069, 15986, 15893, 15791, 15679,
    15557, 15426, 15286, 15137, 14978, 14811, 14635, 14449, 14256, 14053, 13842, 13623, 13395,
    13160, 12916, 12665, 12406, 12140, 11866, 11585, 11297, 11003, 10702, 10394, 10080, 9760,
    9434, 9102, 8765, 8423, 8076, 7723, 7366, 7005, 6639, 6270, 5897, 5520, 5139,
    4756, 4370, 3981, 3590, 3196, 2801, 2404, 2006, 1606, 1205, 804, 402, 0,
];

/// The unit vector of an azimuth, in parts of 16384.
fn direction(azimuth: u8) -> [i32; 2] {
    let cosine = |azimuth: u8| {
        let from_axis = if azimuth > 128 { 256 - usize::from(azimuth) } else { usize::from(azimuth) };
        if from_axis > 64 { -i32::from(COSINE[128 - from_axis]) } else { i32::from(COSINE[from_axis]) }
    };
    [cosine(azimuth), cosine(azimuth.wrapping_sub(64))]
}

/// A wall's plane: its azimuth and its offset from the centre of some column.
type WallPlane = (u8, i8);

/// The planes of a column that is clipped.
fn planes(map: &BlockMap, clips: &[ColumnClip], i: usize) -> [Option<WallPlane>; 2] {
    if map.flags[i] & flag::CLIPPED == 0 {
        return [None; 2];
    }
    let clip = clips[i];
    [Some((map.wall_azimuth[i], clip.offset)), clip.corner.map(|corner| (corner.azimuth, corner.offset))]
}

/// One plane's offset, guessed from a neighbour's if that faces the same way: it is the same wall.
fn code_offset<C: BitCoder>(
    coder: &mut C,
    models: &mut [NumberModel; 2],
    near: &[NearbyWall],
    azimuth: u8,
    value: i8,
) -> i8 {
    let known = near.iter().find(|wall| wall.azimuth == azimuth).and_then(|wall| wall.offset);
    let guess = known.unwrap_or(0);
    let offset = guess + coder.number(&mut models[usize::from(known.is_none())], i32::from(value) - guess);
    offset.clamp(i32::from(i8::MIN), i32::from(i8::MAX)) as i8
}

fn code_clip<C: BitCoder>(
    coder: &mut C,
    models: &mut WallModels,
    map: &BlockMap,
    near: &[NearbyWall],
    i: usize,
    before: Option<usize>,
    clips: &[ColumnClip],
) -> ColumnClip {
    let azimuth = map.wall_azimuth[i];
    let before = before.filter(|j| map.flags[*j] & flag::CLIPPED != 0);
    let value = clips[i];
    let offset = code_offset(coder, &mut models.offset, near, azimuth, value.offset);
    let corner = code_corner(coder, models, near, azimuth, value.corner);
    // The outer part most often goes on as the column does that the wall looks at.
    let towards = |v: i32| if v.abs() > 6270 { v.signum() } else { 0 };
    let [nx, ny] = direction(azimuth);
    let beyond = neighbour(i, (towards(nx), towards(ny))).filter(|j| map.flags[*j] & flag::OCCUPIED != 0);
    let context = before.map_or(0, |j| 1 + usize::from(clips[j].outer.is_some())) * 2 + usize::from(beyond.is_some());
    if !coder.bit(&mut models.outer[context], value.outer.is_some()) {
        return ColumnClip { offset, corner, outer: None };
    }
    let from = before.and_then(|j| clips[j].outer).map(|outer| outer.z);
    let (low, high) = (i32::from(map.z_min[i]) + 1, i32::from(map.z_max[i]) - 1);
    // One or two cells on, the first that is lower.
    let lower = (1..=2).find_map(|k| {
        let (dx, dy) = (towards(nx) * k, towards(ny) * k);
        let j = neighbour(i, (dx, dy)).filter(|j| map.flags[*j] & flag::OCCUPIED != 0)?;
        let top = geometry::plane_at(map, j, [-dx, -dy]);
        (top < i32::from(map.z_max[i]) - i32::from(STEPS_PER_CELL >> map.z_shift) / 2).then_some(top as u16)
    });
    let (guess, model) = match (lower, from) {
        (Some(z), _) => (z, 0),
        (_, Some(z)) => (z, 1),
        _ => (map.z_min[i], 2),
    };
    let guess = i32::from(guess).clamp(low.min(high), high.max(low));
    let value = value.outer.unwrap_or_default();
    let z = guess + coder.number(&mut models.outer_height[model], i32::from(value.z) - guess);
    let z = z.clamp(0, i32::from(Z_CODE_MAX)) as u16;
    ColumnClip { offset, corner, outer: Some(OuterTop { z, roof: value.roof }) }
}

/// The other wall of a corner.
fn code_corner<C: BitCoder>(
    coder: &mut C,
    models: &mut WallModels,
    near: &[NearbyWall],
    azimuth: u8,
    value: Option<CornerWall>,
) -> Option<CornerWall> {
    let other = near.iter().any(|wall| wall.azimuth != azimuth);
    let same = near.iter().any(|wall| wall.azimuth == azimuth);
    let context = usize::from(other) + 2 * usize::from(same);
    if !coder.bit(&mut models.corner[context], value.is_some()) {
        return None;
    }
    let value = value.unwrap_or_default();
    let concave = coder.bit(&mut models.concave, value.concave);
    let azimuth = code_azimuth(coder, &mut models.azimuth, near, Some(azimuth), value.azimuth);
    let offset = code_offset(coder, &mut models.corner_offset, near, azimuth, value.offset);
    Some(CornerWall { azimuth, offset, concave })
}
