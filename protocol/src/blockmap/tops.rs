//! Column tops: which columns exist, and their flags, normals and heights. All lossless, row by row.

use super::neighbours::{WIDTH, median, rim_index};
use super::{BlockMap, COLUMNS, NODE_CELLS, STEPS_PER_CELL, Z_CODE_MAX, flag};
use crate::codec::range::{BitCoder, BitModel, GroupFlag, NumberModel};

/// Number of recent normals that can be referred to by their position in a list.
const RECENT: usize = 16;
/// The octahedral code of straight up.
const UP: u16 = 0x7f7f;

/// A neighbour that precedes a column in row-major order.
struct KnownNeighbour {
    /// Distance back in the grid with a rim.
    back: usize,
    /// From the neighbour to the column, in cells.
    step: [i32; 2],
}

/// West, south, south-west, south-east.
const KNOWN: [KnownNeighbour; 4] = [
    KnownNeighbour { back: 1, step: [1, 0] },
    KnownNeighbour { back: WIDTH, step: [0, 1] },
    KnownNeighbour { back: WIDTH + 1, step: [1, 1] },
    KnownNeighbour { back: WIDTH - 1, step: [-1, 1] },
];

/// Flags that must be equal for two tops to share a plane.
const PLANE_FLAGS: u8 = flag::OCCUPIED | flag::INCLINED;

/// The top of a column as its neighbours see it. Empty cells are all zero.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ColumnTop {
    /// Height code at the cell's centre.
    pub(super) z: i32,
    normal: u16,
    pub(super) flags: u8,
    /// Rise per cell to the east and to the north, in sixteenths of a height code.
    slope: [i16; 2],
}

impl ColumnTop {
    /// Reads the top of column `i`.
    pub(super) fn of(map: &BlockMap, i: usize) -> Self {
        let (flags, normal) = (map.flags[i], map.roof_normal[i]);
        let slope = if flags & flag::INCLINED != 0 { slope(normal, map.z_shift) } else { [0; 2] };
        Self { z: i32::from(map.z_max[i]), normal, flags, slope }
    }

    pub(super) fn is_occupied(&self) -> bool {
        self.flags & flag::OCCUPIED != 0
    }

    /// The height code of the top's plane, `step` cells from the centre.
    pub(super) fn plane_at(&self, [dx, dy]: [i32; 2]) -> i32 {
        self.z + ((i32::from(self.slope[0]) * dx + i32::from(self.slope[1]) * dy + 8) >> 4)
    }

    /// The height code of the lowest point of the top inside its cell; the maximum for an empty cell.
    pub(super) fn lowest(&self) -> i32 {
        let [x, y] = self.slope.map(|s| i32::from(s).abs());
        if self.is_occupied() { self.z - (((x + y) * 3) >> 7) } else { i32::MAX }
    }
}

/// The slope of an octahedral normal; 0 for vertical surfaces.
fn slope(normal: u16, z_shift: u8) -> [i16; 2] {
    let [u, v] = normal.to_le_bytes().map(|b| i32::from(b.min(254)) - 127);
    let up = 127 - u.abs() - v.abs();
    if up <= 0 {
        return [0; 2];
    }
    let codes_per_cell = i32::from(STEPS_PER_CELL >> z_shift);
    [u, v].map(|w| ((-w * codes_per_cell * 32 + up).div_euclid(2 * up)).clamp(-4096, 4096) as i16)
}

#[derive(Default)]
struct TopModels {
    occupied: [BitModel; 16],
    suspended: [BitModel; 9],
    inclined: [BitModel; 9],
    same_normal: [[BitModel; 4]; 4],
    is_recent: [BitModel; 2],
    recent: [[BitModel; RECENT - 1]; 2],
    normal: [NumberModel; 2],
    height: [NumberModel; 10],
}

