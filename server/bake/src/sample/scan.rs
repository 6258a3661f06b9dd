//! Which points of a regular grid lie in a triangle, row by row.
//!
//! In: a triangle in the plane. Out: runs of grid points. Next: `crossings`, `candidates` and `visibility` fill them.

/// Calls `run(row, first, end)` for the grid points `(i + 0.5) * step` inside the triangle, `i` in `0..size`. Two triangles
/// that share an edge share no point and miss none: an edge is computed from its lower end, whichever triangle it is of.
pub(super) fn scan(corners: [[f32; 2]; 3], step: f32, size: [usize; 2], mut run: impl FnMut(usize, usize, usize)) {
    let inverse = 1.0 / step;
    let low = corners.iter().fold(f32::INFINITY, |m, c| m.min(c[1]));
    let high = corners.iter().fold(f32::NEG_INFINITY, |m, c| m.max(c[1]));
    // The cast cuts off and saturates: a ceiling for what is positive, and cheaper than `ceil` on plain x86-64.
    let index = |v: f32, end: usize| {
        let v = v * inverse - 0.5;
        let whole = v as usize;
        (whole + usize::from(v > whole as f32)).min(end)
    };
    for row in index(low, size[1])..index(high, size[1]) {
        let y = (row as f32 + 0.5) * step;
        let (mut left, mut right) = (f32::INFINITY, f32::NEG_INFINITY);
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let (a, b) = if corners[a] <= corners[b] { (corners[a], corners[b]) } else { (corners[b], corners[a]) };
            if (a[1] <= y) != (b[1] <= y) {
                let x = a[0] + (b[0] - a[0]) * ((y - a[1]) / (b[1] - a[1]));
                left = left.min(x);
                right = right.max(x);
            }
        }
        if left < right {
            let (first, end) = (index(left, size[0]), index(right, size[0]));
            if first < end {
                run(row, first, end);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_of_two_triangles_is_covered_once() {
        let (a, b, c, d) = ([0.3, 0.2], [7.5, 0.9], [6.2, 8.1], [-3.0, 7.7]);
        let mut hits = [[0; 8]; 8];
        for corners in [[a, b, c], [c, d, a]] {
            scan(corners, 0.5, [8, 8], |row, first, end| hits[row][first..end].iter_mut().for_each(|h| *h += 1));
        }
        assert!(hits.iter().flatten().all(|h| *h <= 1));
        assert_eq!(hits[3][3], 1);
        let inside: i32 = hits.iter().flatten().sum();
        assert!((40..=64).contains(&inside), "{inside}");
    }
}
