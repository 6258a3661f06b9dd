//! What the V-BlockMaps of one level draw, as a surface: points on it, and distances from it.
//!
//! Coordinates are metres from the root's south-west corner and above the city's height zero. Generated ground is left out.

use glam::{DVec2, DVec3};
use insula_protocol::blockmap::{CLIP_STEPS_PER_CELL, MIN_NORMAL_Z, MapColumn, STEPS_PER_CELL, strip_rows};
use insula_protocol::{BlockMap, NODE_CELLS, TileId, octahedral};
use std::f64::consts::TAU;

/// Steps of a sequence of points that fill a box evenly: powers of the inverse of 1.167304, the root of x^5 = x + 1 (Roberts 2018,
/// "The unreasonable effectiveness of quasirandom sequences").
const EVEN_STEPS: [f64; 4] = [0.856_675, 0.733_892, 0.628_707, 0.538_597];
/// Heights above the horizon from which the points of a surface are seen.
const VIEWS_DEG: [f64; 5] = [15.0, 40.0, 15.0, 40.0, 75.0];

/// The columns of some nodes of one level.
#[derive(Debug)]
pub struct ColumnField {
    cell_m: f64,
    /// Column and row of the first node.
    first: [u32; 2],
    /// Number of nodes along x and y.
    size: [usize; 2],
    /// The cells of each node in row-major order; empty where there is no node.
    nodes: Vec<Vec<Vec<CellPart>>>,
}

/// A part of a cell with the same solids.
#[derive(Debug)]
struct CellPart {
    /// Convex and counter-clockwise.
    outline: Vec<DVec2>,
    /// Full heights from the bottom up.
    solids: Vec<[f64; 2]>,
    /// Rise of the highest top around the cell's centre.
    slope: DVec2,
    centre: DVec2,
    /// Whether one sees below the lowest solid.
    is_open_below: bool,
}

