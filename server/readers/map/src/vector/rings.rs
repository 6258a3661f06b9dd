//! Groups loose rings into polygons with holes.

use super::geometry::{Polygon, Ring};
use insula_source::ring_inside::point_inside;

/// Corners that are visited when holes are assigned to outer rings; the holes past it are left out.
const MAX_STEPS: u64 = 200_000_000;

/// Holes may reach outside of their outer ring by this share of their size.
const OUTSIDE_SHARE: f64 = 0.02;

/// Extent of a ring on the map, and twice its signed area.
struct RingFacts {
    bounds: [f64; 4],
    area: f64,
}

impl RingFacts {
    fn of(ring: &Ring) -> Self {
        let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for [x, y, _] in ring {
            bounds = [bounds[0].min(*x), bounds[1].min(*y), bounds[2].max(*x), bounds[3].max(*y)];
        }
        let origin = ring.first().copied().unwrap_or_default();
        let cross = |pair: &[[f64; 3]]| {
            let [a, b] = [pair[0], pair[1]].map(|p| [p[0] - origin[0], p[1] - origin[1]]);
            a[0] * b[1] - a[1] * b[0]
        };
        Self { bounds, area: ring.windows(2).map(cross).sum() }
    }

    /// Whether the bounds have those of another ring in them, but for what drawing errors may be.
    fn encloses(&self, other: &Self) -> bool {
        let ([w, s, e, n], [ow, os, oe, on]) = (self.bounds, other.bounds);
        let (x, y) = (OUTSIDE_SHARE * (oe - ow), OUTSIDE_SHARE * (on - os));
        w <= ow + x && s <= os + y && e >= oe - x && n >= on - y
    }

    /// Whether the ring has an area on the map; a wall has none.
    fn is_flat(&self) -> bool {
        let [w, s, e, n] = self.bounds;
        self.area.abs() > 1e-9 * ((e - w).powi(2) + (n - s).powi(2))
    }
}

/// Groups the rings of a shapefile's polygon: outer rings are clockwise, holes are not. If no ring is clockwise, all are taken
/// the other way round. A hole outside of all outer rings is a polygon itself. Returns the polygons, and the number of holes
/// that are left out because finding their outer rings would take too long.
pub(super) fn group(rings: Vec<Ring>) -> (Vec<Polygon>, usize) {
    if rings.len() <= 1 {
        return (rings.into_iter().map(|ring| vec![ring]).collect(), 0);
    }
    let facts: Vec<RingFacts> = rings.iter().map(RingFacts::of).collect();
    let is_clockwise = |facts: &RingFacts| facts.area < 0.0;
    let is_outer_clockwise = facts.iter().any(|facts| facts.is_flat() && is_clockwise(facts));
    let is_outer = |facts: &RingFacts| !facts.is_flat() || is_clockwise(facts) == is_outer_clockwise;
    let outer: Vec<usize> = (0..rings.len()).filter(|i| facts.get(*i).is_some_and(is_outer)).collect();
    let mut owners: Vec<Option<usize>> = Vec::with_capacity(rings.len());
    let mut steps = 0;
    let mut left_out = 0;
    for (ring, own) in rings.iter().zip(&facts) {
        if is_outer(own) {
            owners.push(None);
        } else if steps > MAX_STEPS {
            left_out += 1;
            owners.push(Some(usize::MAX));
        } else {
            owners.push(owner_of(ring, own, &outer, &rings, &facts, &mut steps));
        }
    }
    let mut polygons: Vec<Polygon> = Vec::new();
    let mut polygon_of = vec![usize::MAX; rings.len()];
    let mut holes = Vec::new();
    for (index, (ring, owner)) in rings.into_iter().zip(owners).enumerate() {
        match owner {
            None => {
                polygon_of[index] = polygons.len();
                polygons.push(vec![ring]);
            }
            Some(owner) => holes.push((owner, ring)),
        }
    }
    for (owner, hole) in holes {
        let polygon = polygon_of.get(owner).and_then(|index| polygons.get_mut(*index));
        if let Some(polygon) = polygon {
            polygon.push(hole);
        }
    }
    (polygons, left_out)
}

/// Index of the smallest outer ring around a hole.
fn owner_of(
    hole: &Ring,
    own: &RingFacts,
    outer: &[usize],
    rings: &[Ring],
    facts: &[RingFacts],
    steps: &mut u64,
) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    *steps += outer.len() as u64 / 8;
    for index in outer {
        let (Some(ring), Some(facts)) = (rings.get(*index), facts.get(*index)) else { continue };
        let is_better = best.is_none_or(|(_, area)| facts.area.abs() < area);
        if is_better && facts.encloses(own) {
            *steps += ring.len() as u64;
            if contains(ring, hole, steps) {
                best = Some((*index, facts.area.abs()));
            }
        }
    }
    best.map(|(index, _)| index)
}

/// Whether a hole is within a ring: a place inside of it decides, because its corners may be on the ring, or a little outside.
fn contains(ring: &Ring, hole: &Ring, steps: &mut u64) -> bool {
    let on_map: Vec<[f64; 2]> = hole.iter().map(|[x, y, _]| [*x, *y]).collect();
    let Some([x, y]) = point_inside(&on_map) else { return false };
    *steps += (ring.len() + hole.len()) as u64;
    let crosses = |pair: &&[[f64; 3]]| {
        let ([ax, ay, _], [bx, by, _]) = (pair[0], pair[1]);
        (ay > y) != (by > y) && ax + (y - ay) / (by - ay) * (bx - ax) > x
    };
    ring.windows(2).filter(crosses).count() % 2 == 1
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
        let (polygons, left_out) = group(vec![far.clone(), big.clone(), yard.clone(), small.clone(), island.clone()]);
        assert_eq!((polygons, left_out), (vec![vec![big, yard], vec![small, far], vec![island]], 0));
    }

    #[test]
    fn wrong_directions_are_understood() {
        let (big, hole, stray) = (square(0., 0., 10., false), square(2., 2., 4., false), square(50., 0., 1., false));
        // All counter-clockwise: all are outer rings.
        assert_eq!(group(vec![big.clone(), stray.clone()]).0.len(), 2);
        let clockwise = square(0., 0., 10., true);
        let (polygons, _) = group(vec![clockwise.clone(), hole.clone(), stray.clone()]);
        assert_eq!(polygons, [vec![clockwise, hole], vec![stray]], "a hole outside of all is a polygon");
        // A hole that touches the outer ring.
        for touching in [square(0., 0., 4., false), square(-0.005, 3., 4., false), square(3., 6.005, 4., false)] {
            assert_eq!(group(vec![square(0., 0., 10., true), touching]).0.len(), 1);
        }
    }

    #[test]
    fn many_rings_end() {
        let rings: Vec<Ring> =
            (0..3000).map(|i| square(f64::from(i), f64::from(i), f64::from(10_000 - 2 * i), i % 2 == 0)).collect();
        assert_eq!(group(rings).0.len(), 1500);
        assert!(group(Vec::new()).0.is_empty());
        let broken = vec![vec![[f64::NAN; 3]; 5], Vec::new(), square(0., 0., 1., true)];
        assert_eq!(group(broken).0.len(), 3);
    }
}
