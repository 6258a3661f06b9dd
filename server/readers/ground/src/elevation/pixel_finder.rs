//! From the world to the pixels of a raster: the inverse of its placement.

use crate::raster::GeoPlace;
use insula_place::placement::Placement;
use std::array;

/// Steps of Newton's method. From the middle of a raster two or three are enough: placements are nearly linear.
const MAX_STEPS: u32 = 12;
/// Error of a found place, in pixels.
const TOLERANCE_PX: f64 = 1e-4;

/// Finds pixels by the forward placement alone, so that every coordinate system has its inverse.
#[derive(Clone, Copy)]
pub(super) struct PixelFinder<'a> {
    pub(super) place: GeoPlace,
    pub(super) placement: &'a Placement,
}

impl PixelFinder<'_> {
    /// World position of a place among the pixels, with the height `z` of the raster.
    pub(super) fn world(&self, [x, y]: [f64; 2], z: f64) -> Option<[f64; 3]> {
        let [east, north] = self.place.position(x, y);
        self.placement.position([east, north, z])
    }

    /// The place among the pixels of a position on the map, sought from `start`. `None` if the placement fails near it.
    pub(super) fn pixel(&self, world: [f64; 2], start: [f64; 2]) -> Option<[f64; 2]> {
        let mut pixel = start;
        for _ in 0..MAX_STEPS {
            let found = self.world(pixel, 0.0)?;
            let rest: [f64; 2] = array::from_fn(|axis| world[axis] - found[axis]);
            let [column, row] = self.derivatives(pixel)?;
            let area = column[0] * row[1] - column[1] * row[0];
            let step =
                [(rest[0] * row[1] - rest[1] * row[0]) / area, (column[0] * rest[1] - column[1] * rest[0]) / area];
            if !step.iter().all(|step| step.is_finite()) {
                return None;
            }
            pixel = [pixel[0] + step[0], pixel[1] + step[1]];
            if step.iter().all(|step| step.abs() < TOLERANCE_PX) {
                return Some(pixel);
            }
        }
        None
    }

    /// Metres on the map from a pixel to the next column, and to the next row.
    pub(super) fn derivatives(&self, [x, y]: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        let along = |dx: f64, dy: f64| {
            let (low, high) = (self.world([x - dx, y - dy], 0.0)?, self.world([x + dx, y + dy], 0.0)?);
            Some([high[0] - low[0], high[1] - low[1]])
        };
        Some([along(0.5, 0.0)?, along(0.0, 0.5)?])
    }
}
