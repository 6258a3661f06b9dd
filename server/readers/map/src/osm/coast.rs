//! The sea of a map: what lies right of the ways with `natural=coastline`, up to the border of the map's extent.
//!
//! Ways are joined to chains and cut at the extent. A chain that is closed is an island, or a sea within land. Other chains lead from
//! border to border, and the border closes them. Where an extract lacks a piece of the coast, it is guessed: a straight line over a
//! short gap, else straight on to the border. Guesses are reported with their places.

use super::cover::Bounds;
use super::element::{Position, UNITS_PER_DEGREE, degrees};
use super::nesting::{Polygon, area, group};
use insula_dress::paint::{between, clip_segment};
use insula_dress::polygon::area_m2;
use insula_source::problems::{CONTRADICTION, GAP, OPEN_END, TOO_WIDE};
use std::collections::{HashMap, HashSet};

/// More nodes of all coastlines are refused.
pub(super) const MAX_NODES: usize = 8 << 20;
/// A wider or higher extent has no sea: it would be baked as far as the extent reaches, without a city.
const MAX_EXTENT_DEG: f64 = 1.0;
/// A chain that ends so near to the border was cut there.
const CUT_M: f64 = 200.0;
/// Longer gaps are not closed by a line.
const MAX_GAP_M: f64 = 2000.0;
/// More ends within the map are not compared with each other.
const MAX_ENDS: usize = 1024;
/// Points before an end that give its direction.
const DIRECTION_POINTS: usize = 12;
/// Length of a degree of latitude.
const DEGREE_M: f64 = 111_200.0;
/// Positions so near to the border, in units, are on it.
const ON_BORDER: f64 = 0.5;

/// A position in units, while it is computed with.
type Point = [f64; 2];

/// The sea, and what was guessed.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Sea {
    pub(super) polygons: Vec<Polygon>,
    /// Problems with their places.
    pub(super) problems: Vec<(&'static str, String)>,
}

impl Sea {
    /// The sea within an extent by pieces of coastlines, each in the direction that has the water on its right. From the border it goes
    /// straight on to that of `reach`, which the extent is within.
    pub(super) fn new(pieces: Vec<Vec<Position>>, [west, south, east, north]: Bounds, reach: Bounds) -> Self {
        let frame = Frame {
            low: [west, south].map(f64::from),
            high: [east, north].map(f64::from),
            scale: libm::cos(degrees([0, south / 2 + north / 2])[1].to_radians()),
        };
        let mut sea = Self::default();
        let widths = [0, 1].map(|axis| frame.high[axis] - frame.low[axis]);
        if widths.iter().any(|width| *width <= 0.0) {
            return sea;
        }
        if widths.iter().any(|width| *width > MAX_EXTENT_DEG * UNITS_PER_DEGREE) {
            sea.problems.push((TOO_WIDE, place_name([frame.low[0], frame.low[1]])));
            return sea;
        }
        let (mut rings, mut open) = (Vec::new(), Vec::new());
        for chain in join(pieces) {
            frame.cut(&chain, &mut rings, &mut open);
        }
        let open = frame.close_gaps(open, &mut rings, &mut sea.problems);
        let open: Vec<Vec<Point>> = open.into_iter().map(|chain| frame.extend(chain, &mut sea.problems)).collect();
        if open.is_empty() {
            // Islands alone lie in a sea that fills the map.
            let largest = rings.iter().map(|ring| area_m2(ring)).max_by(|a, b| a.abs().total_cmp(&b.abs()));
            if largest.is_some_and(|area| area > 0.0) {
                rings.push((0..=4).map(|corner| frame.at(f64::from(corner % 4))).collect());
            }
        } else {
            rings.extend(frame.around(frame.alternating(open, &mut sea.problems)));
        }
        sea.nest(rings.iter().map(|ring| frame.widened(ring, reach.map(f64::from))).collect());
        sea
    }

