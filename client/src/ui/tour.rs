//! A flight along a path in the window, for so many seconds, with the memory that it takes.
//!
//! In: `view --path FILE --seconds N`. Out: cameras; a line of figures at the end. Next: `city`, standard output.

use crate::report::FrameTimes;
use insula_viewer::camera::{Camera, CameraPath};
use std::time::{Duration, Instant};

/// Seconds that the camera's heading looks ahead.
const AHEAD_SECS: f64 = 0.5;
/// The first part of a flight fills caches; growth is what comes after it.
const WARM_SHARE: f64 = 1.0 / 3.0;
/// Frame times that are kept.
const TIMES: usize = 1_000_000;

/// A flight that flies itself.
#[derive(Debug, Clone)]
pub struct Tour {
    path: CameraPath,
    seconds: f64,
    begin: Option<Instant>,
    /// Seconds and bytes, a sample a second.
    memory: Vec<(f64, u64)>,
    times: Vec<Duration>,
}

impl Tour {
    /// Along `path`, over and over until `seconds` have passed; once without.
    pub fn new(path: CameraPath, seconds: Option<f64>) -> Self {
        let seconds = seconds.unwrap_or(path.seconds);
        Self { path, seconds, begin: None, memory: Vec::new(), times: Vec::new() }
    }

    /// Where it is now and in a moment; `None` at the end. It begins with the first call.
    pub fn cameras(&mut self, now: Instant) -> Option<(Camera, Option<Camera>)> {
        let begin = *self.begin.get_or_insert(now);
        let t = now.duration_since(begin).as_secs_f64();
        if t >= self.seconds {
            return None;
        }
        if self.memory.last().is_none_or(|(at, _)| t - at >= 1.0)
            && let Some(bytes) = resident_bytes()
        {
            self.memory.push((t, bytes));
        }
        let at = |t: f64| self.path.camera_at(t % self.path.seconds);
        Some((at(t)?, at(t + AHEAD_SECS)))
    }

    /// Notes how long a frame took.
    pub fn timed(&mut self, time: Duration) {
        if self.times.len() < TIMES {
            self.times.push(time);
        }
    }

    /// What it came to.
    pub fn summary(&self) -> String {
        let frames = FrameTimes::new(&self.times);
        let mut text = format!(
            "flew {:.0} s: {} frames, median {:.1} ms, p95 {:.1} ms, max {:.1} ms",
            self.seconds, frames.count, frames.median_ms, frames.p95_ms, frames.max_ms
        );
        let mib = |bytes: u64| bytes as f64 / f64::from(1u32 << 20);
        let warm = self.memory.partition_point(|(at, _)| *at < self.seconds * WARM_SHARE);
        let later = &self.memory[warm..];
        if let (Some((_, first)), Some((_, last))) = (later.first(), later.last()) {
            let most = later.iter().map(|(_, bytes)| *bytes).max().unwrap_or(0);
            text += &format!(
                "; resident memory {:.1} MiB after a third, {:.1} MiB at the end, at most {:.1} MiB",
                mib(*first),
                mib(*last),
                mib(most)
            );
        }
        text
    }
}

/// Memory of this process that lies in RAM, where the system tells (Linux).
pub fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_flies_round_and_ends() {
        let text = r#"{"seconds":2,"keys":[{"t":0,"position":[0,0,0],"target":[0,1,0]},{"t":2,"position":[8,0,0],"target":[8,1,0]}]}"#;
        let mut tour = Tour::new(serde_json::from_str(text).unwrap(), Some(5.0));
        let begin = Instant::now();
        let x = |tour: &mut Tour, secs: f64| {
            tour.cameras(begin + Duration::from_secs_f64(secs)).map(|(camera, _)| camera.position.x)
        };
        assert_eq!([x(&mut tour, 0.0), x(&mut tour, 1.0), x(&mut tour, 3.0)], [Some(0.0), Some(4.0), Some(4.0)]);
        tour.timed(Duration::from_millis(7));
        assert_eq!(x(&mut tour, 5.0), None);
        assert!(tour.summary().starts_with("flew 5 s: 1 frames, median 7.0 ms"), "{}", tour.summary());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn memory_that_is_used_counts() {
        let before = resident_bytes().unwrap();
        let used = std::hint::black_box(vec![1u8; 64 << 20]);
        assert!(resident_bytes().unwrap() > before + (32 << 20));
        drop(used);
    }
}