impl ColumnField {
    /// The field of nodes of one level, which all have the same cells. `None` without nodes.
    pub fn new<'a>(maps: impl IntoIterator<Item = &'a BlockMap>) -> Option<Self> {
        let maps: Vec<&BlockMap> = maps.into_iter().collect();
        let cell_m = f64::from(maps.first()?.cell_m);
        let range = |axis: fn(TileId) -> u32| {
            let places = || maps.iter().map(|map| axis(map.id));
            Some((places().min()?, places().max()?))
        };
        let [(west, east), (south, north)] = [range(|id| id.x())?, range(|id| id.y())?];
        let (first, size) = ([west, south], [east - west, north - south].map(|n| n as usize + 1));
        let mut nodes: Vec<Vec<Vec<CellPart>>> = Vec::new();
        nodes.resize_with(size[0] * size[1], Vec::new);
        for map in maps {
            let [x, y] = [map.id.x() - west, map.id.y() - south].map(|n| n as usize);
            nodes[y * size[0] + x] = parts_of(map, cell_m);
        }
        Some(Self { cell_m, first, size, nodes })
    }

    /// Distance from a point to the nearest surface, at most `most_m`, which must be finite: from outside to a solid, from inside to where nothing is.
    pub fn distance_m(&self, p: DVec3, most_m: f64) -> f64 {
        let cell = (p.truncate() / self.cell_m).floor();
        let own = self.parts([cell.x as i64, cell.y as i64]);
        let here = own.iter().find(|part| part.nearest_in_outline(p.truncate()).1 == 0.0);
        let is_inside = here.is_some_and(|part| part.is_full_at(p));
        let (mut best, mut ring) = (most_m, 0i64);
        while ((ring - 1) as f64) * self.cell_m < best {
            let mut visit = |dx: i64, dy: i64| {
                best = best.min(self.cell_distance_m([cell.x as i64 + dx, cell.y as i64 + dy], p, is_inside, best));
            };
            for dx in -ring..=ring {
                visit(dx, -ring);
                if ring > 0 {
                    visit(dx, ring);
                }
            }
            for dy in 1 - ring..ring {
                visit(-ring, dy);
                visit(ring, dy);
            }
            ring += 1;
        }
        best
    }

    /// The points that `count` rays from above hit first, from 15, 40 and 75 degrees above the horizon and all around. Points within
    /// `margin_m` of the field's border are left out.
    pub fn seen_points(&self, count: usize, margin_m: f64) -> Vec<DVec3> {
        let [low, high] = self.extent_m();
        let solids = || self.nodes.iter().flatten().flatten().flat_map(|part| &part.solids);
        let bottom = solids().fold(f64::INFINITY, |z, solid| z.min(solid[0]));
        let top = solids().fold(f64::NEG_INFINITY, |z, solid| z.max(solid[1])) + self.cell_m;
        if bottom > top {
            return Vec::new();
        }
        let mut points = Vec::new();
        for i in 0..count {
            let [x, y, z, around] = EVEN_STEPS.map(|step| (0.5 + step * (i + 1) as f64).fract());
            let target = DVec3::new(x, y, z) * (high - low).extend(top - bottom) + low.extend(bottom);
            let (up, around) = (VIEWS_DEG[i % VIEWS_DEG.len()].to_radians(), around * TAU);
            let dir = -DVec3::new(libm::cos(around) * libm::cos(up), libm::sin(around) * libm::cos(up), libm::sin(up));
            points.extend(self.first_hit(target + dir * ((top - target.z) / dir.z), dir, bottom));
        }
        let (low, high) = (low + margin_m, high - margin_m);
        points.retain(|p| p.truncate().cmpgt(low).all() && p.truncate().cmplt(high).all());
        points
    }

    /// The first point of the surface on a ray that falls from `origin`. The search ends at the height `bottom`.
    fn first_hit(&self, origin: DVec3, dir: DVec3, bottom: f64) -> Option<DVec3> {
        let [low, high] = self.extent_m();
        // The part of the ray over the field.
        let (o, d) = (origin.truncate(), dir.truncate());
        let (to_low, to_high) = ((low - o) / d, (high - o) / d);
        let mut t = to_low.min(to_high).max_element().max(0.0);
        let end = to_low.max(to_high).min_element().min((bottom - origin.z) / dir.z);
        let step = d.signum();
        let mut cell = ((o + d * (t + 1e-9)) / self.cell_m).floor();
        while t < end {
            let parts = self.parts([cell.x as i64, cell.y as i64]).iter();
            let hits = parts.filter_map(|part| Some((part.first_hit(origin, dir)?, part)));
            if let Some((t, part)) = hits.min_by(|a, b| a.0.total_cmp(&b.0)) {
                // Below its bottom, a column that stands on the ground continues, but nobody sees it.
                let p = origin + dir * t;
                return Some(p).filter(|p| p.z >= part.solids.first().map_or(f64::INFINITY, |solid| solid[0]));
            }
            let next = ((cell + step.max(DVec2::ZERO)) * self.cell_m - o) / d;
            let axis = usize::from(next.y < next.x);
            t = next[axis];
            cell[axis] += step[axis];
        }
        None
    }

    /// South-west and north-east corner.
    fn extent_m(&self) -> [DVec2; 2] {
        let side_m = NODE_CELLS as f64 * self.cell_m;
        let corner = |nodes: [f64; 2]| DVec2::from(nodes) * side_m;
        let low = self.first.map(f64::from);
        [corner(low), corner([low[0] + self.size[0] as f64, low[1] + self.size[1] as f64])]
    }

    fn parts(&self, [x, y]: [i64; 2]) -> &[CellPart] {
        let n = NODE_CELLS as i64;
        let [column, row] = [x.div_euclid(n) - i64::from(self.first[0]), y.div_euclid(n) - i64::from(self.first[1])];
        if column < 0 || row < 0 || column >= self.size[0] as i64 || row >= self.size[1] as i64 {
            return &[];
        }
        let cells = &self.nodes[row as usize * self.size[0] + column as usize];
        cells.get((y.rem_euclid(n) * n + x.rem_euclid(n)) as usize).map_or(&[], Vec::as_slice)
    }

    /// Distance to the solids of a cell, or if `is_inside` to where it has none. Any distance if it is at least `most_m`.
    fn cell_distance_m(&self, [x, y]: [i64; 2], p: DVec3, is_inside: bool, most_m: f64) -> f64 {
        let low = DVec2::new(x as f64, y as f64) * self.cell_m;
        let aside_m = p.truncate().distance(p.truncate().clamp(low, low + self.cell_m));
        if aside_m >= most_m {
            return most_m;
        }
        let parts = self.parts([x, y]);
        if parts.is_empty() && is_inside {
            return aside_m;
        }
        parts.iter().map(|part| part.distance_m(p, is_inside)).fold(f64::INFINITY, f64::min)
    }
}

