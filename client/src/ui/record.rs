//! Records where the camera goes, as a path that `insula fly` replays.
//!
//! In: cameras and their times. Out: [`CameraPath`], a file. Next: `commands::fly`.

use crate::error::{ClientError, Result};
use insula_viewer::camera::{Camera, CameraPath, PathKey};
use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// Between two keys; straight lines in between are not seen.
const EVERY: Duration = Duration::from_millis(100);
/// Most keys: an hour of flying.
const MOST: usize = 36_000;
/// A target is so far ahead.
const AHEAD_M: f64 = 100.0;

/// A recording under way.
#[derive(Debug, Clone)]
pub struct Recorder {
    begin: Instant,
    fov_y_deg: f64,
    keys: Vec<PathKey>,
}

impl Recorder {
    /// Begins with `camera`.
    pub fn new(now: Instant, camera: &Camera) -> Self {
        let mut recorder = Self { begin: now, fov_y_deg: camera.fov_y_rad.to_degrees(), keys: Vec::new() };
        recorder.push(0.0, camera);
        recorder
    }

    /// Takes a camera in, if it is time; returns whether there is room for more.
    pub fn sample(&mut self, now: Instant, camera: &Camera) -> bool {
        let t = now.duration_since(self.begin).as_secs_f64();
        if self.keys.last().is_none_or(|last| t - last.t >= EVERY.as_secs_f64()) {
            self.push(t, camera);
        }
        self.keys.len() < MOST
    }

    /// Seconds since it began.
    pub fn secs(&self, now: Instant) -> f64 {
        now.duration_since(self.begin).as_secs_f64()
    }

    fn push(&mut self, t: f64, camera: &Camera) {
        let position = camera.position.to_array();
        let target = (camera.position + camera.forward * AHEAD_M).to_array();
        // A camera that stands still needs two keys, however long.
        if let [.., before, last] = &mut self.keys[..]
            && [before.position, last.position] == [position; 2]
            && [before.target, last.target] == [target; 2]
        {
            last.t = t;
            return;
        }
        self.keys.push(PathKey { t, position, target });
    }

    /// The path, ending with `camera`.
    pub fn finish(mut self, now: Instant, camera: &Camera) -> CameraPath {
        let last = self.keys.last().map_or(0.0, |key| key.t);
        let seconds = self.secs(now).max(last + 0.001);
        self.push(seconds, camera);
        CameraPath { seconds, keys: self.keys, fov_y_deg: self.fov_y_deg }
    }
}

/// Writes a path into `folder` under the first free number.
pub fn write(path: &CameraPath, folder: &Path) -> Result<PathBuf> {
    let json = serde_json::to_string(path).map_err(|e| ClientError::Failed(format!("the path: {e}")))?;
    let file = free(folder, "insula-path", "json");
    let part = file.with_extension("json.part");
    std::fs::write(&part, json + "\n").map_err(ClientError::file(&part))?;
    std::fs::rename(&part, &file).map_err(ClientError::file(&file))?;
    Ok(file)
}

/// The first of `stem-0001.end`, `stem-0002.end`, ... that does not exist yet.
pub fn free(folder: &Path, stem: &str, end: &str) -> PathBuf {
    let name = |n: u32| folder.join(format!("{stem}-{n:04}.{end}"));
    (1..10_000).map(name).find(|path| !path.exists()).unwrap_or_else(|| name(10_000))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_files::read_path;
    use glam::DVec3;

    #[test]
    fn a_recorded_flight_is_replayed() {
        let begin = Instant::now();
        let camera = |t: f64| {
            let still = t.clamp(1.0, 5.0);
            Camera::from_angles(DVec3::new(40.0 * still, -3.0, 50.0), 0.2 * still, -0.3, 1.0)
        };
        let mut recorder = Recorder::new(begin, &camera(0.0));
        for frame in 1..420 {
            let t = f64::from(frame) / 60.0;
            assert!(recorder.sample(begin + Duration::from_secs_f64(t), &camera(t)));
        }
        let path = recorder.finish(begin + Duration::from_secs(7), &camera(7.0));
        assert!(path.keys.len() < 50, "{} keys: standing still costs nothing", path.keys.len());
        let folder = std::env::temp_dir().join(format!("insula-record-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (file, other) = (write(&path, &folder).unwrap(), write(&path, &folder).unwrap());
        assert_ne!(file, other);
        let path = read_path(&file).unwrap();
        std::fs::remove_dir_all(folder).unwrap();
        for t in [0.0, 0.5, 1.05, 2.22, 4.99, 6.0, 7.0] {
            let (flown, replayed) = (camera(t), path.camera_at(t).unwrap());
            assert!((flown.position - replayed.position).length() < 1.0, "{t}: {flown:?} {replayed:?}");
            assert!((flown.forward - replayed.forward).length() < 0.01, "{t}: {flown:?} {replayed:?}");
        }
    }
}
