//! Tests of point clouds, which are made here by hand, and packed with the encoder of `laz`.

mod file;
mod ground;
mod heights;
mod holes;
mod hostile;
mod packed;
mod systems;

use super::super::error::RasterError;
use super::super::facts::{RasterFacts, RasterLimits, Window};
use super::super::source::Source;
use super::super::tests::assert_heights;
use super::PointCloud;
use std::io::Cursor;

const LIMITS: RasterLimits = RasterLimits {
    max_chunk_bytes: 1 << 23,
    cache_bytes: 1 << 12,
    max_window_pixels: 1 << 20,
    max_whole_pixels: 1 << 20,
};

fn open(bytes: &[u8]) -> Result<(PointCloud, RasterFacts), RasterError> {
    open_within(bytes, LIMITS)
}

fn open_within(bytes: &[u8], limits: RasterLimits) -> Result<(PointCloud, RasterFacts), RasterError> {
    PointCloud::open(Source::new(Box::new(Cursor::new(bytes.to_vec())))?, limits)
}

/// What is known of a cloud, and all its heights.
fn read(bytes: &[u8]) -> (RasterFacts, Vec<f32>) {
    let (mut cloud, facts) = open(bytes).unwrap();
    let window = Window::all_of(facts.size);
    let len = facts.size.pixels() as usize;
    let heights = cloud.read_heights(window, len).unwrap();
    assert_eq!(heights.len(), len);
    (facts, heights)
}

fn heights(bytes: &[u8]) -> Vec<f32> {
    read(bytes).1
}
