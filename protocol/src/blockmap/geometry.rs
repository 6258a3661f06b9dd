//! The columns' shapes, without loss: which there are, how their tops lie, where they end.
//!
//! In: a [`BitCoder`] and a map, whose shapes it writes or fills in. Out: the map. Next: `walls`.

use super::{BlockMap, COLUMNS, NODE_CELLS, STEPS_PER_CELL, Z_CODE_MAX, flag};
use crate::codec::range::{BitCoder, BitModel, GroupFlag, NumberModel};

/// Normals that came up last are named by their place in a list of so many.
const RECENT: usize = 16;
/// Width of the grid with a rim of empty cells, so that every cell has neighbours.
pub(super) const WIDTH: usize = NODE_CELLS + 2;
/// The neighbours that are known when a column is coded row by row, as steps back in the grid with its rim and as steps
/// from the neighbour to the column: west, south, south-west, south-east.
const KNOWN: [(usize, [i32; 2]); 4] = [(1, [1, 0]), (WIDTH, [0, 1]), (WIDTH + 1, [1, 1]), (WIDTH - 1, [-1, 1])];

/// Writes or reads bits 0, 2 and 5 of the flags, and normals and heights.
pub(super) fn columns<C: BitCoder>(coder: &mut C, map: &mut BlockMap) {
    let tops = tops(coder, map);
    bottoms(coder, map, &tops);
}

/// The neighbour's index, if it lies in the node.
#[inline]
pub(super) fn neighbour(i: usize, (dx, dy): (i32, i32)) -> Option<usize> {
    let n = NODE_CELLS as i32;
    let (x, y) = (i as i32 % n + dx, i as i32 / n + dy);
    ((0..n).contains(&x) && (0..n).contains(&y)).then_some((y * n + x) as usize)
}

/// A column as its neighbours see it.
#[derive(Debug, Clone, Copy, Default)]
struct ColumnTop {
    z: i32,
    normal: u16,
    flags: u8,
    /// Rise over a cell to the east and to the north, in sixteenths of a code.
    slope: [i16; 2],
}

impl ColumnTop {
    fn occupied(&self) -> bool {
        self.flags & flag::OCCUPIED != 0
    }

    /// Where its plane goes on to.
    fn at(&self, [dx, dy]: [i32; 2]) -> i32 {
        self.z + ((i32::from(self.slope[0]) * dx + i32::from(self.slope[1]) * dy + 8) >> 4)
    }
}

/// The slope of a normal; level where it is steeper than any roof.
fn slope(normal: u16, z_shift: u8) -> [i16; 2] {
    let [u, v] = normal.to_le_bytes().map(|b| i32::from(b.min(254)) - 127);
    let up = 127 - u.abs() - v.abs();
    if up <= 0 {
        return [0; 2];
    }
    let codes = i32::from(STEPS_PER_CELL >> z_shift);
    [u, v].map(|w| ((-w * codes * 32 + up).div_euclid(2 * up)).clamp(-4096, 4096) as i16)
}

/// Where a column's top goes on to, `step` cells away; not below zero.
pub(super) fn plane_at(map: &BlockMap, i: usize, step: [i32; 2]) -> i32 {
    let (flags, normal, z) = (map.flags[i], map.roof_normal[i], i32::from(map.z_max[i]));
    let slope = if flags & flag::INCLINED != 0 { slope(normal, map.z_shift) } else { [0; 2] };
    ColumnTop { z, normal, flags, slope }.at(step).clamp(0, i32::from(Z_CODE_MAX))
}

#[derive(Default)]
struct TopModels {
    occupied: [BitModel; 16],
    suspended: [BitModel; 9],
    inclined: [BitModel; 9],
    same: [[BitModel; 4]; 4],
    listed: [BitModel; 2],
    recent: [[BitModel; RECENT - 1]; 2],
    normal: [NumberModel; 2],
    height: [NumberModel; 10],
}