    /// Makes polygons of rings: seas are clockwise, islands are not.
    fn nest(&mut self, rings: Vec<Vec<Point>>) {
        let rings = rings.into_iter().filter_map(|ring| {
            let mut ring: Vec<Position> = ring.into_iter().map(|point| point.map(|v| v.round() as i32)).collect();
            ring.dedup();
            (ring.len() > 3).then_some(ring)
        });
        match group(rings.collect()) {
            Ok(polygons) => {
                for mut polygon in polygons {
                    let is_sea = polygon.first().is_some_and(|ring| area(ring) < 0.0);
                    let count = polygon.len();
                    let mut number = 0;
                    polygon.retain(|ring| {
                        number += 1;
                        number == 1 || area(ring) > 0.0
                    });
                    if !is_sea || polygon.len() < count {
                        let first = polygon.first().and_then(|ring| ring.first()).copied().unwrap_or_default();
                        self.problems.push((CONTRADICTION, place_name(first.map(f64::from))));
                    }
                    if is_sea {
                        self.polygons.push(polygon);
                    }
                }
            }
            Err(reason) => self.problems.push((reason, "coastline".to_owned())),
        }
    }
}

/// Joins pieces whose ends are at the same place. Closed chains end where they begin.
fn join(pieces: Vec<Vec<Position>>) -> Vec<Vec<Point>> {
    let mut starting: HashMap<Position, Vec<usize>> = HashMap::new();
    let mut ending: HashSet<Position> = HashSet::new();
    for (number, piece) in pieces.iter().enumerate().rev() {
        let (Some(first), Some(last)) = (piece.first(), piece.last()) else { continue };
        starting.entry(*first).or_default().push(number);
        ending.insert(*last);
    }
    let is_head = |piece: &Vec<Position>| piece.first().is_none_or(|first| !ending.contains(first));
    // First those that no other leads to, then the closed ones.
    let order = (0..pieces.len()).filter(|i| is_head(&pieces[*i])).chain(0..pieces.len());
    let mut is_used = vec![false; pieces.len()];
    let mut chains = Vec::new();
    for first in order {
        if std::mem::replace(&mut is_used[first], true) || pieces[first].len() < 2 {
            continue;
        }
        let mut chain = pieces[first].clone();
        while let Some(end) = chain.last().copied().filter(|end| chain.first() != Some(end)) {
            let next = starting.get_mut(&end).and_then(|numbers| {
                while let Some(number) = numbers.pop() {
                    if !std::mem::replace(&mut is_used[number], true) {
                        return Some(number);
                    }
                }
                None
            });
            let Some(next) = next else { break };
            chain.extend(pieces[next].iter().skip(1));
        }
        chains.push(chain.into_iter().map(|position| position.map(f64::from)).collect());
    }
    chains
}

/// The border of the map's extent. A place on it is a number from 0 to 4: clockwise from the south-western corner, one for each side.
#[derive(Debug, Clone, Copy)]
struct Frame {
    low: Point,
    high: Point,
    /// Length of a degree of longitude by one of latitude.
    scale: f64,
}

impl Frame {
    /// Adds what is within of a chain: a closed one to `rings`, or parts from border to border, or with ends within, to `open`.
    fn cut(&self, chain: &[Point], rings: &mut Vec<Vec<Point>>, open: &mut Vec<Vec<Point>>) {
        let is_closed = chain.len() > 3 && chain.first() == chain.last();
        let first_open = open.len();
        let mut part: Vec<Point> = Vec::new();
        let mut is_whole = true;
        let mut end = |part: &mut Vec<Point>| {
            let mut part = std::mem::take(part);
            part.dedup();
            if part.len() > 1 {
                open.push(part);
            }
        };
        for pair in chain.windows(2) {
            let Some([from, to]) = clip_segment(pair[0], pair[1], [self.low, self.high]) else {
                is_whole = false;
                end(&mut part);
                continue;
            };
            if part.is_empty() || from > 0.0 {
                end(&mut part);
                part.push(between(pair[0], pair[1], from));
            }
            part.push(if to < 1.0 { between(pair[0], pair[1], to) } else { pair[1] });
            if to < 1.0 || from > 0.0 {
                is_whole = false;
            }
            if to < 1.0 {
                end(&mut part);
            }
        }
        if is_closed && is_whole {
            rings.push(part);
            return;
        }
        end(&mut part);
        // A closed chain has no end where it begins.
        let parts = open.len() - first_open;
        if is_closed
            && parts > 1
            && open[first_open].first() == chain.first()
            && open[open.len() - 1].last() == chain.last()
        {
            let first = open.remove(first_open);
            if let Some(last) = open.last_mut() {
                last.extend(first.into_iter().skip(1));
            }
        }
    }