impl CellPart {
    /// The nearest point of the outline, and its distance: 0 inside.
    fn nearest_in_outline(&self, p: DVec2) -> (DVec2, f64) {
        let edges = (0..self.outline.len()).map(|i| (self.outline[i], self.outline[(i + 1) % self.outline.len()]));
        if edges.clone().all(|(a, b)| (b - a).perp_dot(p - a) >= -1e-9) {
            return (p, 0.0);
        }
        let nearest = edges.map(|(a, b)| {
            let share = (p - a).dot(b - a) / (b - a).length_squared().max(1e-12);
            a + (b - a) * share.clamp(0.0, 1.0)
        });
        let nearest = nearest.min_by(|a, b| a.distance_squared(p).total_cmp(&b.distance_squared(p))).unwrap_or(p);
        (nearest, nearest.distance(p))
    }

    /// Height of the highest top at a point of the outline.
    fn top_at(&self, at: DVec2) -> f64 {
        self.solids.last().map_or(f64::NEG_INFINITY, |[low, high]| (high + self.slope.dot(at - self.centre)).max(*low))
    }

    /// The solids at a point of the outline. The lowest one has no bottom if it stands on the ground.
    fn solids_at(&self, at: DVec2) -> impl Iterator<Item = [f64; 2]> + '_ {
        let (last, top) = (self.solids.len().saturating_sub(1), self.top_at(at));
        self.solids.iter().enumerate().map(move |(i, [low, high])| {
            let low = if i == 0 && !self.is_open_below { f64::NEG_INFINITY } else { *low };
            [low, if i == last { top } else { *high }]
        })
    }

    fn is_full_at(&self, p: DVec3) -> bool {
        self.solids_at(p.truncate()).any(|[low, high]| low < p.z && p.z < high)
    }

    fn distance_m(&self, p: DVec3, to_empty: bool) -> f64 {
        let (at, aside_m) = self.nearest_in_outline(p.truncate());
        let up_m = |low: f64, high: f64| (low - p.z).max(p.z - high).max(0.0);
        let (mut nearest, mut empty_from) = (f64::INFINITY, f64::NEG_INFINITY);
        for [low, high] in self.solids_at(at) {
            if !to_empty {
                nearest = nearest.min(up_m(low, high));
            } else if empty_from < low {
                nearest = nearest.min(up_m(empty_from, low));
            }
            empty_from = high;
        }
        if to_empty {
            nearest = nearest.min(up_m(empty_from, f64::INFINITY));
        }
        libm::hypot(aside_m, nearest)
    }

    /// Where a falling ray first meets a solid.
    fn first_hit(&self, origin: DVec3, dir: DVec3) -> Option<f64> {
        let (o, d) = (origin.truncate(), dir.truncate());
        let mut over = [0.0, f64::INFINITY];
        for i in 0..self.outline.len() {
            let (a, edge) = (self.outline[i], self.outline[(i + 1) % self.outline.len()] - self.outline[i]);
            keep_positive(&mut over, edge.perp_dot(o - a), edge.perp_dot(d));
        }
        let last = self.solids.len().saturating_sub(1);
        let hits = self.solids.iter().enumerate().filter_map(|(i, [low, high])| {
            let slope = if i == last { self.slope } else { DVec2::ZERO };
            let mut full = over;
            let below_top = high + slope.dot(o - self.centre) - origin.z;
            keep_positive(&mut full, below_top, slope.dot(d) - dir.z);
            if i > 0 || self.is_open_below {
                keep_positive(&mut full, origin.z - low, dir.z);
            }
            (full[0] < full[1]).then_some(full[0])
        });
        hits.min_by(f64::total_cmp)
    }
}

