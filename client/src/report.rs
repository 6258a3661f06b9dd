//! What a run cost, as JSON for scripts.
//!
//! In: counters and times of a `session`. Out: [`Report`]. Next: a file, or standard output.

use crate::{
    error::{ClientError, Result},
    render::AdapterInfo,
};
use serde::Serialize;
use std::{path::Path, time::Duration};

/// Tiles that became resident, by kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct TileCounts {
    /// V-BlockMaps.
    pub blockmaps: u64,
    /// Subtrees.
    pub subtrees: u64,
    /// Given up: missing on the server, or damaged again and again.
    pub bad: u64,
}

/// Times of all frames, in milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FrameTimes {
    /// How many.
    pub count: usize,
    /// Half were faster.
    pub median_ms: f64,
    /// 95 in 100 were faster.
    pub p95_ms: f64,
    /// The slowest.
    pub max_ms: f64,
}

impl FrameTimes {
    /// Of times in any order.
    pub fn new(times: &[Duration]) -> Self {
        let mut ms: Vec<f64> = times.iter().map(|t| t.as_secs_f64() * 1e3).collect();
        ms.sort_by(f64::total_cmp);
        let at = |share: f64| ms.get(((ms.len() as f64 * share).ceil() as usize).max(1) - 1).copied().unwrap_or(0.0);
        Self { count: ms.len(), median_ms: at(0.5), p95_ms: at(0.95), max_ms: at(1.0) }
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
    /// From the start (connecting included) to the first frame that shows anything of the city.
    pub time_to_first_picture_secs: Option<f64>,
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
    /// Share of a path's frames whose picture was not converged, 0 to 1 (`fly` only).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unconverged_share: Option<f64>,
}

impl Report {
    /// Writes it to `path`.
    pub fn write(&self, path: &Path) -> Result<()> {
        let json = serde_json::to_string_pretty(self).map_err(|e| ClientError::Failed(format!("the report: {e}")))?;
        std::fs::write(path, json + "\n").map_err(ClientError::file(path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles() {
        let times: Vec<Duration> = (1..=100).rev().map(Duration::from_millis).collect();
        let t = FrameTimes::new(&times);
        assert_eq!((t.count, t.median_ms, t.p95_ms, t.max_ms), (100, 50.0, 95.0, 100.0));
        assert_eq!(FrameTimes::new(&[]), FrameTimes::default());
    }
}
