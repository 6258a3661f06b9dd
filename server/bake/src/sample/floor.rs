//! The floor: below which height no viewer can be, and from where a line of sight leads out into the open.
//!
//! A viewer below a roof stands on the ground, and can walk there from a place under the open sky. So a point is
//! visible from below the horizon only if the line from it towards the viewer reaches a place with nothing above before it
//! reaches the floor. Other lines would show the inside of a shell that has no floor of its own. The objects of the surfaces do
//! not matter: a deck on its piers is the same whether a source has them as one object or as many.

use super::local_block::{LocalBlock, LocalTriangle};
use super::rasterise::rasterise;
use glam::{Vec2, Vec3};

/// Most cells around the block whose floor counts. Lines that end under cover further away lead out.
const MOST_MARGIN_CELLS: usize = 256;
/// Objects whose lowest point is this much above the ground, in cells, hang in the air. Others stand on it, and the small space
/// below them is no space for viewers.
const STANDING_CELLS: f32 = 1.5;
/// A place is open to the sky from this height above the highest surface around it, in cells. Surfaces are known at the middles
/// of cells only.
const CLEAR_CELLS: f32 = 2.0;
/// Height from which lines lead out beyond the margin: everything does. Finite, so that it can be interpolated.
const BEYOND_M: f32 = -1e9;

/// The floor of the cells in and around a block.
#[derive(Debug)]
pub(super) struct Floor {
    /// Number of cells along x and y.
    size: [usize; 2],
    /// West and south border, in the block's coordinates.
    corner: Vec2,
    cell_m: f32,
    /// Height of the floor in each cell, in rows along x, and in rows along y.
    floors_m: [Vec<f32>; 2],
    /// Height from which a cell is open to the sky; negative infinity where nothing stands. Also in both orders.
    open_m: [Vec<f32>; 2],
}

impl Floor {
    /// `margin_m` is the width of the block's margin.
    pub(super) fn new(block: &LocalBlock, margin_m: f64) -> Self {
        let margin = ((margin_m / f64::from(block.cell_m)).ceil() as usize).clamp(2, MOST_MARGIN_CELLS);
        let size = block.cells.map(|n| n + 2 * margin);
        let places = FloorCells { size, corner: Vec2::splat(-(margin as f32) * block.cell_m), cell_m: block.cell_m };
        let cover = StandingCover::of(block, places);
        let grounds_m = ground_heights(block, places);
        let floors_m: Vec<f32> = grounds_m
            .iter()
            .zip(&cover.feet_m)
            .map(|(ground, foot)| floor_height(*ground, *foot, block.cell_m))
            .collect();
        // Where nothing is known there is nothing that could be looked into.
        let lowest_m = floors_m.iter().copied().fold(f32::INFINITY, f32::min);
        let floors_m: Vec<f32> = floors_m.into_iter().map(|z| if z.is_finite() { z } else { lowest_m }).collect();
        let open_m: Vec<f32> = cover.tops_m.into_iter().map(|z| z + CLEAR_CELLS * block.cell_m).collect();
        let turned = |values: &[f32]| {
            (0..values.len()).map(|i| values[(i % size[1]) * size[0] + i / size[1]]).collect::<Vec<f32>>()
        };
        let (turned_floors_m, turned_open_m) = (turned(&floors_m), turned(&open_m));
        Self {
            size,
            corner: places.corner,
            cell_m: block.cell_m,
            floors_m: [floors_m, turned_floors_m],
            open_m: [open_m, turned_open_m],
        }
    }

    fn place(&self, x_m: f32, y_m: f32) -> [usize; 2] {
        let at = (Vec2::new(x_m, y_m) - self.corner) / self.cell_m;
        // The cast saturates, so that points outside belong to the nearest cell.
        [(at.x as usize).min(self.size[0] - 1), (at.y as usize).min(self.size[1] - 1)]
    }

    /// The floor at a place; positive infinity if none is known anywhere.
    pub(super) fn at(&self, x_m: f32, y_m: f32) -> f32 {
        let [x, y] = self.place(x_m, y_m);
        self.floors_m[0][y * self.size[0] + x]
    }

