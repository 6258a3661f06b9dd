//! Cuts the holes out of polygons whose rings touch, share edges or cross: with whole coordinates, so that the result is exact, and the
//! same on every machine.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay::{IntOverlayOptions, Overlay, ShapeType};
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::core::solver::Solver;
use i_overlay::i_float::int::point::IntPoint;

/// Size of the units, about a millimetre. Corners nearer to each other than this are one.
const UNIT_M: f64 = 1.0 / 1024.0;
/// Coordinates of larger polygons would be no whole numbers of 32 bits.
const MAX_EXTENT_M: f64 = 500_000.0;
/// Rings of a smaller area, and those that are at most this wide, are what remains between rings that nearly touch.
const MIN_AREA_M2: f64 = 0.01;
const SLIVER_M: f64 = 0.004;
/// Pairs of edges that are compared, and those of them that may cross: the rings of a hostile file may cross everywhere.
const MAX_STEPS: u64 = 50_000_000;
const MAX_PAIRS: u64 = 1_000_000;
/// Rings that cross more often are a tangle. Whole coordinates alone make a dense ring cross itself about once at a corner.
const CROSSINGS_PER_CORNER: u64 = 8;

/// Rings of one polygon: the outer one counter-clockwise, then the holes, clockwise.
pub type Rings = Vec<Vec<[f64; 2]>>;

/// The polygons that remain of an outer ring without its holes, in metres; the holes come after the outer ring, and may turn either
/// way. `None` if the rings neither touch nor cross, so that nothing has to be done, or if they cross too often.
pub fn clean(rings: &[impl AsRef<[[f64; 2]]>]) -> Option<Vec<Rings>> {
    let origin = *rings.first()?.as_ref().first()?;
    let whole: Option<Vec<Vec<IntPoint<i32>>>> = rings.iter().map(|ring| to_whole(ring.as_ref(), origin)).collect();
    let whole = whole?;
    if !can_be_cleaned(&whole) {
        return None;
    }
    let options = IntOverlayOptions { preserve_output_collinear: true, ..IntOverlayOptions::default() };
    let mut overlay = Overlay::new_custom(whole.iter().map(Vec::len).sum(), options, Solver::default());
    for (number, ring) in whole.iter().enumerate() {
        overlay.add_contour(ring, if number == 0 { ShapeType::Subject } else { ShapeType::Clip });
    }
    let shapes = overlay.overlay(OverlayRule::Difference, FillRule::NonZero);
    let corners = |rings: &[Vec<IntPoint<i32>>]| {
        let mut counts: Vec<usize> = rings.iter().map(Vec::len).collect();
        counts.sort_unstable();
        counts
    };
    if let [shape] = shapes.as_slice()
        && corners(shape) == corners(&whole)
    {
        return None;
    }
    let from_whole = |ring: Vec<IntPoint<i32>>| {
        let position = |p: IntPoint<i32>| [origin[0] + f64::from(p.x) * UNIT_M, origin[1] + f64::from(p.y) * UNIT_M];
        ring.into_iter().map(position).collect::<Vec<_>>()
    };
    let polygons = shapes.into_iter().filter_map(|shape| {
        let mut rings = shape.into_iter().map(from_whole);
        let outer = rings.next().filter(|ring| !is_sliver(ring))?;
        Some(std::iter::once(outer).chain(rings.filter(|ring| !is_sliver(ring))).collect())
    });
    Some(polygons.collect())
}

/// Whether a ring crosses itself or comes back to one of its corners, so that its signed area is not that of what it encloses.
/// Rings that cross too often, or are too large to be cleaned, do not count.
pub fn crosses_itself(ring: &[[f64; 2]]) -> bool {
    let Some(whole) = ring.first().and_then(|origin| to_whole(ring, *origin)) else { return false };
    let mut corners = whole.clone();
    corners.sort_unstable_by_key(|corner| [corner.x, corner.y]);
    if corners.windows(2).any(|pair| pair[0] == pair[1]) {
        return true;
    }
    crossings(edges_of(&whole).collect(), 0) > 0
}

/// Whether rings cross far more often than any drawn by mistake: ear clipping would take minutes to find that they have no triangles.
pub(super) fn is_tangle<'r>(rings: impl Iterator<Item = &'r [[f64; 2]]>) -> bool {
    let mut edges = Vec::new();
    for ring in rings {
        let Some(whole) = to_whole(ring, [0.0; 2]) else { return false };
        edges.extend(edges_of(&whole));
    }
    let many = CROSSINGS_PER_CORNER * edges.len() as u64;
    crossings(edges, many) > many
}

/// The edges of a ring, each from its end in the west.
fn edges_of(whole: &[IntPoint<i32>]) -> impl Iterator<Item = [IntPoint<i32>; 2]> {
    let next = whole.iter().cycle().skip(1);
    whole.iter().zip(next).map(|(a, b)| if (a.x, a.y) <= (b.x, b.y) { [*a, *b] } else { [*b, *a] })
}

