//! Removes buildings and plants from a grid of lowest points.
//!
//! Progressive morphological filter of Zhang and others, "A progressive morphological filter for removing nonground
//! measurements from airborne LIDAR data", IEEE TGRS 41(4), 2003: the surface is opened (lowest, then highest height
//! around each cell) with larger and larger squares. This lowers everything that is narrower than the square. Cells that
//! are lowered further than terrain could be are not ground.

use super::super::facts::RasterSize;
use super::extremes::Extreme;

/// Largest square: wider buildings stay.
const MAX_SQUARE_M: f32 = 60.0;
/// The opening lowers terrain by at most this much for the smallest square, and for all squares together.
const MIN_STEP_M: f32 = 0.5;
const MAX_STEP_M: f32 = 3.0;
/// Steepest slope of terrain between a square and the next larger one.
const SLOPE: f32 = 0.3;
/// Single cells that are so far below all around them are errors of measurement.
const PIT_M: f32 = 2.0;

/// Sets heights that are not on the ground to NaN. `unit_m` is that of the heights.
pub(super) fn keep_ground(heights: &mut [f32], size: RasterSize, step_m: f64, unit_m: f64) {
    let (step_m, per_m) = (step_m as f32, (1.0 / unit_m) as f32);
    let mut surface = heights.to_vec();
    Extreme::Highest.of_squares(&mut surface, size, 1);
    Extreme::Lowest.of_squares(&mut surface, size, 1);
    for (height, closed) in heights.iter_mut().zip(&surface) {
        if closed - *height > PIT_M * per_m {
            *height = f32::NAN;
        }
    }
    surface.copy_from_slice(heights);
    let (mut last, mut radius) = (0, 1);
    while (2 * radius + 1) as f32 * step_m <= MAX_SQUARE_M {
        Extreme::Lowest.of_squares(&mut surface, size, radius);
        Extreme::Highest.of_squares(&mut surface, size, radius);
        let grown_m = 2.0 * (radius - last) as f32 * step_m;
        let limit = (MIN_STEP_M + SLOPE * grown_m).min(MAX_STEP_M) * per_m;
        for (height, opened) in heights.iter_mut().zip(&surface) {
            if *height - opened > limit {
                *height = f32::NAN;
            }
        }
        surface.iter_mut().zip(&*heights).for_each(|(opened, height)| {
            if !height.is_nan() {
                *opened = *height;
            }
        });
        (last, radius) = (radius, radius * 2);
    }
}
