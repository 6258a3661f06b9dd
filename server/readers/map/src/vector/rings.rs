//! Groups loose rings into polygons with holes.

use super::geometry::{Polygon, Ring, extent_of};
use insula_dress::palette::area_vector;
use insula_source::ring_inside::point_inside;

/// Corners that are visited when rings are assigned to those around them; of the rings past it, those that turn as holes do are left
/// out.
const MAX_STEPS: u64 = 200_000_000;

/// Holes may reach outside of their outer ring by this share of their size.
const OUTSIDE_SHARE: f64 = 0.02;

/// A ring that turns as another one does, and is hardly smaller, is a copy of it and no hole.
const COPY_SHARE: f64 = 0.02;

/// Polygons whose heights differ by more are not at the same height: one may be the roof above the other.
const SAME_HEIGHT: f64 = 0.001;

/// Extent of a ring, and twice its signed area on the map.
struct RingFacts {
    bounds: [f64; 4],
    heights: [f64; 2],
    area: f64,
}

impl RingFacts {
    fn of(ring: &Ring) -> Self {
        let of_none = [f64::INFINITY, f64::NEG_INFINITY];
        let heights = ring.iter().fold(of_none, |[low, high], [.., z]| [low.min(*z), high.max(*z)]);
        Self { bounds: extent_of(ring), heights, area: 2.0 * area_vector(ring).z }
    }

    /// Whether another ring may lie in this one, by bounds, areas and heights.
    fn can_own(&self, other: &Self) -> bool {
        let least = if self.turns_as(other) { 1.0 + COPY_SHARE } else { 1.0 };
        let [low, high] = self.heights;
        let is_larger = self.area.abs() > least * other.area.abs();
        let has_height = !self.turns_as(other) || low <= other.heights[0] && other.heights[1] <= high;
        is_larger && has_height && self.encloses(other)
    }

    /// Whether another ring is certainly no hole in this one, and not one that only reaches outside.
    fn is_no_owner(&self, other: &Self) -> bool {
        let ([w, s, e, n], [ow, os, oe, on]) = (self.bounds, other.bounds);
        let is_apart = ow > e || oe < w || os > n || on < s;
        is_apart || other.area.abs() > self.area.abs() && other.encloses(self)
    }

    fn turns_as(&self, other: &Self) -> bool {
        (self.area < 0.0) == (other.area < 0.0)
    }

    /// Rings around this one begin further to the west than this.
    fn west_of_owners(&self) -> f64 {
        let [west, _, east, _] = self.bounds;
        west + OUTSIDE_SHARE * (east - west)
    }

    /// Whether the bounds have those of another ring in them, but for what drawing errors may be.
    fn encloses(&self, other: &Self) -> bool {
        let ([w, s, e, n], [_, os, oe, on]) = (self.bounds, other.bounds);
        let (x, y) = (OUTSIDE_SHARE * (oe - other.bounds[0]), OUTSIDE_SHARE * (on - os));
        w <= other.west_of_owners() && s <= os + y && e >= oe - x && n >= on - y
    }

    /// Whether the ring has an area on the map; a wall has none.
    fn is_flat(&self) -> bool {
        let [w, s, e, n] = self.bounds;
        self.area.abs() > 1e-9 * ((e - w).powi(2) + (n - s).powi(2))
    }
}

/// Rings of one polygon or of several, grouped.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Grouped {
    pub(super) polygons: Vec<Polygon>,
    /// Rings that are left out because finding what they lie in would take too long.
    pub(super) left_out: usize,
    /// Holes that turn as their outer ring does.
    pub(super) turned_holes: usize,
}

