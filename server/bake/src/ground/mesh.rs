//! Triangles of a height field: right triangles that are halved where the field is not flat (Evans, Kirkpatrick and
//! Townsend 2001, "Right-triangulated irregular networks"). Neighbours share whole edges.
//!
//! They begin with two in each leaf, so that the ground of tiles (`insula_protocol::blockmap::ground`) is the same surface.

use super::grid::GroundGrid;
use insula_protocol::blockmap::ground::SQUARES;

/// Largest triangle that covers ground together with places without ground, in steps.
const MAX_MIXED_STEPS: usize = 4;
/// Triangles of a leaf that may be halved.
const TRIANGLES: usize = 2 * SQUARES * SQUARES - 2;

/// Heights that a simplified surface may have, and where it is needed.
#[derive(Debug, Clone)]
pub(super) struct HeightRange {
    pub(super) low: Vec<f32>,
    pub(super) high: Vec<f32>,
    pub(super) is_needed: Vec<bool>,
}

/// Columns and rows of a triangle's corners: both ends of its longest edge, then the right angle.
type Corners = [[usize; 2]; 3];

/// Triangles with the heights `field` at their corners that keep within `range` at all vertices. The grid's vertices are
/// those of leaves' squares from its corner on.
pub(super) fn triangulate(grid: &GroundGrid, field: &[f32], range: &HeightRange, outside_m: f32) -> Vec<[[f32; 3]; 3]> {
    let leaves = grid.size.map(|n| (n - 1).div_ceil(SQUARES));
    let vertices = leaves.map(|n| n * SQUARES + 1);
    let is_halved = vec![false; vertices[0] * vertices[1]];
    let mut halving = Halving { grid, field, range, outside_m, width: vertices[0], leaves, is_halved };
    halving.decide();
    let mut triangles = Vec::new();
    for leaf in halving.leaves() {
        halving.emit(corners_of(2, leaf), &mut triangles);
        halving.emit(corners_of(3, leaf), &mut triangles);
    }
    triangles
}

struct Halving<'a> {
    grid: &'a GroundGrid,
    field: &'a [f32],
    range: &'a HeightRange,
    /// Height outside of the grid.
    outside_m: f32,
    /// Number of vertices in a row of all leaves.
    width: usize,
    /// Number of leaves along x and y.
    leaves: [usize; 2],
    /// Whether the triangles with this middle of their longest edge are halved.
    is_halved: Vec<bool>,
}

impl Halving<'_> {
    /// The south-west vertices of all leaves.
    fn leaves(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let [columns, rows] = self.leaves;
        (0..rows).flat_map(move |y| (0..columns).map(move |x| [x * SQUARES, y * SQUARES]))
    }

    /// Decides from the smallest triangles of all leaves up, because a triangle is halved where a half of it is.
    fn decide(&mut self) {
        let with_halves = TRIANGLES - SQUARES * SQUARES;
        for i in (0..TRIANGLES).rev() {
            for leaf in self.leaves() {
                let corners = corners_of(i + 2, leaf);
                let [a, b, c] = corners;
                let middle = self.number(middle(a, b));
                if self.is_halved[middle] {
                    continue;
                }
                let has_halved_half = i < with_halves
                    && [self.number(self::middle(a, c)), self.number(self::middle(b, c))]
                        .into_iter()
                        .any(|half| self.is_halved[half]);
                self.is_halved[middle] = has_halved_half || !self.is_accurate(&corners);
            }
        }
    }

    fn number(&self, [x, y]: [usize; 2]) -> usize {
        y * self.width + x
    }

    fn vertex(&self, [x, y]: [usize; 2]) -> Option<usize> {
        (x < self.grid.size[0] && y < self.grid.size[1]).then(|| self.grid.index(x, y))
    }

    fn height(&self, p: [usize; 2]) -> f32 {
        self.vertex(p).map_or(self.outside_m, |i| self.field[i])
    }

    /// Whether the triangle keeps within the heights of all vertices in it.
    fn is_accurate(&self, corners: &Corners) -> bool {
        let [a, b, c] = corners.map(|p| p.map(|v| v as f32));
        let z = corners.map(|p| self.height(p));
        let det = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let (mut has_needed, mut has_other) = (false, false);
        let is_within = all_inside(corners, |p| {
            let Some(i) = self.vertex(p) else {
                has_other = true;
                return true;
            };
            has_needed |= self.range.is_needed[i];
            has_other |= !self.range.is_needed[i];
            let [dx, dy] = [p[0] as f32 - a[0], p[1] as f32 - a[1]];
            let u = (dx * (c[1] - a[1]) - dy * (c[0] - a[0])) / det;
            let v = (dy * (b[0] - a[0]) - dx * (b[1] - a[1])) / det;
            let surface = z[0] + u * (z[1] - z[0]) + v * (z[2] - z[0]);
            surface >= self.range.low[i] && surface <= self.range.high[i]
        });
        let length = corners[0][0].abs_diff(corners[1][0]).max(corners[0][1].abs_diff(corners[1][1]));
        is_within && !(has_needed && has_other && length > MAX_MIXED_STEPS)
    }

    fn emit(&self, corners: Corners, triangles: &mut Vec<[[f32; 3]; 3]>) {
        let [a, b, c] = corners;
        let m = middle(a, b);
        let is_smallest = (a[0] + b[0]) % 2 == 1 || (a[1] + b[1]) % 2 == 1;
        if !is_smallest && self.is_halved[self.number(m)] {
            self.emit([c, a, m], triangles);
            self.emit([b, c, m], triangles);
            return;
        }
        let is_free = all_inside(&corners, |p| self.vertex(p).is_none_or(|i| !self.range.is_needed[i]));
        if !is_free {
            let corner = |p: [usize; 2]| {
                let [x, y] = self.grid.position(p[0], p[1]);
                [x as f32, y as f32, self.height(p)]
            };
            triangles.push([a, b, c].map(corner));
        }
    }
}

