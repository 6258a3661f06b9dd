//! Bundles of lines, and what the eyes on them can see.
//!
//! A cell's outgoing lines are divided by direction into sectors, and those of a sector by their offset into strips. Each bundle is
//! followed outwards through the city's heights. At every distance its lines cross a short segment. What is solid over the whole
//! segment hides what lies behind, for all lines and thus for all eyes of the bundle together: its slope is kept as a horizon
//! (Bittner, Wonka and Wimmer 2005 subdivide the space of lines; the horizons fuse occluders). What rises above the horizon
//! anywhere near the segment is potentially visible.
//!
//! Heights only: columns are solid from below up to a height. A line from a lower eye to the same point lies lower everywhere, so the
//! eyes of a layer see at most what its highest eyes see.

use insula_protocol::visibility_tile::{LAYERS, SCALE_LEVELS, SCALES};

use crate::{
    heights::CityHeights,
    settings::Settings,
    windows::{BLOCK_SIDES, BlockTables, SIZES, Windows},
};

/// `1 / sqrt(2)`, rounded down: squares of this side at any angle fit into an upright one of side 1.
const TILT: f32 = 0.707;
/// Most windows across a bundle before larger windows are taken.
const MAX_ACROSS: f32 = 3.0;
/// How often the widest bundles are halved in both ranges.
const HALVINGS: u32 = 2;
/// Way between two places at which lines are compared with what is solid, in metres and as a share of the distance.
const SOLID_STEP_M: f32 = 1.5;
const SOLID_STEP_SHARE: f32 = 1.0 / 80.0;
/// Least way that is looked at as a whole, as a share of the distance.
const LOOK_SHARE: f32 = 1.0 / 40.0;
/// What is lower than this below the lowest eyes is not taken as hiding anything, in metres.
const LOW_M: f32 = 1.0;

/// The whole number below a value, which must be within those of an i32. Without an instruction of its own, `f32::floor` is a call.
#[inline]
fn floor(v: f32) -> isize {
    let whole = v as i32;
    (whole - i32::from(v < whole as f32)) as isize
}

/// Number of a layer, or [`LAYERS`] for what no layer sees.
pub(crate) type LayerNumber = u8;

/// The tables of a city.
#[derive(Debug)]
pub(crate) struct HeightTables {
    tops: Windows,
    blocks: BlockTables,
}

impl HeightTables {
    pub(crate) fn new(heights: &CityHeights) -> Self {
        let (width, height) = (heights.width, heights.height);
        Self {
            tops: Windows::new(width, height, &heights.tops, u16::max),
            blocks: BlockTables::new(width, height, &heights.tops),
        }
    }
}

/// A cell of which the set is computed. Lengths in metres from the south-western corner of the city's grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ViewCell {
    pub(crate) centre: [f32; 2],
    pub(crate) half_m: f32,
    /// The highest eyes of each layer, in metres above the city's origin.
    pub(crate) tops: [f32; LAYERS],
}

/// What the eyes of one layer on a bundle know at some distance.
#[derive(Debug, Clone, Copy)]
struct Horizon {
    /// Height of the eyes.
    eye_m: f32,
    /// Along the bundle: behind all of the eyes, and before all of them.
    first: f32,
    last: f32,
    /// Steepest slope to something above the eyes, from the farthest eye.
    above: f32,
    /// Flattest slope to something below the eyes, from the nearest eye.
    below: f32,
}

impl Horizon {
    /// Whether something between two places along the bundle, and not above `top_m`, is hidden from all eyes.
    #[inline]
    fn hides(&self, top_m: f32, [from, to]: [f32; 2], margin: f32) -> bool {
        let rise = top_m - self.eye_m;
        if rise > 0.0 {
            let distance = from - self.first;
            return from > self.last && rise <= (self.above - margin) * distance;
        }
        self.above > margin || rise <= (self.below - margin) * (to - self.last)
    }

    fn has_eyes(&self) -> bool {
        self.first <= self.last
    }

    /// The height of something solid at a place that does not change the horizon yet.
    #[inline]
    fn least_to_raise(&self, at: f32) -> f32 {
        if at <= self.last {
            f32::INFINITY
        } else if self.above > 0.0 {
            self.eye_m + self.above * (at - self.first)
        } else if self.below > f32::NEG_INFINITY {
            self.eye_m + self.below * (at - self.last)
        } else {
            f32::NEG_INFINITY
        }
    }

