//! Tests of rasters. Files are made here by hand, or with the encoder of `tiff`; those in `data` with GDAL.

mod colours;
mod encoded;
mod geo;
mod hostile;
mod other_formats;
mod pixels;
mod tiff_file;

use super::{Raster, RasterError, RasterLimits, Window};
use std::io::Cursor;

fn open(bytes: &[u8]) -> Result<Raster, RasterError> {
    open_named(bytes, "file")
}

fn open_named(bytes: &[u8], name: &str) -> Result<Raster, RasterError> {
    let limits = RasterLimits {
        max_chunk_bytes: 1 << 22,
        cache_bytes: 1 << 12,
        max_window_pixels: 1 << 22,
        max_whole_pixels: 1 << 22,
    };
    Raster::open(Box::new(Cursor::new(bytes.to_vec())), name, limits)
}

fn heights(bytes: &[u8], level: usize) -> Vec<f32> {
    let mut raster = open(bytes).unwrap();
    let size = raster.facts().levels[level];
    raster.read_heights(Window::all_of(size), level).unwrap()
}

fn colours(bytes: &[u8]) -> Vec<[u8; 4]> {
    let mut raster = open(bytes).unwrap();
    let size = raster.facts().size;
    raster.read_colours(Window::all_of(size), 0).unwrap()
}

/// Equal, with NaN equal to NaN.
pub(super) fn assert_heights(actual: &[f32], expected: &[f32]) {
    let is_equal = |(a, b): (&f32, &f32)| a == b || a.is_nan() && b.is_nan();
    let are_equal = actual.len() == expected.len() && actual.iter().zip(expected).all(is_equal);
    assert!(are_equal, "{actual:?} is not {expected:?}");
}