/// Keeps the part of an interval of `t` in which `value + rise * t` is positive.
fn keep_positive(interval: &mut [f64; 2], value: f64, rise: f64) {
    let zero = -value / rise;
    if rise > 0.0 {
        interval[0] = interval[0].max(zero);
    } else if rise < 0.0 {
        interval[1] = interval[1].min(zero);
    } else if value <= 0.0 {
        interval[1] = f64::NEG_INFINITY;
    }
}

fn parts_of(map: &BlockMap, cell_m: f64) -> Vec<Vec<CellPart>> {
    let corner = DVec2::new(f64::from(map.id.x()), f64::from(map.id.y())) * NODE_CELLS as f64;
    let columns = map.columns();
    let cell = |i: usize| corner + DVec2::new((i % NODE_CELLS) as f64, (i / NODE_CELLS) as f64);
    (0..columns.len())
        .map(|i| columns[i].as_ref().map_or_else(Vec::new, |column| cell_parts(map, column, cell(i) * cell_m, cell_m)))
        .collect()
}

fn cell_parts(map: &BlockMap, column: &MapColumn, low: DVec2, cell_m: f64) -> Vec<CellPart> {
    let metres = |code: u16| map.z_base_m() + f64::from(code) * f64::from(map.z_step_m());
    let centre = low + cell_m / 2.0;
    let [nx, ny, nz] = octahedral::decode(column.roof_normal).map(f64::from);
    let slope = if column.inclined { DVec2::new(-nx, -ny) / nz.max(f64::from(MIN_NORMAL_Z)) } else { DVec2::ZERO };
    let square = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|at| low + at * cell_m).to_vec();
    let solids: Vec<[f64; 2]> = full_codes(map, column).into_iter().map(|run| run.map(metres)).collect();
    let part = |outline: Vec<DVec2>, solids: Vec<[f64; 2]>, slope: DVec2| {
        let is_open_below = column.suspended;
        (outline.len() > 2).then_some(CellPart { outline, solids, slope, centre, is_open_below })
    };
    let (Some(clip), Some(strip)) = (column.clip, column.strip.as_ref()) else {
        return part(square, solids, slope).into_iter().collect();
    };
    let plane = |azimuth: u8, offset: i8| {
        let (sin, cos) = libm::sincos(f64::from(azimuth) / 256.0 * TAU);
        let normal = DVec2::new(cos, sin);
        (normal, normal.dot(centre) + f64::from(offset) / f64::from(CLIP_STEPS_PER_CELL) * cell_m)
    };
    let first = plane(strip.azimuth, clip.offset);
    let flip = |(normal, offset): (DVec2, f64)| (-normal, -offset);
    let cut =
        |planes: &[(DVec2, f64)]| planes.iter().fold(square.clone(), |outline, plane| keep_inner(&outline, *plane));
    let (inner, outer) = match clip.corner {
        None => (vec![cut(&[first])], vec![cut(&[flip(first)])]),
        Some(corner) => {
            let second = plane(corner.azimuth, corner.offset);
            let either = |a, b| vec![cut(&[a]), cut(&[b])];
            if corner.concave {
                (either(first, second), vec![cut(&[flip(first), flip(second)])])
            } else {
                (vec![cut(&[first, second])], either(flip(first), flip(second)))
            }
        }
    };
    let outer_solids = clip.outer.map(|outer| vec![[metres(column.z_min), metres(outer.z)]]).unwrap_or_default();
    let inner = inner.into_iter().filter_map(|outline| part(outline, solids.clone(), slope));
    let outer = outer.into_iter().filter_map(|outline| part(outline, outer_solids.clone(), DVec2::ZERO));
    inner.chain(outer).collect()
}

/// The part of a convex outline with `normal . p <= offset`.
fn keep_inner(outline: &[DVec2], (normal, offset): (DVec2, f64)) -> Vec<DVec2> {
    let mut kept = Vec::new();
    for i in 0..outline.len() {
        let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
        let (da, db) = (normal.dot(a) - offset, normal.dot(b) - offset);
        if da <= 0.0 {
            kept.push(a);
        }
        if (da <= 0.0) != (db <= 0.0) {
            kept.push(a + (b - a) * (da / (da - db)));
        }
    }
    kept
}

