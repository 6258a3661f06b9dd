//! The ground meets the bases of buildings that have heights of their own.
//!
//! Under a building it has the height of the base. Beside it, it passes into the elevation model's heights within
//! [`BLEND_M`]. Between buildings the nearest one counts most (Shepard 1968, inverse distances).

use super::lattice::MapGrid;
use insula_dress::building_base::{BLEND_M, BuildingBase};
use std::sync::Arc;

/// Distances below this part of [`BLEND_M`] weigh alike.
const NEAR_SHARE: f64 = 1e-3;

/// What the buildings near a point want.
#[derive(Clone, Copy)]
struct Wish {
    /// Sum of heights of bases over the point, and their number.
    under: [f64; 2],
    /// Sum of weighted heights of bases beside the point, and of weights.
    beside: [f64; 2],
    nearest_m: f64,
}

impl Wish {
    const NONE: Self = Self { under: [0.0; 2], beside: [0.0; 2], nearest_m: f64::INFINITY };

    fn add(&mut self, height_m: f64, distance_m: f64) {
        if distance_m <= 0.0 {
            self.under = [self.under[0] + height_m, self.under[1] + 1.0];
        } else if distance_m < BLEND_M {
            let share = distance_m / BLEND_M;
            let weight = (1.0 - share).powi(2) / share.max(NEAR_SHARE);
            self.beside = [self.beside[0] + weight * height_m, self.beside[1] + weight];
            self.nearest_m = self.nearest_m.min(distance_m);
        }
    }

    /// The height of a point at which the model has another.
    fn applied_to(&self, height_m: f64) -> f64 {
        let [sum, count] = self.under;
        if count > 0.0 {
            return sum / count;
        }
        let [sum, weights] = self.beside;
        if weights <= 0.0 {
            return height_m;
        }
        let share = 1.0 - self.nearest_m / BLEND_M;
        height_m + (sum / weights - height_m) * share * share * (3.0 - 2.0 * share)
    }
}

/// Changes the heights of a grid, in rows. Points without a height keep none.
pub(super) fn fit_to_bases(grid: &MapGrid, heights: &mut [f32], bases: &[Arc<BuildingBase>]) {
    let mut wishes = vec![Wish::NONE; if bases.is_empty() { 0 } else { heights.len() }];
    for base in bases {
        for (point, distance_m) in distances(grid, base) {
            wishes[point].add(base.height_m, distance_m);
        }
    }
    for (height, wish) in heights.iter_mut().zip(&wishes) {
        *height = wish.applied_to(f64::from(*height)) as f32;
    }
}

/// The points of a grid near a base, with their distances.
fn distances(grid: &MapGrid, base: &BuildingBase) -> impl Iterator<Item = (usize, f64)> {
    let triangles: Vec<[[f64; 2]; 3]> = base.triangles.iter().map(|triangle| base.on_map(triangle)).collect();
    let all = window(grid, triangles.as_flattened());
    let width = all.width();
    let mut nearest_m = vec![f64::INFINITY; width * all.height()];
    for triangle in &triangles {
        for [x, y] in window(grid, triangle).points() {
            let nearest = &mut nearest_m[(y - all.low[1]) * width + x - all.low[0]];
            if *nearest > 0.0 {
                *nearest = nearest.min(distance_m(grid.position(x, y), triangle));
            }
        }
    }
    let columns = grid.size[0];
    all.points().zip(nearest_m).map(move |([x, y], distance_m)| (y * columns + x, distance_m))
}

/// A rectangle of a grid's points; the high ones do not belong to it.
#[derive(Debug, Clone, Copy)]
struct Window {
    low: [usize; 2],
    high: [usize; 2],
}

impl Window {
    fn width(&self) -> usize {
        self.high[0] - self.low[0]
    }

    fn height(&self) -> usize {
        self.high[1] - self.low[1]
    }

    fn points(self) -> impl Iterator<Item = [usize; 2]> {
        (self.low[1]..self.high[1]).flat_map(move |y| (self.low[0]..self.high[0]).map(move |x| [x, y]))
    }
}

/// The points of a grid around positions.
fn window(grid: &MapGrid, positions: &[[f64; 2]]) -> Window {
    let point = |axis: usize, along: f64| {
        // Saturates outside of the grid.
        (((along - grid.corner[axis]) / grid.step_m).floor() as usize).min(grid.size[axis])
    };
    let ends = |axis: usize| {
        let low = positions.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = positions.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let low = point(axis, low - BLEND_M);
        [low, point(axis, high + BLEND_M + grid.step_m).max(low)]
    };
    let [x, y] = [ends(0), ends(1)];
    Window { low: [x[0], y[0]], high: [x[1], y[1]] }
}

