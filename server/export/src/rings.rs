//! Rings of points with whole coordinates: areas, and the removal of what is smaller than their precision.

use i_overlay::i_float::int::point::IntPoint;

/// Twice the area in square units, positive if counter-clockwise.
#[must_use]
pub fn twice_area(ring: &[IntPoint<i32>]) -> i64 {
    let next = ring.iter().cycle().skip(1);
    let sum: i128 =
        ring.iter().zip(next).map(|(a, b)| i128::from(a.x) * i128::from(b.y) - i128::from(b.x) * i128::from(a.y)).sum();
    i64::try_from(sum).unwrap_or(if sum < 0 { i64::MIN } else { i64::MAX })
}

/// Whether a ring has less than `min_area` square units or is at most `width` units wide.
#[must_use]
pub fn is_sliver(ring: &[IntPoint<i32>], min_area: f64, width: f64) -> bool {
    let area = 0.5 * (twice_area(ring) as f64).abs();
    let next = ring.iter().cycle().skip(1);
    let length: f64 = ring.iter().zip(next).map(|(a, b)| distance(*a, *b)).sum();
    ring.len() < 3 || area < min_area || 2.0 * area <= width * length
}

/// The ring without points that are within `tolerance` units of the line between their neighbours, and without spikes and slits
/// of that width. Fewer than three points if nothing remains.
#[must_use]
pub fn tidy(ring: &[IntPoint<i32>], tolerance: f64) -> Vec<IntPoint<i32>> {
    let mut ring = ring.to_vec();
    // Each pass but the last removes a point.
    loop {
        let before = ring.len();
        ring = one_pass(&ring, tolerance);
        if ring.len() == before || ring.len() < 3 {
            return ring;
        }
    }
}

/// Removes points that are not needed, but never two neighbours, because the second may be needed without the first.
fn one_pass(ring: &[IntPoint<i32>], tolerance: f64) -> Vec<IntPoint<i32>> {
    let count = ring.len();
    let mut kept = Vec::with_capacity(count);
    let mut was_removed = false;
    let mut first_was_removed = false;
    for i in 0..count {
        let [previous, point, next] = [i + count - 1, i, i + 1].map(|j| ring[j % count]);
        let has_removed_neighbour = was_removed || (i + 1 == count && first_was_removed);
        let is_needed = to_segment(point, previous, next) > tolerance
            && to_segment(previous, point, next) > tolerance
            && to_segment(next, previous, point) > tolerance;
        was_removed = !has_removed_neighbour && !is_needed;
        first_was_removed |= was_removed && i == 0;
        if !was_removed {
            kept.push(point);
        }
    }
    kept
}

fn distance(a: IntPoint<i32>, b: IntPoint<i32>) -> f64 {
    (f64::from(a.x) - f64::from(b.x)).hypot(f64::from(a.y) - f64::from(b.y))
}

/// Distance of a point from a segment.
fn to_segment(point: IntPoint<i32>, a: IntPoint<i32>, b: IntPoint<i32>) -> f64 {
    let minus = |p: IntPoint<i32>, q: IntPoint<i32>| [f64::from(p.x) - f64::from(q.x), f64::from(p.y) - f64::from(q.y)];
    let (along, to) = (minus(b, a), minus(point, a));
    let length2 = along[0] * along[0] + along[1] * along[1];
    let t = if length2 > 0.0 { ((to[0] * along[0] + to[1] * along[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (to[0] - t * along[0]).hypot(to[1] - t * along[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(points: &[[i32; 2]]) -> Vec<IntPoint<i32>> {
        points.iter().map(|[x, y]| IntPoint::new(*x, *y)).collect()
    }

    #[test]
    fn points_on_a_line_spikes_and_slits_are_removed() {
        let square = [[0, 0], [1000, 0], [1000, 1000], [0, 1000]];
        let line = ring(&[[0, 0], [500, 1], [1000, 0], [1000, 1000], [0, 1000]]);
        assert_eq!(tidy(&line, 2.0), ring(&square));
        let spike = ring(&[[0, 0], [1000, 0], [1000, 1000], [500, 1000], [500, 2000], [499, 1000], [0, 1000]]);
        assert_eq!(tidy(&spike, 2.0), ring(&square));
        let slit =
            ring(&[[0, 0], [500, 0], [505, 400], [700, 500], [506, 402], [501, 0], [1000, 0], [1000, 1000], [0, 1000]]);
        assert_eq!(tidy(&slit, 2.0), ring(&square));
        assert!(tidy(&ring(&[[0, 0], [1000, 0], [500, 1]]), 2.0).len() < 3);
    }

    #[test]
    fn slivers_are_thin_or_small() {
        assert!(is_sliver(&ring(&[[0, 0], [9000, 0], [9000, 2], [0, 2]]), 100.0, 2.0));
        assert!(is_sliver(&ring(&[[0, 0], [9, 0], [9, 9], [0, 9]]), 100.0, 2.0));
        assert!(!is_sliver(&ring(&[[0, 0], [99, 0], [99, 99], [0, 99]]), 100.0, 2.0));
    }
}
