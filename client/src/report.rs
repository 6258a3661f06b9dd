//! Reports of a run as JSON for scripts (`--report`). The field names are the JSON keys.

use crate::error::{ClientError, Result};
use crate::render::AdapterInfo;
use insula_archive::new_file::replace;
use insula_command_line::output::FileKind;
use insula_protocol::text::printable_json;
use insula_shaders::cpu::raycast::Pixels;
use insula_viewer::streamer::TileCounts;
use serde::Serialize;
use std::path::Path;
use std::time::Duration;

/// A colour channel that differs by more than this makes a pixel wrong.
const WRONG_CHANNEL_DIFFERENCE: u8 = 8;

/// Percentiles of the frame times, in milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FrameTimes {
    /// Number of frames.
    pub count: usize,
    pub median_ms: f64,
    pub p95_ms: f64,
    pub p99_ms: f64,
    pub max_ms: f64,
}

impl FrameTimes {
    /// Percentiles of `times`, which may be in any order.
    pub fn new(times: &[Duration]) -> Self {
        let mut ms: Vec<f64> = times.iter().map(|t| t.as_secs_f64() * 1e3).collect();
        ms.sort_by(f64::total_cmp);
        let at = |share: f64| ms.get(((ms.len() as f64 * share).ceil() as usize).max(1) - 1).copied().unwrap_or(0.0);
        Self { count: ms.len(), median_ms: at(0.5), p95_ms: at(0.95), p99_ms: at(0.99), max_ms: at(1.0) }
    }
}

/// What a run cost. Durations are in seconds unless the name says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunReport {
    pub city: String,
    /// Version from the city's manifest.
    pub version: String,
    /// Bytes of all response bodies.
    pub bytes_fetched: u64,
    pub requests: u64,
    pub tiles: TileCounts,
    /// Selection, upload and drawing of each frame.
    pub frame_times: FrameTimes,
    /// From the start of the command, connecting included, to the first frame that shows the city.
    pub time_to_first_picture_secs: Option<f64>,
    /// To the first frame whose visible errors are at most four times tau.
    pub time_to_near_picture_secs: Option<f64>,
    /// To the first frame that no further tile can improve.
    pub time_to_converged_picture_secs: Option<f64>,
    pub peak_cache_bytes: u64,
    /// Capacity of the cache.
    pub cache_bytes: u64,
    pub adapter: AdapterInfo,
    /// Requested error threshold.
    pub tau_px: f64,
    /// Adaptive error threshold of the last frame; above `tau_px` if the cache was full.
    pub tau_reached_px: f64,
    /// Largest screen-space error in the last frame.
    pub worst_error_px: f64,
    /// Draw tiles of the last frame.
    pub nodes_drawn: u32,
    /// Draw tiles of the last frame that were drawn as meshes.
    pub meshes_drawn: u32,
    pub triangles_drawn: u64,
    /// Share of a flight's frames that lacked tiles, 0 to 1 (`fly` only).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unconverged_share: Option<f64>,
    /// Whether the camera is inside of a building or below terrain (`snapshot` only).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_inside_solid: Option<bool>,
}

impl RunReport {
    /// What a report has, also that of a flight.
    pub const KIND: FileKind = FileKind::Json("a report", &["tau_px", "tau_reached_px", "worst_error_px"]);

    /// Writes the report to `path`. Fails if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_json(self, path)
    }
}

fn write_json(report: &impl Serialize, path: &Path) -> Result<()> {
    let json = to_json(report)?;
    replace(path, (json + "\n").as_bytes()).map_err(ClientError::file(path))
}

fn to_json(report: &impl Serialize) -> Result<String> {
    serde_json::to_string_pretty(report)
        .map_err(|e| ClientError::Failed(format!("the report cannot be written as JSON: {e}")))
}

/// State of a flight at one time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FlightSample {
    /// Seconds since the start of the path.
    pub t: f64,
    /// Bytes fetched so far.
    pub bytes: u64,
    /// Requests so far.
    pub requests: u64,
    pub in_flight: usize,
    /// Bytes in the cache.
    pub cache_bytes: u64,
    /// Number of draw tiles.
    pub drawn: u32,
    /// Number of draw tiles that cross-fade.
    pub fading: usize,
    /// Adaptive error threshold.
    pub tau_px: f64,
    /// Largest screen-space error of the draw tiles that are not occluded.
    pub worst_error_px: f64,
    /// Largest screen-space error of the draw tiles that rays hit.
    pub seen_error_px: f64,
}

/// Difference between a frame and the converged frame of the same view.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FrameDifference {
    /// Seconds since the start of the path.
    pub t: f64,
    /// Mean difference of the colour channels, 0 to 255.
    pub mean: f64,
    /// Share of pixels with a channel that differs by more than 8 of 255.
    pub wrong_share: f64,
    /// Share of pixels that show the city in one of the frames only.
    pub holes_share: f64,
}

/// Compares two frames of the same size. `t` of the result is 0.
pub fn compare_frames(a: &Pixels, b: &Pixels) -> FrameDifference {
    let mut sum = FrameDifference::default();
    let pixels = a.colour.len().min(b.colour.len()).max(1) as f64;
    for i in 0..a.colour.len().min(b.colour.len()) {
        let channels = a.colour[i].to_le_bytes().into_iter().zip(b.colour[i].to_le_bytes()).take(3);
        let (total, largest) = channels.fold((0u32, 0u8), |(total, largest), (a, b)| {
            (total + u32::from(a.abs_diff(b)), largest.max(a.abs_diff(b)))
        });
        sum.mean += f64::from(total) / 3.0;
        sum.wrong_share += f64::from(u8::from(largest > WRONG_CHANNEL_DIFFERENCE));
        sum.holes_share += f64::from(u8::from(a.distance[i].is_finite() != b.distance[i].is_finite()));
    }
    FrameDifference {
        t: 0.0,
        mean: sum.mean / pixels,
        wrong_share: sum.wrong_share / pixels,
        holes_share: sum.holes_share / pixels,
    }
}

/// Report of `insula fly`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightReport {
    #[serde(flatten)]
    pub run: RunReport,
    /// Frames that took at least four times the median.
    pub stalls: usize,
    /// Tiles evicted from the cache.
    pub evictions: u64,
    /// Tiles fetched again after their eviction.
    pub fetched_again: u64,
    /// About one sample a second.
    pub moments: Vec<FlightSample>,
    /// Differences from the converged frames (`--compare`).
    pub errors: Vec<FrameDifference>,
}

impl FlightReport {
    /// Writes the report to `path`, or to standard output without one. Fails if the file cannot be written.
    pub fn write(&self, path: Option<&Path>) -> Result<()> {
        match path {
            Some(path) => write_json(self, path),
            None => {
                println!("{}", printable_json(&to_json(self)?));
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_times_have_nearest_rank_percentiles() {
        let times: Vec<Duration> = (1..=100).rev().map(Duration::from_millis).collect();
        let t = FrameTimes::new(&times);
        assert_eq!((t.count, t.median_ms, t.p95_ms, t.p99_ms, t.max_ms), (100, 50.0, 95.0, 99.0, 100.0));
        assert_eq!(FrameTimes::new(&[]), FrameTimes::default());
    }
}
