//! Screen-space error: by how many pixels a node may be drawn wrong (Vacca 2008, section 3.6.2).

use crate::camera::View;
use glam::DVec3;

/// Smallest distance at which an error is measured, in metres.
pub(super) const MIN_DISTANCE_M: f64 = 1.0;

/// Projects world-space errors to pixels, for one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorMetric {
    pub eye: DVec3,
    /// Pixels that a metre covers at a distance of one metre: `height_px / (2 tan(fov_y / 2))`.
    pub focal_px: f64,
}

impl ErrorMetric {
    /// The metric of a view.
    pub fn new(view: &View) -> Self {
        Self { eye: view.camera.position, focal_px: view.focal_px() }
    }

    /// Screen-space error in pixels of a node with world-space error `error_m` and bounding sphere (`centre`, `radius_m`).
    ///
    /// A child whose sphere lies inside its parent's and whose error is not larger never gets a larger result than its parent.
    pub fn error_px(&self, error_m: f64, centre: DVec3, radius_m: f64) -> f64 {
        error_m * self.focal_px / ((self.eye - centre).length() - radius_m).max(MIN_DISTANCE_M)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_falls_with_distance_and_is_bounded_near_the_eye() {
        let at =
            |x: f64| ErrorMetric { eye: DVec3::new(x, 0.0, 0.0), focal_px: 540.0 }.error_px(0.5, DVec3::ZERO, 10.0);
        assert_eq!(at(110.0), 0.5 * 540.0 / 100.0);
        assert_eq!(at(3.0), 0.5 * 540.0);
        assert!(at(50.0) > at(60.0));
    }

    #[test]
    fn nested_spheres_have_nested_errors() {
        for i in 0..200 {
            let a = f64::from(i);
            let centre = DVec3::new(a.sin(), a.cos(), 0.3) * 8.0;
            let eye = DVec3::new((a * 1.7).cos(), (a * 0.3).sin(), (a * 0.9).sin()) * (a * 0.5);
            let metric = ErrorMetric { eye, focal_px: 500.0 };
            let child = metric.error_px(0.6, centre, 20.0 - centre.length());
            assert!(child <= metric.error_px(1.0, DVec3::ZERO, 20.0));
        }
    }
}
