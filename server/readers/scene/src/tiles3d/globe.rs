//! The ellipsoid WGS 84, as far as tiles need it: whether a position is at its surface, and which way is up there.

use glam::{DMat4, DVec3};

const EQUATORIAL_RADIUS_M: f64 = 6_378_137.0;
pub(super) const POLAR_RADIUS_M: f64 = 6_356_752.314_245_179;
/// Positions within these distances of the Earth's centre are geocentric: from 150 km below to 220 km above the ground.
const SURFACE_M: std::ops::Range<f64> = 6.2e6..6.6e6;

/// Whether a position is near the Earth's surface if it is geocentric.
pub(super) fn is_near_surface(position: DVec3) -> bool {
    SURFACE_M.contains(&position.length())
}

/// Longitude and geodetic latitude of a geocentric position near the surface (Bowring 1976, one step: below 1e-6 degrees).
pub(super) fn lon_lat_deg(position: DVec3) -> [f64; 2] {
    let (a, b) = (EQUATORIAL_RADIUS_M, POLAR_RADIUS_M);
    let axis_distance = libm::hypot(position.x, position.y);
    let (first, second) = ((a * a - b * b) / (a * a), (a * a - b * b) / (b * b));
    let (sin, cos) = libm::sincos(libm::atan2(position.z * a, axis_distance * b));
    let latitude = libm::atan2(position.z + second * b * sin.powi(3), axis_distance - first * a * cos.powi(3));
    [libm::atan2(position.y, position.x).to_degrees(), latitude.to_degrees()]
}

/// Turns east, north and up at a geocentric position into geocentric axes.
pub(super) fn east_north_up(position: DVec3) -> DMat4 {
    let [lon, lat] = lon_lat_deg(position).map(f64::to_radians);
    let (sin_lon, cos_lon) = libm::sincos(lon);
    let (sin_lat, cos_lat) = libm::sincos(lat);
    let east = DVec3::new(-sin_lon, cos_lon, 0.0);
    let north = DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
    let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
    DMat4::from_cols(east.extend(0.0), north.extend(0.0), up.extend(0.0), position.extend(1.0))
}

/// The geocentric position of a longitude and latitude in degrees and a height over the ellipsoid.
#[cfg(test)]
pub(super) fn ecef(lon_deg: f64, lat_deg: f64, height_m: f64) -> DVec3 {
    let (sin_lon, cos_lon) = libm::sincos(lon_deg.to_radians());
    let (sin_lat, cos_lat) = libm::sincos(lat_deg.to_radians());
    let (a, b) = (EQUATORIAL_RADIUS_M, POLAR_RADIUS_M);
    let normal = a * a / (a * a * cos_lat * cos_lat + b * b * sin_lat * sin_lat).sqrt();
    let z = (b * b / (a * a) * normal + height_m) * sin_lat;
    DVec3::new((normal + height_m) * cos_lat * cos_lon, (normal + height_m) * cos_lat * sin_lon, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_return_from_geocentric_positions() {
        for (lon, lat, height) in [(140.11458539, 35.61016729, 40.0), (-73.9, 40.7, 541.0), (0.0, -89.0, 8000.0)] {
            let [found_lon, found_lat] = lon_lat_deg(ecef(lon, lat, height));
            assert!((found_lon - lon).abs() < 1e-9 && (found_lat - lat).abs() < 1e-6, "{found_lon} {found_lat}");
        }
    }

    #[test]
    fn up_leads_away_from_the_ellipsoid() {
        let at = ecef(140.0, 35.0, 0.0);
        let above = east_north_up(at).transform_point3(DVec3::new(0.0, 0.0, 100.0));
        assert!(above.distance(ecef(140.0, 35.0, 100.0)) < 1e-2);
        let east = east_north_up(at).transform_point3(DVec3::new(100.0, 0.0, 0.0));
        assert!(lon_lat_deg(east)[0] > 140.0 && (lon_lat_deg(east)[1] - 35.0).abs() < 1e-5);
        assert!(is_near_surface(at) && !is_near_surface(DVec3::splat(1000.0)) && !is_near_surface(DVec3::NAN));
    }
}