    /// Whether the triangle hangs so far above the floor that a viewer may be under it.
    pub(super) fn is_below(&self, triangle: &LocalTriangle) -> bool {
        let [low, high] = triangle.bounds();
        let ([x0, y0], [x1, y1]) = (self.place(low.x, low.y), self.place(high.x, high.y));
        let limit_m = low.z - STANDING_CELLS * self.cell_m;
        (y0..=y1).any(|y| self.floors_m[0][y * self.size[0]..][x0..=x1].iter().any(|floor_m| *floor_m < limit_m))
    }

    /// From which heights lines towards a viewer below the horizon lead out.
    pub(super) fn ways_out(&self, direction: Vec3) -> WaysOut<'_> {
        // Steps of one cell along the axis that the direction is nearer to, in rows along the other one.
        let main = usize::from(direction.y.abs() > direction.x.abs());
        let (across, order) = (1 - main, 1 - main);
        let width = self.size[across];
        let per_step = direction[main].abs().max(1e-6);
        let (turn, fall_m) = (direction[across] / per_step, -direction.z / per_step * self.cell_m);
        // From -1 to 1, as one step goes at most as far across as along.
        let (whole, share) = (turn.floor(), turn - turn.floor());
        let first = (whole + 1.0) as usize;
        let mut heights_m = self.floors_m[order].clone();
        // With one more cell before, and two behind.
        let mut next_m = vec![BEYOND_M; width + 3];
        for step in 0..self.size[main] {
            let along = if direction[main] > 0.0 { self.size[main] - 1 - step } else { step };
            let row = along * width..(along + 1) * width;
            let heights_m = &mut heights_m[row.clone()];
            let ends = next_m[first..].iter().zip(&next_m[first + 1..]);
            for ((out_m, open_m), (near_m, far_m)) in heights_m.iter_mut().zip(&self.open_m[order][row]).zip(ends) {
                let exit_m = near_m * (1.0 - share) + far_m * share + fall_m;
                let exit_m = if exit_m < *open_m { exit_m } else { *open_m };
                *out_m = if exit_m > *out_m { exit_m } else { *out_m };
            }
            next_m[1..=width].copy_from_slice(heights_m);
        }
        let strides = if order == 0 { [1, width] } else { [width, 1] };
        WaysOut { floor: self, strides, heights_m }
    }
}

/// For one direction below the horizon: from which heights lines lead out.
#[derive(Debug)]
pub(super) struct WaysOut<'a> {
    floor: &'a Floor,
    /// Distances of neighbours along x and y.
    strides: [usize; 2],
    /// Lowest such height of each cell.
    heights_m: Vec<f32>,
}

impl WaysOut<'_> {
    /// Whether the line from `p` comes into the open before it meets the floor.
    pub(super) fn lead_from(&self, p: Vec3) -> bool {
        let [x, y] = self.floor.place(p.x, p.y);
        p.z >= self.heights_m[x * self.strides[0] + y * self.strides[1]]
    }
}

/// The floor of a cell from the height of its ground and the foot of what stands there; NaN and infinite if unknown.
fn floor_height(ground_m: f32, foot_m: f32, cell_m: f32) -> f32 {
    let hangs = foot_m > ground_m + STANDING_CELLS * cell_m;
    if ground_m.is_nan() || foot_m.is_infinite() {
        if ground_m.is_nan() { foot_m } else { ground_m }
    } else if hangs {
        ground_m
    } else {
        ground_m.max(foot_m)
    }
}

/// The grid of cells.
#[derive(Debug, Clone, Copy)]
struct FloorCells {
    size: [usize; 2],
    corner: Vec2,
    cell_m: f32,
}