/// Groups rings into polygons by containment. The direction in which they turn does not count: a ring in an outer ring is a hole, and a
/// ring in a hole is the outer ring of another polygon. Rings that overlap, and copies of a ring, are polygons of their own. If two
/// rings turn the same way, the inner one is a hole only if its heights are within those of the outer one, because the roof of a body
/// lies above its floor.
pub(super) fn group(rings: Vec<Ring>) -> Grouped {
    if rings.len() <= 1 {
        let polygons = rings.into_iter().map(|ring| vec![ring]).collect();
        return Grouped { polygons, ..Grouped::default() };
    }
    let facts: Vec<RingFacts> = rings.iter().map(RingFacts::of).collect();
    let (owners, left_out) = owners_of(&rings, &facts);
    // What a ring lies in is larger, so it comes before.
    let mut order: Vec<usize> = (0..rings.len()).collect();
    order.sort_by(|a, b| facts[*b].area.abs().total_cmp(&facts[*a].area.abs()));
    let mut is_hole = vec![false; rings.len()];
    let mut turned_holes = 0;
    for index in order {
        if let Owner::Ring(owner) = owners[index] {
            is_hole[index] = !is_hole[owner];
            turned_holes += usize::from(is_hole[index] && facts[index].turns_as(&facts[owner]));
        }
    }
    let mut grouped = Grouped { left_out, turned_holes, ..Grouped::default() };
    let mut polygon_of = vec![usize::MAX; rings.len()];
    let mut holes = Vec::new();
    for (index, ring) in rings.into_iter().enumerate() {
        match owners[index] {
            Owner::Unknown => {}
            Owner::Ring(owner) if is_hole[index] => holes.push((owner, ring)),
            Owner::None | Owner::Ring(_) => {
                polygon_of[index] = grouped.polygons.len();
                grouped.polygons.push(vec![ring]);
            }
        }
    }
    for (owner, hole) in holes {
        let polygon = polygon_of.get(owner).and_then(|index| grouped.polygons.get_mut(*index));
        if let Some(polygon) = polygon {
            polygon.push(hole);
        }
    }
    grouped
}

/// Regroups polygons whose first ring cannot be the outer ring of the others, because another ring encloses it or lies apart from it.
/// Returns whether there was such a polygon.
pub(super) fn regroup(polygons: &mut Vec<Polygon>) -> bool {
    let is_wrong = |polygon: &Polygon| {
        let Some((first, others)) = polygon.split_first().filter(|(_, others)| !others.is_empty()) else {
            return false;
        };
        let around = RingFacts::of(first);
        around.is_flat() && others.iter().map(RingFacts::of).any(|ring| ring.is_flat() && around.is_no_owner(&ring))
    };
    if !polygons.iter().any(is_wrong) {
        return false;
    }
    let grouped = |polygon: Polygon| if is_wrong(&polygon) { group(polygon).polygons } else { vec![polygon] };
    *polygons = std::mem::take(polygons).into_iter().flat_map(grouped).collect();
    true
}

/// Polygons of a feature that lie within others of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Nested {
    /// Those that became holes.
    pub(super) holes: usize,
    /// Those that stay.
    pub(super) parts: usize,
}

/// Makes holes of the polygons of a feature that lie within another of it at the same height, and turn the other way: their writer took
/// each ring for a polygon. Those that turn the same way stay.
pub(super) fn unnest(polygons: &mut Vec<Polygon>) -> Nested {
    let mut nested = Nested::default();
    if polygons.len() < 2 {
        return nested;
    }
    // Outer rings first, then the holes, in which other polygons may lie.
    let count = polygons.len();
    let outer = polygons.iter().map(|polygon| polygon.first().cloned().unwrap_or_default());
    let holes = polygons.iter().flat_map(|polygon| polygon.iter().skip(1)).cloned();
    let rings: Vec<Ring> = outer.chain(holes).collect();
    let facts: Vec<RingFacts> = rings.iter().map(RingFacts::of).collect();
    let (owners, _) = owners_of(&rings, &facts);
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| facts[*b].area.abs().total_cmp(&facts[*a].area.abs()));
    let mut hole_of = vec![None; count];
    let mut steps = 0;
    for index in order {
        let Owner::Ring(owner) = owners[index] else { continue };
        let (own, around) = (&facts[index], &facts[owner]);
        let is_same_height = (0..2).all(|end| (own.heights[end] - around.heights[end]).abs() <= SAME_HEIGHT);
        let is_smaller = around.area.abs() > (1.0 + COPY_SHARE) * own.area.abs();
        let is_within = owner < count && hole_of[owner].is_none() && is_same_height && is_smaller;
        if !is_within {
            continue;
        }
        steps += (rings[owner].len() * rings[index].len()) as u64;
        if steps > MAX_STEPS || !is_near_inside([&rings[owner], &rings[index]], own) {
            continue;
        }
        if own.turns_as(around) || polygons[index].len() > 1 {
            nested.parts += 1;
        } else {
            hole_of[index] = Some(owner);
            nested.holes += 1;
        }
    }
    for (index, owner) in hole_of.iter().enumerate() {
        if let Some(owner) = owner {
            let hole = std::mem::take(&mut polygons[index]);
            polygons[*owner].extend(hole);
        }
    }
    polygons.retain(|polygon| !polygon.is_empty());
    nested
}

