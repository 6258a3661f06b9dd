//! The regular grid of the ground's height field.

use insula_protocol::blockmap::ground;

/// Most steps along a side. Larger cities get a coarser grid, so that a field has at most 17 MB.
const MAX_STEPS: usize = 2048;
/// Steps of the finest grid along the side of a leaf: those of the ground in tiles.
const STEPS_PER_LEAF: f64 = ground::SQUARES as f64;
/// Share of the city's extent that the skirt around it has, and its limits in metres.
const SKIRT_SHARE: f64 = 0.1;
const SKIRT_RANGE_M: [f64; 2] = [32.0, 300.0];

/// Vertices in rows from the south-west corner. Vertices lie on the borders of leaves, so that triangles end there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GroundGrid {
    /// South-west vertex in scene coordinates.
    pub(super) corner: [f64; 2],
    /// Distance of vertices in metres.
    pub(super) step_m: f64,
    /// Number of vertices along x and y.
    pub(super) size: [usize; 2],
    /// Number of steps from the grid's border to the city.
    pub(super) skirt: usize,
}

impl GroundGrid {
    /// A grid over `[min, max]` (scene coordinates) and the skirt around. `leaf_m` is the side of a leaf. `None` if the
    /// extent is not finite.
    pub(super) fn covering(min: [f64; 3], max: [f64; 3], world_origin: [f64; 3], leaf_m: f64) -> Option<Self> {
        let extent_m = (max[0] - min[0]).max(max[1] - min[1]);
        if !extent_m.is_finite() || leaf_m <= 0.0 {
            return None;
        }
        let skirt_m = (SKIRT_SHARE * extent_m).clamp(SKIRT_RANGE_M[0], SKIRT_RANGE_M[1]).max(leaf_m / 2.0);
        let mut step_m = leaf_m / STEPS_PER_LEAF;
        while (extent_m + 2.0 * skirt_m) / step_m > (MAX_STEPS - 32) as f64 {
            step_m *= 2.0;
        }
        let side_m = step_m.max(leaf_m);
        let corner = [0, 1].map(|axis: usize| {
            ((min[axis] - skirt_m + world_origin[axis]) / side_m).floor() * side_m - world_origin[axis]
        });
        let size = [0, 1].map(|axis: usize| ((max[axis] + skirt_m - corner[axis]) / step_m).ceil() as usize + 1);
        Some(Self { corner, step_m, size, skirt: (skirt_m / step_m) as usize })
    }

    pub(super) fn len(&self) -> usize {
        self.size[0] * self.size[1]
    }

    pub(super) fn index(&self, x: usize, y: usize) -> usize {
        y * self.size[0] + x
    }

    /// Column and row of a vertex.
    pub(super) fn place(&self, i: usize) -> [usize; 2] {
        [i % self.size[0], i / self.size[0]]
    }

    /// Column and row of the square of four vertices that contains a point of the scene.
    pub(super) fn square(&self, x_m: f64, y_m: f64) -> [usize; 2] {
        let along = |axis: usize, v: f64| (((v - self.corner[axis]) / self.step_m) as usize).min(self.size[axis] - 2);
        [along(0, x_m), along(1, y_m)]
    }

    /// Position of a point in its square, 0 to 1 along x and y.
    pub(super) fn within_square(&self, [x_m, y_m, _]: [f32; 3], [x, y]: [usize; 2]) -> [f32; 2] {
        let [west, south] = self.position(x, y);
        [f64::from(x_m) - west, f64::from(y_m) - south].map(|d| (d / self.step_m).clamp(0.0, 1.0) as f32)
    }

    /// Position of a vertex in scene coordinates.
    pub(super) fn position(&self, x: usize, y: usize) -> [f64; 2] {
        [self.corner[0] + x as f64 * self.step_m, self.corner[1] + y as f64 * self.step_m]
    }

    /// The vertices around the city, without the skirt: those on the border of the city's rectangle.
    pub(super) fn border(&self) -> impl Iterator<Item = usize> + '_ {
        let [low, high] = [[self.skirt; 2], self.size.map(|n| n.saturating_sub(1 + self.skirt))];
        (0..self.len()).filter(move |i| {
            let p = self.place(*i);
            let is_inside = (0..2).all(|axis| p[axis] >= low[axis] && p[axis] <= high[axis]);
            is_inside && (0..2).any(|axis| p[axis] == low[axis] || p[axis] == high[axis])
        })
    }

    /// Steps from each vertex to the nearest marked one, along x or along y, whichever is more; at most `u16::MAX`.
    pub(super) fn distances(&self, is_marked: impl Fn(usize) -> bool) -> Vec<u16> {
        let [width, height] = self.size;
        let mut steps: Vec<u16> = (0..self.len()).map(|i| if is_marked(i) { 0 } else { u16::MAX }).collect();
        let mut relax = |i: usize, others: [Option<usize>; 4]| {
            let nearest = others.into_iter().flatten().map(|other| steps[other].saturating_add(1)).min();
            steps[i] = nearest.map_or(steps[i], |nearest| nearest.min(steps[i]));
        };
        let west = |i: usize| (!i.is_multiple_of(width)).then(|| i - 1);
        let east = |i: usize| (i % width + 1 < width).then(|| i + 1);
        for i in 0..width * height {
            let south = i.checked_sub(width);
            relax(i, [west(i), south, south.and_then(west), south.and_then(east)]);
        }
        for i in (0..width * height).rev() {
            let north = Some(i + width).filter(|i| *i < width * height);
            relax(i, [east(i), north, north.and_then(west), north.and_then(east)]);
        }
        steps
    }

    /// Whether a vertex lies on the grid's border.
    pub(super) fn is_rim(&self, [x, y]: [usize; 2]) -> bool {
        x == 0 || y == 0 || x + 1 == self.size[0] || y + 1 == self.size[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grid_covers_the_city_and_its_skirt() {
        let grid = GroundGrid::covering([-3.0, 10.0, 0.0], [997.0, 510.0, 9.0], [1000.0, 5.0, 0.0], 64.0).unwrap();
        assert_eq!((grid.step_m, grid.skirt), (8.0, 12));
        assert!(grid.corner[0] <= -103.0 && grid.corner[1] <= -90.0);
        assert_eq!((grid.corner[0] + 1000.0) % 64.0, 0.0);
        let end = grid.position(grid.size[0] - 1, grid.size[1] - 1);
        assert!(end[0] >= 1097.0 && end[1] >= 610.0);
        assert_eq!(
            grid.square(-3.0, 10.0),
            [((-3.0 - grid.corner[0]) / 8.0) as usize, ((10.0 - grid.corner[1]) / 8.0) as usize]
        );
    }

    #[test]
    fn huge_city_has_a_coarser_grid() {
        let grid = GroundGrid::covering([0.0; 3], [350_000.0; 3], [0.0; 3], 64.0).unwrap();
        assert!(grid.size.iter().all(|n| *n <= MAX_STEPS + 1), "{grid:?}");
        assert!(GroundGrid::covering([0.0; 3], [f64::INFINITY; 3], [0.0; 3], 64.0).is_none());
    }
}