    /// Joins chains whose ends within the map are near each other, the nearest first. Those that are closed then go to `rings`.
    fn close_gaps(
        &self,
        mut open: Vec<Vec<Point>>,
        rings: &mut Vec<Vec<Point>>,
        problems: &mut Vec<(&'static str, String)>,
    ) -> Vec<Vec<Point>> {
        let inside = |point: Option<&Point>| point.copied().filter(|point| self.border_distance_m(*point) > CUT_M);
        let tails: Vec<(usize, Point)> =
            open.iter().enumerate().filter_map(|(i, chain)| Some((i, inside(chain.last())?))).collect();
        let heads: Vec<(usize, Point)> =
            open.iter().enumerate().filter_map(|(i, chain)| Some((i, inside(chain.first())?))).collect();
        if tails.len() > MAX_ENDS || heads.len() > MAX_ENDS {
            return open;
        }
        let mut gaps: Vec<(f64, usize, usize)> = Vec::new();
        for (from, tail) in &tails {
            for (to, head) in &heads {
                let gap_m = self.distance_m(*tail, *head);
                let is_nearer = gap_m < self.border_distance_m(*tail) + self.border_distance_m(*head);
                if gap_m <= MAX_GAP_M && is_nearer && (from != to || open[*from].len() > 2) {
                    gaps.push((gap_m, *from, *to));
                }
            }
        }
        gaps.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let (mut next, mut before) = (vec![None; open.len()], vec![None; open.len()]);
        for (gap_m, from, to) in gaps {
            if next[from].is_none() && before[to].is_none() {
                (next[from], before[to]) = (Some(to), Some(from));
                let at = open[from].last().copied().unwrap_or_default();
                problems.push((GAP, format!("{}, {gap_m:.0} m", place_name(at))));
            }
        }
        let order: Vec<usize> = (0..open.len()).filter(|i| before[*i].is_none()).chain(0..open.len()).collect();
        let mut joined = Vec::new();
        for first in order {
            let mut chain = std::mem::take(&mut open[first]);
            let mut last = first;
            while let Some(following) = next[last].filter(|following| !open[*following].is_empty()) {
                chain.append(&mut open[following]);
                last = following;
            }
            if chain.is_empty() {
                continue;
            }
            if next[last] == Some(first) {
                chain.push(chain[0]);
                rings.push(chain);
            } else {
                joined.push(chain);
            }
        }
        joined
    }

    /// Draws both ends of a chain on to the border.
    fn extend(&self, mut chain: Vec<Point>, problems: &mut Vec<(&'static str, String)>) -> Vec<Point> {
        for _ in 0..2 {
            chain.reverse();
            let Some(end) = chain.last().copied() else { continue };
            if self.is_on_border(end) {
                continue;
            }
            let nearest = self.nearest(end);
            let target = if self.distance_m(end, nearest) <= CUT_M {
                nearest
            } else {
                problems.push((OPEN_END, place_name(end)));
                let before = chain[chain.len() - chain.len().min(DIRECTION_POINTS)];
                self.ahead(before, end).unwrap_or(nearest)
            };
            chain.push(target);
        }
        chain
    }

    /// Leaves out chains after which the border would have water on both sides of a place, or land: along it, ends and starts alternate.
    /// Of two that contradict each other the longer one stays.
    fn alternating(&self, mut chains: Vec<Vec<Point>>, problems: &mut Vec<(&'static str, String)>) -> Vec<Vec<Point>> {
        let place = |point: Option<&Point>| point.map_or(0.0, |point| self.place(*point));
        let ends = chains
            .iter()
            .enumerate()
            .flat_map(|(number, chain)| [(place(chain.first()), true, number), (place(chain.last()), false, number)]);
        let mut ends: Vec<(f64, bool, usize)> = ends.collect();
        ends.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let lengths: Vec<f64> = chains.iter().map(|chain| self.length_m(chain)).collect();
        // Each step removes a chain.
        for _ in 0..MAX_ENDS {
            let next = |i: usize| ends[(i + 1) % ends.len()];
            let Some(at) = (0..ends.len()).find(|i| ends[*i].1 == next(*i).1) else { return chains };
            let (one, other) = (ends[at].2, next(at).2);
            let shorter = if lengths[one] < lengths[other] { one } else { other };
            let chain = std::mem::take(&mut chains[shorter]);
            problems.push((CONTRADICTION, place_name(chain.first().copied().unwrap_or_default())));
            ends.retain(|(.., number)| *number != shorter);
        }
        Vec::new()
    }

    /// A closed ring whose parts along the border are moved to that of a larger extent.
    fn widened(&self, ring: &[Point], [west, south, east, north]: [f64; 4]) -> Vec<Point> {
        let is_at = |a: f64, b: f64| (a - b).abs() <= ON_BORDER;
        let outside = |point: Point| {
            [(0, west, east), (1, south, north)].map(|(axis, low, high)| match point[axis] {
                v if is_at(v, self.low[axis]) => low,
                v if is_at(v, self.high[axis]) => high,
                v => v,
            })
        };
        // Ends on different sides are those of a coast.
        let is_along = |from: Point, to: Point| {
            (0..2).any(|axis| {
                [self.low[axis], self.high[axis]].iter().any(|side| is_at(from[axis], *side) && is_at(to[axis], *side))
            })
        };
        let mut wide: Vec<Point> = Vec::with_capacity(ring.len() + 4);
        for pair in ring.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            wide.extend(if is_along(from, to) { [outside(from), outside(to)] } else { [from, to] });
        }
        // The ring may begin where a coast meets the border.
        wide.extend(wide.first().copied());
        wide
    }

    fn length_m(&self, chain: &[Point]) -> f64 {
        chain.windows(2).map(|pair| self.distance_m(pair[0], pair[1])).sum()
    }

    /// Closes chains from border to border: from the end of each along the border, with the water on the right, to the next start.
    fn around(&self, chains: Vec<Vec<Point>>) -> Vec<Vec<Point>> {
        let place = |point: Option<&Point>| point.map_or(0.0, |point| self.place(*point));
        let with_ends = chains.iter().enumerate().filter(|(_, chain)| !chain.is_empty());
        let mut starts: Vec<(f64, usize)> = with_ends.map(|(number, chain)| (place(chain.first()), number)).collect();
        starts.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut is_used = vec![false; chains.len()];
        let mut rings = Vec::new();
        for first in 0..chains.len() {
            if is_used[first] || chains[first].is_empty() {
                continue;
            }
            let (mut ring, mut number) = (Vec::new(), first);
            loop {
                is_used[number] = true;
                ring.extend_from_slice(&chains[number]);
                let end = place(chains[number].last());
                let from = starts.partition_point(|(start, _)| *start < end);
                let mut ahead = starts[from..].iter().chain(&starts[..from]);
                let Some((start, next)) = ahead.find(|(_, next)| *next == first || !is_used[*next]) else { break };
                // The corners between, clockwise.
                let to = if *start < end { start + 4.0 } else { *start };
                let mut corner = end.floor() + 1.0;
                while corner < to {
                    ring.push(self.at(corner % 4.0));
                    corner += 1.0;
                }
                number = *next;
                if number == first {
                    break;
                }
            }
            if let Some(start) = ring.first().copied() {
                ring.push(start);
            }
            rings.push(ring);
        }
        rings
    }

    /// The position of a place on the border.
    fn at(&self, place: f64) -> Point {
        let ([west, south], [east, north]) = (self.low, self.high);
        let share = place - place.floor();
        match place.floor() as u8 {
            0 => [west, south + share * (north - south)],
            1 => [west + share * (east - west), north],
            2 => [east, north - share * (north - south)],
            _ => [east - share * (east - west), south],
        }
    }

    /// The place on the border that is nearest to a position.
    fn place(&self, [x, y]: Point) -> f64 {
        let ([west, south], [east, north]) = (self.low, self.high);
        let along = [(y - south) / (north - south), (x - west) / (east - west)].map(|share| share.clamp(0.0, 1.0));
        let sides =
            [(x - west).abs() * self.scale, (north - y).abs(), (east - x).abs() * self.scale, (y - south).abs()];
        let nearest = (1..4).fold(0, |nearest, side| if sides[side] < sides[nearest] { side } else { nearest });
        let share = [along[0], along[1], 1.0 - along[0], 1.0 - along[1]][nearest];
        (nearest as f64 + share) % 4.0
    }

    fn nearest(&self, point: Point) -> Point {
        self.at(self.place(point))
    }

    fn border_distance_m(&self, point: Point) -> f64 {
        self.distance_m(point, self.nearest(point))
    }

    fn is_on_border(&self, point: Point) -> bool {
        let nearest = self.nearest(point);
        (0..2).all(|axis| (point[axis] - nearest[axis]).abs() <= ON_BORDER)
    }

    fn distance_m(&self, a: Point, b: Point) -> f64 {
        libm::hypot((a[0] - b[0]) * self.scale, a[1] - b[1]) / UNITS_PER_DEGREE * DEGREE_M
    }

    /// Where the way from one position to another, which is within, leaves the map.
    fn ahead(&self, before: Point, end: Point) -> Option<Point> {
        let step = [end[0] - before[0], end[1] - before[1]];
        let length = libm::hypot(step[0], step[1]);
        let reach = self.high[0] - self.low[0] + self.high[1] - self.low[1];
        let far = [0, 1].map(|axis| end[axis] + step[axis] / length * reach);
        let [_, to] = clip_segment(end, far, [self.low, self.high]).filter(|_| length > 0.0)?;
        Some(between(end, far, to))
    }
}

/// Latitude and longitude in degrees.
fn place_name(point: Point) -> String {
    let [lon, lat] = point.map(|v| v / UNITS_PER_DEGREE);
    format!("near {lat:.5}, {lon:.5}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// About 11 km along each side.
    const EXTENT: Bounds = [0, 0, 1_000_000, 1_000_000];

    /// A piece of coast, in hundredths of the extent.
    fn piece(points: &[[i32; 2]]) -> Vec<Position> {
        points.iter().map(|point| point.map(|v| v * 10_000)).collect()
    }

    fn sea(pieces: &[&[[i32; 2]]]) -> Sea {
        Sea::new(pieces.iter().map(|points| piece(points)).collect(), EXTENT, EXTENT)
    }

    /// Whether a position, in hundredths of the extent, is water: by the crossings of a line to the west.
    fn is_water(sea: &Sea, x: f64, y: f64) -> bool {
        let crosses = |pair: &[Position]| {
            let [a, b] = [pair[0], pair[1]].map(|position| position.map(|v| f64::from(v) / 10_000.0));
            (a[1] > y) != (b[1] > y) && a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) < x
        };
        sea.polygons.iter().flatten().flat_map(|ring| ring.windows(2)).filter(|pair| crosses(pair)).count() % 2 == 1
    }

    fn reasons(sea: &Sea) -> Vec<&'static str> {
        sea.problems.iter().map(|(reason, _)| *reason).collect()
    }

    #[test]
    fn water_is_on_the_right_up_to_the_border() {
        // The land is in the north, with a bay; the coast runs eastwards in pieces and leaves the map. An island lies in the south.
        let sea = sea(&[
            &[[60, 50], [120, 45]],
            &[[40, 50], [40, 80], [60, 80], [60, 50]],
            &[[20, 10], [40, 10], [40, 30], [20, 30], [20, 10]],
            &[[-30, 50], [40, 50]],
        ]);
        assert_eq!(reasons(&sea), [""; 0]);
        for (x, y, expected) in [
            (50.0, 40.0, true),
            (50.0, 70.0, true),
            (50.0, 90.0, false),
            (10.0, 60.0, false),
            (99.0, 1.0, true),
            (99.0, 99.0, false),
            (30.0, 20.0, false),
            (45.0, 20.0, true),
            (1.0, 1.0, true),
        ] {
            assert_eq!(is_water(&sea, x, y), expected, "{x} {y} {sea:?}");
        }
    }

    #[test]
    fn missing_pieces_are_guessed_and_reported() {
        // Gaps of a kilometre become lines, ends far from the border go on to it.
        let gap = sea(&[&[[-30, 50], [40, 50]], &[[49, 50], [130, 50]]]);
        assert_eq!(reasons(&gap), [GAP]);
        assert!(is_water(&gap, 44.0, 49.0) && !is_water(&gap, 44.0, 51.0), "{gap:?}");
        assert!(gap.problems[0].1.starts_with("near 0.05000, 0.04000"), "{gap:?}");
        let end = sea(&[&[[-30, 50], [40, 50], [50, 60]]]);
        assert_eq!(reasons(&end), [OPEN_END]);
        assert!(is_water(&end, 80.0, 50.0) && !is_water(&end, 60.0, 95.0), "{end:?}");
        // Cut at the border: no guess.
        assert_eq!(reasons(&sea(&[&[[1, 50], [99, 50]]])), [""; 0]);
    }

    #[test]
    fn islands_and_seas_alone() {
        let island: &[[i32; 2]] = &[[20, 20], [40, 20], [40, 40], [20, 40], [20, 20]];
        let around = sea(&[island]);
        assert!(is_water(&around, 10.0, 10.0) && !is_water(&around, 30.0, 30.0), "{around:?}");
        let mut turned = island.to_vec();
        turned.reverse();
        let inland = sea(&[&turned]);
        assert!(!is_water(&inland, 10.0, 10.0) && is_water(&inland, 30.0, 30.0), "{inland:?}");
        // A coast that begins within, goes out of the map and comes back: the border would have the sea on both sides.
        let bent = sea(&[&[[20, 1], [18, 1], [18, -5], [30, -5], [30, 20], [60, 95]]]);
        assert_eq!(reasons(&bent), [OPEN_END, CONTRADICTION]);
        assert!(is_water(&bent, 80.0, 50.0) && !is_water(&bent, 10.0, 50.0), "{bent:?}");
        // An island that the border cuts.
        let cut = sea(&[&[[80, 20], [120, 20], [120, 40], [80, 40], [80, 20]]]);
        assert!(is_water(&cut, 10.0, 10.0) && is_water(&cut, 99.0, 90.0) && !is_water(&cut, 90.0, 30.0), "{cut:?}");
        // Within land.
        let wrong = sea(&[&[[-30, 50], [130, 50]], &[[20, 60], [40, 60], [40, 80], [20, 80], [20, 60]]]);
        assert_eq!(reasons(&wrong), [CONTRADICTION]);
        assert!(!is_water(&wrong, 30.0, 70.0) && is_water(&wrong, 30.0, 30.0), "{wrong:?}");
        assert_eq!(Sea::new(Vec::new(), EXTENT, EXTENT), Sea::default());
        let wide = [0, 0, 1_000_000, 20_000_000];
        assert_eq!(reasons(&Sea::new(vec![piece(island)], wide, wide)), [TOO_WIDE]);
    }

    #[test]
    fn the_sea_goes_straight_on_beyond_the_border() {
        // The land is in the north-west; its objects reach out to all sides.
        let coast =
            [piece(&[[-30, 40], [50, 60], [50, 130]]), piece(&[[70, 20], [90, 20], [90, 30], [70, 30], [70, 20]])];
        let sea = Sea::new(Vec::from(coast), EXTENT, [-50_000, -20_000, 1_100_000, 1_030_000]);
        assert_eq!(reasons(&sea), [""; 0]);
        for (x, y, expected) in [
            (-4.0, 44.0, true),
            (-4.0, 55.0, false),
            (40.0, -1.0, true),
            (109.0, -1.0, true),
            (109.0, 102.0, true),
            (52.0, 102.0, true),
            (48.0, 102.0, false),
            (80.0, 25.0, false),
            (60.0, 60.0, true),
            (112.0, 50.0, false),
        ] {
            assert_eq!(is_water(&sea, x, y), expected, "{x} {y} {sea:?}");
        }
    }
}