/// What a ring lies in.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Owner {
    None,
    /// The smallest ring around it, which has a larger area.
    Ring(usize),
    /// Not looked for, because that would take too long.
    Unknown,
}

/// What each ring lies in, and how many are [`Owner::Unknown`].
fn owners_of(rings: &[Ring], facts: &[RingFacts]) -> (Vec<Owner>, usize) {
    let mut owners = vec![Owner::None; rings.len()];
    let mut order: Vec<usize> = (0..rings.len()).filter(|index| facts[*index].is_flat()).collect();
    // A sweep from west to east. Those of one place go from the largest to the smallest.
    let start = |index: usize| facts[index].west_of_owners();
    order.sort_by(|a, b| {
        let by_area = facts[*b].area.abs().total_cmp(&facts[*a].area.abs());
        facts[*a].bounds[0].total_cmp(&facts[*b].bounds[0]).then(by_area)
    });
    let mut active: Vec<usize> = Vec::new();
    let mut waiting = order.iter().copied().peekable();
    let (mut steps, mut left_out) = (0, 0);
    for &index in &order {
        let own = &facts[index];
        while let Some(next) = waiting.next_if(|next| facts[*next].bounds[0] <= start(index)) {
            active.push(next);
        }
        active.retain(|other| facts[*other].bounds[2] >= own.bounds[0]);
        steps += active.len() as u64 / 8;
        if steps > MAX_STEPS {
            // Of rings by the thousand, those that turn as outer rings do stay.
            if own.area > 0.0 {
                owners[index] = Owner::Unknown;
                left_out += 1;
            }
            continue;
        }
        let mut best: Option<usize> = None;
        // The nearest ones were reached last.
        for &other in active.iter().rev() {
            let around = &facts[other];
            let is_better = best.is_none_or(|best| around.area.abs() < facts[best].area.abs());
            if is_better && around.can_own(own) && contains([&rings[other], &rings[index]], [around, own], &mut steps) {
                best = Some(other);
            }
        }
        owners[index] = best.map_or(Owner::None, Owner::Ring);
    }
    (owners, left_out)
}

/// Whether a ring is within another. A place inside of it decides, because its corners may be on the other ring, or a little
/// outside. Of rings that turn the same way, which may only overlap, no corner may be further outside.
fn contains([outer, inner]: [&Ring; 2], [around, own]: [&RingFacts; 2], steps: &mut u64) -> bool {
    let on_map: Vec<[f64; 2]> = inner.iter().map(|[x, y, _]| [*x, *y]).collect();
    let Some(place) = point_inside(&on_map) else { return false };
    *steps += (outer.len() + inner.len()) as u64;
    if !is_inside(outer, place) {
        return false;
    }
    if !own.turns_as(around) {
        return true;
    }
    *steps += (outer.len() * inner.len()) as u64;
    *steps <= MAX_STEPS && is_near_inside([outer, inner], own)
}

