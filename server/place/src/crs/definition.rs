//! Definitions of horizontal systems as strings for PROJ, in a normal form that `proj4rs` computes right.

use proj4rs::Proj;
use proj4rs::adaptors::transform_vertex_2d;

/// Parameters of projections. Everything else, such as names of grid files, is left out or has its own meaning.
const PARAMETERS: [&str; 19] = [
    "lat_0", "lon_0", "lat_1", "lat_2", "lat_ts", "lonc", "alpha", "gamma", "k", "k_0", "x_0", "y_0", "azi", "no_uoff",
    "no_off", "guam", "h", "lon_1", "lon_2",
];
/// Radii and shapes of ellipsoids.
const ELLIPSOID: [&str; 8] = ["ellps", "a", "b", "rf", "f", "R", "es", "R_A"];
/// Ellipsoids of modern datums, which are within two metres of WGS84.
const MODERN_ELLIPSOIDS: [&str; 2] = ["GRS80", "WGS84"];
/// Datums by the names that PROJ has for them: ellipsoid and `+towgs84`. For NAD27 the mean of the United States,
/// EPSG:1173; the grids of `proj4rs` are not bundled.
const DATUMS: [(&str, &str, &str); 10] = [
    ("WGS84", "WGS84", "0,0,0"),
    ("NAD83", "GRS80", "0,0,0"),
    ("NAD27", "clrk66", "-8,160,176"),
    ("potsdam", "bessel", "598.1,73.7,418.2,0.202,0.045,-2.455,6.7"),
    ("carthage", "clrk80ign", "-263,6,431"),
    ("hermannskogel", "bessel", "577.326,90.129,463.919,5.137,1.474,5.297,2.4232"),
    ("ire65", "mod_airy", "482.53,-130.596,564.557,-1.042,-0.214,-0.631,8.15"),
    ("nzgd49", "intl", "59.47,-5.04,187.44,0.47,-0.1,1.024,-4.5993"),
    ("OSGB36", "airy", "446.448,-125.157,542.06,0.1502,0.247,0.8421,-20.4894"),
    ("GGRS87", "GRS80", "-199.87,74.79,246.62"),
];
/// Units of lengths by the names that PROJ has for them.
const UNITS_M: [(&str, f64); 12] = [
    ("m", 1.0),
    ("km", 1000.0),
    ("cm", 0.01),
    ("mm", 0.001),
    ("ft", 0.3048),
    ("us-ft", 1200.0 / 3937.0),
    ("yd", 0.9144),
    ("ind-ft", 0.304_798_41),
    ("ind-yd", 0.914_395_23),
    ("link", 0.201_168),
    ("ch", 20.1168),
    ("us-ch", 79200.0 / 3937.0),
];
/// Projections of the whole world, whose lengths are far from true.
const WORLD_PROJECTIONS: [&str; 11] =
    ["webmerc", "eqc", "cea", "eqearth", "moll", "robin", "sinu", "mill", "geos", "ortho", "gnom"];

/// Systems whose coordinates differ by less are the same: GRS80 and WGS84 differ by less than a millimetre, and
/// published parameters are rounded.
const SAME_POSITION_M: f64 = 0.01;
/// Longitudes relative to the central meridian, and latitudes, at which projections are compared.
const SAMPLES_DEG: [[f64; 2]; 4] = [[1.0, 35.0], [-2.0, 50.0], [0.5, -30.0], [1.5, 80.0]];

/// Parameters of a shift to WGS84: three translations in metres, three rotations in arc seconds (position vector), and
/// a scale in parts per million.
pub(super) type Shift = [f64; 7];

/// A horizontal system.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Definition {
    projection: String,
    parameters: Vec<String>,
    ellipsoid: String,
    prime_meridian: Option<String>,
    /// `None` if the shift of the datum is unknown.
    shift: Option<Shift>,
    /// Whether the string has the shift. It is taken to be none otherwise for ellipsoids of modern datums.
    has_own_shift: bool,
    /// Metres in a unit of its coordinates; 1 for geographic systems.
    pub unit_m: f64,
}

