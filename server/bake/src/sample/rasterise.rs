//! Scan conversion: the points of a regular grid that lie in a triangle, row by row.
//!
//! Two triangles that share an edge share no grid point along it and leave none out.

/// An edge, always taken from its lower end, so that two triangles that share it compute the same points on it.
#[derive(Clone, Copy)]
struct RasterEdge {
    from: [f32; 2],
    to_x: f32,
    /// Change of x per y. Not finite for a horizontal edge, which no row crosses.
    x_per_y: f32,
}

impl RasterEdge {
    fn new(a: [f32; 2], b: [f32; 2]) -> Self {
        let (from, to) = if (a[1], a[0]) <= (b[1], b[0]) { (a, b) } else { (b, a) };
        Self { from, to_x: to[0], x_per_y: (to[0] - from[0]) / (to[1] - from[1]) }
    }

    /// Clamped to the edge's ends: on a flat edge, a row that rounding puts past an end would give an x far off.
    fn x_at(self, y: f32) -> f32 {
        let x = self.from[0] + (y - self.from[1]) * self.x_per_y;
        if self.from[0] < self.to_x {
            min(max(x, self.from[0]), self.to_x)
        } else {
            min(max(x, self.to_x), self.from[0])
        }
    }
}

/// Like `f32::min` without its handling of NaN, which takes three times as long.
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Like `f32::max` without its handling of NaN.
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Calls `run(row, first, end)` for each row of grid points inside the triangle. Point `i` of an axis lies at
/// `(i + 0.5) * step`, with `i` in `0..size`.
pub(crate) fn rasterise(corners: [[f32; 2]; 3], step: f32, size: [usize; 2], mut run: impl FnMut(usize, usize, usize)) {
    let inverse = 1.0 / step;
    // The cast truncates and saturates. For positive values this is a ceiling, and cheaper than `ceil` on plain x86-64.
    let index = |v: f32, end: usize| {
        let v = v * inverse - 0.5;
        let whole = v as i32;
        ((whole + i32::from(v > whole as f32)).max(0) as usize).min(end)
    };
    let [low, middle, high] = sorted_by_y(corners);
    let rows = [index(low[1], size[1]), index(high[1], size[1])];
    let leftmost = low[0].min(middle[0]).min(high[0]);
    let rightmost = low[0].max(middle[0]).max(high[0]);
    if rows[0] >= rows[1] || index(leftmost, size[0]) >= index(rightmost, size[0]) {
        return;
    }
    let middle_row = index(middle[1], size[1]);
    let long = RasterEdge::new(low, high);
    for (edge, rows) in
        [(RasterEdge::new(low, middle), rows[0]..middle_row), (RasterEdge::new(middle, high), middle_row..rows[1])]
    {
        for row in rows {
            let y = (row as f32 + 0.5) * step;
            let (a, b) = (long.x_at(y), edge.x_at(y));
            let (first, end) = (index(min(a, b), size[0]), index(max(a, b), size[0]));
            if first < end {
                run(row, first, end);
            }
        }
    }
}

fn sorted_by_y(corners: [[f32; 2]; 3]) -> [[f32; 2]; 3] {
    let [mut low, mut middle, mut high] = corners;
    if middle[1] < low[1] {
        (low, middle) = (middle, low);
    }
    if high[1] < low[1] {
        (low, middle, high) = (high, low, middle);
    } else if high[1] < middle[1] {
        (middle, high) = (high, middle);
    }
    [low, middle, high]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_triangles_of_a_quad_cover_each_point_once() {
        let (a, b, c, d) = ([0.3, 0.2], [7.5, 0.9], [6.2, 8.1], [-3.0, 7.7]);
        let mut hits = [[0; 8]; 8];
        for corners in [[a, b, c], [c, d, a]] {
            rasterise(corners, 0.5, [8, 8], |row, first, end| hits[row][first..end].iter_mut().for_each(|h| *h += 1));
        }
        assert!(hits.iter().flatten().all(|h| *h <= 1));
        assert_eq!(hits[3][3], 1);
        let inside: i32 = hits.iter().flatten().sum();
        assert!((40..=64).contains(&inside), "{inside}");
    }

    #[test]
    fn order_of_corners_does_not_change_the_runs() {
        let corners = [[0.3, 0.2], [7.5, 0.9], [6.2, 8.1]];
        let runs = |[i, j, k]: [usize; 3]| {
            let mut runs = Vec::new();
            rasterise([corners[i], corners[j], corners[k]], 0.5, [20, 20], |row, first, end| {
                runs.push((row, first, end));
            });
            runs
        };
        let first = runs([0, 1, 2]);
        assert!(first.len() > 10);
        for order in [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            assert_eq!(runs(order), first);
        }
    }
}
