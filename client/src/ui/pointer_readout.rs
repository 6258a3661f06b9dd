//! Coordinates of the surface under the pointer, and the scale there.

use glam::DVec3;
use insula_protocol::text::{fixed, printable};
use insula_viewer::camera::{Camera, View};
use std::time::{Duration, Instant};

/// Shortest interval between two samples: a ray on a GPU waits for the frame before it.
const INTERVAL: Duration = Duration::from_millis(80);
/// Longest CRS that is shown, in characters.
const MAX_CRS: usize = 24;

/// Where a ray is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SamplePlace {
    /// Shares of the window's width and height.
    at: [f64; 2],
    camera: Camera,
}

/// The readout and its last sample.
#[derive(Debug, Clone, Default)]
pub struct PointerReadout {
    /// Shares of the window's width and height; `None` outside of the window.
    pointer: Option<[f64; 2]>,
    sampled: Option<(SamplePlace, Instant)>,
    /// The surface that was sampled; `None` for the sky.
    surface: Option<DVec3>,
    /// Metres that a pixel covers there.
    metres_per_px: Option<f64>,
}

impl PointerReadout {
    /// The pointer moved to shares of the window's width and height, or left the window.
    pub fn pointer_moved(&mut self, pointer: Option<[f64; 2]>) {
        self.pointer = pointer.filter(|at| at.iter().all(|share| (0.0..=1.0).contains(share)));
    }

    /// Whether the pointer is in the window. Without one, the middle of the window is sampled.
    pub fn has_pointer(&self) -> bool {
        self.pointer.is_some()
    }

    fn place(&self, camera: &Camera) -> SamplePlace {
        SamplePlace { at: self.pointer.unwrap_or([0.5; 2]), camera: *camera }
    }

    /// Shares of the window's width and height to sample, if a sample is due.
    pub fn due(&self, camera: &Camera, now: Instant) -> Option<[f64; 2]> {
        self.due_at(camera, now).filter(|at| *at <= now).map(|_| self.place(camera).at)
    }

    /// When the next sample is due; `None` if the last one is still right.
    pub fn due_at(&self, camera: &Camera, now: Instant) -> Option<Instant> {
        match self.sampled {
            None => Some(now),
            Some((place, at)) => (place != self.place(camera)).then(|| at + INTERVAL),
        }
    }

    /// Takes the sample that was due in `view`: the surface, or `None` for the sky.
    pub fn sample(&mut self, view: &View, surface: Option<DVec3>, now: Instant) {
        self.sampled = Some((self.place(&view.camera), now));
        let depth_m = surface.map(|p| (p - view.camera.position).dot(view.camera.forward));
        self.metres_per_px = depth_m.filter(|depth_m| *depth_m > 0.0).map(|depth_m| depth_m / view.focal_px());
        self.surface = surface;
    }

    /// Metres that a pixel covers at the sampled surface; `None` for the sky.
    pub fn metres_per_px(&self) -> Option<f64> {
        self.metres_per_px
    }

    /// Coordinates under the pointer with their CRS; `None` without a pointer.
    pub fn text(&self, crs: Option<&str>) -> Option<String> {
        self.pointer?;
        let (Some(p), Some(metres_per_px)) = (self.surface, self.metres_per_px) else { return Some("sky".to_owned()) };
        // A digit that is smaller than a pixel says nothing.
        let decimals = if metres_per_px < 0.5 { 1 } else { 0 };
        let crs = crs.map_or_else(|| "local metres".into(), printable);
        let crs: String = crs.chars().take(MAX_CRS).collect();
        let [x, y, z] = p.to_array().map(|v| fixed(v, decimals));
        Some(format!("E {x}  N {y}  height {z} m  ({crs})"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> View {
        let camera = Camera::look_at(DVec3::Z * 100.0, DVec3::ZERO, DVec3::Y, 1.0).unwrap();
        View::of(camera, [800, 400])
    }

    #[test]
    fn samples_are_taken_when_pointer_or_camera_move_but_not_too_often() {
        let (mut readout, view, begin) = (PointerReadout::default(), view(), Instant::now());
        assert_eq!(readout.due(&view.camera, begin), Some([0.5; 2]));
        readout.sample(&view, Some(DVec3::ZERO), begin);
        assert_eq!(readout.due_at(&view.camera, begin), None);
        readout.pointer_moved(Some([0.1, 0.2]));
        assert_eq!(
            (readout.due(&view.camera, begin), readout.due_at(&view.camera, begin)),
            (None, Some(begin + INTERVAL))
        );
        assert_eq!(readout.due(&view.camera, begin + INTERVAL), Some([0.1, 0.2]));
        readout.sample(&view, None, begin + INTERVAL);
        let moved = Camera { position: DVec3::ONE, ..view.camera };
        assert_eq!(readout.due(&moved, begin + 2 * INTERVAL), Some([0.1, 0.2]));
        readout.pointer_moved(Some([1.5, 0.2]));
        assert!(!readout.has_pointer());
    }

    #[test]
    fn coordinates_have_no_more_digits_than_the_pixels() {
        let (mut readout, view, now) = (PointerReadout::default(), view(), Instant::now());
        let point = DVec3::new(84_498.26, 447_540.04, 12.34);
        readout.sample(&view, Some(point), now);
        assert_eq!(readout.text(Some("EPSG:7415")), None, "there is no pointer");
        readout.pointer_moved(Some([0.5; 2]));
        assert_eq!(readout.text(Some("EPSG:7415")).unwrap(), "E 84498.3  N 447540.0  height 12.3 m  (EPSG:7415)");
        let far = View { camera: Camera { position: DVec3::Z * 9000.0, ..view.camera }, ..view };
        readout.sample(&far, Some(point), now);
        assert_eq!(readout.text(None).unwrap(), "E 84498  N 447540  height 12 m  (local metres)");
        readout.sample(&far, Some(DVec3::splat(-0.04)), now);
        assert_eq!(readout.text(None).unwrap(), "E 0  N 0  height 0 m  (local metres)");
        assert!(readout.text(Some(&"\u{1b}x".repeat(99))).unwrap().len() < 99);
        readout.sample(&view, None, now);
        assert_eq!((readout.text(None).unwrap().as_str(), readout.metres_per_px()), ("sky", None));
    }

    #[test]
    fn the_scale_is_that_of_the_surface() {
        let (mut readout, view) = (PointerReadout::default(), view());
        readout.sample(&view, Some(DVec3::new(7.0, 8.0, 50.0)), Instant::now());
        assert!((readout.metres_per_px().unwrap() - 50.0 / view.focal_px()).abs() < 1e-12);
    }
}
