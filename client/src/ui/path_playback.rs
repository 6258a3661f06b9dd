//! Flies along a camera path in the window (`view --path FILE --seconds N`) and measures frame times and memory.

use super::process_memory::resident_bytes;
use crate::report::FrameTimes;
use insula_viewer::camera::{Camera, CameraPath};
use std::time::{Duration, Instant};

/// How far ahead the camera's motion is prefetched, in seconds.
const LOOKAHEAD_SECS: f64 = 0.5;
/// Interval of the memory samples, in seconds.
const SAMPLE_SECS: f64 = 1.0;
/// Share of a flight that fills the caches. Memory growth is measured after it.
const WARM_UP_SHARE: f64 = 1.0 / 3.0;
/// Number of frame times that are recorded. Later ones are ignored.
const MAX_FRAME_TIMES: usize = 1_000_000;

/// Playback of a camera path.
#[derive(Debug, Clone)]
pub struct PathPlayback {
    path: CameraPath,
    /// Duration of the flight, which may be several times along the path.
    seconds: f64,
    begin: Option<Instant>,
    memory: Vec<MemorySample>,
    frame_times: Vec<Duration>,
}

#[derive(Debug, Clone, Copy)]
struct MemorySample {
    secs: f64,
    resident_bytes: u64,
}

/// Cameras of a frame of the playback.
#[derive(Debug, Clone, Copy)]
pub struct PlaybackCameras {
    pub now: Camera,
    /// Camera half a second later, for prefetching.
    pub ahead: Option<Camera>,
}

impl PathPlayback {
    /// Repeats `path` until `seconds` have passed, or plays it once without.
    pub fn new(path: CameraPath, seconds: Option<f64>) -> Self {
        let seconds = seconds.unwrap_or(path.seconds);
        Self { path, seconds, begin: None, memory: Vec::new(), frame_times: Vec::new() }
    }

    /// The cameras at `now`; `None` after the end. The flight begins with the first call.
    pub fn cameras(&mut self, now: Instant) -> Option<PlaybackCameras> {
        let begin = *self.begin.get_or_insert(now);
        let secs = now.duration_since(begin).as_secs_f64();
        if secs >= self.seconds {
            return None;
        }
        if self.memory.last().is_none_or(|last| secs - last.secs >= SAMPLE_SECS)
            && let Some(resident_bytes) = resident_bytes()
        {
            self.memory.push(MemorySample { secs, resident_bytes });
        }
        let camera_at = |secs: f64| self.path.camera_at(secs % self.path.seconds);
        Some(PlaybackCameras { now: camera_at(secs)?, ahead: camera_at(secs + LOOKAHEAD_SECS) })
    }

    /// Records how long a frame took.
    pub fn record_frame_time(&mut self, time: Duration) {
        if self.frame_times.len() < MAX_FRAME_TIMES {
            self.frame_times.push(time);
        }
    }

    /// Frame times and memory use in one line.
    pub fn summary(&self) -> String {
        let frames = FrameTimes::new(&self.frame_times);
        let mut text = format!(
            "flew {:.0} s: {} frames, median {:.1} ms, p95 {:.1} ms, max {:.1} ms",
            self.seconds, frames.count, frames.median_ms, frames.p95_ms, frames.max_ms
        );
        let mib = |bytes: u64| bytes as f64 / f64::from(1u32 << 20);
        let warm = self.memory.partition_point(|sample| sample.secs < self.seconds * WARM_UP_SHARE);
        let bytes: Vec<u64> = self.memory[warm..].iter().map(|sample| sample.resident_bytes).collect();
        if let (Some(first), Some(last), Some(peak)) = (bytes.first(), bytes.last(), bytes.iter().max()) {
            text += &format!(
                "; resident memory {:.1} MiB after a third, {:.1} MiB at the end, at most {:.1} MiB",
                mib(*first),
                mib(*last),
                mib(*peak)
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_the_path_until_its_seconds_have_passed() {
        let text = r#"{"seconds":2,"keys":[{"t":0,"position":[0,0,0],"target":[0,1,0]},{"t":2,"position":[8,0,0],"target":[8,1,0]}]}"#;
        let mut playback = PathPlayback::new(serde_json::from_str(text).unwrap(), Some(5.0));
        let begin = Instant::now();
        let x = |playback: &mut PathPlayback, secs: f64| {
            playback.cameras(begin + Duration::from_secs_f64(secs)).map(|cameras| cameras.now.position.x)
        };
        let found = [x(&mut playback, 0.0), x(&mut playback, 1.0), x(&mut playback, 3.0)];
        assert_eq!(found, [Some(0.0), Some(4.0), Some(4.0)]);
        playback.record_frame_time(Duration::from_millis(7));
        assert_eq!(x(&mut playback, 5.0), None);
        assert!(playback.summary().starts_with("flew 5 s: 1 frames, median 7.0 ms"), "{}", playback.summary());
    }
}