    /// Takes in that all lines meet something solid up to `solid_m` at a place behind all eyes.
    #[inline]
    fn raise(&mut self, solid_m: f32, at: f32) {
        let rise = solid_m - self.eye_m;
        if at <= self.last {
        } else if rise > 0.0 {
            self.above = self.above.max(rise / (at - self.first));
        } else {
            self.below = self.below.max(rise / (at - self.last));
        }
    }
}

/// Lines whose direction and offset from the cell's centre lie in two ranges.
#[derive(Debug, Clone, Copy)]
struct LineRange {
    /// Middle and half of the range of angles.
    angle: f32,
    half_angle: f32,
    /// Middle and half of the range of offsets, in metres.
    offset: f32,
    half_m: f32,
}

impl LineRange {
    /// The four parts with half the ranges.
    fn parts(&self) -> [Self; 4] {
        let (half_angle, half_m) = (self.half_angle / 2.0, self.half_m / 2.0);
        [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)].map(|(a, o)| Self {
            angle: self.angle + a * half_angle,
            half_angle,
            offset: self.offset + o * half_m,
            half_m,
        })
    }

    fn bundle(&self, cell: &ViewCell) -> LineBundle {
        let along = [libm::cosf(self.angle), libm::sinf(self.angle)];
        let across = [-along[1], along[0]];
        let start = [0, 1].map(|axis| cell.centre[axis] + across[axis] * self.offset);
        // Offsets are measured across each line, and widths across the axis.
        let skew = (self.offset.abs() + self.half_m) * (1.0 / libm::cosf(self.half_angle) - 1.0);
        let half_m = self.half_m + skew;
        LineBundle { start, along, across, offset: self.offset, half_m, spread: libm::tanf(self.half_angle) }
    }
}

/// A bundle: its axis, and how far its lines lie from it.
#[derive(Debug, Clone, Copy)]
struct LineBundle {
    /// Middle of the axis, beside the cell's centre.
    start: [f32; 2],
    /// Distance of the axis from the cell's centre.
    offset: f32,
    along: [f32; 2],
    across: [f32; 2],
    half_m: f32,
    /// Growth of `half_m` per metre.
    spread: f32,
}

impl LineBundle {
    fn half_at(&self, t: f32) -> f32 {
        self.half_m + t.abs() * self.spread
    }

    fn point(&self, t: f32, offset: f32) -> [f32; 2] {
        [0, 1].map(|axis| self.start[axis] + self.along[axis] * t + self.across[axis] * offset)
    }
}

/// Windows that cover a bundle over a short way.
#[derive(Debug, Clone, Copy)]
struct WindowCover {
    size: usize,
    count: usize,
    spacing: f32,
    /// Way along the bundle that is covered.
    way: f32,
    /// Half the width that is covered.
    half_m: f32,
}

/// Follows the bundles of a cell.
pub(crate) struct Walker<'a> {
    pub(crate) heights: &'a CityHeights,
    pub(crate) tables: &'a HeightTables,
    pub(crate) settings: &'a Settings,
}