/// Writes or reads which columns exist, their flags `SUSPENDED` and `INCLINED`, their normals and their tops. Returns
/// the tops on the grid with a rim.
pub(super) fn code<C: BitCoder>(coder: &mut C, map: &mut BlockMap) -> Vec<ColumnTop> {
    let mut models = Box::<TopModels>::default();
    let mut recent = RecentNormals::default();
    let mut tops = vec![ColumnTop::default(); WIDTH * WIDTH];
    let mut last_z = 0;
    let occupied = code_group_occupancy(coder, map);
    let mut code_share = |bit: u8| {
        let columns = map.flags.iter().filter(|f| **f & flag::OCCUPIED != 0);
        let group = if C::WRITES { GroupFlag::of(columns.map(|f| f & bit != 0)) } else { GroupFlag::Unset };
        group.code(coder, &mut [BitModel::NEW; 2])
    };
    let (suspended, inclined) = (code_share(flag::SUSPENDED), code_share(flag::INCLINED));
    for i in 0..COLUMNS {
        let occupied = occupied[group_of(i)];
        if occupied == GroupFlag::Unset {
            continue;
        }
        let at = rim_index(i);
        let known = &KNOWN.map(|neighbour| &tops[at - neighbour.back]);
        if occupied == GroupFlag::Mixed {
            let pattern = known.iter().enumerate().map(|(k, t)| usize::from(t.is_occupied()) << k).sum::<usize>();
            if !coder.bit(&mut models.occupied[pattern], map.flags[i] & flag::OCCUPIED != 0) {
                continue;
            }
        }
        // Of the western and southern neighbours: 0 empty, 1 without the flag, 2 with the flag.
        let state = |top: &ColumnTop, bit: u8| usize::from(top.is_occupied()) + usize::from(top.flags & bit != 0);
        let context = |bit: u8| state(known[0], bit) * 3 + state(known[1], bit);
        let mut flags = flag::OCCUPIED;
        for (group, models, bit) in
            [(suspended, &mut models.suspended, flag::SUSPENDED), (inclined, &mut models.inclined, flag::INCLINED)]
        {
            if group.bit(coder, &mut models[context(bit)], map.flags[i] & bit != 0) {
                flags |= bit;
            }
        }
        let mut normals = NormalCoder { models: &mut models, recent: &mut recent, z_shift: map.z_shift };
        let (normal, slope) = normals.code(coder, known, flags, map.roof_normal[i]);
        let mut top = ColumnTop { z: 0, normal, flags, slope };
        let (expected, confidence) = predict_top(&top, known, last_z);
        let difference = i32::from(map.z_max[i]) - expected;
        let z = expected + coder.number(&mut models.height[confidence], difference);
        top.z = z.clamp(0, i32::from(u16::MAX));
        last_z = top.z;
        tops[at] = top;
        if !C::WRITES {
            map.flags[i] = flags;
            map.roof_normal[i] = normal;
            map.z_max[i] = top.z as u16;
        }
    }
    tops
}

/// Side in columns of the groups that are coded as full or empty as a whole.
const GROUP_SIDE: usize = 8;
const GROUPS_PER_SIDE: usize = NODE_CELLS / GROUP_SIDE;

fn group_of(i: usize) -> usize {
    i / NODE_CELLS / GROUP_SIDE * GROUPS_PER_SIDE + i % NODE_CELLS / GROUP_SIDE
}

/// Codes for each group whether all, none or some of its columns exist.
fn code_group_occupancy<C: BitCoder>(coder: &mut C, map: &BlockMap) -> [GroupFlag; GROUPS_PER_SIDE * GROUPS_PER_SIDE] {
    let mut models = [[BitModel::NEW; 2]; 9];
    let mut groups = [GroupFlag::Unset; GROUPS_PER_SIDE * GROUPS_PER_SIDE];
    for at in 0..groups.len() {
        let corner = at / GROUPS_PER_SIDE * GROUP_SIDE * NODE_CELLS + at % GROUPS_PER_SIDE * GROUP_SIDE;
        let columns = (0..GROUP_SIDE * GROUP_SIDE).map(|k| corner + k / GROUP_SIDE * NODE_CELLS + k % GROUP_SIDE);
        let group = if C::WRITES {
            GroupFlag::of(columns.map(|i| map.flags[i] & flag::OCCUPIED != 0))
        } else {
            GroupFlag::Unset
        };
        let west = if at % GROUPS_PER_SIDE > 0 { groups[at - 1] } else { GroupFlag::Mixed };
        let south = if at >= GROUPS_PER_SIDE { groups[at - GROUPS_PER_SIDE] } else { GroupFlag::Mixed };
        groups[at] = group.code(coder, &mut models[west as usize * 3 + south as usize]);
    }
    groups
}

/// Recently used normals, the latest first.
#[derive(Default)]
struct RecentNormals {
    list: Vec<u16>,
}

impl RecentNormals {
    fn position(&self, normal: u16) -> Option<usize> {
        self.list.iter().position(|n| *n == normal)
    }

