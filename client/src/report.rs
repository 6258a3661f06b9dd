//! What a run cost, as JSON for scripts.
//!
//! In: counters and times of a `session`. Out: [`Report`]. Next: a file, or standard output.

use crate::{
    error::{ClientError, Result},
    render::AdapterInfo,
};
use insula_shaders::cpu::raycast::Pixels;
use insula_viewer::streamer::TileCounts;
use serde::Serialize;
use std::{path::Path, time::Duration};

/// Times of all frames, in milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FrameTimes {
    /// How many.
    pub count: usize,
    /// Half were faster.
    pub median_ms: f64,
    /// 95 in 100 were faster.
    pub p95_ms: f64,
    /// 99 in 100 were faster.
    pub p99_ms: f64,
    /// The slowest.
    pub max_ms: f64,
}

impl FrameTimes {
    /// Of times in any order.
    pub fn new(times: &[Duration]) -> Self {
        let mut ms: Vec<f64> = times.iter().map(|t| t.as_secs_f64() * 1e3).collect();
        ms.sort_by(f64::total_cmp);
        let at = |share: f64| ms.get(((ms.len() as f64 * share).ceil() as usize).max(1) - 1).copied().unwrap_or(0.0);
        Self { count: ms.len(), median_ms: at(0.5), p95_ms: at(0.95), p99_ms: at(0.99), max_ms: at(1.0) }
    }
}

/// A run's report. Lengths of time in seconds unless the name says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Which city, at which version.
    pub city: String,
    /// The manifest's.
    pub version: String,
    /// Bodies of all answers.
    pub bytes_fetched: u64,
    /// Requests sent.
    pub requests: u64,
    /// Tiles that arrived.
    pub tiles: TileCounts,
    /// Selection, upload and drawing of each frame.
    pub frame_times: FrameTimes,
    /// From the start (connecting included) until the first picture was drawn that shows anything of the city: all of it
    /// that is in view, as there is never a hole.
    pub time_to_first_picture_secs: Option<f64>,
    /// From the start until a picture was drawn whose errors, where a ray hit, are at most four times tau.
    pub time_to_near_picture_secs: Option<f64>,
    /// From the start to the first frame that nothing could make better.
    pub time_to_converged_picture_secs: Option<f64>,
    /// Most bytes in the cache.
    pub peak_cache_bytes: u64,
    /// The cache's size.
    pub cache_bytes: u64,
    /// What drew.
    pub adapter: AdapterInfo,
    /// Asked for.
    pub tau_px: f64,
    /// What it rose to in the last frame, for want of cache.
    pub tau_reached_px: f64,
    /// Largest projected error in the last frame.
    pub worst_error_px: f64,
    /// Nodes in the last frame's cut.
    pub nodes_drawn: u32,
    /// Those of them that were drawn as meshes.
    pub meshes_drawn: u32,
    /// Triangles of those.
    pub triangles_drawn: u64,
    /// Share of a path's frames whose picture was not converged, 0 to 1 (`fly` only).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unconverged_share: Option<f64>,
}

impl Report {
    /// Writes it to `path`.
    pub fn write(&self, path: &Path) -> Result<()> {
        write(self, path)
    }
}

fn write(report: &impl Serialize, path: &Path) -> Result<()> {
    let json = serde_json::to_string_pretty(report).map_err(|e| ClientError::Failed(format!("the report: {e}")))?;
    std::fs::write(path, json + "\n").map_err(ClientError::file(path))
}

/// What a flight has cost up to a moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FlightMoment {
    /// Seconds of the path.
    pub t: f64,
    /// Bytes fetched so far.
    pub bytes: u64,
    /// Requests so far.
    pub requests: u64,
    /// Requests under way.
    pub in_flight: usize,
    /// Bytes in the cache.
    pub cache_bytes: u64,
    /// Squares in the cut.
    pub drawn: u32,
    /// Squares that fade from one level of detail to another.
    pub fading: usize,
    /// What tau rose to.
    pub tau_px: f64,
    /// Largest projected error of what is drawn and not hidden.
    pub worst_error_px: f64,
    /// Largest projected error of what is drawn and seen.
    pub seen_error_px: f64,
}

/// How far a frame is from the picture that it would be if all were here.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PictureError {
    /// Seconds of the path.
    pub t: f64,
    /// Mean difference of a colour's channels, 0 to 255.
    pub mean: f64,
    /// Share of pixels with a channel that is over 8 of 255 apart.
    pub wrong_share: f64,
    /// Share of pixels that show the city in one picture only.
    pub holes_share: f64,
}

/// Compares two pictures of one size.
pub fn pictures_apart(a: &Pixels, b: &Pixels) -> PictureError {
    let mut apart = PictureError::default();
    let pixels = a.colour.len().min(b.colour.len()).max(1) as f64;
    for i in 0..a.colour.len().min(b.colour.len()) {
        let channels = a.colour[i].to_le_bytes().into_iter().zip(b.colour[i].to_le_bytes()).take(3);
        let (sum, most) =
            channels.fold((0u32, 0u8), |(sum, most), (a, b)| (sum + u32::from(a.abs_diff(b)), most.max(a.abs_diff(b))));
        apart.mean += f64::from(sum) / 3.0;
        apart.wrong_share += f64::from(u8::from(most > 8));
        apart.holes_share += f64::from(u8::from(a.distance[i].is_finite() != b.distance[i].is_finite()));
    }
    PictureError {
        t: 0.0,
        mean: apart.mean / pixels,
        wrong_share: apart.wrong_share / pixels,
        holes_share: apart.holes_share / pixels,
    }
}

/// A flight's report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightReport {
    /// What all runs report.
    #[serde(flatten)]
    pub run: Report,
    /// Frames that took four times as long as the median one, or longer.
    pub stalls: usize,
    /// Tiles that had to leave the cache.
    pub evictions: u64,
    /// Tiles that were fetched again after they had left it.
    pub fetched_again: u64,
    /// Second by second.
    pub moments: Vec<FlightMoment>,
    /// Frames against the pictures that they were on their way to (`--compare`).
    pub errors: Vec<PictureError>,
}

impl FlightReport {
    /// Writes it to `path`.
    pub fn write(&self, path: &Path) -> Result<()> {
        write(self, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles() {
        let times: Vec<Duration> = (1..=100).rev().map(Duration::from_millis).collect();
        let t = FrameTimes::new(&times);
        assert_eq!((t.count, t.median_ms, t.p95_ms, t.p99_ms, t.max_ms), (100, 50.0, 95.0, 99.0, 100.0));
        assert_eq!(FrameTimes::new(&[]), FrameTimes::default());
    }
}
