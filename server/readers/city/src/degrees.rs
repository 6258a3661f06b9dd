//! Templates in systems in degrees: they are in metres, and placed at a latitude and a longitude.

use insula_place::crs::is_geographic;

/// Metres of a degree of latitude.
const METRES_PER_DEGREE: f64 = 111_195.0;

/// Degrees of a metre to the east and to the north at a latitude.
pub(crate) fn degrees_per_metre(latitude_deg: f64) -> [f64; 2] {
    let north = 1.0 / METRES_PER_DEGREE;
    [north / libm::cos(latitude_deg.to_radians()).max(1e-6), north]
}

/// Whether a coordinate system is in degrees with latitude first.
pub(crate) fn is_latitude_first(system: &str) -> bool {
    is_geographic(system) && !system.contains("CRS84")
}