    /// Moves a normal to the front.
    fn touch(&mut self, normal: u16) {
        let at = self.position(normal).unwrap_or_else(|| {
            self.list.truncate(RECENT - 1);
            self.list.push(normal);
            self.list.len() - 1
        });
        self.list[..=at].rotate_right(1);
    }
}

struct NormalCoder<'a> {
    models: &'a mut TopModels,
    recent: &'a mut RecentNormals,
    z_shift: u8,
}

impl NormalCoder<'_> {
    /// Codes a normal: as that of a known neighbour, else as a recent one, else as differences of its two bytes.
    /// Returns it with its slope.
    fn code<C: BitCoder>(&mut self, coder: &mut C, known: &[&ColumnTop; 4], flags: u8, value: u16) -> (u16, [i16; 2]) {
        let is_inclined = usize::from(flags & flag::INCLINED != 0);
        let mut first = None;
        for k in 0..4 {
            let top = known[k];
            let was_tried = |j: &&ColumnTop| j.normal == top.normal && (flags ^ j.flags) & PLANE_FLAGS == 0;
            if (flags ^ top.flags) & PLANE_FLAGS != 0 || known[..k].iter().any(was_tried) {
                continue;
            }
            let mut agreeing = 0;
            for other in known {
                agreeing += usize::from(other.normal == top.normal && other.is_occupied());
            }
            let models = &mut self.models.same_normal[if first.is_some() { 2 } else { 0 } + is_inclined];
            if coder.bit(&mut models[(agreeing - 1) & 3], value == top.normal) {
                return (top.normal, top.slope);
            }
            first = first.or(Some(top.normal));
        }
        let normal = self.code_unlike_neighbours(coder, is_inclined, first.unwrap_or(UP), value);
        self.recent.touch(normal);
        (normal, if is_inclined == 0 { [0; 2] } else { slope(normal, self.z_shift) })
    }

    fn code_unlike_neighbours<C: BitCoder>(&mut self, coder: &mut C, is_inclined: usize, near: u16, value: u16) -> u16 {
        let at = if C::WRITES { self.recent.position(value) } else { None };
        if coder.bit(&mut self.models.is_recent[is_inclined], at.is_some()) {
            let at = coder.choice(&mut self.models.recent[is_inclined], at.unwrap_or(0) as u32) as usize;
            return self.recent.list.get(at).copied().unwrap_or_default();
        }
        let (near, value) = (near.to_le_bytes(), value.to_le_bytes());
        let mut code_byte = |k: usize| {
            let difference = i32::from(value[k].wrapping_sub(near[k]) as i8);
            near[k].wrapping_add(coder.number(&mut self.models.normal[k], difference) as u8)
        };
        u16::from_le_bytes([code_byte(0), code_byte(1)])
    }
}

/// Predicts the height of a top from its neighbours. Returns it with the model to use: 5 levels of confidence, for
/// level and for inclined tops.
fn predict_top(own: &ColumnTop, known: &[&ColumnTop; 4], last_z: i32) -> (i32, usize) {
    let inclined = if own.flags & flag::INCLINED != 0 { 5 } else { 0 };
    let (mut sum, mut count, mut low, mut high, mut first) = (0, 0, i32::MAX, i32::MIN, 0);
    for k in (0..4).rev() {
        let top = known[k];
        if top.normal == own.normal && (top.flags ^ own.flags) & PLANE_FLAGS == 0 {
            first = top.plane_at(KNOWN[k].step);
            (sum, count, low, high) = (sum + first, count + 1, low.min(first), high.max(first));
        }
    }
    let agreement = if high == low { 4 } else { 3 };
    let [west, south, south_west, _] = known;
    let (expected, confidence) = match count {
        0 => {
            let expected = match (west.is_occupied(), south.is_occupied(), south_west.is_occupied()) {
                (true, true, true) => median(west.z, south.z, south_west.z),
                (true, ..) => west.z,
                (false, true, _) => south.z,
                _ => last_z,
            };
            (expected, 0)
        }
        1 => (first, 1),
        _ if high - low > 2 => (first, 2),
        2 => ((sum + 1) >> 1, agreement),
        3 => ((2 * sum + 3).div_euclid(6), agreement),
        _ => ((2 * sum + 4) >> 3, agreement),
    };
    (expected.clamp(0, i32::from(Z_CODE_MAX)), inclined + confidence)
}
