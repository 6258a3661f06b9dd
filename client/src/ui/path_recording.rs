//! Records the camera's motion as a path file for `insula fly`.

use insula_viewer::camera::{Camera, CameraPath, PathKey};
use std::time::{Duration, Instant};

/// Interval between two keys. The straight lines between them are not noticeable.
const KEY_INTERVAL: Duration = Duration::from_millis(100);
/// Shortest path: of two presses within one slow frame.
const MIN_SECS: f64 = 0.1;
/// Largest number of keys: an hour of flying.
const MAX_KEYS: usize = 36_000;
/// Distance from the camera to a key's target, in metres.
const TARGET_DISTANCE_M: f64 = 100.0;

/// A recording in progress.
#[derive(Debug, Clone)]
pub struct PathRecorder {
    begin: Instant,
    fov_y_deg: f64,
    keys: Vec<PathKey>,
}

impl PathRecorder {
    /// Starts a recording at `camera`.
    pub fn new(now: Instant, camera: &Camera) -> Self {
        let mut recorder = Self { begin: now, fov_y_deg: camera.fov_y_rad.to_degrees(), keys: Vec::new() };
        recorder.push(0.0, camera);
        recorder
    }

    /// Records `camera` if a key is due. Returns whether another key would fit.
    pub fn sample(&mut self, now: Instant, camera: &Camera) -> bool {
        let t = self.secs(now);
        if self.keys.last().is_none_or(|last| t - last.t >= KEY_INTERVAL.as_secs_f64()) {
            self.push(t, camera);
        }
        self.keys.len() < MAX_KEYS
    }

    /// Seconds since the start.
    pub fn secs(&self, now: Instant) -> f64 {
        now.duration_since(self.begin).as_secs_f64()
    }

    fn push(&mut self, t: f64, camera: &Camera) {
        let position = camera.position.to_array();
        let target = (camera.position + camera.forward * TARGET_DISTANCE_M).to_array();
        // Two keys are enough while the camera stands still.
        if let [.., before, last] = &mut self.keys[..]
            && [before.position, last.position] == [position; 2]
            && [before.target, last.target] == [target; 2]
        {
            last.t = t;
            return;
        }
        self.keys.push(PathKey { t, position, target });
    }

    /// Ends the recording at `camera`.
    pub fn finish(mut self, now: Instant, camera: &Camera) -> CameraPath {
        let last = self.keys.last().map_or(0.0, |key| key.t);
        let seconds = self.secs(now).max(last + 0.001).max(MIN_SECS);
        self.push(seconds, camera);
        CameraPath { seconds, keys: self.keys, fov_y_deg: self.fov_y_deg }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_files::{read_path, write_new};
    use glam::DVec3;

    #[test]
    fn a_path_between_two_quick_presses_is_not_in_an_instant() {
        let (now, camera) = (Instant::now(), |x| Camera::from_angles(DVec3::new(x, 0.0, 9.0), 0.2, -0.3, 1.0));
        let path = PathRecorder::new(now, &camera(0.0)).finish(now, &camera(3.0));
        assert_eq!((path.seconds, path.keys.len()), (MIN_SECS, 2));
        assert!(path.keys[1].t - path.keys[0].t >= MIN_SECS);
    }

    #[test]
    fn a_recorded_path_replays_the_flight() {
        let begin = Instant::now();
        let camera = |t: f64| {
            let moving = t.clamp(1.0, 5.0);
            Camera::from_angles(DVec3::new(40.0 * moving, -3.0, 50.0), 0.2 * moving, -0.3, 1.0)
        };
        let mut recorder = PathRecorder::new(begin, &camera(0.0));
        for frame in 1..420 {
            let t = f64::from(frame) / 60.0;
            assert!(recorder.sample(begin + Duration::from_secs_f64(t), &camera(t)));
        }
        let path = recorder.finish(begin + Duration::from_secs(7), &camera(7.0));
        assert!(path.keys.len() < 50, "{} keys, though a resting camera needs only two", path.keys.len());
        let folder = tempfile::tempdir().unwrap();
        let write = || write_new(&path, folder.path(), "insula-path").unwrap();
        let (file, other) = (write(), write());
        assert_ne!(file, other);
        let path = read_path(&file).unwrap();
        for t in [0.0, 0.5, 1.05, 2.22, 4.99, 6.0, 7.0] {
            let (flown, replayed) = (camera(t), path.camera_at(t).unwrap());
            assert!((flown.position - replayed.position).length() < 1.0, "{t}: {flown:?} {replayed:?}");
            assert!((flown.forward - replayed.forward).length() < 0.01, "{t}: {flown:?} {replayed:?}");
        }
    }
}