/// The full codes of a column from the bottom up: all but its gap and the open rows of its wall.
fn full_codes(map: &BlockMap, column: &MapColumn) -> Vec<[u16; 2]> {
    let (codes, (first, _)) = (STEPS_PER_CELL >> map.z_shift, strip_rows(column.z_min, column.z_max, map.z_shift));
    let rows = column.strip.iter().flat_map(|strip| strip.texels.iter().enumerate());
    let open_rows = rows.filter(|(_, texel)| texel.is_open()).map(|(k, _)| (first + k as u16) * codes);
    let open = column.gap.into_iter().chain(open_rows.map(|low| [low, low + codes]));
    open.fold(vec![[column.z_min, column.z_max]], |solids, [low, high]| {
        let split = solids.into_iter().flat_map(|[bottom, top]| [[bottom, top.min(low)], [bottom.max(high), top]]);
        split.filter(|[bottom, top]| bottom < top).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::Texel;
    use insula_protocol::blockmap::COLUMNS;

    /// A node with cells of 2 m: a tower of 2 x 2 cells and 40 m, and one cell in the air from 10 to 12 m.
    fn field() -> ColumnField {
        let mut columns = vec![None; COLUMNS];
        let column = |z_min, z_max, suspended| {
            Some(MapColumn { z_min, z_max, suspended, roof: Texel::default(), ..MapColumn::default() })
        };
        for at in [[30, 30], [31, 30], [30, 31], [31, 31]] {
            columns[at[1] * NODE_CELLS + at[0]] = column(0, 20 * STEPS_PER_CELL, false);
        }
        columns[30 * NODE_CELLS + 40] = column(5 * STEPS_PER_CELL, 6 * STEPS_PER_CELL, true);
        let id = TileId::new(2, 1, 0).unwrap();
        ColumnField::new([&BlockMap::from_columns(id, 2.0, 0, 0, &columns).unwrap()]).unwrap()
    }

    #[test]
    fn distances_are_those_of_boxes() {
        let (field, west) = (field(), 128.0);
        for (p, expected) in [
            ([west + 60.0, 60.0, 20.0], 0.0),
            ([west + 62.0, 62.0, 20.0], 2.0),
            ([west + 62.0, 62.0, 39.5], 0.5),
            ([west + 62.0, 62.0, 43.0], 3.0),
            ([west + 57.0, 56.0, 20.0], 5.0),
            ([west + 81.0, 61.0, 9.0], 1.0),
            ([west + 10.0, 10.0, 9.0], 30.0),
        ] {
            let found = field.distance_m(p.into(), 30.0);
            assert!((found - expected).abs() < 1e-6, "{p:?}: {found}");
        }
    }

    #[test]
    fn seen_points_have_no_distance_and_lie_on_all_faces() {
        let field = field();
        let points = field.seen_points(100_000, 1.0);
        assert!(points.iter().all(|p| field.distance_m(*p, 9.0) < 1e-6));
        let count = |is_on: fn(&DVec3) -> bool| points.iter().filter(|p| is_on(p)).count();
        let is = |a: f64, b: f64| (a - b).abs() < 1e-6;
        let tops = [count(|p| p.z > 39.99), count(|p| p.z > 11.99 && p.z < 12.01 && p.x > 206.0)];
        assert!(tops.iter().all(|count| *count > 2), "{tops:?}");
        let is_below = |p: &DVec3| p.z < 10.001 && p.x > 208.01 && p.x < 209.99 && p.y > 60.01 && p.y < 61.99;
        assert_eq!(count(is_below), 0, "from above");
        for (axis, end) in [(0, 188.0), (0, 192.0), (1, 60.0), (1, 64.0)] {
            assert!(points.iter().filter(|p| is(p[axis], end)).count() > 50, "{axis} {end}");
        }
        assert_eq!(points.iter().filter(|p| is(p.x, 190.0) && p.z < 39.9).count(), 0, "inside of the tower");
    }
}
