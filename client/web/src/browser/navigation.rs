//! Flights of the camera to another view.

use glam::{DVec3, Vec3Swizzles};
use insula_viewer::camera::Camera;
use std::time::Duration;
use web_time::Instant;

const MAX_SECS: f64 = 60.0;

/// A flight between two cameras that begins and ends slowly.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CameraFlight {
    from: Camera,
    to: Camera,
    begin: Instant,
    duration: Duration,
}

impl CameraFlight {
    pub(crate) fn new(from: Camera, to: Camera, seconds: f64, begin: Instant) -> Self {
        let duration = Duration::try_from_secs_f64(seconds.clamp(0.0, MAX_SECS)).unwrap_or_default();
        Self { from, to, begin, duration }
    }

    /// The camera at a time, and whether it has arrived.
    pub(crate) fn camera_at(&self, now: Instant) -> (Camera, bool) {
        let secs = now.saturating_duration_since(self.begin).as_secs_f64();
        let share = secs / self.duration.as_secs_f64();
        if share.is_nan() || share >= 1.0 {
            return (self.to, true);
        }
        let t = share * share * (3.0 - 2.0 * share);
        let (from, to) = (self.from.angles(), self.to.angles());
        let turn = (to.0 - from.0).sin().atan2((to.0 - from.0).cos());
        // Far flights rise on their way, so that they do not pass through what stands between.
        let way = self.to.position - self.from.position;
        let rise = DVec3::Z * way.xy().length() * 0.25 * (std::f64::consts::PI * t).sin();
        let position = self.from.position + way * t + rise;
        let fov = self.from.fov_y_rad + (self.to.fov_y_rad - self.from.fov_y_rad) * t;
        (Camera::from_angles(position, from.0 + turn * t, from.1 + (to.1 - from.1) * t, fov), false)
    }
}
