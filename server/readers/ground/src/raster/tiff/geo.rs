//! Where a GeoTIFF is, and in which coordinate system (OGC 19-008).

use super::super::error::RasterError;
use super::super::facts::RasterCrs;
use super::super::geo_keys::{GEO_KEYS, GEO_REALS, GEO_TEXTS, GeoKeys, RASTER_TYPE_KEY};
use super::super::place::GeoPlace;
use super::directory::{Directory, TiffFile};
use super::gdal::HeightRule;

const MODEL_PIXEL_SCALE: u16 = 33550;
const MODEL_TIE_POINT: u16 = 33922;
const MODEL_TRANSFORMATION: u16 = 34264;
const PIXEL_IS_POINT: u64 = 2;

/// The geographic tags of an image.
pub(super) struct GeoTags {
    keys: GeoKeys,
    scale: Vec<f64>,
    tie_points: Vec<f64>,
    transformation: Vec<f64>,
}

impl GeoTags {
    pub(super) fn read(file: &mut TiffFile, directory: &Directory) -> Result<Self, RasterError> {
        let keys = GeoKeys {
            keys: file.integers(directory, GEO_KEYS)?,
            reals: file.reals(directory, GEO_REALS)?,
            texts: file.bytes(directory, GEO_TEXTS)?,
        };
        Ok(Self {
            keys,
            scale: file.reals(directory, MODEL_PIXEL_SCALE)?,
            tie_points: file.reals(directory, MODEL_TIE_POINT)?,
            transformation: file.reals(directory, MODEL_TRANSFORMATION)?,
        })
    }

    /// Where the pixels are; `None` if the tags do not tell, or only by control points.
    pub(super) fn place(&self) -> Option<GeoPlace> {
        let (corner, column, row) = self.corner()?;
        let is_point = self.keys.number(RASTER_TYPE_KEY) == Some(PIXEL_IS_POINT);
        if is_point { GeoPlace::checked(corner, column, row) } else { GeoPlace::from_corner(corner, column, row) }
    }

    /// Number of places that only tell where some pixels are.
    pub(super) fn control_points(&self) -> usize {
        if self.corner().is_none() { self.tie_points.len() / 6 } else { 0 }
    }

    /// The position of the place (0, 0), and the steps to the next column and row.
    fn corner(&self) -> Option<([f64; 2], [f64; 2], [f64; 2])> {
        if let ([width, height, ..], [x, y, _, east, north, ..]) = (&self.scale[..], &self.tie_points[..]) {
            // The height is positive although rows go south; some writers have it negative.
            let height = height.abs();
            return Some(([east - x * width, north + y * height], [*width, 0.0], [0.0, -height]));
        }
        let [a, b, _, east, d, e, _, north, ..] = self.transformation[..] else { return None };
        Some(([east, north], [a, d], [b, e]))
    }

    /// How numbers become heights by the third numbers of scale and tie point (OGC 19-008, 7.3.1); `None` if they stay as they are.
    pub(super) fn heights(&self) -> Option<HeightRule> {
        let ([_, _, scale, ..], [_, _, number, _, _, height, ..]) = (&self.scale[..], &self.tie_points[..]) else {
            return None;
        };
        let rule = HeightRule { scale: *scale, offset: height - number * scale };
        // Most writers of level rasters leave a 0, or a 1, there.
        let is_set = rule.scale.is_finite() && rule.offset.is_finite() && ![0.0, 1.0].contains(&rule.scale);
        is_set.then_some(rule)
    }

    /// The coordinate system.
    pub(super) fn crs(&self) -> RasterCrs {
        self.keys.crs()
    }
}