/// The corners of triangle `id` of a leaf, whose binary digits name the halves from the smallest up.
fn corners_of(mut id: usize, [x, y]: [usize; 2]) -> Corners {
    let s = SQUARES;
    let [mut a, mut b, mut c] = if id & 1 == 1 { [[0, 0], [s, s], [s, 0]] } else { [[s, s], [0, 0], [0, s]] };
    id >>= 1;
    while id > 1 {
        let m = middle(a, b);
        [a, b] = if id & 1 == 1 { [c, a] } else { [b, c] };
        c = m;
        id >>= 1;
    }
    [a, b, c].map(|p| [x + p[0], y + p[1]])
}

fn middle(a: [usize; 2], b: [usize; 2]) -> [usize; 2] {
    [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]
}

/// Whether `is_good` holds for all vertices in the triangle and on its edges.
fn all_inside(corners: &Corners, mut is_good: impl FnMut([usize; 2]) -> bool) -> bool {
    let [a, b, c] = corners.map(|p| p.map(|v| v as i64));
    let range = |axis: usize| a[axis].min(b[axis]).min(c[axis])..=a[axis].max(b[axis]).max(c[axis]);
    let side = |from: [i64; 2], to: [i64; 2], p: [i64; 2]| {
        (to[0] - from[0]) * (p[1] - from[1]) - (to[1] - from[1]) * (p[0] - from[0])
    };
    let turn = side(a, b, c).signum();
    for y in range(1) {
        for x in range(0) {
            let p = [x, y];
            let is_inside = [(a, b), (b, c), (c, a)].into_iter().all(|(from, to)| side(from, to, p) * turn >= 0);
            if is_inside && !is_good([x as usize, y as usize]) {
                return false;
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ground::standing::height_at;
    use std::collections::HashMap;

    #[test]
    fn triangles_are_few_where_flat_accurate_elsewhere_and_share_edges() {
        let grid = GroundGrid { corner: [0.0; 2], step_m: 4.0, size: [41, 29], skirt: 0 };
        let height = |i: usize| {
            let [x, y] = grid.place(i).map(|v| v as f32);
            if x < 20.0 { 1.0 } else { 1.0 + 0.05 * (x - 20.0) * (y - 14.0) }
        };
        let field: Vec<f32> = (0..grid.len()).map(height).collect();
        let range = HeightRange {
            low: field.iter().map(|z| z - 0.1).collect(),
            high: field.iter().map(|z| z + 0.2).collect(),
            is_needed: vec![true; field.len()],
        };
        let triangles = triangulate(&grid, &field, &range, 1.0);
        let is_west = |t: &&[[f32; 3]; 3]| t.iter().all(|corner| corner[0] <= 64.0);
        assert!(triangles.iter().filter(is_west).count() < 60);
        // Every edge inside of the surface belongs to two triangles.
        let mut uses: HashMap<[[u32; 3]; 2], u32> = HashMap::new();
        for triangle in &triangles {
            for k in 0..3 {
                let mut ends = [triangle[k], triangle[(k + 1) % 3]].map(|p| p.map(f32::to_bits));
                ends.sort_unstable();
                *uses.entry(ends).or_default() += 1;
            }
        }
        let is_inside = |end: &[u32; 3]| {
            let [x, y] = [f32::from_bits(end[0]), f32::from_bits(end[1])];
            x > 0.0 && y > 0.0 && x < 156.0 && y < 108.0
        };
        assert!(uses.iter().filter(|(ends, _)| ends.iter().any(is_inside)).all(|(_, n)| *n == 2));
        for i in (0..grid.len()).filter(|i| grid.place(*i)[0] < 40) {
            let [x, y] = grid.place(i).map(|v| v as f32 * 4.0);
            let z = triangles.iter().find_map(|t| height_at(t, [x, y])).unwrap();
            assert!(z >= range.low[i] - 1e-4 && z <= range.high[i] + 1e-4, "{x} {y}: {z} for {}", field[i]);
        }
    }
}
