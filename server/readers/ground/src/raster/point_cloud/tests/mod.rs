//! Tests of point clouds, which are made here by hand, and packed with the encoder of `laz`.

mod file;
mod ground;
mod heights;
mod holes;
mod hostile;
mod packed;
mod systems;

use std::io::Cursor;

use super::super::error::RasterError;
use super::super::facts::{RasterFacts, RasterLimits, Window};
use super::super::source::Source;
use super::PointCloud;

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

/// Equal, with NaN equal to NaN.
fn assert_heights(actual: &[f32], expected: &[f32]) {
    let is_equal = |(a, b): (&f32, &f32)| a == b || a.is_nan() && b.is_nan();
    let are_equal = actual.len() == expected.len() && actual.iter().zip(expected).all(is_equal);
    assert!(are_equal, "{actual:?} is not {expected:?}");
}