impl Definition {
    /// Parses a string such as `+proj=utm +zone=32 +ellps=GRS80`. Fails with the reason if it is not understood.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut definition = Self { unit_m: 1.0, ..Self::default() };
        let mut utm = Utm::default();
        let mut has_null_grid = false;
        for token in text.split_ascii_whitespace() {
            let (key, value) =
                token.trim_start_matches('+').split_once('=').unwrap_or((token.trim_start_matches('+'), ""));
            match key {
                "proj" => definition.projection = value.to_owned(),
                "zone" => utm.zone = value.parse().ok(),
                "south" => utm.is_south = true,
                "nadgrids" => has_null_grid |= value == "@null",
                _ => definition.set(key, value)?,
            }
        }
        if definition.projection == "utm" {
            definition.expand_utm(utm)?;
        }
        if definition.ellipsoid.is_empty() {
            "+ellps=WGS84".clone_into(&mut definition.ellipsoid);
        }
        definition.has_own_shift = definition.shift.is_some();
        if definition.shift.is_none() && (has_null_grid || definition.is_modern() || definition.is_sphere()) {
            definition.shift = Some([0.0; 7]);
        }
        definition.proj()?;
        Ok(definition)
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), String> {
        match key {
            "datum" => {
                let datum = DATUMS.iter().find(|(name, ..)| name.eq_ignore_ascii_case(value));
                let (_, ellipsoid, shift) = datum.ok_or_else(|| format!("the datum {value} is not known"))?;
                self.ellipsoid = format!("+ellps={ellipsoid}");
                self.shift = parse_shift(shift);
            }
            "towgs84" => self.shift = Some(parse_shift(value).ok_or_else(|| format!("+towgs84={value} is invalid"))?),
            "pm" => self.prime_meridian = (value != "greenwich").then(|| value.to_owned()),
            "units" => self.unit_m = unit_m(value).ok_or_else(|| format!("the unit {value} is not known"))?,
            "to_meter" => self.unit_m = positive(value)?,
            _ if ELLIPSOID.contains(&key) => {
                if !self.ellipsoid.is_empty() {
                    self.ellipsoid.push(' ');
                }
                self.ellipsoid.push_str(&if value.is_empty() { format!("+{key}") } else { format!("+{key}={value}") });
            }
            _ if PARAMETERS.contains(&key) => {
                let is_valid = value.is_empty() || value.parse().is_ok_and(f64::is_finite);
                if !is_valid {
                    return Err(format!("+{key}={value} is not a number"));
                }
                self.parameters.push(if value.is_empty() { format!("+{key}") } else { format!("+{key}={value}") });
            }
            _ => {}
        }
        Ok(())
    }

    /// The zone as a transverse Mercator projection, so that equal systems have equal strings.
    fn expand_utm(&mut self, utm: Utm) -> Result<(), String> {
        let zone = utm.zone.filter(|zone| (1..=60).contains(zone)).ok_or("the zone of UTM is not 1 to 60")?;
        let false_northing_m = if utm.is_south { 10_000_000 } else { 0 };
        "tmerc".clone_into(&mut self.projection);
        let parameters = format!("+lat_0=0 +lon_0={} +k=0.9996 +x_0=500000 +y_0={false_northing_m}", zone * 6 - 183);
        self.parameters = parameters.split(' ').map(str::to_owned).collect();
        Ok(())
    }

    fn is_modern(&self) -> bool {
        let name = self.ellipsoid.strip_prefix("+ellps=").unwrap_or_default();
        MODERN_ELLIPSOIDS.contains(&name)
            || self
                .ellipsoid_m()
                .is_some_and(|[a, b]| (a - 6_378_137.0).abs() < 0.01 && (b - 6_356_752.314).abs() < 0.01)
    }

    fn is_sphere(&self) -> bool {
        self.ellipsoid_m().is_some_and(|[a, b]| a == b)
    }

    /// Equatorial and polar radius.
    pub fn ellipsoid_m(&self) -> Option<[f64; 2]> {
        let proj = Proj::from_proj_string(&format!("+proj=longlat {}", self.ellipsoid)).ok()?;
        let (a, b) = proj.ellipse_parameters();
        Some([a, b])
    }

    /// The string for PROJ: coordinates in metres (or degrees), east and north.
    pub fn text(&self) -> String {
        let mut text = format!("+proj={}", self.projection);
        for parameter in &self.parameters {
            text.push(' ');
            text.push_str(parameter);
        }
        text.push(' ');
        text.push_str(&self.ellipsoid);
        if let Some(meridian) = &self.prime_meridian {
            text.push_str(" +pm=");
            text.push_str(meridian);
        }
        match self.shift {
            Some(shift) if self.is_sphere() && shift == [0.0; 7] => text.push_str(" +nadgrids=@null"),
            Some(shift) => {
                let numbers: Vec<String> = shift.iter().map(f64::to_string).collect();
                let count = if shift[3..] == [0.0; 4] { 3 } else { 7 };
                text.push_str(" +towgs84=");
                text.push_str(&numbers[..count].join(","));
            }
            None => {}
        }
        text
    }

    /// The projection. Fails with the reason if it is not supported.
    pub fn proj(&self) -> Result<Proj, String> {
        let proj = Proj::from_proj_string(&self.text());
        let proj = proj.map_err(|error| format!("the projection {} is not supported ({error})", self.projection))?;
        match self.is_geographic() || self.is_geocentric() || proj.has_inverse() && proj.has_forward() {
            true => Ok(proj),
            false => Err(format!("the projection {} is not supported", self.projection)),
        }
    }

    /// Whether coordinates are degrees.
    pub fn is_geographic(&self) -> bool {
        matches!(&*self.projection, "longlat" | "latlong" | "lonlat" | "latlon")
    }

    /// Whether coordinates are metres from the middle of the Earth.
    pub fn is_geocentric(&self) -> bool {
        matches!(&*self.projection, "geocent" | "cart")
    }

    /// Whether it is the projection of Czechia and Slovakia, whose axes point south and west.
    pub fn is_krovak(&self) -> bool {
        self.projection == "krovak"
    }

    /// Whether lengths on the map are nearly true. Not so in Web Mercator and other maps of the world.
    pub fn is_metric(&self) -> bool {
        let is_scaled = self.parameters.iter().any(|parameter| {
            let scale = parameter.strip_prefix("+k=").or_else(|| parameter.strip_prefix("+k_0="));
            scale.and_then(|scale| scale.parse().ok()).is_some_and(|scale: f64| scale != 1.0)
        });
        let is_world = WORLD_PROJECTIONS.contains(&&*self.projection) || self.projection == "merc" && !is_scaled;
        !(self.is_geographic() || self.is_geocentric() || is_world)
    }

    /// The shift of its datum to WGS 84, if it states one.
    pub fn shift(&self) -> Option<Shift> {
        self.shift
    }

    /// The shift, if the string has it.
    pub fn own_shift(&self) -> Option<Shift> {
        self.shift.filter(|_| self.has_own_shift)
    }

    /// The same with another shift.
    pub fn with_shift(mut self, shift: Option<Shift>) -> Self {
        self.shift = shift;
        self
    }

    /// The same system with coordinates in metres.
    pub fn in_metres(mut self) -> Self {
        self.unit_m = 1.0;
        self
    }

    /// Whether its unit has this length in metres.
    pub fn unit_m_is(&self, unit_m: f64) -> bool {
        (self.unit_m / unit_m - 1.0).abs() < 1e-7
    }

    /// Whether it is Web Mercator: the ellipsoid's coordinates projected as if they were on a sphere.
    pub fn is_pseudo_mercator(&self) -> bool {
        self.projection == "merc" && self.is_sphere() && self.ellipsoid_m().is_some_and(|[a, _]| a == 6_378_137.0)
    }

    /// Whether positions have the same coordinates in both up to a centimetre, datums and units aside.
    pub fn is_same_projection(&self, other: &Self) -> bool {
        let (left, right) = (self.clone().with_shift(None), other.clone().with_shift(None));
        if left.is_geographic() || right.is_geographic() || left.is_geocentric() || right.is_geocentric() {
            return false;
        }
        let ([a, b], [other_a, other_b]) = match (left.ellipsoid_m(), right.ellipsoid_m()) {
            (Some(ellipsoid), Some(other)) => (ellipsoid, other),
            _ => return false,
        };
        if (a - other_a).abs() > 0.01 || (b - other_b).abs() > 0.01 {
            return false;
        }
        let (Ok(from), Ok(to)) = (Proj::from_proj_string(&left.text()), Proj::from_proj_string(&right.text())) else {
            return false;
        };
        let Ok(degrees) = Proj::from_proj_string(&format!("+proj=longlat {}", left.ellipsoid)) else { return false };
        let middle = from.longitude_of_origin() + from.from_greenwich();
        let mut compared = 0;
        for [longitude, latitude] in SAMPLES_DEG {
            let position = (middle + longitude.to_radians(), latitude.to_radians());
            let (left, right) =
                (transform_vertex_2d(&degrees, &from, position), transform_vertex_2d(&degrees, &to, position));
            match (left, right) {
                (Ok(left), Ok(right)) if libm::hypot(left.0 - right.0, left.1 - right.1) <= SAME_POSITION_M => {
                    compared += 1
                }
                // Both fail where a projection is not defined.
                (Err(_), Err(_)) => {}
                _ => return false,
            }
        }
        compared >= 2
    }

    /// Whether the datum is shifted alike.
    pub fn has_same_shift(&self, other: &Self) -> bool {
        match (self.shift, other.shift) {
            (Some(left), Some(right)) => left.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-6),
            (None, None) => true,
            _ => false,
        }
    }
}

#[derive(Default)]
struct Utm {
    zone: Option<i32>,
    is_south: bool,
}

/// Parses three or seven numbers with commas between.
pub(super) fn parse_shift(text: &str) -> Option<Shift> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let numbers = numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite()))?;
    match numbers[..] {
        [x, y, z] => Some([x, y, z, 0.0, 0.0, 0.0, 0.0]),
        [x, y, z, rx, ry, rz, scale] => Some([x, y, z, rx, ry, rz, scale]),
        _ => None,
    }
}

pub(super) fn unit_m(name: &str) -> Option<f64> {
    match name {
        "degrees" => Some(1.0),
        _ => UNITS_M.iter().find(|(known, _)| *known == name).map(|(_, metres)| *metres),
    }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite() && *value > 1e-6 && *value < 1e6);
    value.ok_or_else(|| format!("+to_meter={text} is invalid"))
}