fn tops<C: BitCoder>(coder: &mut C, map: &mut BlockMap) -> Vec<ColumnTop> {
    let mut models = Box::<TopModels>::default();
    let mut recent = RecentNormals::default();
    let mut tops = vec![ColumnTop::default(); WIDTH * WIDTH];
    let mut last = 0;
    let full = full(coder, map);
    let mut shared = |bit: u8| {
        let occupied = map.flags.iter().filter(|f| **f & flag::OCCUPIED != 0);
        let share = if C::WRITES { GroupFlag::of(occupied.map(|f| f & bit != 0)) } else { GroupFlag::Unset };
        share.code(coder, &mut [BitModel::NEW; 2])
    };
    let (suspended, inclined) = (shared(flag::SUSPENDED), shared(flag::INCLINED));
    for i in 0..COLUMNS {
        let full = full[square(i)];
        if full == GroupFlag::Unset {
            continue;
        }
        let at = place(i);
        // As in `KNOWN`.
        let [west, south] = [&tops[at - 1], &tops[at - WIDTH]];
        let known = &[west, south, &tops[at - WIDTH - 1], &tops[at - WIDTH + 1]];
        if full == GroupFlag::Mixed {
            let around = known.iter().enumerate().map(|(k, t)| usize::from(t.occupied()) << k).sum::<usize>();
            if !coder.bit(&mut models.occupied[around], map.flags[i] & flag::OCCUPIED != 0) {
                continue;
            }
        }
        // Of the western and the southern neighbour: 0 not there, 1 without, 2 with the flag.
        let state = |top: &ColumnTop, bit: u8| usize::from(top.occupied()) + usize::from(top.flags & bit != 0);
        let context = |bit: u8| state(west, bit) * 3 + state(south, bit);
        let mut flags = flag::OCCUPIED;
        for (share, models, bit) in
            [(suspended, &mut models.suspended, flag::SUSPENDED), (inclined, &mut models.inclined, flag::INCLINED)]
        {
            let set = match share {
                GroupFlag::Mixed => coder.bit(&mut models[context(bit)], map.flags[i] & bit != 0),
                share => share == GroupFlag::Set,
            };
            flags |= if set { bit } else { 0 };
        }
        let (normal, slope) = normal(coder, &mut models, &mut recent, known, flags, map.roof_normal[i], map.z_shift);
        let mut top = ColumnTop { z: 0, normal, flags, slope };
        let (guess, doubt) = guess_top(&top, known, last);
        let z = guess + coder.number(&mut models.height[doubt], i32::from(map.z_max[i]) - guess);
        top.z = z.clamp(0, i32::from(u16::MAX));
        last = top.z;
        tops[at] = top;
        if !C::WRITES {
            map.flags[i] = flags;
            map.roof_normal[i] = normal;
            map.z_max[i] = top.z as u16;
        }
    }
    tops
}

/// Side of the squares that are said to be full or empty as a whole.
const SQUARE: usize = 8;
const SQUARES: usize = NODE_CELLS / SQUARE;

fn square(i: usize) -> usize {
    i / NODE_CELLS / SQUARE * SQUARES + i % NODE_CELLS / SQUARE
}

/// How many columns each square has.
fn full<C: BitCoder>(coder: &mut C, map: &BlockMap) -> [GroupFlag; SQUARES * SQUARES] {
    let mut models = [[BitModel::NEW; 2]; 9];
    let mut shares = [GroupFlag::Unset; SQUARES * SQUARES];
    for at in 0..shares.len() {
        let corner = at / SQUARES * SQUARE * NODE_CELLS + at % SQUARES * SQUARE;
        let cells = (0..SQUARE * SQUARE).map(|k| corner + k / SQUARE * NODE_CELLS + k % SQUARE);
        let share =
            if C::WRITES { GroupFlag::of(cells.map(|i| map.flags[i] & flag::OCCUPIED != 0)) } else { GroupFlag::Unset };
        let west = if at % SQUARES > 0 { shares[at - 1] } else { GroupFlag::Mixed };
        let south = if at >= SQUARES { shares[at - SQUARES] } else { GroupFlag::Mixed };
        shares[at] = share.code(coder, &mut models[west as usize * 3 + south as usize]);
    }
    shares
}

pub(super) fn place(i: usize) -> usize {
    (i / NODE_CELLS + 1) * WIDTH + i % NODE_CELLS + 1
}

/// Normals, the one that came up last in front.
#[derive(Default)]
struct RecentNormals {
    list: Vec<u16>,
}

impl RecentNormals {
    fn push(&mut self, normal: u16) {
        let place = self.list.iter().position(|n| *n == normal).unwrap_or_else(|| {
            self.list.truncate(RECENT - 1);
            self.list.push(normal);
            self.list.len() - 1
        });
        self.list[..=place].rotate_right(1);
    }
}

