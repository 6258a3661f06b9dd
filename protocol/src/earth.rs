//! Places on Earth in the grid of a city.

use crate::Manifest;

/// Half-axis of the WGS84 ellipsoid at the equator, and its eccentricity squared.
const EQUATOR_M: f64 = 6_378_137.0;
const ECCENTRICITY_SQUARED: f64 = 6.694_379_990_14e-3;
/// A step along a meridian that tells in which direction it lies.
const STEP_DEG: f64 = 1e-4;
/// Nearer to the pole, the step goes to the south.
const POLAR_DEG: f64 = 89.0;

/// World x and y in metres of a longitude and latitude in degrees. `None` if it is not known where the city lies, or if the place is not
/// on Earth.
///
/// The shortest line from the middle of the city, by its azimuth and length (mid-latitude formula of Gauss), as if the grid had no
/// distortion: within a thousandth of the distance from there.
#[must_use]
pub fn grid_position(manifest: &Manifest, [longitude_deg, latitude_deg]: [f64; 2]) -> Option<[f64; 2]> {
    let middle = manifest.location?;
    if !(-180.0..=180.0).contains(&longitude_deg) || !(-90.0..=90.0).contains(&latitude_deg) {
        return None;
    }
    let turn = (longitude_deg - middle.longitude_deg + 540.0).rem_euclid(360.0) - 180.0;
    let east = turn.to_radians();
    let north = (latitude_deg - middle.latitude_deg).to_radians();
    let (sin, cos) = libm::sincos((0.5 * (latitude_deg + middle.latitude_deg)).to_radians());
    let shape = 1.0 - ECCENTRICITY_SQUARED * sin * sin;
    let along_parallel_m = EQUATOR_M / shape.sqrt() * cos * east;
    let along_meridian_m = EQUATOR_M * (1.0 - ECCENTRICITY_SQUARED) / (shape * shape.sqrt()) * north;
    // The azimuth is that at half way: the meridian of the city's middle converges to it. Then to the grid's north.
    let (sin, cos) = libm::sincos(0.5 * east * sin - middle.north_deg.to_radians());
    let [x, y] = [0, 1].map(|axis| 0.5 * (manifest.focus[0][axis] + manifest.focus[1][axis]));
    Some([x + along_parallel_m * cos - along_meridian_m * sin, y + along_parallel_m * sin + along_meridian_m * cos])
}

/// Degrees clockwise from the grid's north to true north at a place. `None` as for [`grid_position`].
#[must_use]
pub fn north_deg(manifest: &Manifest, [longitude_deg, latitude_deg]: [f64; 2]) -> Option<f64> {
    let sign = if latitude_deg < POLAR_DEG { 1.0 } else { -1.0 };
    let from = grid_position(manifest, [longitude_deg, latitude_deg])?;
    let to = grid_position(manifest, [longitude_deg, latitude_deg + sign * STEP_DEG])?;
    let [east_m, north_m] = [0, 1].map(|axis| sign * (to[axis] - from[axis]));
    Some(libm::atan2(east_m, north_m).to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::GeoLocation;

    fn city(location: Option<GeoLocation>) -> Manifest {
        Manifest { location, focus: [[84_900.0, 447_400.0], [85_100.0, 447_600.0]], ..Manifest::default() }
    }

    #[test]
    fn places_agree_with_a_projection() {
        // Delft in the Dutch grid (EPSG:28992) by PROJ 9: the grid's north is 0.81 degrees anticlockwise of true north there.
        let delft = city(Some(GeoLocation { longitude_deg: 4.357_7, latitude_deg: 52.011_4, north_deg: 0.81 }));
        let [x, y] = [85_000.0, 447_500.0];
        assert_eq!(grid_position(&delft, [4.357_7, 52.011_4]), Some([x, y]));
        let from_there = |place| {
            let [to_x, to_y] = grid_position(&delft, place).unwrap();
            [to_x - x, to_y - y]
        };
        // 0.09 degrees of a meridian at 52.06 degrees north: 10,014 m.
        let [east_m, north_m] = from_there([4.357_7, 52.101_4]);
        assert!((libm::hypot(east_m, north_m) - 10_014.0).abs() < 10.0, "{east_m}, {north_m}");
        assert!((east_m / north_m - libm::tan(0.81f64.to_radians())).abs() < 1e-4, "{east_m}, {north_m}");
        // 0.146 degrees of the parallel: 10,026 m.
        let [east_m, north_m] = from_there([4.503_7, 52.011_4]);
        assert!((libm::hypot(east_m, north_m) - 10_026.0).abs() < 10.0, "{east_m}, {north_m}");
        assert!(east_m > 0.0 && north_m < 0.0, "{east_m}, {north_m}");
    }

    #[test]
    fn north_is_that_of_the_place() {
        let delft = city(Some(GeoLocation { longitude_deg: 4.357_7, latitude_deg: 52.011_4, north_deg: 0.81 }));
        assert!((north_deg(&delft, [4.357_7, 52.011_4]).unwrap() - 0.81).abs() < 1e-6);
        // Meridians converge: by the sine of the latitude for each degree of longitude.
        let east = north_deg(&delft, [5.357_7, 52.011_4]).unwrap();
        assert!((0.81 - east - libm::sin(52.011_4f64.to_radians())).abs() < 0.02, "{east}");
        assert_eq!(north_deg(&city(None), [4.0, 52.0]), None);
    }

    #[test]
    fn places_that_are_not_known_or_not_on_earth_are_none() {
        let fiji = city(Some(GeoLocation { longitude_deg: 179.9, latitude_deg: -17.0, north_deg: 0.0 }));
        assert_eq!(grid_position(&city(None), [4.0, 52.0]), None);
        assert_eq!(grid_position(&fiji, [4.0, 92.0]), None);
        assert_eq!(grid_position(&fiji, [f64::NAN, 2.0]), None);
        let [east, west] = [-179.9, 179.9].map(|longitude| grid_position(&fiji, [longitude, -17.0]).unwrap()[0]);
        assert!((east - west - 21_300.0).abs() < 100.0, "{east}, {west}");
    }
}
