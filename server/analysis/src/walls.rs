//! Points on the walls of buildings, where they stand on the ground.

use crate::surface::{CitySurface, TopKind};

/// A lower difference between a roof and the ground beside it is no wall that anybody looks out of.
const LEAST_WALL_M: f32 = 2.0;

/// A point on a wall, a metre of which is a cell wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallPoint {
    /// Index of the cell of ground before the wall.
    pub cell: u32,
    /// Metres above the surface's base.
    pub height_m: f32,
    /// Direction of the wall's normal, from the grid's north over east.
    pub azimuth_deg: f32,
    /// Index of the building.
    pub building: u32,
}

/// Points on all walls at heights above the ground before them, in metres. Walls that end below have none there.
#[must_use]
pub fn wall_points(surface: &CitySurface, heights_m: &[f64]) -> Vec<WallPoint> {
    let [width, height] = surface.size();
    let mut points = Vec::new();
    let row = |y: usize| -> Vec<TopKind> { if y < height { surface.kinds_of_row(y).collect() } else { Vec::new() } };
    // The rows before, at and after the one that is looked at.
    let mut kinds = [Vec::new(), Vec::new(), row(0)];
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        if x == 0 {
            kinds.rotate_left(1);
            kinds[2] = row(y + 1);
        }
        let roof = y * width + x;
        let TopKind::Roof(building) = kinds[1][x] else { continue };
        for (step, axis_deg) in [([1, 0], 90.0), ([0, 1], 0.0), ([-1, 0], 270.0), ([0, -1], 180.0)] {
            let Some([before_x, before_y]) = neighbour([x, y], step, [width, height]) else { continue };
            let before = before_y * width + before_x;
            let (ground, top) = (surface.top(before), surface.top(roof));
            if !kinds[before_y + 1 - y][before_x].is_ground() || top - ground < LEAST_WALL_M {
                continue;
            }
            // A wall that runs across the cells has its own direction, as long as it looks over this side of the cell.
            let own = surface.wall_azimuth_deg(roof).filter(|azimuth| cos_between(*azimuth, axis_deg) > 0.3);
            let azimuth_deg = own.unwrap_or(axis_deg) as f32;
            let heights = heights_m.iter().map(|height| *height as f32).filter(|height| ground + height < top);
            points.extend(heights.map(|height| WallPoint {
                cell: before as u32,
                height_m: ground + height,
                azimuth_deg,
                building,
            }));
        }
    }
    points
}

fn neighbour([x, y]: [usize; 2], step: [isize; 2], [width, height]: [usize; 2]) -> Option<[usize; 2]> {
    let [x, y] = [x.checked_add_signed(step[0])?, y.checked_add_signed(step[1])?];
    (x < width && y < height).then_some([x, y])
}

fn cos_between(a_deg: f64, b_deg: f64) -> f64 {
    (a_deg - b_deg).to_radians().cos()
}

/// Which points lie in each row of a raster, of which columns are rows where it is transposed.
#[derive(Debug)]
pub(crate) struct WallRows {
    /// Where each row's points begin; one more at the end.
    starts: Vec<u32>,
    /// Numbers of points.
    points: Vec<u32>,
    /// Of the raster that is not transposed.
    width: u32,
    is_transposed: bool,
}

impl WallRows {
    /// For a raster of `size`, turned or not.
    pub(crate) fn new(points: &[WallPoint], [width, height]: [usize; 2], is_transposed: bool) -> Self {
        let rows = if is_transposed { width } else { height };
        let mut all = Self { starts: vec![0; rows + 1], points: Vec::new(), width: width as u32, is_transposed };
        for point in points {
            let (row, _) = all.row_and_place(point);
            all.starts[row + 1] += 1;
        }
        for row in 0..rows {
            all.starts[row + 1] += all.starts[row];
        }
        let mut next = all.starts.clone();
        all.points.resize(points.len(), 0);
        for (number, point) in (0u32..).zip(points) {
            let (row, _) = all.row_and_place(point);
            all.points[next[row] as usize] = number;
            next[row] += 1;
        }
        all
    }

    fn row_and_place(&self, point: &WallPoint) -> (usize, usize) {
        let [x, y] = [point.cell % self.width, point.cell / self.width].map(|v| v as usize);
        if self.is_transposed { (x, y) } else { (y, x) }
    }

    /// The points of a row: numbers, and places in it.
    pub(crate) fn row<'a>(&'a self, row: usize, points: &'a [WallPoint]) -> impl Iterator<Item = (usize, usize)> + 'a {
        let numbers = &self.points[self.starts[row] as usize..self.starts[row + 1] as usize];
        numbers.iter().map(|number| (*number as usize, self.row_and_place(&points[*number as usize]).1))
    }
}
