//! The ground where no elevation model tells its height, for what is painted on it: as high as the buildings around stand, and level
//! at 0 where none has a height of its own.

use crate::relax::{Bounds, smooth_field};
use insula_dress::building_base::BuildingBase;
use insula_dress::map_store::MapBounds;

/// Distance of heights at least, and most of them along a side.
const MIN_STEP_M: f64 = 16.0;
const MAX_STEPS: f64 = 512.0;
/// Distance of heights that are all 0.
const LEVEL_STEP_M: f64 = 64.0;

/// Heights of a city's ground, smooth between the buildings, and level beyond.
pub struct LevelGround {
    /// Number of the report that counts it.
    pub(super) source: usize,
    pub(super) step_m: f64,
    corner: [f64; 2],
    size: [usize; 2],
    /// By row; empty while the ground is level at 0.
    heights: Vec<f32>,
    /// Sum of heights of bases near each point, and their number.
    sums: Vec<[f64; 2]>,
}

impl LevelGround {
    /// Level ground at 0 of a city with these bounds.
    pub fn new(source: usize, [low, high]: MapBounds) -> Self {
        let extent_m = (high[0] - low[0]).max(high[1] - low[1]);
        let step_m = MIN_STEP_M.max(extent_m / MAX_STEPS);
        let size = [0, 1].map(|axis| ((high[axis] - low[axis]) / step_m).ceil() as usize + 1);
        Self { source, step_m, corner: low, size, heights: Vec::new(), sums: Vec::new() }
    }

    /// Takes note of what a building stands on.
    pub fn add(&mut self, base: &BuildingBase) {
        self.sums.resize(self.size[0] * self.size[1], [0.0; 2]);
        for corner in base.triangles.iter().flat_map(|triangle| base.on_map(triangle)) {
            let [x, y] = [0, 1].map(|axis| {
                let along = ((corner[axis] - self.corner[axis]) / self.step_m).round().max(0.0) as usize;
                along.min(self.size[axis] - 1)
            });
            let [sum, count] = &mut self.sums[y * self.size[0] + x];
            (*sum, *count) = (*sum + base.height_m, *count + 1.0);
        }
    }

    /// The ground, after the last building.
    pub fn finished(mut self) -> Self {
        let sums = std::mem::take(&mut self.sums);
        if sums.is_empty() {
            self.step_m = LEVEL_STEP_M;
            return self;
        }
        let mut bounds = Bounds::unknown(self.size);
        for (i, [sum, count]) in sums.into_iter().enumerate().filter(|(_, [_, count])| *count > 0.0) {
            let mean = (sum / count) as f32;
            (bounds.low[i], bounds.high[i]) = (mean, mean);
        }
        self.heights = smooth_field(&bounds);
        self
    }

    /// Whether all of it has the height 0.
    pub(super) fn is_level(&self) -> bool {
        self.heights.is_empty()
    }

    /// World height at a position on the map.
    pub(super) fn height_m(&self, position: [f64; 2]) -> f32 {
        if self.is_level() {
            return 0.0;
        }
        let along = |axis: usize| {
            let steps = (position[axis] - self.corner[axis]) / self.step_m;
            let steps = steps.clamp(0.0, (self.size[axis] - 1) as f64);
            let first = (steps.floor() as usize).min(self.size[axis].saturating_sub(2));
            (first, (first + 1).min(self.size[axis] - 1), (steps - first as f64) as f32)
        };
        let ((west, east, x), (south, north, y)) = (along(0), along(1));
        let at = |column: usize, row: usize| self.heights[row * self.size[0] + column];
        let low = at(west, south) + (at(east, south) - at(west, south)) * x;
        let high = at(west, north) + (at(east, north) - at(west, north)) * x;
        low + (high - low) * y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn base(corner: [f64; 2], height_m: f64) -> BuildingBase {
        BuildingBase { height_m, corner, triangles: vec![[[0.0, 0.0], [8.0, 0.0], [8.0, 8.0]]] }
    }

    #[test]
    fn ground_is_level_without_buildings_and_passes_through_those_that_have_heights() {
        let bounds = [[1000.0, 2000.0], [1400.0, 2200.0]];
        let level = LevelGround::new(0, bounds).finished();
        assert_eq!((level.is_level(), level.height_m([1100.0, 2050.0])), (true, 0.0));
        let mut ground = LevelGround::new(0, bounds);
        ground.add(&base([1016.0, 2032.0], 40.0));
        ground.add(&base([1336.0, 2032.0], 60.0));
        let ground = ground.finished();
        assert!(!ground.is_level());
        let [west, middle, east] = [1016.0, 1180.0, 1336.0].map(|x| ground.height_m([x, 2032.0]));
        assert!((west - 40.0).abs() < 1.0 && (east - 60.0).abs() < 1.0, "{west} {east}");
        assert!((42.0..58.0).contains(&middle), "{middle}");
        assert!((39.0..61.0).contains(&ground.height_m([-1e6, 1e6])), "beyond");
    }
}