/// Distance of a point to a triangle, 0 in it.
fn distance_m(point: [f64; 2], triangle: &[[f64; 2]; 3]) -> f64 {
    let edges = [0, 1, 2].map(|i| (triangle[i], triangle[(i + 1) % 3]));
    let sides = edges.map(|(a, b)| (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]));
    if sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0) {
        return 0.0;
    }
    let to_edge = |(a, b): ([f64; 2], [f64; 2])| {
        let along = [b[0] - a[0], b[1] - a[1]];
        let from_a = [point[0] - a[0], point[1] - a[1]];
        let length2 = along[0] * along[0] + along[1] * along[1];
        let share = if length2 > 0.0 { (from_a[0] * along[0] + from_a[1] * along[1]) / length2 } else { 0.0 };
        let share = share.clamp(0.0, 1.0);
        libm::hypot(from_a[0] - share * along[0], from_a[1] - share * along[1])
    };
    edges.map(to_edge).into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: MapGrid = MapGrid { corner: [1000.0, 2000.0], step_m: 0.5, size: [120, 80] };

    /// A rectangle of two triangles.
    fn base(low: [f32; 2], high: [f32; 2], height_m: f64) -> Arc<BuildingBase> {
        let triangles = vec![[low, [high[0], low[1]], high], [low, high, [low[0], high[1]]]];
        Arc::new(BuildingBase { height_m, corner: GRID.corner, triangles })
    }

    fn slope() -> Vec<f32> {
        (0..GRID.size[0] * GRID.size[1]).map(|i| (i % GRID.size[0]) as f32 * 0.05).collect()
    }

    fn fitted(bases: &[Arc<BuildingBase>]) -> impl Fn(f64, f64) -> f64 + use<> {
        let mut heights = slope();
        fit_to_bases(&GRID, &mut heights, bases);
        move |x, y| f64::from(heights[(y / GRID.step_m) as usize * GRID.size[0] + (x / GRID.step_m) as usize])
    }

    #[test]
    fn ground_meets_a_base_and_passes_into_the_model() {
        let height = fitted(&[base([20.0, 10.0], [30.0, 20.0], 4.0)]);
        assert_eq!([height(20.0, 10.0), height(25.0, 15.0), height(30.0, 20.0)], [4.0; 3]);
        assert!((height(19.5, 15.0) - 4.0).abs() < 0.1, "{}", height(19.5, 15.0));
        assert!((height(11.0, 15.0) - 1.1).abs() < 1e-6 && (height(45.0, 15.0) - 4.5).abs() < 1e-6);
        for x in 1..118 {
            let (before, after) = (height(f64::from(x) * 0.5, 15.0), height(f64::from(x + 1) * 0.5, 15.0));
            assert!((before - after).abs() < 0.45, "{x}: no step from {before} to {after}");
        }
    }

    #[test]
    fn buildings_side_by_side_keep_their_heights() {
        let height = fitted(&[base([10.0, 10.0], [20.0, 20.0], 3.0), base([20.5, 10.0], [30.0, 20.0], 5.0)]);
        assert_eq!(
            [height(15.0, 15.0), height(20.0, 15.0), height(20.5, 15.0), height(25.0, 15.0)],
            [3.0, 3.0, 5.0, 5.0]
        );
        // Two over the same place: between them.
        let height = fitted(&[base([10.0, 10.0], [20.0, 20.0], 3.0), base([15.0, 10.0], [30.0, 20.0], 5.0)]);
        assert_eq!([height(12.0, 15.0), height(17.0, 15.0), height(25.0, 15.0)], [3.0, 4.0, 5.0]);
    }

    #[test]
    fn heights_do_not_depend_on_the_part_that_is_read() {
        let bases = [base([-5.0, 10.0], [3.0, 90.0], 1.0), base([40.0, -30.0], [900.0, 20.0], 3.5)];
        let mut whole = slope();
        fit_to_bases(&GRID, &mut whole, &bases);
        assert!(whole != slope());
        let part = MapGrid { corner: [GRID.corner[0] + 30.0, GRID.corner[1] + 5.0], size: [50, 40], ..GRID };
        let at = |heights: &[f32], i: usize| heights[(i / 50 + 10) * GRID.size[0] + i % 50 + 60];
        let mut heights: Vec<f32> = (0..50 * 40).map(|i| at(&slope(), i)).collect();
        heights[7] = f32::NAN;
        fit_to_bases(&part, &mut heights, &bases);
        assert!(heights[7].is_nan() && at(&slope(), 7).is_finite());
        assert!((0..50 * 40).filter(|i| *i != 7).all(|i| heights[i] == at(&whole, i)));
        // Far outside.
        let mut far = slope();
        fit_to_bases(&MapGrid { corner: [0.0; 2], ..GRID }, &mut far, &bases);
        assert!(far == slope());
    }
}
