//! Where places of a city's coordinate system are on Earth, for programs that write baked cities in other formats.

use super::crs::geoid::Geoid;
use super::crs::{self, Axes};
use proj4rs::Proj;
use proj4rs::adaptors::transform_vertex_2d;
use proj4rs::transform::transform;

/// A projected coordinate system by the name that a manifest has.
pub struct EarthPlace {
    plane: Proj,
    degrees: Proj,
    geocentric: Proj,
    epsg: Option<u32>,
    definition: Option<(u32, String, [f64; 2])>,
    /// Whether the registry has the northing first.
    is_north_first: bool,
    /// From what heights are measured; `None` for the ellipsoid.
    geoid: Option<Geoid>,
}

impl EarthPlace {
    /// `None` if the system is not known.
    #[must_use]
    pub fn of(crs: &str) -> Option<Self> {
        let horizontal = crs::resolve(crs).ok()?.horizontal;
        let definition = horizontal.definition()?;
        let base = horizontal.code.and_then(crs::projected_base);
        Some(Self {
            plane: definition.proj().ok()?,
            degrees: Proj::from_proj_string("+proj=longlat +datum=WGS84").ok()?,
            geocentric: Proj::from_proj_string("+proj=geocent +datum=WGS84").ok()?,
            epsg: horizontal.code,
            is_north_first: horizontal.axes == Axes::NORTH_EAST,
            definition: base
                .zip(definition.ellipsoid_m())
                // On a sphere the inverse flattening is infinite.
                .map(|(base, [a, b])| (base, definition.text(), [a, a / (a - b)])),
            geoid: None,
        })
    }

    /// With heights above sea level, by EGM96, where a city's are. Where it does not know from what its own are measured, zero is the
    /// ellipsoid: there globes show their map.
    #[must_use]
    pub fn above_sea_level(self, are_heights: bool) -> Self {
        // The bundled grid is read in the tests.
        Self { geoid: are_heights.then(|| Geoid::egm96(None).ok()).flatten(), ..self }
    }

    /// What is between heights of the city and those above the ellipsoid.
    fn undulation_m(&self, [longitude, latitude]: [f64; 2]) -> Option<f64> {
        self.geoid.as_ref().map_or(Some(0.0), |geoid| geoid.undulation_m(longitude, latitude))
    }

    /// EPSG code of the plane's system, without heights.
    #[must_use]
    pub fn epsg(&self) -> Option<u32> {
        self.epsg
    }

    /// Whether coordinates in the order of the registry have the northing first.
    #[must_use]
    pub fn is_north_first(&self) -> bool {
        self.is_north_first
    }

    /// EPSG code of the geographic system that is projected, the definition for PROJ, and semi-major axis in metres and inverse
    /// flattening of the ellipsoid.
    #[must_use]
    pub fn definition(&self) -> Option<(u32, &str, [f64; 2])> {
        self.definition.as_ref().map(|(base, text, ellipsoid)| (*base, text.as_str(), *ellipsoid))
    }

    /// Longitude and latitude in degrees; `None` where the projection does not reach.
    #[must_use]
    pub fn lon_lat(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let (longitude, latitude) = transform_vertex_2d(&self.plane, &self.degrees, (x, y)).ok()?;
        let degrees = [longitude.to_degrees(), latitude.to_degrees()];
        (degrees[0].abs() <= 180.0 && degrees[1].abs() <= 90.0).then_some(degrees)
    }

    /// Place on the map of a longitude and latitude in degrees; `None` where the projection does not reach.
    #[must_use]
    pub fn on_map(&self, degrees: [f64; 2]) -> Option<[f64; 2]> {
        let [longitude, latitude] = degrees.map(f64::to_radians);
        let (x, y) = transform_vertex_2d(&self.degrees, &self.plane, (longitude, latitude)).ok()?;
        (x.is_finite() && y.is_finite()).then_some([x, y])
    }

    /// South-west and north-east corner of the box on the map around west, south, east and north in degrees; `None` where the projection
    /// does not reach.
    #[must_use]
    pub fn box_on_map(&self, [west, south, east, north]: [f64; 4]) -> Option<[[f64; 2]; 2]> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for degrees in border([west, south], [east, north]) {
            let place = self.on_map(degrees)?;
            (low, high) = ([0, 1].map(|k| low[k].min(place[k])), [0, 1].map(|k| high[k].max(place[k])));
        }
        Some([low, high])
    }

    /// West, south, lowest, east, north and highest of a box on the map: degrees, and metres above the ellipsoid. West is greater than east
    /// if the box crosses the meridian of 180 degrees. `None` where the projection does not reach.
    #[must_use]
    pub fn extent(&self, [low, high]: [[f64; 3]; 2]) -> Option<[f64; 6]> {
        let middle = self.lon_lat([0, 1].map(|k| 0.5 * (low[k] + high[k])))?;
        let (mut least, mut most) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in border([low[0], low[1]], [high[0], high[1]]) {
            let [longitude, latitude] = self.lon_lat(point)?;
            let undulation_m = self.undulation_m([longitude, latitude])?;
            // From the middle, longitudes on both sides of 180 degrees have an order.
            let place = [within_half_turn(longitude - middle[0]), latitude, undulation_m];
            (least, most) = ([0, 1, 2].map(|k| least[k].min(place[k])), [0, 1, 2].map(|k| most[k].max(place[k])));
        }
        let [west, east] = [least[0], most[0]].map(|offset| within_half_turn(middle[0] + offset));
        Some([west, least[1], low[2] + least[2], east, most[1], high[2] + most[2]])
    }

    /// Metres from the centre of the Earth of a place with a height; `None` where the projection does not reach.
    #[must_use]
    pub fn geocentric(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 3]> {
        let [longitude, latitude] = self.lon_lat([x, y])?;
        let z = z + self.undulation_m([longitude, latitude])?;
        let mut point = (longitude.to_radians(), latitude.to_radians(), z);
        transform(&self.degrees, &self.geocentric, &mut point).ok()?;
        let all = [point.0, point.1, point.2];
        all.iter().all(|v| v.is_finite()).then_some(all)
    }
}

