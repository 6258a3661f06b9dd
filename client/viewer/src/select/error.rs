//! How wrong a node looks from a point (design 4; Vacca 2008, 3.6.2).
//!
//! In: error and sphere of a node, the eye. Out: pixels. Next: `priority`.

use glam::DVec3;

/// Projected error in pixels of a node of world error `error_m` and sphere (`centre`, `radius_m`).
///
/// `focal_px` is `height_px / (2 tan(fov_y / 2))`. A child whose sphere lies in its parent's and whose error is not larger
/// never gets a larger result than its parent: the cut is monotone.
pub fn error_px(error_m: f64, centre: DVec3, radius_m: f64, eye: DVec3, focal_px: f64, near_m: f64) -> f64 {
    error_m * focal_px / ((eye - centre).length() - radius_m).max(near_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn falls_with_distance_and_is_bounded_near_by() {
        let at = |x: f64| error_px(0.5, DVec3::ZERO, 10.0, DVec3::new(x, 0.0, 0.0), 540.0, 1.0);
        assert_eq!(at(110.0), 0.5 * 540.0 / 100.0);
        assert_eq!(at(3.0), 0.5 * 540.0);
        assert!(at(50.0) > at(60.0));
    }

    #[test]
    fn nested_spheres_give_nested_errors() {
        let parent = (DVec3::ZERO, 20.0, 1.0);
        for i in 0..200 {
            let a = f64::from(i);
            let centre = DVec3::new(a.sin(), a.cos(), 0.3) * 8.0;
            let child = (centre, 20.0 - centre.length(), 0.6);
            let eye = DVec3::new((a * 1.7).cos(), (a * 0.3).sin(), (a * 0.9).sin()) * (a * 0.5);
            let of = |(c, r, e): (DVec3, f64, f64)| error_px(e, c, r, eye, 500.0, 1.0);
            assert!(of(child) <= of(parent));
        }
    }
}
