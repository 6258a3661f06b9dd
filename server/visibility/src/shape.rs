//! The shape of one node's columns, as far as it decides what they hide.
//!
//! From a V-BlockMap come tops, and up to where each column is solid from below. A column with a gap hides what is below the gap
//! only if the gap is closed on all sides, as between the floor and the roof of a hall ([`NodeShape::open_gaps`]).

use crate::height_scale::HeightScale;
use insula_protocol::blockmap::{
    CLIP_STEPS_PER_CELL, COLUMNS, ColumnClip, MIN_NORMAL_Z, STEPS_PER_CELL, flag, strip_rows,
};
use insula_protocol::{BlockMap, NODE_CELLS, octahedral};

/// The four sides of a cell: east, north, west, south.
const SIDES: [(i32, i32); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];
/// Clips that leave less of a side free than this, in cells, leave nothing free: rounding of the stored planes.
const FREE_SIDE: f64 = 1.0 / CLIP_STEPS_PER_CELL as f64;

/// A gap of a column: the free heights between its two solids.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Gap {
    column: u16,
    low: u16,
    high: u16,
    is_open: bool,
}

/// Heights of a node's columns in codes of a [`HeightScale`], row-major from the south-west corner; 0 for none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NodeShape {
    /// Highest points, rounded up.
    pub(crate) tops: Vec<u16>,
    /// The height up to which a column is solid over its whole cell, rounded down, if its gap is closed.
    pub(crate) solids: Vec<u16>,
    /// From which height on each side of a cell is free, for the four [`SIDES`], rounded down.
    free_from: Vec<[u16; 4]>,
    gaps: Vec<Gap>,
    /// The highest point of the ground; 0 if the node stores none.
    pub(crate) ground: u16,
}

impl NodeShape {
    pub(crate) fn new(map: BlockMap, scale: &HeightScale) -> Self {
        let ground = ground_of(&map, scale);
        let stands = ground_mask(&map);
        let map = map.stand_on_ground();
        let mut shape = Self {
            tops: vec![0; COLUMNS],
            solids: vec![0; COLUMNS],
            free_from: vec![[0; 4]; COLUMNS],
            gaps: Vec::new(),
            ground,
        };
        let (mut gaps, mut clips, mut strip_at) = (map.gaps.iter(), map.clips.iter(), 0);
        for i in 0..COLUMNS {
            let flags = map.flags[i];
            if flags & flag::OCCUPIED == 0 {
                continue;
            }
            let gap = (flags & flag::GAP != 0).then(|| gaps.next()).flatten().copied();
            let clip = (flags & flag::CLIPPED != 0).then(|| clips.next()).flatten();
            let mut rows = 0;
            if flags & flag::EXPOSED != 0 {
                rows = usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1);
            }
            let strip = map.strips.get(strip_at..strip_at + rows).unwrap_or_default();
            strip_at += rows;
            let hangs = flags & flag::SUSPENDED != 0 && !stands[i];
            let is_thin = map.thin.binary_search_by_key(&(i as u16), |(column, _)| *column).is_ok();
            let column = HeightColumn { map: &map, i, gap, clip, strip, hangs, is_thin };
            shape.put(&column, scale);
        }
        shape
    }

    fn put(&mut self, column: &HeightColumn<'_>, scale: &HeightScale) {
        let i = column.i;
        let (low, high) = column.top_range();
        let solid = scale.down(low);
        self.tops[i] = scale.up(high);
        self.free_from[i] = [solid; 4];
        self.solids[i] = solid;
        if let Some(clip) = column.clip {
            let outer = clip.outer.map_or(0, |outer| scale.down(column.height(f64::from(outer.z))));
            let is_free = free_sides(column.map.wall_azimuth[i], clip);
            for (free_from, is_free) in self.free_from[i].iter_mut().zip(is_free) {
                *free_from = if is_free { outer } else { *free_from };
            }
            self.solids[i] = outer;
        }
        if column.is_thin {
            // One sees through what is thin.
            let from = column.gap.map_or(0, |[low, _]| scale.down(column.height(f64::from(low))));
            self.solids[i] = from;
            self.free_from[i] = [from; 4];
        } else if let Some([low, high]) = column.gap {
            let (low, high) = (scale.down(column.height(f64::from(low))), scale.up(column.height(f64::from(high))));
            // What a clip leaves free beside a gap may lead into it.
            self.gaps.push(Gap { column: i as u16, low, high, is_open: column.clip.is_some() });
        }
        if let Some(open) = column.lowest_open_row() {
            self.solids[i] = self.solids[i].min(scale.down(open));
            self.free_from[i] = self.free_from[i].map(|from| from.min(scale.down(open)));
        }
        if column.hangs {
            self.solids[i] = 0;
            self.free_from[i] = [0; 4];
        }
    }

    /// Lowers the solids below all gaps into which a way leads from outside. `around` are the nodes to the east, north, west and
    /// south; where there is none, everything is free.
    pub(crate) fn open_gaps(mut self, around: [Option<&NodeShape>; 4]) -> Self {
        const NONE: u32 = u32::MAX;
        let mut gap_at = vec![NONE; COLUMNS];
        for (number, gap) in self.gaps.iter().enumerate() {
            gap_at[usize::from(gap.column)] = number as u32;
        }
        let mut open: Vec<usize> = Vec::new();
        for number in 0..self.gaps.len() {
            let gap = self.gaps[number];
            if gap.is_open || SIDES.iter().enumerate().any(|(side, _)| self.leads_in(gap, side, &around)) {
                self.gaps[number].is_open = true;
                open.push(number);
            }
        }
        while let Some(number) = open.pop() {
            let from = self.gaps[number];
            for (dx, dy) in SIDES {
                let Some(i) = inside(from.column, dx, dy) else { continue };
                let Some(next) = self.gaps.get(gap_at[i] as usize).copied() else { continue };
                if !next.is_open && next.low.max(from.low) < next.high.min(from.high) {
                    self.gaps[gap_at[i] as usize].is_open = true;
                    open.push(gap_at[i] as usize);
                }
            }
        }
        for gap in self.gaps.iter().filter(|gap| gap.is_open) {
            let solid = &mut self.solids[usize::from(gap.column)];
            *solid = (*solid).min(gap.low);
        }
        self
    }

    /// Whether the space above the neighbour on a side leads into a gap, or whether the neighbour is of another node and has a gap.
    fn leads_in(&self, gap: Gap, side: usize, around: &[Option<&NodeShape>; 4]) -> bool {
        let (dx, dy) = SIDES[side];
        let opposite = (side + 2) % 4;
        if let Some(i) = inside(gap.column, dx, dy) {
            return self.free_from[i][opposite] < gap.high;
        }
        let Some(other) = around[side] else { return true };
        let i = wrapped(gap.column, dx, dy);
        // Gaps of other nodes are followed no further: they count as open.
        let has_gap = other.gaps.iter().any(|gap| usize::from(gap.column) == i);
        has_gap || other.free_from[i][opposite] < gap.high
    }
}

