//! Places on Earth in the grid of a city.

use glam::DVec2;
use insula_protocol::Manifest;

/// Half-axis of the WGS84 ellipsoid at the equator, and its eccentricity squared.
const EQUATOR_M: f64 = 6_378_137.0;
const ECCENTRICITY_SQUARED: f64 = 6.694_379_990_14e-3;

/// World x and y in metres of a longitude and latitude in degrees. `None` if it is not known where the city lies, or if the place is not
/// on Earth.
///
/// The shortest line from the middle of the city, by its azimuth and length (mid-latitude formula of Gauss), as if the grid had no
/// distortion: within a thousandth of the distance from there.
pub fn grid_position(manifest: &Manifest, [longitude_deg, latitude_deg]: [f64; 2]) -> Option<DVec2> {
    let middle = manifest.location?;
    if !(-180.0..=180.0).contains(&longitude_deg) || !(-90.0..=90.0).contains(&latitude_deg) {
        return None;
    }
    let turn = (longitude_deg - middle.longitude_deg + 540.0).rem_euclid(360.0) - 180.0;
    let east = turn.to_radians();
    let north = (latitude_deg - middle.latitude_deg).to_radians();
    let (sin, cos) = (0.5 * (latitude_deg + middle.latitude_deg)).to_radians().sin_cos();
    let shape = 1.0 - ECCENTRICITY_SQUARED * sin * sin;
    let along_parallel_m = EQUATOR_M / shape.sqrt() * cos * east;
    let along_meridian_m = EQUATOR_M * (1.0 - ECCENTRICITY_SQUARED) / shape.powf(1.5) * north;
    // The azimuth is that at half way: the meridian of the city's middle converges to it. Then to the grid's north.
    let turned = DVec2::from_angle(0.5 * east * sin - middle.north_deg.to_radians());
    let [low, high] = manifest.focus.map(DVec2::from);
    Some((low + high) * 0.5 + turned.rotate(DVec2::new(along_parallel_m, along_meridian_m)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::manifest::GeoLocation;
    use insula_test_support::small_city::empty_manifest;

    fn at(location: Option<GeoLocation>, place: [f64; 2]) -> Option<DVec2> {
        let focus = [[84_900.0, 447_400.0], [85_100.0, 447_600.0]];
        grid_position(&Manifest { location, focus, ..empty_manifest(0) }, place)
    }

    #[test]
    fn places_agree_with_a_projection() {
        // Delft in the Dutch grid (EPSG:28992) by PROJ 9: the grid's north is 0.81 degrees anticlockwise of true north there.
        let delft = GeoLocation { longitude_deg: 4.357_7, latitude_deg: 52.011_4, north_deg: 0.81 };
        let here = at(Some(delft), [4.357_7, 52.011_4]).unwrap();
        assert_eq!(here, DVec2::new(85_000.0, 447_500.0));
        let north = at(Some(delft), [4.357_7, 52.101_4]).unwrap() - here;
        // 0.09 degrees of a meridian at 52.06 degrees north: 10,014 m.
        assert!((north.length() - 10_014.0).abs() < 10.0, "{north}");
        assert!((north.x / north.y - 0.81f64.to_radians().tan()).abs() < 1e-4, "{north}");
        let east = at(Some(delft), [4.503_7, 52.011_4]).unwrap() - here;
        // 0.146 degrees of the parallel: 10,026 m.
        assert!((east.length() - 10_026.0).abs() < 10.0, "{east}");
        assert!(east.x > 0.0 && east.y < 0.0, "{east}");
    }

    #[test]
    fn places_that_are_not_known_or_not_on_earth_are_none() {
        let fiji = GeoLocation { longitude_deg: 179.9, latitude_deg: -17.0, north_deg: 0.0 };
        assert_eq!(at(None, [4.0, 52.0]), None);
        assert_eq!(at(Some(fiji), [4.0, 92.0]), None);
        assert_eq!(at(Some(fiji), [f64::NAN, 2.0]), None);
        let across = at(Some(fiji), [-179.9, -17.0]).unwrap() - at(Some(fiji), [179.9, -17.0]).unwrap();
        assert!((across.x - 21_300.0).abs() < 100.0, "{across}");
    }
}