impl FloorCells {
    /// Calls `visit` with the number of each cell whose middle is in the triangle, seen from above, and the height there.
    fn for_each(self, corners: &[Vec3; 3], mut visit: impl FnMut(usize, f32)) {
        let [a, b, c] = *corners;
        let n = (b - a).cross(c - a);
        if n.z.abs() <= 1e-4 * n.length() {
            return;
        }
        let (low, high) = (a.z.min(b.z).min(c.z), a.z.max(b.z).max(c.z));
        let flat = corners.map(|p| [p.x - self.corner.x, p.y - self.corner.y]);
        rasterise(flat, self.cell_m, self.size, |row, first, end| {
            let y = (row as f32 + 0.5) * self.cell_m + self.corner.y;
            for column in first..end {
                let x = (column as f32 + 0.5) * self.cell_m + self.corner.x;
                let z = a.z - (n.x * (x - a.x) + n.y * (y - a.y)) / n.z;
                visit(row * self.size[0] + column, z.clamp(low, high));
            }
        });
    }

    /// For each cell, the values of it and of the eight around it, combined.
    fn spread(self, values: &[f32], combine: fn(f32, f32) -> f32) -> Vec<f32> {
        let [width, height] = self.size;
        let along_x = |i: usize| {
            let x = i % width;
            let end = values[i - usize::from(x > 0)..=i + usize::from(x + 1 < width)].iter().copied();
            end.fold(values[i], combine)
        };
        let rows: Vec<f32> = (0..values.len()).map(along_x).collect();
        let along_y = |i: usize| {
            let (below, above) = (i.saturating_sub(width), i + width);
            let ends = [if i >= width { below } else { i }, if above < width * height { above } else { i }];
            ends.into_iter().fold(rows[i], |value, end| combine(value, rows[end]))
        };
        (0..values.len()).map(along_y).collect()
    }
}

/// Lowest terrain of each cell, else its generated ground; NaN where there is neither.
fn ground_heights(block: &LocalBlock, places: FloorCells) -> Vec<f32> {
    let mut grounds_m = vec![f32::NAN; places.size[0] * places.size[1]];
    for corners in &block.ground {
        places.for_each(corners, |i, z| grounds_m[i] = z);
    }
    let mut terrain_m = vec![f32::INFINITY; grounds_m.len()];
    for triangle in block.triangles.iter().filter(|triangle| triangle.is_terrain) {
        places.for_each(&triangle.corners, |i, z| terrain_m[i] = terrain_m[i].min(z));
    }
    for (ground_m, terrain_m) in grounds_m.iter_mut().zip(terrain_m) {
        *ground_m = if terrain_m.is_finite() { terrain_m } else { *ground_m };
    }
    grounds_m
}

/// What stands in the cells, without terrain.
#[derive(Debug)]
struct StandingCover {
    /// Highest surface of each cell and of those around it; negative infinity where there is none.
    tops_m: Vec<f32>,
    /// Lowest point of the objects there, and of those under them; infinite where there are none.
    feet_m: Vec<f32>,
}

