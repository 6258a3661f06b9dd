//! A place inside of a ring, by which it is told in which other rings it lies: its corners may touch those.

/// A position inside of a closed ring, far from its edges along a line; `None` of a ring without an area.
pub fn point_inside(ring: &[[f64; 2]]) -> Option<[f64; 2]> {
    let mut heights: Vec<f64> = ring.iter().map(|position| position[1]).collect();
    heights.sort_unstable_by(f64::total_cmp);
    // The line is between the two heights that are furthest apart, so that it meets no corner.
    let gaps = heights.windows(2).map(|pair| [pair[0], pair[1]]);
    let [low, high] = gaps.reduce(|best, gap| if gap[1] - gap[0] > best[1] - best[0] { gap } else { best })?;
    let y = low + (high - low) / 2.0;
    if !(low < y && y < high) {
        return None;
    }
    let crossing = |pair: &[[f64; 2]]| {
        let ([ax, ay], [bx, by]) = (pair[0], pair[1]);
        ((ay > y) != (by > y)).then(|| ax + (y - ay) / (by - ay) * (bx - ax))
    };
    let mut crossings: Vec<f64> = ring.windows(2).filter_map(crossing).collect();
    crossings.sort_unstable_by(f64::total_cmp);
    let spans = crossings.chunks_exact(2).map(|pair| [pair[0], pair[1]]);
    let [west, east] = spans.reduce(|best, span| if span[1] - span[0] > best[1] - best[0] { span } else { best })?;
    (west < east).then_some([west + (east - west) / 2.0, y])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_inside() {
        let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]];
        assert_eq!(point_inside(&square), Some([2.0, 2.0]));
        let angle = [[0.0, 0.0], [9.0, 0.0], [9.0, 1.0], [1.0, 1.0], [1.0, 9.0], [0.0, 9.0], [0.0, 0.0]];
        let [x, y] = point_inside(&angle).unwrap();
        assert!(
            (0.0..1.0).contains(&x) && (1.0..9.0).contains(&y) || (0.0..9.0).contains(&x) && (0.0..1.0).contains(&y)
        );
        assert_eq!(point_inside(&[[0.0, 1.0], [5.0, 1.0], [0.0, 1.0]]), None);
        assert_eq!(point_inside(&[]), None);
        assert_eq!(point_inside(&[[f64::NAN; 2]; 4]), None);
    }
}
