//! The position of the moon.

use glam::DVec3;

/// Julian date of the epoch J2000.
const J2000: f64 = 2_451_545.0;

/// Unit vector towards the moon from a place on Earth, east, north and up, at a Julian date of universal time. Latitude and
/// longitude are degrees north and east.
///
/// Low-precision formulae of the Astronomical Almanac (section D): 0.3 degrees, about the moon's radius.
pub(crate) fn direction(julian_date: f64, [latitude, longitude]: [f64; 2]) -> DVec3 {
    let days = julian_date - J2000;
    let (ecliptic, parallax_deg) = geocentric(days / 36_525.0);
    let (sin_tilt, cos_tilt) = (23.439 - 3.6e-7 * days).to_radians().sin_cos();
    let equatorial = DVec3::new(
        ecliptic.x,
        cos_tilt * ecliptic.y - sin_tilt * ecliptic.z,
        sin_tilt * ecliptic.y + cos_tilt * ecliptic.z,
    );
    let sidereal_deg = 280.460_618 + 360.985_647_366 * days + longitude;
    let (sin, cos) = sidereal_deg.rem_euclid(360.0).to_radians().sin_cos();
    // Towards the meridian at the equator, east, and the pole.
    let meridian = cos * equatorial.x + sin * equatorial.y;
    let east = cos * equatorial.y - sin * equatorial.x;
    let (sin, cos) = latitude.to_radians().sin_cos();
    let north = cos * equatorial.z - sin * meridian;
    let up = cos * meridian + sin * equatorial.z;
    // An observer on the ground is an Earth's radius closer to what is above.
    DVec3::new(east, north, up - parallax_deg.to_radians().sin()).normalize_or(DVec3::Z)
}

/// Unit vector in ecliptic coordinates, and the horizontal parallax in degrees, `t` Julian centuries after J2000.
fn geocentric(t: f64) -> (DVec3, f64) {
    let wave = |degrees: f64, per_century: f64| (degrees + per_century * t).rem_euclid(360.0).to_radians();
    let longitude = 218.32 + (481_267.881 * t).rem_euclid(360.0) + 6.29 * wave(135.0, 477_198.87).sin()
        - 1.27 * wave(259.3, -413_335.36).sin()
        + 0.66 * wave(235.7, 890_534.22).sin()
        + 0.21 * wave(269.9, 954_397.74).sin()
        - 0.19 * wave(357.5, 35_999.05).sin()
        - 0.11 * wave(186.5, 966_404.03).sin();
    let latitude = 5.13 * wave(93.3, 483_202.02).sin() + 0.28 * wave(228.2, 960_400.89).sin()
        - 0.28 * wave(318.3, 6003.15).sin()
        - 0.17 * wave(217.6, -407_332.21).sin();
    let parallax = 0.9508
        + 0.0518 * wave(135.0, 477_198.87).cos()
        + 0.0095 * wave(259.3, -413_335.36).cos()
        + 0.0078 * wave(235.7, 890_534.22).cos()
        + 0.0028 * wave(269.9, 954_397.74).cos();
    let ((sin_longitude, cos_longitude), (sin, cos)) =
        (longitude.to_radians().sin_cos(), latitude.to_radians().sin_cos());
    (DVec3::new(cos * cos_longitude, cos * sin_longitude, sin), parallax)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Meeus, Astronomical Algorithms (1998), example 47.a: 12 April 1992.
    #[test]
    fn position_agrees_with_an_almanac() {
        let (at, parallax) = geocentric((2_448_724.5 - J2000) / 36_525.0);
        let (longitude, latitude) = (at.y.atan2(at.x).to_degrees(), at.z.asin().to_degrees());
        assert!((longitude - 133.163).abs() < 0.3 && (latitude + 3.229).abs() < 0.3, "{longitude} {latitude}");
        assert!((parallax - 0.992).abs() < 0.01, "{parallax}");
    }

    /// The moon was full on 18 September 2024 at 2:35: opposite to the sun, which stands under Greenwich's horizon.
    #[test]
    fn a_full_moon_is_high_around_midnight() {
        let full = direction(2_460_571.5 + 0.1, [51.5, 0.0]);
        assert!(full.z > 0.2 && full.x < 0.0, "west of south after midnight: {full}");
        let noon = direction(2_460_571.5 + 0.5, [51.5, 0.0]);
        assert!(noon.z < 0.0, "{noon}");
    }
}
