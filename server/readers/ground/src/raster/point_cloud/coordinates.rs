//! The coordinate system of a point cloud, and the sizes of its units.

use super::super::error::RasterError;
use super::super::facts::RasterCrs;
use super::records::Records;
use insula_place::crs;
use insula_place::crs::{Crs, System, Vertical};

/// Of a degree of latitude on a sphere with the equator's radius.
const METRES_OF_DEGREE: f64 = 6_378_137.0 * std::f64::consts::PI / 180.0;
/// Degrees of longitude near the poles are as long as at this latitude.
const MAX_LATITUDE_DEG: f64 = 89.0;

/// A coordinate system with the sizes of its units.
pub(super) struct Coordinates {
    pub(super) crs: RasterCrs,
    /// Metres of a unit towards east and towards north, which are 1 if the system is not known.
    pub(super) unit_m: [f64; 2],
    /// What the file's heights are multiplied with, to be in the unit of the system.
    pub(super) height_factor: f64,
    /// Metres of the unit of the system's heights.
    pub(super) height_unit_m: f64,
}

impl Coordinates {
    /// `middle_y` is the second coordinate in the middle of the cloud. Fails if the coordinates are not on a map.
    pub(super) fn new(records: &Records, prefers_wkt: bool, middle_y: f64) -> Result<Self, RasterError> {
        let wkt = records.wkt.as_ref().map(|text| RasterCrs { horizontal: Some(text.clone()), ..RasterCrs::default() });
        let keys = records.geo_keys.as_ref().map(|keys| keys.crs());
        let [first, second] = if prefers_wkt { [wkt, keys] } else { [keys, wkt] };
        let candidates = || [&first, &second].into_iter().flatten();
        let known = candidates().find_map(|crs| Some((crs.clone(), crs::resolve(&full_name(crs)?).ok()?)));
        let Some((crs, system)) = known else {
            // The reader of coordinate systems reports why the system is unknown.
            let named = candidates().find(|crs| crs.horizontal.is_some()).or(candidates().next());
            let crs = named.cloned().unwrap_or_default();
            let height_unit_m = crs.height_unit_m.unwrap_or(1.0);
            return Ok(Self { crs, unit_m: [1.0; 2], height_factor: 1.0, height_unit_m });
        };
        let unit_m = units(&system, middle_y)?;
        let height_unit_m = match &system.vertical {
            Vertical::Ellipsoidal { unit_m } => *unit_m,
            Vertical::Orthometric(datum) => datum.unit_m,
            // Heights without a system are in the unit of the map.
            Vertical::Unknown if matches!(system.horizontal.system, System::Projected(_)) => unit_m[1],
            Vertical::Unknown => 1.0,
        };
        // Keys can have another unit of heights than the system that they name, mostly feet of a system in metres.
        let height_factor = crs.height_unit_m.map_or(1.0, |own_unit_m| own_unit_m / height_unit_m.abs());
        let is_ellipsoidal = crs.is_ellipsoidal || matches!(system.vertical, Vertical::Ellipsoidal { .. });
        let crs = RasterCrs { is_ellipsoidal, height_unit_m: Some(height_unit_m), ..crs };
        Ok(Self { crs, unit_m, height_factor, height_unit_m: height_unit_m.abs() })
    }
}

/// The name of the horizontal and the vertical system together.
fn full_name(crs: &RasterCrs) -> Option<String> {
    Some(crs.with_vertical(crs.horizontal.as_ref().or(crs.citation.as_ref())?.clone()))
}

/// Metres of a unit towards east and north. Fails if the system is not that of a map.
fn units(system: &Crs, middle_y: f64) -> Result<[f64; 2], RasterError> {
    match &system.horizontal.system {
        System::Geographic { unit_deg, .. } => {
            let latitude_deg = (middle_y * unit_deg).clamp(-MAX_LATITUDE_DEG, MAX_LATITUDE_DEG);
            let north_m = METRES_OF_DEGREE * unit_deg;
            Ok([north_m * libm::cos(latitude_deg.to_radians()), north_m])
        }
        System::Projected(definition) => Ok([definition.unit_m; 2]),
        System::Local(_) => Ok([1.0; 2]),
        System::Geocentric(_) => Err(RasterError::unsupported("positions from the centre of the Earth")),
    }
}