impl StandingCover {
    fn of(block: &LocalBlock, places: FloorCells) -> Self {
        let n = places.size[0] * places.size[1];
        let (mut tops_m, mut own_feet_m) = (vec![f32::NEG_INFINITY; n], vec![f32::INFINITY; n]);
        let solid = || block.triangles.iter().filter(|triangle| !triangle.is_terrain);
        for triangle in solid() {
            places.for_each(&triangle.corners, |i, z| {
                tops_m[i] = tops_m[i].max(z);
                own_feet_m[i] = own_feet_m[i].min(triangle.object_bottom_m);
            });
        }
        // An object whose foot is not on the ground stands on what is under it.
        let mut feet_m = vec![f32::INFINITY; n];
        let mut cells = Vec::new();
        for object in block.triangles.chunk_by(|a, b| a.object == b.object).filter(|object| !object[0].is_terrain) {
            cells.clear();
            object.iter().for_each(|triangle| places.for_each(&triangle.corners, |i, _| cells.push(i)));
            let lowest_m = cells.iter().map(|i| own_feet_m[*i]).fold(f32::INFINITY, f32::min);
            cells.iter().for_each(|i| feet_m[*i] = feet_m[*i].min(lowest_m));
        }
        Self { tops_m: places.spread(&tops_m, f32::max), feet_m: places.spread(&feet_m, f32::min) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block of 64 x 64 cells of 1 m with these level squares: west, south, side, height, number of the object, its foot.
    fn block(squares: &[([f32; 4], u32, f32)], ground_m: Option<f32>) -> LocalBlock {
        let halves = |[west, south, side, z]: [f32; 4]| {
            let corner = |x: f32, y: f32| Vec3::new(west + x * side, south + y * side, z);
            let [a, b, c, d] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
            [[a, b, c], [a, c, d]]
        };
        let triangle = |corners, object, object_bottom_m| LocalTriangle {
            corners,
            normal: Vec3::Z,
            area_m2: 1.0,
            is_terrain: false,
            object,
            object_bottom_m,
            is_closed: false,
            source: 0,
        };
        let triangles = squares
            .iter()
            .flat_map(|(square, object, foot_m)| halves(*square).map(|corners| triangle(corners, *object, *foot_m)));
        LocalBlock {
            triangles: triangles.collect(),
            ground: ground_m.map_or_else(Vec::new, |z| halves([-64.0, -64.0, 192.0, z]).to_vec()),
            cell_m: 1.0,
            cells: [64; 2],
            first_leaf: [0; 2],
            z_range_m: [0.0, 20.0],
            sky_directions: 64,
            is_level: false,
        }
    }

    /// Whether a line that falls 1 m on 4 m towards the east leads out from a place.
    fn leads_east(floor: &Floor, p: [f32; 3]) -> bool {
        floor.ways_out(Vec3::new(4.0, 0.0, -1.0).normalize()).lead_from(p.into())
    }

    #[test]
    fn roofs_in_the_air_are_seen_from_below_as_far_as_the_ground_allows() {
        let roof = [10.0, 10.0, 40.0, 8.0];
        for squares in [vec![(roof, 0, 8.0)], vec![(roof, 0, 8.0), ([20.5, 20.5, 4.0, 3.0], 1, 0.0)]] {
            let floor = Floor::new(&block(&squares, Some(0.0)), 64.0);
            // The roof ends at x = 50, so the line from 8 m reaches the ground at 32 m before.
            assert!(leads_east(&floor, [40.5, 30.5, 8.0]) && leads_east(&floor, [22.5, 30.5, 8.0]));
            assert!(!leads_east(&floor, [14.5, 30.5, 8.0]));
            assert!(floor.at(30.5, 30.5) <= 0.0);
        }
    }

    #[test]
    fn no_line_leads_out_through_the_floor_of_a_shell() {
        for ground_m in [None, Some(-0.3), Some(0.4)] {
            // A roof of a shell without a floor, whose walls end at 0.
            let floor = Floor::new(&block(&[([10.0, 10.0, 40.0, 8.0], 0, 0.0)], ground_m), 64.0);
            assert!(!leads_east(&floor, [14.5, 30.5, 8.0]), "{ground_m:?}");
            assert!(leads_east(&floor, [40.5, 30.5, 8.0]), "only a wall could end this line");
            assert!(!leads_east(&floor, [45.5, 30.5, 1.0]), "{ground_m:?}");
            assert_eq!(floor.at(30.5, 30.5), ground_m.unwrap_or(0.0).max(0.0));
        }
    }

    #[test]
    fn without_ground_things_stand_on_what_is_below_them() {
        let (podium, slab) = (([10.0, 10.0, 40.0, 6.0], 0, 0.0), ([5.0, 5.0, 50.0, 20.0], 1, 20.0));
        let one =
            Floor::new(&block(&[([10.0, 10.0, 40.0, 6.0], 0, 0.0), ([5.0, 5.0, 50.0, 20.0], 0, 0.0)], None), 64.0);
        let two = Floor::new(&block(&[podium, slab], None), 64.0);
        assert_eq!(one.floors_m, two.floors_m);
        assert!(leads_east(&two, [30.5, 30.5, 20.0]));
        let alone = Floor::new(&block(&[slab], None), 64.0);
        assert_eq!(alone.at(30.5, 30.5), 20.0);
    }
}