impl Walker<'_> {
    /// Notes in `seen`, for each leaf square, the lowest layer that sees it.
    pub(crate) fn see(&self, cell: &ViewCell, seen: &mut [LayerNumber]) {
        let sectors = (self.settings.sectors >> HALVINGS).max(1);
        let half_angle = std::f32::consts::PI / sectors as f32;
        for sector in 0..sectors {
            let angle = (2 * sector + 1) as f32 * half_angle;
            // The widest that the cell is in any direction of the sector.
            let reach = [angle - half_angle, angle, angle + half_angle]
                .map(|angle| libm::cosf(angle).abs() + libm::sinf(angle).abs())
                .into_iter()
                .fold(0.0, f32::max);
            let reach = cell.half_m * (reach * 1.01).min(std::f32::consts::SQRT_2);
            let widest = self.settings.half_strip_m * (1 << HALVINGS) as f32;
            let strips = (reach / widest).ceil().max(1.0);
            let half_m = reach / strips;
            for strip in 0..strips as u32 {
                let offset = (2.0 * strip as f32 + 1.0 - strips) * half_m;
                self.see_lines(cell, &LineRange { angle, half_angle, offset, half_m }, HALVINGS, seen);
            }
        }
    }

    /// Divides lines until they show nothing new, or are narrow enough.
    fn see_lines(&self, cell: &ViewCell, lines: &LineRange, halvings: u32, seen: &mut [LayerNumber]) {
        let bundle = lines.bundle(cell);
        if halvings == 0 {
            self.follow(cell, &bundle, seen, false);
        } else if self.follow(cell, &bundle, seen, true) {
            lines.parts().iter().for_each(|part| self.see_lines(cell, part, halvings - 1, seen));
        }
    }

    /// The windows that cover a bundle from `t` on.
    #[inline]
    fn cover(&self, bundle: &LineBundle, t: f32) -> WindowCover {
        let square_m = self.heights.square_m;
        let half_m = bundle.half_at(t + square_m);
        let mut size = 0;
        loop {
            // A window covers whole squares: of its side, one less than its squares is certain.
            let side = ((2usize << size) - 1) as f32 * square_m * TILT;
            let is_enough = 2.0 * half_m <= MAX_ACROSS * side && t.abs() * LOOK_SHARE <= side;
            if is_enough || size + 1 == SIZES {
                let half_m = bundle.half_at(t + side);
                let count = (2.0 * half_m / side).ceil().max(1.0);
                return WindowCover { size, count: count as usize, spacing: 2.0 * half_m / count, way: side, half_m };
            }
            size += 1;
        }
    }

    /// South-western square of a window around a point.
    #[inline]
    fn window_at(&self, size: usize, point: [f32; 2]) -> [isize; 2] {
        let half = ((2usize << size) - 1) as f32 * 0.5;
        point.map(|v| floor(v / self.heights.square_m - half))
    }

    /// What is solid at a point.
    #[inline]
    fn solid_at(&self, x: isize, y: isize) -> u16 {
        let heights = self.heights;
        let (width, height) = (2 * heights.width as isize, 2 * heights.height as isize);
        if x >= 0 && y >= 0 && x < width && y < height { heights.solids[(y * width + x) as usize] } else { 0 }
    }

    /// The lowest solid in the squares that a bundle's lines cross at a place, or any value up to `enough` if it is not above that.
    #[inline]
    fn solid_across(&self, bundle: &LineBundle, t: f32, enough: u16) -> u16 {
        let per_m = 2.0 / self.heights.square_m;
        let half = bundle.half_at(t);
        let [x0, y0] = bundle.point(t, -half).map(|v| v * per_m);
        let [x1, y1] = bundle.point(t, half).map(|v| v * per_m);
        let middle = self.solid_at(floor((x0 + x1) * 0.5), floor((y0 + y1) * 0.5));
        if middle <= enough {
            return middle;
        }
        // Row by row, all squares that the segment touches, with a little margin for rounding.
        const SLACK: f32 = 0.01;
        let is_steep = (y1 - y0).abs() > (x1 - x0).abs();
        let (mut from, mut to) = if is_steep { ([y0, x0], [y1, x1]) } else { ([x0, y0], [x1, y1]) };
        if from[0] > to[0] {
            (from, to) = (to, from);
        }
        let slope = if to[0] - from[0] > 1e-6 { (to[1] - from[1]) / (to[0] - from[0]) } else { 0.0 };
        let mut lowest = middle;
        for major in floor(from[0] - SLACK)..=floor(to[0] + SLACK) {
            let ends =
                [major as f32, major as f32 + 1.0].map(|v| from[1] + (v.clamp(from[0], to[0]) - from[0]) * slope);
            let (low, high) = (ends[0].min(ends[1]) - SLACK, ends[0].max(ends[1]) + SLACK);
            for minor in floor(low)..=floor(high) {
                lowest = lowest.min(if is_steep { self.solid_at(minor, major) } else { self.solid_at(major, minor) });
            }
            if lowest <= enough {
                return lowest;
            }
        }
        lowest
    }

    /// Where the eyes of each layer are on a bundle. `None` if there is none.
    fn horizons(&self, cell: &ViewCell, bundle: &LineBundle) -> Option<[Horizon; LAYERS]> {
        // All lines of the bundle stay within the cell for no longer than its axis does in a larger cell.
        let half = cell.half_m + bundle.half_m + cell.half_m * 1.5 * bundle.spread;
        let [mut t0, mut t1] = [f32::NEG_INFINITY, f32::INFINITY];
        for axis in 0..2 {
            let (from, way) = (bundle.across[axis] * bundle.offset, bundle.along[axis]);
            if way.abs() < 1e-6 {
                continue;
            }
            let ends = [(-half - from) / way, (half - from) / way];
            (t0, t1) = (t0.max(ends[0].min(ends[1])), t1.min(ends[0].max(ends[1])));
        }
        if t0 >= t1 {
            return None;
        }
        let mut horizons = cell.tops.map(|eye_m| Horizon {
            eye_m,
            first: f32::INFINITY,
            last: f32::NEG_INFINITY,
            above: f32::NEG_INFINITY,
            below: f32::NEG_INFINITY,
        });
        let steps = ((t1 - t0) / self.heights.square_m).ceil().max(1.0);
        let step = (t1 - t0) / steps;
        for k in 0..=steps as u32 {
            let t = t0 + k as f32 * step;
            let solid_m = self.heights.scale.height_m(self.solid_across(bundle, t, 0));
            for horizon in horizons.iter_mut().filter(|horizon| solid_m < horizon.eye_m) {
                // Eyes may stand anywhere between this place and the next.
                horizon.first = horizon.first.min((t - step).max(t0));
                horizon.last = horizon.last.max((t + step).min(t1));
            }
        }
        horizons.iter().any(|horizon| horizon.first <= horizon.last).then_some(horizons)
    }

    /// South-western and north-eastern corner of what a cell's set is about.
    fn limits(&self, cell: &ViewCell) -> [[f32; 2]; 2] {
        let leaf_m = self.heights.per_leaf as f32 * self.heights.square_m;
        let widest_m = leaf_m * f32::from(1u16 << (SCALE_LEVELS * (SCALES - 1)));
        let reach_m = f32::from(self.settings.reach + 1) * widest_m;
        [0, 1].map(|end| {
            let size = [self.heights.leaves.width, self.heights.leaves.height].map(|count| count as f32 * leaf_m);
            std::array::from_fn(|axis| match end {
                0 => (cell.centre[axis] - reach_m).max(0.0),
                _ => (cell.centre[axis] + reach_m).min(size[axis]),
            })
        })
    }

    /// Follows a bundle outwards. With `is_test`, whether its lines may see anything that is not in `seen` yet; otherwise notes
    /// what they may see.
    fn follow(&self, cell: &ViewCell, bundle: &LineBundle, seen: &mut [LayerNumber], is_test: bool) -> bool {
        let Some(mut horizons) = self.horizons(cell, bundle) else { return false };
        let mut t = horizons.iter().filter(|h| h.has_eyes()).map(|h| h.last).fold(f32::INFINITY, f32::min);
        let margin = self.settings.slope_margin;
        let (scale, square_m) = (self.heights.scale, self.heights.square_m);
        let size = [self.heights.width as f32 * square_m, self.heights.height as f32 * square_m];
        let limits = self.limits(cell);
        loop {
            let point = bundle.point(t, 0.0);
            // What is solid in the part of the way from here on hides nothing in the same part.
            let cover = self.cover(bundle, t);
            let beyond = bundle.half_at(t) + 2.0 * cover.way;
            let is_beyond = |axis: usize| {
                let (v, way) = (point[axis], bundle.along[axis]);
                way > 0.0 && v > limits[1][axis] + beyond || way < 0.0 && v < limits[0][axis] - beyond
            };
            let hides_all = |span: [f32; 2], top_m: f32| {
                horizons.iter().filter(|h| h.has_eyes()).all(|h| h.hides(top_m, span, margin))
            };
            if is_beyond(0) || is_beyond(1) {
                return false;
            }
            let [x, y] = point.map(|v| floor(v / square_m));
            let is_inside = (0..2).all(|axis| point[axis] >= 0.0 && point[axis] < size[axis]);
            // If small blocks are not hidden, larger ones are not.
            let skips = (0..BLOCK_SIDES.len()).filter(|_| is_inside).map_while(|level| {
                let way = BLOCK_SIDES[level] as f32 * square_m * 0.5;
                let top_m = scale.height_m(self.tables.blocks.at(level, x, y));
                hides_all([t, t + way], top_m).then_some(way)
            });
            let skip = skips.filter(|way| bundle.half_at(t + way) <= *way).last();
            if let Some(way) = skip {
                t += way;
                continue;
            }
            let end = t + cover.way;
            let top = self.top_of(bundle, &cover, t);
            let top_m = scale.height_m(top);
            let sees = |h: &Horizon| h.has_eyes() && !h.hides(top_m, [t, end], margin);
            let Some(layer) = horizons.iter().position(sees).filter(|_| top > 0) else {
                // A hidden segment raises no horizon.
                t = end;
                continue;
            };
            if self.mark(bundle, &cover, t, layer as LayerNumber, seen, is_test) {
                return true;
            }
            // Ground hides little.
            let lowest_eye_m = horizons.iter().filter(|h| h.has_eyes()).map(|h| h.eye_m).fold(f32::INFINITY, f32::min);
            if top_m < lowest_eye_m - LOW_M {
                t = end;
                continue;
            }
            while t < end {
                let enough =
                    horizons.iter().filter(|h| h.has_eyes()).map(|h| h.least_to_raise(t)).fold(f32::INFINITY, f32::min);
                let solid = self.solid_across(bundle, t, scale.down(f64::from(enough)));
                if solid > 0 {
                    let solid_m = scale.height_m(solid);
                    horizons.iter_mut().for_each(|horizon| horizon.raise(solid_m, t));
                }
                t += SOLID_STEP_M.max(t * SOLID_STEP_SHARE);
            }
            t = end;
        }
    }

    /// The highest code near the part of a bundle that begins at `t`; 0 if nothing is there.
    #[inline]
    fn top_of(&self, bundle: &LineBundle, cover: &WindowCover, t: f32) -> u16 {
        let tops = (0..cover.count).map(|k| {
            let offset = (k as f32 + 0.5) * cover.spacing - cover.half_m;
            let [x, y] = self.window_at(cover.size, bundle.point(t + cover.way * 0.5, offset));
            self.tables.tops.at(cover.size, x, y)
        });
        tops.max().unwrap_or(0)
    }

    /// Notes that a layer sees the part of a bundle that begins at `t`. With `is_test`, returns whether that would be new.
    #[inline]
    fn mark(
        &self,
        bundle: &LineBundle,
        cover: &WindowCover,
        t: f32,
        layer: LayerNumber,
        seen: &mut [LayerNumber],
        is_test: bool,
    ) -> bool {
        let Some(part) = self.leaves_of(bundle, cover, t) else { return false };
        if is_test {
            return !self.all_leaves(part, |i| seen[i] <= layer);
        }
        self.all_leaves(part, |i| {
            seen[i] = seen[i].min(layer);
            true
        });
        false
    }

    /// The leaf squares, as ranges of columns and rows, around the part of a bundle that begins at `t`. `None` outside of the city.
    #[inline]
    fn leaves_of(&self, bundle: &LineBundle, cover: &WindowCover, t: f32) -> Option<[(usize, usize); 2]> {
        let heights = self.heights;
        let per_m = 1.0 / (heights.per_leaf as f32 * heights.square_m);
        let counts = [heights.leaves.width as f32, heights.leaves.height as f32];
        let range = |axis: usize| {
            let from = bundle.start[axis] + bundle.along[axis] * t;
            let to = from + bundle.along[axis] * cover.way;
            let half = bundle.across[axis].abs() * cover.half_m;
            let (low, high) = ((from.min(to) - half) * per_m, (from.max(to) + half) * per_m);
            (high >= 0.0 && low < counts[axis])
                .then_some((low.max(0.0) as usize, (high as usize).min(counts[axis] as usize - 1)))
        };
        Some([range(0)?, range(1)?])
    }

    #[inline]
    fn all_leaves(&self, [columns, rows]: [(usize, usize); 2], mut check: impl FnMut(usize) -> bool) -> bool {
        let width = self.heights.leaves.width as usize;
        (rows.0..=rows.1).all(|y| (columns.0..=columns.1).all(|x| check(y * width + x)))
    }
}