/// Number of pairs of edges that cross, as far as `max` + 1, and among as many pairs as are compared.
fn crossings(mut edges: Vec<[IntPoint<i32>; 2]>, max: u64) -> u64 {
    edges.sort_unstable_by_key(|[low, _]| low.x);
    let (mut steps, mut found) = (0_u64, 0_u64);
    for (number, [low, high]) in edges.iter().enumerate() {
        for [other_low, other_high] in edges[number + 1..].iter().take_while(|[other_low, _]| other_low.x <= high.x) {
            steps += 1;
            if steps > MAX_STEPS || found > max {
                return found;
            }
            let are_apart = |a, b, p, q| side(a, b, p) * side(a, b, q) >= 0;
            let cross = !are_apart(low, high, other_low, other_high) && !are_apart(other_low, other_high, low, high);
            found += u64::from(cross);
        }
    }
    found
}

/// On which side of a line a point is: -1, 0 or 1.
fn side(a: &IntPoint<i32>, b: &IntPoint<i32>, p: &IntPoint<i32>) -> i64 {
    let from = |p: &IntPoint<i32>| [i64::from(p.x) - i64::from(a.x), i64::from(p.y) - i64::from(a.y)];
    let ([bx, by], [px, py]) = (from(b), from(p));
    (bx * py - by * px).signum()
}

/// The ring in units, without repeated corners; `None` if it is too large.
fn to_whole(ring: &[[f64; 2]], origin: [f64; 2]) -> Option<Vec<IntPoint<i32>>> {
    let mut whole: Vec<IntPoint<i32>> = Vec::with_capacity(ring.len());
    for position in ring {
        let [x, y] = [0, 1].map(|axis| position[axis] - origin[axis]);
        // Not a number is too large, too.
        if !(x.abs() <= MAX_EXTENT_M && y.abs() <= MAX_EXTENT_M) {
            return None;
        }
        let point = IntPoint::new((x / UNIT_M).round() as i32, (y / UNIT_M).round() as i32);
        if whole.last() != Some(&point) {
            whole.push(point);
        }
    }
    if whole.len() > 1 && whole.first() == whole.last() {
        whole.pop();
    }
    Some(whole)
}

/// Whether few enough edges cross. Those whose bounds overlap may do so.
fn can_be_cleaned(rings: &[Vec<IntPoint<i32>>]) -> bool {
    let mut edges: Vec<[i32; 4]> = Vec::new();
    for ring in rings {
        let next = ring.iter().cycle().skip(1);
        edges.extend(ring.iter().zip(next).map(|(a, b)| [a.x.min(b.x), a.x.max(b.x), a.y.min(b.y), a.y.max(b.y)]));
    }
    edges.sort_unstable();
    let (mut steps, mut pairs) = (0_u64, 0_u64);
    // Each edge touches its two neighbours.
    let max_pairs = MAX_PAIRS + 4 * edges.len() as u64;
    for (number, [_, high_x, low_y, high_y]) in edges.iter().enumerate() {
        for [low, _, other_low_y, other_high_y] in &edges[number + 1..] {
            if low > high_x {
                break;
            }
            steps += 1;
            pairs += u64::from(other_low_y <= high_y && low_y <= other_high_y);
            if steps > MAX_STEPS || pairs > max_pairs {
                return false;
            }
        }
    }
    true
}

/// Whether a ring has hardly any area, or is a strip of hardly any width.
fn is_sliver(ring: &[[f64; 2]]) -> bool {
    let area_m2 = area_m2(ring).abs();
    let next = ring.iter().cycle().skip(1);
    let length_m: f64 = ring.iter().zip(next).map(|(a, b)| libm::hypot(b[0] - a[0], b[1] - a[1])).sum();
    area_m2 < MIN_AREA_M2 || 2.0 * area_m2 <= SLIVER_M * length_m
}