/// The column beside `column`; `None` beyond the node.
fn inside(column: u16, dx: i32, dy: i32) -> Option<usize> {
    let side = NODE_CELLS as i32;
    let (x, y) = (i32::from(column) % side + dx, i32::from(column) / side + dy);
    ((0..side).contains(&x) && (0..side).contains(&y)).then_some((y * side + x) as usize)
}

/// The column beside `column`, in the next node if need be.
fn wrapped(column: u16, dx: i32, dy: i32) -> usize {
    let side = NODE_CELLS as i32;
    let (x, y) = (i32::from(column) % side + dx, i32::from(column) / side + dy);
    (y.rem_euclid(side) * side + x.rem_euclid(side)) as usize
}

/// An occupied column.
struct HeightColumn<'a> {
    map: &'a BlockMap,
    i: usize,
    gap: Option<[u16; 2]>,
    clip: Option<&'a ColumnClip>,
    strip: &'a [insula_protocol::Texel],
    /// Whether nothing supports it.
    hangs: bool,
    is_thin: bool,
}

impl HeightColumn<'_> {
    /// A height code in metres above the city's origin.
    fn height(&self, code: f64) -> f64 {
        self.map.z_base_m() + code * f64::from(self.map.z_step_m())
    }

    /// Lowest and highest point of the top.
    fn top_range(&self) -> (f64, f64) {
        let top = f64::from(self.map.z_max[self.i]);
        let mut half_rise = 0.0;
        if self.map.flags[self.i] & flag::INCLINED != 0 {
            let n = octahedral::decode(self.map.roof_normal[self.i]);
            let codes = f64::from(STEPS_PER_CELL >> self.map.z_shift);
            half_rise = 0.5 * codes * f64::from(n[0].abs() + n[1].abs()) / f64::from(n[2].max(MIN_NORMAL_Z));
        }
        (self.height(top - half_rise), self.height(top + half_rise))
    }

    /// The bottom of the lowest transparent texel of its wall.
    fn lowest_open_row(&self) -> Option<f64> {
        let row = self.strip.iter().position(|texel| texel.is_open())?;
        let first = strip_rows(self.map.z_min[self.i], self.map.z_max[self.i], self.map.z_shift).0;
        let codes = f64::from(STEPS_PER_CELL >> self.map.z_shift);
        Some(self.height((f64::from(first) + row as f64) * codes))
    }
}

/// Which sides of a clipped column's cell touch what lies beyond its walls.
fn free_sides(azimuth: u8, clip: &ColumnClip) -> [bool; 4] {
    let touches = |azimuth: u8, offset: i8| {
        let angle = f64::from(azimuth) * (std::f64::consts::TAU / 256.0);
        let (x, y) = (libm::cos(angle), libm::sin(angle));
        let offset = f64::from(offset) / f64::from(CLIP_STEPS_PER_CELL);
        SIDES.map(|(dx, dy)| {
            let (dx, dy) = (f64::from(dx), f64::from(dy));
            let across = (x * dy - y * dx).abs();
            0.5 * (x * dx + y * dy) + 0.5 * across > offset + FREE_SIDE
        })
    };
    let mut free = touches(azimuth, clip.offset);
    if let Some(corner) = clip.corner {
        let other = touches(corner.azimuth, corner.offset);
        for (free, other) in free.iter_mut().zip(other) {
            // Beyond a concave corner means beyond both planes.
            *free = if corner.concave { *free && other } else { *free || other };
        }
    }
    free
}

/// Columns that stand on generated ground.
fn ground_mask(map: &BlockMap) -> Vec<bool> {
    let Some(ground) = &map.ground else { return vec![false; COLUMNS] };
    let surface = ground.surface();
    let centre = |n: usize| n as f32 + 0.5;
    (0..COLUMNS).map(|i| surface.at(centre(i % NODE_CELLS), centre(i / NODE_CELLS)).is_some()).collect()
}

/// The highest point of the ground at every third column.
fn ground_of(map: &BlockMap, scale: &HeightScale) -> u16 {
    let Some(ground) = &map.ground else { return 0 };
    let surface = ground.surface();
    let centre = |n: usize| n as f32 + 0.5;
    let points = (0..COLUMNS).step_by(3);
    let heights = points.filter_map(|i| surface.at(centre(i % NODE_CELLS), centre(i / NODE_CELLS)));
    let codes = heights.map(|point| scale.up(map.z_base_m() + f64::from(point.z) * f64::from(map.cell_m)));
    codes.max().unwrap_or(0)
}
