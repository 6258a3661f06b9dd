//! Which points of a regular grid lie in a triangle, row by row.
//!
//! In: a triangle in the plane. Out: runs of grid points. Next: `crossings`, `candidates` and `visibility` fill them.

/// An edge, taken from its lower end whichever triangle it is of: two triangles that share it find the same places on it.
#[derive(Clone, Copy)]
struct RasterEdge {
    from: [f32; 2],
    to_x: f32,
    /// Change of x with y; not finite for an edge along a row, which no row's line crosses.
    run: f32,
}

impl RasterEdge {
    fn new(a: [f32; 2], b: [f32; 2]) -> Self {
        let (from, to) = if (a[1], a[0]) <= (b[1], b[0]) { (a, b) } else { (b, a) };
        Self { from, to_x: to[0], run: (to[0] - from[0]) / (to[1] - from[1]) }
    }

    /// Never beyond its ends: a row that rounding puts there would be far off on a flat edge.
    fn x_at(self, y: f32) -> f32 {
        let x = self.from[0] + (y - self.from[1]) * self.run;
        if self.from[0] < self.to_x {
            least(most(x, self.from[0]), self.to_x)
        } else {
            least(most(x, self.to_x), self.from[0])
        }
    }
}

/// As `f32::min` and `f32::max`, which look for numbers that are none and are three times as long.
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Calls `run(row, first, end)` for the grid points `(i + 0.5) * step` inside the triangle, `i` in `0..size`. Two triangles
/// that share an edge share no point and miss none.
pub(super) fn scan(corners: [[f32; 2]; 3], step: f32, size: [usize; 2], mut run: impl FnMut(usize, usize, usize)) {
    let inverse = 1.0 / step;
    // The cast cuts off and saturates: a ceiling for what is positive, and cheaper than `ceil` on plain x86-64.
    let index = |v: f32, end: usize| {
        let v = v * inverse - 0.5;
        let whole = v as i32;
        ((whole + i32::from(v > whole as f32)).max(0) as usize).min(end)
    };
    let [mut low, mut middle, mut high] = corners;
    if middle[1] < low[1] {
        (low, middle) = (middle, low);
    }
    if high[1] < low[1] {
        (low, middle, high) = (high, low, middle);
    } else if high[1] < middle[1] {
        (middle, high) = (high, middle);
    }
    let rows = [index(low[1], size[1]), index(high[1], size[1])];
    let leftmost = low[0].min(middle[0]).min(high[0]);
    let rightmost = low[0].max(middle[0]).max(high[0]);
    if rows[0] >= rows[1] || index(leftmost, size[0]) >= index(rightmost, size[0]) {
        return;
    }
    let turn = index(middle[1], size[1]);
    let long = RasterEdge::new(low, high);
    for (edge, rows) in [(RasterEdge::new(low, middle), rows[0]..turn), (RasterEdge::new(middle, high), turn..rows[1])]
    {
        for row in rows {
            let y = (row as f32 + 0.5) * step;
            let (a, b) = (long.x_at(y), edge.x_at(y));
            let (first, end) = (index(least(a, b), size[0]), index(most(a, b), size[0]));
            if first < end {
                run(row, first, end);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::sample::rasterise::*;

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

    #[test]
    fn corners_in_any_order_give_the_same_runs() {
        let corners = [[0.3, 0.2], [7.5, 0.9], [6.2, 8.1]];
        let runs = |[i, j, k]: [usize; 3]| {
            let mut runs = Vec::new();
            scan([corners[i], corners[j], corners[k]], 0.5, [20, 20], |row, first, end| runs.push((row, first, end)));
            runs
        };
        let first = runs([0, 1, 2]);
        assert!(first.len() > 10);
        for order in [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            assert_eq!(runs(order), first);
        }
    }
}
