//! Positions on the ellipsoid of WGS84, from the centre of the Earth, and around a point.

const EQUATORIAL_RADIUS_M: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const ECCENTRICITY_2: f64 = FLATTENING * (2.0 - FLATTENING);
/// Nearer to the poles, a metre to the east has as many degrees as here.
const MIN_COSINE: f64 = 1e-6;
/// Positions nearer to the centre of the Earth have no latitude.
const MIN_RADIUS_M: f64 = 1e6;
const MAX_ITERATIONS: usize = 10;
/// A tenth of a micrometre on the ground.
const LATITUDE_TOLERANCE_RAD: f64 = 1e-14;

/// Degrees of a metre to the east and to the north at a latitude, on the ellipsoid.
pub fn degrees_per_metre(latitude_deg: f64) -> [f64; 2] {
    let (sin, cos) = libm::sincos(latitude_deg.to_radians());
    let flat = 1.0 - ECCENTRICITY_2 * sin * sin;
    // The radii of the circle of latitude's normal section, and of the meridian.
    let normal_m = EQUATORIAL_RADIUS_M / flat.sqrt();
    let meridian_m = normal_m * (1.0 - ECCENTRICITY_2) / flat;
    [normal_m * cos.max(MIN_COSINE), meridian_m].map(|radius_m| (1.0 / radius_m).to_degrees())
}

/// Longitude, latitude and height above the ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Geodetic {
    pub(super) longitude_rad: f64,
    pub(super) latitude_rad: f64,
    pub(super) height_m: f64,
}

impl Geodetic {
    /// From metres from the centre of the Earth. `None` if the position is deep within it or not finite.
    ///
    /// The iteration of Bowring, B. R. (1976), Transformation from spatial to geographical coordinates, Survey Review
    /// 23, on the parametric latitude; it converges in two or three steps near the Earth.
    pub(super) fn from_centre([x, y, z]: [f64; 3]) -> Option<Self> {
        let radius_m = libm::hypot(x, y);
        if !(libm::hypot(radius_m, z) >= MIN_RADIUS_M && libm::hypot(radius_m, z) <= 1e9) {
            return None;
        }
        let polar_radius_m = EQUATORIAL_RADIUS_M * (1.0 - FLATTENING);
        let second_2 = ECCENTRICITY_2 / (1.0 - ECCENTRICITY_2);
        let mut parametric = libm::atan2(z * EQUATORIAL_RADIUS_M, radius_m * polar_radius_m);
        let mut latitude_rad = f64::NAN;
        for _ in 0..MAX_ITERATIONS {
            let (sin, cos) = libm::sincos(parametric);
            let next = libm::atan2(
                z + second_2 * polar_radius_m * sin.powi(3),
                radius_m - ECCENTRICITY_2 * EQUATORIAL_RADIUS_M * cos.powi(3),
            );
            let is_done = (next - latitude_rad).abs() <= LATITUDE_TOLERANCE_RAD;
            latitude_rad = next;
            if is_done {
                break;
            }
            let (sin, cos) = libm::sincos(latitude_rad);
            parametric = libm::atan2((1.0 - FLATTENING) * sin, cos);
        }
        let (sin, cos) = libm::sincos(latitude_rad);
        let normal_m = EQUATORIAL_RADIUS_M / (1.0 - ECCENTRICITY_2 * sin * sin).sqrt();
        // Exact to second order in the latitude's error, also at the poles.
        let height_m = radius_m * cos + z * sin - EQUATORIAL_RADIUS_M * EQUATORIAL_RADIUS_M / normal_m;
        Some(Self { longitude_rad: libm::atan2(y, x), latitude_rad, height_m })
    }

    /// Metres from the centre of the Earth.
    pub(super) fn to_centre(self) -> [f64; 3] {
        let (sin_lat, cos_lat) = libm::sincos(self.latitude_rad);
        let (sin_lon, cos_lon) = libm::sincos(self.longitude_rad);
        let normal_m = EQUATORIAL_RADIUS_M / (1.0 - ECCENTRICITY_2 * sin_lat * sin_lat).sqrt();
        let radius_m = (normal_m + self.height_m) * cos_lat;
        [radius_m * cos_lon, radius_m * sin_lon, (normal_m * (1.0 - ECCENTRICITY_2) + self.height_m) * sin_lat]
    }

    /// Metres from the centre of the Earth of a position that is `local` metres east, north and up of this one.
    pub(super) fn local_to_centre(self, [east, north, up]: [f64; 3]) -> [f64; 3] {
        let (sin_lat, cos_lat) = libm::sincos(self.latitude_rad);
        let (sin_lon, cos_lon) = libm::sincos(self.longitude_rad);
        let [x, y, z] = self.to_centre();
        // Outwards from the axis.
        let out = up * cos_lat - north * sin_lat;
        [x + out * cos_lon - east * sin_lon, y + out * sin_lon + east * cos_lon, z + north * cos_lat + up * sin_lat]
    }
}
