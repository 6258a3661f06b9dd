//! Cuts rings and segments at a rectangle.

/// Cuts a ring at a rectangle: what is left has the same inside within it (Sutherland and Hodgman 1974, "Reentrant
/// polygon clipping"). `spare` is overwritten.
pub(super) fn clip_ring(ring: &mut Vec<[f64; 2]>, spare: &mut Vec<[f64; 2]>, [low, high]: [[f64; 2]; 2]) {
    for axis in 0..2 {
        // How far a point is on the inner side of a border.
        cut(ring, spare, |point| point[axis] - low[axis]);
        std::mem::swap(ring, spare);
        cut(ring, spare, |point| high[axis] - point[axis]);
        std::mem::swap(ring, spare);
    }
}

fn cut(ring: &[[f64; 2]], left: &mut Vec<[f64; 2]>, inside: impl Fn([f64; 2]) -> f64) {
    left.clear();
    let Some(mut last) = ring.last().copied() else { return };
    for &point in ring {
        let (a, b) = (inside(last), inside(point));
        if (a < 0.0) != (b < 0.0) {
            left.push(between(last, point, a / (a - b)));
        }
        if b >= 0.0 {
            left.push(point);
        }
        last = point;
    }
}

/// The part of a segment within a rectangle, as shares of its length (Liang and Barsky 1984, "A new concept and method
/// for line clipping"); `None` if there is none.
pub fn clip_segment(from: [f64; 2], to: [f64; 2], [low, high]: [[f64; 2]; 2]) -> Option<[f64; 2]> {
    let (mut first, mut last) = (0.0f64, 1.0f64);
    for axis in 0..2 {
        let step = to[axis] - from[axis];
        let (to_low, to_high) = (low[axis] - from[axis], high[axis] - from[axis]);
        if step == 0.0 {
            if to_low > 0.0 || to_high < 0.0 {
                return None;
            }
            continue;
        }
        let (enter, leave) = if step > 0.0 { (to_low / step, to_high / step) } else { (to_high / step, to_low / step) };
        (first, last) = (first.max(enter), last.min(leave));
    }
    (first <= last).then_some([first, last])
}

/// The point at a share of the way from one to another.
pub fn between(from: [f64; 2], to: [f64; 2], share: f64) -> [f64; 2] {
    [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[f64; 2]; 2] = [[0.0; 2], [10.0; 2]];

    fn area(ring: &[[f64; 2]]) -> f64 {
        let next = ring.iter().cycle().skip(1);
        ring.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>() / 2.0
    }

    fn clipped(ring: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let (mut ring, mut spare) = (ring.to_vec(), vec![[7.0; 2]; 3]);
        clip_ring(&mut ring, &mut spare, SQUARE);
        ring
    }

    #[test]
    fn rings_keep_their_area_within_the_rectangle() {
        for (ring, expected) in [
            (&[[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]][..], 25.0),
            (&[[-1e8, -1e8], [1e8, -1e8], [1e8, 1e8], [-1e8, 1e8]], 100.0),
            (&[[2.0, 2.0], [4.0, 2.0], [4.0, 3.0]], 1.0),
            (&[[0.0, -10.0], [20.0, 10.0], [0.0, 10.0]], 100.0),
            (&[[20.0, 20.0], [30.0, 20.0], [30.0, 30.0]], 0.0),
            (&[], 0.0),
        ] {
            let ring = clipped(ring);
            assert!((area(&ring) - expected).abs() < 1e-6, "{ring:?}");
            assert!(ring.iter().flatten().all(|v| (-1e-6..=10.0 + 1e-6).contains(v)), "{ring:?}");
        }
    }

    #[test]
    fn segments_keep_their_part_within_the_rectangle() {
        assert_eq!(clip_segment([-10.0, 5.0], [30.0, 5.0], SQUARE), Some([0.25, 0.5]));
        assert_eq!(clip_segment([30.0, 5.0], [-10.0, 5.0], SQUARE), Some([0.5, 0.75]));
        assert_eq!(clip_segment([1.0, 1.0], [9.0, 2.0], SQUARE), Some([0.0, 1.0]));
        assert_eq!(clip_segment([-10.0, 11.0], [30.0, 11.0], SQUARE), None);
        assert_eq!(clip_segment([-10.0, 5.0], [5.0, 40.0], SQUARE), None);
        assert_eq!(clip_segment([3.0, 3.0], [3.0, 3.0], SQUARE), Some([0.0, 1.0]));
        assert_eq!(between([0.0, 2.0], [4.0, 4.0], 0.25), [1.0, 2.5]);
    }
}