fn normal<C: BitCoder>(
    coder: &mut C,
    models: &mut TopModels,
    recent: &mut RecentNormals,
    known: &[&ColumnTop; 4],
    flags: u8,
    value: u16,
    z_shift: u8,
) -> (u16, [i16; 2]) {
    let kind = usize::from(flags & flag::INCLINED != 0);
    let bits = flag::OCCUPIED | flag::INCLINED;
    let mut first = None;
    for k in 0..4 {
        let top = known[k];
        let tried = |j: &&ColumnTop| j.normal == top.normal && (flags ^ j.flags) & bits == 0;
        if (flags ^ top.flags) & bits != 0 || known[..k].iter().any(tried) {
            continue;
        }
        let mut agree = 0;
        for other in known {
            agree += usize::from(other.normal == top.normal && other.occupied());
        }
        let models = &mut models.same[if first.is_some() { 2 } else { 0 } + kind];
        if coder.bit(&mut models[(agree - 1) & 3], value == top.normal) {
            return (top.normal, top.slope);
        }
        first = first.or(Some(top.normal));
    }
    let place = if C::WRITES { recent.list.iter().position(|n| *n == value) } else { None };
    let slope = |normal: u16| if kind == 0 { [0; 2] } else { slope(normal, z_shift) };
    if coder.bit(&mut models.listed[kind], place.is_some()) {
        let place = coder.choice(&mut models.recent[kind], place.unwrap_or(0) as u32) as usize;
        let other = recent.list.get(place).copied().unwrap_or_default();
        recent.push(other);
        return (other, slope(other));
    }
    let near = first.unwrap_or(0x7f7f).to_le_bytes();
    let [u, v] = value.to_le_bytes();
    let part = |a: u8, b: u8| i32::from(a.wrapping_sub(b) as i8);
    let u = near[0].wrapping_add(coder.number(&mut models.normal[0], part(u, near[0])) as u8);
    let v = near[1].wrapping_add(coder.number(&mut models.normal[1], part(v, near[1])) as u8);
    let value = u16::from_le_bytes([u, v]);
    recent.push(value);
    (value, slope(value))
}

/// What the top should be after its neighbours, and how doubtful that is, 0 to 9.
fn guess_top(own: &ColumnTop, known: &[&ColumnTop; 4], last: i32) -> (i32, usize) {
    let kind = if own.flags & flag::INCLINED != 0 { 5 } else { 0 };
    let bits = flag::OCCUPIED | flag::INCLINED;
    let (mut sum, mut count, mut low, mut high, mut first) = (0, 0, i32::MAX, i32::MIN, 0);
    for k in (0..4).rev() {
        let (top, step) = (known[k], KNOWN[k].1);
        if top.normal == own.normal && (top.flags ^ own.flags) & bits == 0 {
            first = top.at(step);
            (sum, count, low, high) = (sum + first, count + 1, low.min(first), high.max(first));
        }
    }
    let [west, south, corner, _] = known;
    let (guess, doubt) = match count {
        0 => {
            let guess = match (west.occupied(), south.occupied(), corner.occupied()) {
                (true, true, true) => median(west.z, south.z, corner.z),
                (true, ..) => west.z,
                (false, true, _) => south.z,
                _ => last,
            };
            (guess, 0)
        }
        1 => (first, 1),
        _ if high - low > 2 => (first, 2),
        2 => ((sum + 1) >> 1, if high == low { 4 } else { 3 }),
        3 => ((2 * sum + 3).div_euclid(6), if high == low { 4 } else { 3 }),
        _ => ((2 * sum + 4) >> 3, if high == low { 4 } else { 3 }),
    };
    (guess.clamp(0, i32::from(Z_CODE_MAX)), kind + doubt)
}

/// LOCO-I's guess of what goes on from `a` and `b`, with `c` between them (Weinberger et al. 2000).
#[inline]
pub(super) fn median(a: i32, b: i32, c: i32) -> i32 {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    if c >= high {
        low
    } else if c <= low {
        high
    } else {
        a + b - c
    }
}

#[derive(Default)]
struct BottomModels {
    /// Whether it is the ground around, and if not, whether it is nearer to that; by what the neighbours did.
    just_ground: [BitModel; 18],
    ground: [BitModel; 18],
    height: [NumberModel; 4],
}