/// Points along the sides of a rectangle: in another system, the sides are curves.
fn border(low: [f64; 2], high: [f64; 2]) -> impl Iterator<Item = [f64; 2]> {
    /// Parts of each side.
    const STEPS: u32 = 16;
    (0..=STEPS).flat_map(move |step| {
        let [x, y] = [0, 1].map(|k| low[k] + (high[k] - low[k]) * f64::from(step) / f64::from(STEPS));
        [[x, low[1]], [x, high[1]], [low[0], y], [high[0], y]]
    })
}

/// The same direction in degrees, from -180 to below 180.
fn within_half_turn(degrees: f64) -> f64 {
    (degrees + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delft_is_where_it_is() {
        let place = EarthPlace::of("EPSG:7415").unwrap();
        assert_eq!(place.epsg(), Some(28992));
        let [longitude, latitude] = place.lon_lat([84_498.0, 447_540.0]).unwrap();
        assert!((longitude - 4.3609).abs() < 1e-3 && (latitude - 52.0123).abs() < 1e-3, "{longitude} {latitude}");
        let [x, y] = place.on_map([longitude, latitude]).unwrap();
        assert!((x - 84_498.0).abs() < 1e-3 && (y - 447_540.0).abs() < 1e-3, "{x} {y}");
        let [low, high] =
            place.box_on_map([longitude - 0.001, latitude - 0.001, longitude + 0.001, latitude + 0.001]).unwrap();
        // 68.6 m of the parallel and 111.3 m of the meridian to each side, turned by 0.8 degrees.
        assert!(
            (high[0] - low[0] - 2.0 * 70.2).abs() < 1.0 && (high[1] - low[1] - 2.0 * 112.2).abs() < 1.0,
            "{low:?} {high:?}"
        );
        let [x, y, z] = place.geocentric([84_498.0, 447_540.0, 45.0]).unwrap();
        // 6,364.5 km from the centre at this latitude.
        assert!(((x * x + y * y + z * z).sqrt() - 6_364_900.0).abs() < 1500.0);
        assert!((y.atan2(x).to_degrees() - longitude).abs() < 1e-9);
        // The sea is 43 m above the ellipsoid.
        let [u, v, w] =
            EarthPlace::of("EPSG:7415").unwrap().above_sea_level(true).geocentric([84_498.0, 447_540.0, 0.0]).unwrap();
        assert!((f64::hypot(f64::hypot(u - x, v - y), w - z) - 2.0).abs() < 0.5, "{u} {v} {w}");
        let (base, text, [axis, inverse_flattening]) = place.definition().unwrap();
        assert_eq!((base, axis.round()), (4289, 6_377_397.0));
        // Bessel 1841.
        assert!((inverse_flattening - 299.152_812_8).abs() < 1e-5, "{inverse_flattening}");
        assert!(text.contains("+proj=sterea"), "{text}");
        assert!(EarthPlace::of("nowhere").is_none());
        // New Zealand's grid.
        assert!(!place.is_north_first() && EarthPlace::of("EPSG:2193").unwrap().is_north_first());
    }

    #[test]
    fn an_extent_has_heights_above_the_ellipsoid_and_an_order_of_longitudes() {
        let place = EarthPlace::of("EPSG:7415").unwrap().above_sea_level(true);
        let (low, high) = ([84_400.0, 447_400.0, -2.0], [84_600.0, 447_600.0, 45.0]);
        let [west, south, lowest, east, north, highest] = place.extent([low, high]).unwrap();
        let [longitude, latitude] = place.lon_lat([84_500.0, 447_500.0]).unwrap();
        assert!(west < longitude && longitude < east && east - west < 0.004, "{west} {east}");
        assert!(south < latitude && latitude < north && north - south < 0.003, "{south} {north}");
        // The geoid is about 43 m above the ellipsoid in Delft.
        assert!((lowest - 41.0).abs() < 2.0 && (highest - 88.0).abs() < 2.0, "{lowest} {highest}");

        // UTM zone 1, a kilometre of it on the other side of 180 degrees.
        let place = EarthPlace::of("EPSG:32701").unwrap();
        let [x, y] = place.on_map([-180.0, -17.0]).unwrap();
        let [west, .., east, _, _] = place.extent([[x - 1000.0, y, 0.0], [x + 1000.0, y + 1000.0, 9.0]]).unwrap();
        assert!(west > 179.9 && east < -179.9, "{west} {east}");
    }
}
