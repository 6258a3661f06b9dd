//! Where a city lies on Earth, from its coordinate system: clients need it for the sun and for maps beside the city, and have no
//! table of coordinate systems.

use insula_place::earth_place::EarthPlace;
use insula_protocol::manifest::GeoLocation;

/// Location of the middle of `focus` in a CRS such as `EPSG:7415`. `None` if the CRS is not known, or the place is not in it.
pub(super) fn locate(crs: &str, focus: [[f64; 2]; 2]) -> Option<GeoLocation> {
    let earth = EarthPlace::of(crs)?;
    let [x, y] = [0, 1].map(|axis| (focus[0][axis] + focus[1][axis]) * 0.5);
    let (here, north) = (earth.lon_lat([x, y])?, earth.lon_lat([x, y + 1000.0])?);
    let east = (north[0] - here[0]) * libm::cos(here[1].to_radians());
    let north_deg = -libm::atan2(east, north[1] - here[1]).to_degrees();
    Some(GeoLocation { latitude_deg: here[1], longitude_deg: here[0], north_deg })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn location_follows_from_the_crs() {
        // Delft's Nieuwe Kerk: 52.0123 N, 4.3609 E.
        let delft = [[84_498.0, 447_540.0]; 2];
        let site = locate("EPSG:7415", delft).unwrap();
        let GeoLocation { latitude_deg, longitude_deg, north_deg } = site;
        assert!((latitude_deg - 52.0123).abs() < 0.005 && (longitude_deg - 4.3609).abs() < 0.01, "{site:?}");
        // The grid's central meridian is 5.39 E. West of it, true north is clockwise of the grid's, by sin(52 deg) times the
        // difference.
        assert!((north_deg - 0.81).abs() < 0.05, "{site:?}");
        for zone in ["EPSG:32654", "EPSG:6677", "EPSG:10170"] {
            assert!(locate(zone, [[-8000.0, -36_000.0]; 2]).is_some(), "{zone}");
        }
        for unknown in ["EPSG:1", "EPSG:99999", "somewhere"] {
            assert_eq!(locate(unknown, delft), None, "{unknown}");
        }
    }
}
