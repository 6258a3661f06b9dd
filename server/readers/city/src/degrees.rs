//! Templates in systems in degrees: they are in metres, and placed at a latitude and a longitude.

use insula_place::crs::is_geographic;
pub(crate) use insula_place::placement::degrees_per_metre;

/// Whether a coordinate system is in degrees with latitude first.
pub(crate) fn is_latitude_first(system: &str) -> bool {
    is_geographic(system) && !system.contains("CRS84")
}