/// Whether no corner of a ring is further outside of another than drawing errors are.
fn is_near_inside([outer, inner]: [&Ring; 2], own: &RingFacts) -> bool {
    let [west, south, east, north] = own.bounds;
    let slack = OUTSIDE_SHARE * (east - west).max(north - south);
    let is_near = |corner: [f64; 2]| is_inside(outer, corner) || distance_squared(outer, corner) <= slack * slack;
    inner.iter().all(|[x, y, _]| is_near([*x, *y]))
}

/// Whether a place is within a closed ring.
fn is_inside(ring: &Ring, [x, y]: [f64; 2]) -> bool {
    let crosses = |pair: &&[[f64; 3]]| {
        let ([ax, ay, _], [bx, by, _]) = (pair[0], pair[1]);
        (ay > y) != (by > y) && ax + (y - ay) / (by - ay) * (bx - ax) > x
    };
    ring.windows(2).filter(crosses).count() % 2 == 1
}

/// Square of the distance of a place from the nearest edge of a ring.
fn distance_squared(ring: &Ring, [x, y]: [f64; 2]) -> f64 {
    let to_edge = |pair: &[[f64; 3]]| {
        let ([ax, ay, _], [bx, by, _]) = (pair[0], pair[1]);
        let (dx, dy) = (bx - ax, by - ay);
        let length = dx * dx + dy * dy;
        let along = if length > 0.0 { (((x - ax) * dx + (y - ay) * dy) / length).clamp(0.0, 1.0) } else { 0.0 };
        (ax + along * dx - x).powi(2) + (ay + along * dy - y).powi(2)
    };
    ring.windows(2).map(to_edge).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64, size: f64, clockwise: bool) -> Ring {
        let mut ring =
            vec![[x, y, 0.0], [x + size, y, 0.0], [x + size, y + size, 0.0], [x, y + size, 0.0], [x, y, 0.0]];
        if clockwise {
            ring.reverse();
        }
        ring
    }

    #[test]
    fn holes_find_their_outer_ring() {
        let (big, small, island) = (square(0., 0., 10., true), square(20., 0., 3., true), square(3., 3., 1., true));
        let (yard, far) = (square(2., 2., 4., false), square(21., 1., 1., false));
        let rings = vec![far.clone(), big.clone(), yard.clone(), small.clone(), island.clone()];
        let polygons = vec![vec![big, yard], vec![small, far], vec![island]];
        assert_eq!(group(rings), Grouped { polygons, ..Grouped::default() });
    }

    #[test]
    fn holes_are_holes_whichever_way_they_turn() {
        for turns in 0..8_u32 {
            let of = |x: f64, size: f64, bit: u32| square(x, x, size, turns & (1 << bit) != 0);
            let (big, yard, island) = (of(0., 10., 0), of(2., 5., 1), of(3., 1., 2));
            let found = group(vec![big.clone(), yard.clone(), island.clone()]);
            let turned = usize::from((turns & 1) == ((turns >> 1) & 1));
            let expected = Grouped { polygons: vec![vec![big, yard], vec![island]], left_out: 0, turned_holes: turned };
            assert_eq!(found, expected, "turns {turns}");
        }
    }

    #[test]
    fn overlaps_copies_and_roofs_are_no_holes() {
        let big = square(0., 0., 10., true);
        let angle: Ring = [[0., 0.], [0., 10.], [4., 10.], [4., 4.], [10., 4.], [10., 0.], [0., 0.]]
            .map(|[x, y]| [x, y, 0.])
            .to_vec();
        let roof = square(2., 2., 5., true).into_iter().map(|[x, y, _]| [x, y, 9.]).collect();
        for (outer, other) in [(&big, big.clone()), (&angle, square(1., 1., 6., true)), (&big, roof)] {
            assert_eq!(group(vec![outer.clone(), other]).polygons.len(), 2);
        }
    }

    #[test]
    fn polygons_whose_first_ring_is_not_around_the_others_are_grouped_anew() {
        let (big, yard, far) = (square(0., 0., 10., true), square(2., 2., 4., false), square(50., 0., 1., true));
        let mut polygons = vec![vec![yard.clone(), big.clone(), far.clone()]];
        assert!(regroup(&mut polygons));
        assert_eq!(polygons, [vec![big.clone(), yard.clone()], vec![far]]);
        // A hole that reaches outside stays one.
        let good = vec![vec![big.clone(), yard], vec![big, square(8., 2., 4., true)]];
        let mut polygons = good.clone();
        assert!(!regroup(&mut polygons));
        assert_eq!(polygons, good);
    }

    #[test]
    fn polygons_within_others_of_a_feature_are_holes_if_they_turn_the_other_way() {
        let (big, hole, part) = (square(0., 0., 10., false), square(2., 2., 4., true), square(7., 7., 2., false));
        let (island, far) = (square(3., 3., 1., false), square(50., 0., 4., true));
        let mut polygons: Vec<Polygon> = [&hole, &big, &island, &part, &far].map(|ring| vec![ring.clone()]).into();
        assert_eq!(unnest(&mut polygons), Nested { holes: 1, parts: 1 });
        assert_eq!(polygons, [vec![big.clone(), hole.clone()], vec![island.clone()], vec![part], vec![far]]);
        // An island in a hole, a floor below a roof, neighbours and a copy are none.
        let floor = hole.iter().map(|[x, y, _]| [*x, *y, -3.]).collect();
        let angle: Ring = [[0., 0.], [10., 0.], [10., 4.], [4., 4.], [4., 10.], [0., 10.], [0., 0.]]
            .map(|[x, y]| [x, y, 0.])
            .to_vec();
        for polygons in [
            vec![vec![big.clone(), hole.clone()], vec![island]],
            vec![vec![big.clone()], vec![floor]],
            vec![vec![angle], vec![square(0.5, 0.5, 6., true)]],
            vec![vec![big.clone()], vec![square(0., 0., 10., true)]],
            vec![vec![big]],
        ] {
            let mut found = polygons.clone();
            assert_eq!(unnest(&mut found), Nested::default(), "{polygons:?}");
            assert_eq!(found, polygons);
        }
    }

    #[test]
    fn wrong_directions_are_understood() {
        let (big, hole, stray) = (square(0., 0., 10., false), square(2., 2., 4., false), square(50., 0., 1., false));
        // Both counter-clockwise and apart: both are outer rings.
        assert_eq!(group(vec![big, stray.clone()]).polygons.len(), 2);
        let clockwise = square(0., 0., 10., true);
        let found = group(vec![clockwise.clone(), hole.clone(), stray.clone()]).polygons;
        assert_eq!(found, [vec![clockwise, hole], vec![stray]], "a hole outside of all is a polygon");
        // A hole that touches the outer ring.
        for touching in [square(0., 0., 4., false), square(-0.005, 3., 4., false), square(3., 6.005, 4., false)] {
            assert_eq!(group(vec![square(0., 0., 10., true), touching]).polygons.len(), 1);
        }
    }

    #[test]
    fn many_rings_end() {
        let rings: Vec<Ring> =
            (0..3000).map(|i| square(f64::from(i), f64::from(i), f64::from(10_000 - 2 * i), i % 2 == 0)).collect();
        assert_eq!(group(rings).polygons.len(), 1500);
        assert!(group(Vec::new()).polygons.is_empty());
        let broken = vec![vec![[f64::NAN; 3]; 5], Vec::new(), square(0., 0., 1., true)];
        assert_eq!(group(broken).polygons.len(), 3);
        // Islands of an archipelago are compared with few others.
        let islands = (0..40_000).map(|i| square(f64::from(i % 200) * 3., f64::from(i / 200) * 3., 1., i % 2 == 0));
        let found = group(islands.collect());
        assert_eq!((found.polygons.len(), found.left_out), (40_000, 0));
    }
}