/// A column on the ground ends a little under the lowest ground around, another where its neighbours end: whichever is
/// nearer is said.
fn bottoms<C: BitCoder>(coder: &mut C, map: &mut BlockMap, tops: &[ColumnTop]) {
    let mut models = Box::<BottomModels>::default();
    let lowest = lowest(tops);
    // Per column, what the neighbours need to know: 0 nothing, 1 the other guess, 2 the ground; and the bottom.
    let mut done = vec![(0u8, 0i32); WIDTH * WIDTH];
    let under = i32::from(STEPS_PER_CELL >> map.z_shift) / 4;
    let mut last = 0;
    for i in 0..COLUMNS {
        let at = place(i);
        let top = &tops[at];
        if !top.occupied() {
            continue;
        }
        let ground = (lowest[at] - under).clamp(0, i32::from(Z_CODE_MAX));
        let (west, south) = (done[at - 1], done[at - WIDTH]);
        let other = if west.0 != 0 {
            west.1
        } else if south.0 != 0 {
            south.1
        } else {
            last
        };
        let suspended = usize::from(top.flags & flag::SUSPENDED != 0);
        let context = (suspended * 3 + usize::from(west.0)) * 3 + usize::from(south.0);
        let value = i32::from(map.z_min[i]);
        // Mostly it is just there, so that is one bit.
        let (on_ground, bottom) = if coder.bit(&mut models.just_ground[context], value == ground) {
            (true, ground)
        } else {
            let nearer = (value - ground).abs() <= (value - other).abs();
            let on_ground = coder.bit(&mut models.ground[context], nearer);
            let guess = if on_ground { ground } else { other };
            let inclined = usize::from(top.flags & flag::INCLINED != 0);
            let model = &mut models.height[if on_ground { 2 + inclined } else { suspended }];
            (on_ground, (guess + coder.number(model, value - guess)).clamp(0, i32::from(u16::MAX)))
        };
        last = bottom;
        done[at] = (if on_ground { 2 } else { 1 }, last);
        if !C::WRITES {
            map.z_min[i] = last as u16;
        }
    }
}

/// How many codes a hidden bottom may be moved: half of what it lies under the ground.
const SETTLE: i32 = 2;

impl BlockMap {
    /// Moves bottoms that lie hidden a little under the ground to where a reader expects them, by at most two codes, so that they cost nothing. Only columns without a strip: the others show where they end.
    pub fn snap_hidden_bottoms(&mut self) {
        let mut tops = vec![ColumnTop::default(); WIDTH * WIDTH];
        for i in (0..COLUMNS).filter(|i| self.flags[*i] & flag::OCCUPIED != 0) {
            let (flags, normal, z) = (self.flags[i], self.roof_normal[i], i32::from(self.z_max[i]));
            let slope = if flags & flag::INCLINED == 0 { [0; 2] } else { slope(normal, self.z_shift) };
            tops[place(i)] = ColumnTop { z, normal, flags, slope };
        }
        let lowest = lowest(&tops);
        let row = i32::from(STEPS_PER_CELL >> self.z_shift);
        let hidden = |flags: u8| flags & (flag::OCCUPIED | flag::SUSPENDED | flag::EXPOSED) == flag::OCCUPIED;
        for i in (0..COLUMNS).filter(|i| hidden(self.flags[*i])) {
            let (low, ground) = (i32::from(self.z_min[i]), (lowest[place(i)] - row / 4).max(0));
            if (low - ground).abs() <= SETTLE && ground < i32::from(self.z_max[i]) {
                self.z_min[i] = ground as u16;
            }
        }
    }
}

/// For each cell the lowest top of the 3 x 3 around, where their slopes reach lowest.
fn lowest(tops: &[ColumnTop]) -> Vec<i32> {
    let reach = |top: &ColumnTop| {
        let [x, y] = top.slope.map(|s| i32::from(s).abs());
        if top.occupied() { top.z - (((x + y) * 3) >> 7) } else { i32::MAX }
    };
    let own: Vec<i32> = tops.iter().map(reach).collect();
    let least = |values: &[i32], step: usize| {
        let mut least = values.to_vec();
        let (before, after) = (&values[..values.len() - 2 * step], &values[2 * step..]);
        for (least, (before, after)) in least[step..].iter_mut().zip(before.iter().zip(after)) {
            *least = (*least).min(*before).min(*after);
        }
        least
    };
    least(&least(&own, 1), WIDTH)
}