/// Signed area, positive if counter-clockwise. Relative to the first corner: products of full map coordinates would
/// lose their digits by cancellation.
pub fn area_m2(ring: &[[f64; 2]]) -> f64 {
    let Some(first) = ring.first() else { return 0.0 };
    let from = |p: [f64; 2]| [p[0] - first[0], p[1] - first[1]];
    let cross = |pair: &[[f64; 2]]| {
        let [a, b] = [from(pair[0]), from(pair[1])];
        a[0] * b[1] - a[1] * b[0]
    };
    ring.windows(2).map(cross).sum::<f64>() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]];

    /// Area and number of the cleaned polygons of a square of 900 m² with holes, far from the origin of the map.
    fn cleaned(holes: &[&[[f64; 2]]]) -> Option<(f64, usize)> {
        let far = |ring: &[[f64; 2]]| ring.iter().map(|[x, y]| [x + 691_234.125, y + 5_334_567.75]).collect::<Vec<_>>();
        let rings: Vec<Vec<[f64; 2]>> = std::iter::once(&SQUARE[..]).chain(holes.iter().copied()).map(far).collect();
        let polygons = clean(&rings)?;
        Some((polygons.iter().flatten().map(|ring| area_m2(ring)).sum(), polygons.len()))
    }

    #[test]
    fn rings_that_do_not_touch_stay_as_they_are() {
        assert_eq!(cleaned(&[]), None);
        assert_eq!(cleaned(&[&[[5.0, 5.0], [6.0, 5.0], [6.0, 6.0]], &[[8.0, 5.0], [8.0, 9.0], [9.0, 9.0]]]), None);
    }

    #[test]
    fn holes_that_touch_share_edges_or_lie_outside_are_cut() {
        for (holes, expected_m2, count) in [
            (&[&[[0.0, 10.0], [10.0, 5.0], [10.0, 15.0]][..]][..], 850.0, 1),
            (&[&[[-0.001, 10.0], [10.0, 5.0], [10.0, 15.0]]], 850.0, 1),
            (&[&[[0.0004, 10.0], [10.0, 5.0], [10.0, 15.0]]], 850.0, 1),
            (&[&[[-0.005, 5.0], [10.0, 5.0], [10.0, 15.0], [-0.005, 15.0]]], 800.0, 1),
            (&[&[[0.0, 5.0], [0.0, 15.0], [10.0, 15.0], [10.0, 5.0]]], 800.0, 1),
            (&[&[[0.0, 0.0], [5.0, 10.0], [10.0, 5.0]]], 862.5, 1),
            (&[&[[0.0, 15.0], [15.0, 20.0], [30.0, 15.0], [15.0, 10.0]]], 750.0, 2),
            (&[&[[10.0, 10.0], [20.0, 10.0], [20.0, 20.0]], &[[10.0, 10.0], [20.0, 20.0], [10.0, 20.0]]], 800.0, 1),
            (&[&[[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]]], 0.0, 0),
        ] {
            let Some((area_m2, found)) = cleaned(holes) else { panic!("{holes:?}") };
            assert!((area_m2 - expected_m2).abs() < 0.2 && found == count, "{holes:?}: {area_m2} m2 in {found}");
        }
    }

    #[test]
    fn rings_that_cross_themselves_become_their_lobes() {
        let bow = [[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]];
        let by_a_corner = [[0.0, 0.0], [5.0, 5.0], [10.0, 10.0], [10.0, 0.0], [5.0, 5.0], [0.0, 10.0]];
        let uneven = [[0.0, 0.0], [20.0, 20.0], [20.0, 0.0], [0.0, 10.0]];
        for (ring, expected_m2) in [(&bow[..], 50.0), (&by_a_corner, 50.0), (&uneven, 500.0 / 3.0)] {
            assert!(crosses_itself(ring), "{ring:?}");
            let Some(lobes) = clean(&[ring]) else { panic!("{ring:?}") };
            let found_m2: f64 = lobes.iter().flatten().map(|ring| area_m2(ring)).sum();
            assert!(lobes.len() == 2 && (found_m2 - expected_m2).abs() < 0.1, "{ring:?}: {found_m2}");
        }
        // A hole that crosses itself.
        let hole = bow.map(|[x, y]| [x + 5.0, y + 5.0]);
        let Some((area_m2, count)) = cleaned(&[&hole]) else { panic!() };
        assert!((area_m2 - 850.0).abs() < 0.1 && count == 1, "{area_m2} m2 in {count}");
        let l_shape = [[0.0, 0.0], [9.0, 0.0], [9.0, 3.0], [3.0, 3.0], [3.0, 9.0], [0.0, 9.0]];
        for ring in [&SQUARE[..], &l_shape, &[[0.0, 0.0], [9.0, 0.0], [18.0, 0.0], [9.0, 9.0]]] {
            assert!(!crosses_itself(ring), "{ring:?}");
        }
    }

    #[test]
    fn tangles_and_large_polygons_are_left_alone() {
        let mut rng = Rng::new(1);
        let tangle: Vec<[f64; 2]> = (0..20_000).map(|_| [rng.range(0.0, 100.0), rng.range(0.0, 100.0)]).collect();
        assert!(is_tangle([&tangle[..]].into_iter()));
        assert_eq!(clean(&[tangle]), None);
        // A saw crosses nothing, and a bow once.
        let teeth = (0..20_000).map(|i| [f64::from(i), f64::from(i % 2) * 50.0]);
        let saw = teeth.chain([[19_999.0, -9.0], [0.0, -9.0]]);
        assert!(!is_tangle([&saw.collect::<Vec<_>>()[..], &[[0.0, -8.0], [9.0, -1.0], [9.0, -8.0]]].into_iter()));
        assert!(!is_tangle([&[[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]][..]].into_iter()));
        assert_eq!(clean(&[vec![[0.0, 0.0], [1e9, 0.0], [0.0, 1e9]]]), None);
        assert_eq!(clean(&[vec![[0.0, 0.0], [f64::NAN, 0.0], [0.0, 1.0]]]), None);
        assert_eq!(clean(&[Vec::<[f64; 2]>::new()]), None);
    }
}
