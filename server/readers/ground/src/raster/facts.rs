//! What is known of a raster before its pixels are read.

use super::error::RasterError;
use super::place::GeoPlace;
use std::ops::RangeInclusive;

/// Bounds of memory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RasterLimits {
    /// Bytes of a tile or strip, packed or unpacked.
    pub(crate) max_chunk_bytes: u64,
    /// Bytes of the unpacked tiles and strips that are kept.
    pub(crate) cache_bytes: u64,
    /// Pixels of a window that is read at once.
    pub(crate) max_window_pixels: u64,
    /// Pixels of a picture whose format allows only to unpack it whole, such as JPEG and PNG.
    pub(crate) max_whole_pixels: u64,
}

impl Default for RasterLimits {
    fn default() -> Self {
        Self { max_chunk_bytes: 1 << 29, cache_bytes: 1 << 27, max_window_pixels: 1 << 26, max_whole_pixels: 1 << 28 }
    }
}

/// Type of the numbers of a raster. Numbers with fewer bits than a type has are in the next larger one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SampleKind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    F32,
    F64,
}

/// Pixels of a raster from the top left one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// Size of a raster, or of its smaller copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RasterSize {
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// Coordinate system of a raster as its file names it. All empty if the file says nothing.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct RasterCrs {
    /// Such as `EPSG:28992`; `None` if it is missing or defined by the file itself.
    pub(crate) horizontal: Option<String>,
    /// System of the heights, such as `EPSG:5709`.
    pub(crate) vertical: Option<String>,
    /// The file says that its heights are above the ellipsoid.
    pub(crate) is_ellipsoidal: bool,
    /// Metres of one unit of height, if the file tells.
    pub(crate) height_unit_m: Option<f64>,
    /// The file's own text about its system, or the string for PROJ of a projection that is not supported.
    pub(crate) citation: Option<String>,
    /// What to tell if the file gives its horizontal system another unit than the system has, or heights one that is not known.
    pub(crate) other_unit: Option<String>,
}

impl RasterCrs {
    /// The name of a horizontal system together with the vertical one, if it is a code.
    pub(crate) fn with_vertical(&self, horizontal: String) -> String {
        if !horizontal.starts_with("EPSG:") {
            return horizontal;
        }
        match self.vertical.as_deref().map(|vertical| vertical.trim_start_matches("EPSG:")) {
            Some(vertical) => format!("{horizontal}+{vertical}"),
            // Which ellipsoid it is makes no difference.
            None if self.is_ellipsoidal => format!("{horizontal}+4979"),
            None => horizontal,
        }
    }
}

/// Heights on land, in metres. Others are marks of missing heights that a file does not declare.
pub const HEIGHTS_M: RangeInclusive<f64> = -500.0..=9000.0;
/// Heights with those of the sea's ground.
pub(crate) const HEIGHTS_AND_DEPTHS_M: RangeInclusive<f64> = -12_000.0..=9000.0;

/// What is known of a raster before its pixels are read.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RasterFacts {
    pub(crate) size: RasterSize,
    /// Numbers of each pixel.
    pub(crate) bands: u16,
    pub(crate) sample: SampleKind,
    /// Where the pixels are; `None` if the file does not tell.
    pub(crate) place: Option<GeoPlace>,
    /// Number of places by which the file tells in place of `place` where some pixels are.
    pub(crate) control_points: usize,
    pub(crate) crs: RasterCrs,
    /// The value of pixels without one.
    pub(crate) nodata: Option<f64>,
    /// The raster itself, then its smaller copies, from large to small.
    pub(crate) levels: Vec<RasterSize>,
    /// The file's name of its unit of height, if it is not known.
    pub(crate) unknown_unit: Option<String>,
    /// What to tell of a number that is none.
    pub(crate) odd_number: Option<String>,
    /// Another image in the file tells which pixels are valid.
    pub(crate) has_mask: bool,
}

impl RasterFacts {
    /// Facts of a raster with one size, one number a pixel, and nothing else.
    pub(super) fn new(size: RasterSize, sample: SampleKind) -> Self {
        Self {
            size,
            bands: 1,
            sample,
            place: None,
            control_points: 0,
            crs: RasterCrs::default(),
            nodata: None,
            unknown_unit: None,
            odd_number: None,
            levels: vec![size],
            has_mask: false,
        }
    }

    /// Where the pixels of a level are.
    pub(crate) fn place_of_level(&self, level: usize) -> Option<GeoPlace> {
        let (place, size) = (self.place?, self.levels.get(level)?);
        let across = f64::from(self.size.width) / f64::from(size.width);
        let down = f64::from(self.size.height) / f64::from(size.height);
        Some(GeoPlace {
            origin: place.position((across - 1.0) / 2.0, (down - 1.0) / 2.0),
            column: place.column.map(|step| step * across),
            row: place.row.map(|step| step * down),
        })
    }
}

impl RasterSize {
    pub(crate) fn pixels(self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }
}

impl Window {
    /// All of a raster, or of a level.
    #[cfg(test)]
    pub(crate) fn all_of(size: RasterSize) -> Self {
        Self { x: 0, y: 0, width: size.width, height: size.height }
    }

    /// Number of its pixels. Fails if it is empty, too large, or not within the level.
    pub(super) fn checked_len(self, size: RasterSize, limits: &RasterLimits) -> Result<usize, RasterError> {
        let fits =
            |start: u32, length: u32, all: u32| length > 0 && start.checked_add(length).is_some_and(|end| end <= all);
        if !fits(self.x, self.width, size.width) || !fits(self.y, self.height, size.height) {
            return Err(RasterError::Outside);
        }
        let limit = limits.max_window_pixels;
        let pixels = u64::from(self.width) * u64::from(self.height);
        let len = usize::try_from(pixels).ok().filter(|_| pixels <= limit);
        len.ok_or(RasterError::TooLarge { what: "the number of pixels of a window", limit })
    }
}
