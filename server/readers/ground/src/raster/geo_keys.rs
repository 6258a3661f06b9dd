//! The coordinate system of GeoTIFF (OGC 19-008), which LAS files have too.

use super::facts::RasterCrs;
use insula_place::crs::{System, VerticalDatum, resolve};
use insula_source::units::metres_of;

/// Number of the tag, or of the record, with the keys.
pub(super) const GEO_KEYS: u16 = 34735;
/// With the numbers that keys refer to.
pub(super) const GEO_REALS: u16 = 34736;
/// With the texts that keys refer to.
pub(super) const GEO_TEXTS: u16 = 34737;
pub(super) const RASTER_TYPE_KEY: u64 = 1025;

const MODEL_TYPE_KEY: u64 = 1024;
const CITATION_KEY: u64 = 1026;
const GEOGRAPHIC_TYPE_KEY: u64 = 2048;
const GEOGRAPHIC_CITATION_KEY: u64 = 2049;
const PROJECTED_TYPE_KEY: u64 = 3072;
const PROJECTED_CITATION_KEY: u64 = 3073;
const DATUM_KEY: u64 = 2050;
const ELLIPSOID_KEY: u64 = 2056;
const MERIDIAN_KEY: u64 = 2061;
const SHIFT_KEY: u64 = 2062;
const RADIUS_KEY: u64 = 2057;
const INVERSE_FLATTENING_KEY: u64 = 2059;
/// In place of a code.
const USER_DEFINED: u64 = 32767;
const PROJECTION_KEY: u64 = 3074;
const METHOD_KEY: u64 = 3075;
const LINEAR_UNITS_KEY: u64 = 3076;
const LINEAR_UNIT_SIZE_KEY: u64 = 3077;
const FIRST_PARALLEL_KEY: u64 = 3078;
const VERTICAL_TYPE_KEY: u64 = 4096;
const VERTICAL_UNITS_KEY: u64 = 4099;
/// Keys of parameters, best first, with their names in PROJ.
const PARAMETERS: [(&str, &[u64]); 9] = [
    ("lat_0", &[3081, 3085, 3089]),
    ("lon_0", &[3095, 3080, 3084, 3088]),
    ("lat_1", &[FIRST_PARALLEL_KEY]),
    ("lat_2", &[3079]),
    ("alpha", &[3094]),
    ("gamma", &[3096]),
    ("k_0", &[3092, 3093]),
    ("x_0", &[3082, 3086, 3090]),
    ("y_0", &[3083, 3087, 3091]),
];
/// Methods of projections by their numbers, with their names in PROJ. Those that are not supported are refused by name.
const METHODS: [(u64, &str); 28] = [
    (1, "tmerc"),
    (2, "alsk"),
    (OBLIQUE_MERCATOR_A, OBLIQUE_MERCATOR),
    (4, "labrd"),
    (5, "somerc"),
    (7, "merc"),
    (8, "lcc"),
    (LAMBERT_1SP, "lcc"),
    (10, "laea"),
    (11, "aea"),
    (12, "aeqd"),
    (13, "eqdc"),
    (14, "stere"),
    (POLAR_STEREOGRAPHIC, "stere"),
    (16, "sterea"),
    (17, "eqc"),
    (18, "cass"),
    (19, "gnom"),
    // That of PROJ is spherical, unlike here.
    (20, "miller_cylindrical"),
    (21, "ortho"),
    (22, "poly"),
    (23, "robin"),
    (24, "sinu"),
    (25, "vandg"),
    (26, "nzmg"),
    (27, "tmerc_south_orientated"),
    (28, "cea"),
    (9815, OBLIQUE_MERCATOR),
];
const OBLIQUE_MERCATOR: &str = "omerc";
const OBLIQUE_MERCATOR_A: u64 = 3;
const LAMBERT_1SP: u64 = 9;
const POLAR_STEREOGRAPHIC: u64 = 15;
/// What stands before well-known text in a citation.
const ESRI_TEXT: &str = "ESRI PE String = ";
const CITATIONS: [u64; 3] = [PROJECTED_CITATION_KEY, CITATION_KEY, GEOGRAPHIC_CITATION_KEY];
/// Numbers of vertical datums, which GeoTIFF 1.0 had for systems, with those of the systems.
const VERTICAL_DATUMS: [(u64, u64); 3] = [(5101, 5701), (5102, 5702), (5103, 5703)];
const PROJECTED_MODEL: u64 = 1;
const GEOGRAPHIC_MODEL: u64 = 2;
const GEOCENTRIC_MODEL: u64 = 3;

/// Keys with their numbers and texts.
#[derive(Default)]
pub(super) struct GeoKeys {
    /// A directory: each key has four numbers.
    pub(super) keys: Vec<u64>,
    pub(super) reals: Vec<f64>,
    pub(super) texts: Vec<u8>,
}

impl GeoKeys {
    /// The coordinate system. Systems that the file defines by itself, and that are not understood, have only their
    /// citation, or what is understood of their projection in its place.
    pub(super) fn crs(&self) -> RasterCrs {
        let code = |key| self.number(key).filter(|code| (1024..32767).contains(code));
        let epsg = |key| code(key).map(|code| format!("EPSG:{code}"));
        let projected = || epsg(PROJECTED_TYPE_KEY).or_else(|| self.esri_text()).or_else(|| self.projection());
        let geographic = || epsg(GEOGRAPHIC_TYPE_KEY).or_else(|| self.esri_text());
        let horizontal = match self.number(MODEL_TYPE_KEY) {
            Some(PROJECTED_MODEL) => projected(),
            Some(GEOGRAPHIC_MODEL) => geographic(),
            Some(GEOCENTRIC_MODEL) => None,
            // Esri writes models of its own; the base of a projection is not its system.
            _ => projected().or_else(|| geographic().filter(|_| self.number(PROJECTED_TYPE_KEY).is_none())),
        };
        // Files beside the raster may tell more than a projection that is not supported.
        let (horizontal, refused) = match horizontal {
            Some(name) if name.starts_with('+') && resolve(&name).is_err() => (None, Some(name)),
            horizontal => (horizontal, None),
        };
        // Numbers of GeoTIFF 1.0 for heights above one of its ellipsoids.
        let is_ellipsoidal = code(VERTICAL_TYPE_KEY).is_some_and(|code| (5001..=5033).contains(&code));
        let of_datum = |code| VERTICAL_DATUMS.into_iter().find_map(|(datum, system)| (datum == code).then_some(system));
        let vertical = code(VERTICAL_TYPE_KEY).filter(|_| !is_ellipsoidal);
        // That of a system with a code is known by its name.
        let is_own = horizontal.as_ref().is_some_and(|name| !name.starts_with("EPSG:"));
        let unit_m = vertical.filter(|_| is_own).map(|code| VerticalDatum::from_code(code as u32).unit_m);
        let other_unit = horizontal.as_deref().filter(|_| !is_own).and_then(|name| self.other_unit(name));
        RasterCrs {
            other_unit: other_unit.or_else(|| self.odd_height_unit()),
            horizontal,
            vertical: vertical.map(|code| format!("EPSG:{}", of_datum(code).unwrap_or(code))),
            is_ellipsoidal,
            height_unit_m: self.number(VERTICAL_UNITS_KEY).and_then(|code| metres_of(&code.to_string())).or(unit_m),
            citation: refused.or_else(|| CITATIONS.into_iter().find_map(|key| self.text(key))),
        }
    }

    /// Warning about an unknown unit of heights.
    fn odd_height_unit(&self) -> Option<String> {
        let code =
            self.number(VERTICAL_UNITS_KEY).filter(|code| *code > 0 && metres_of(&code.to_string()).is_none())?;
        Some(format!(
            "its unit of heights has the number {code}, which is not known; they are taken in that of the system"
        ))
    }

    /// What to tell if a key gives a projected system with a code another unit than it has.
    fn other_unit(&self, system: &str) -> Option<String> {
        let own_m = metres_of(&self.number(LINEAR_UNITS_KEY)?.to_string())?;
        let System::Projected(definition) = resolve(system).ok()?.horizontal.system else { return None };
        let unit_m = definition.unit_m;
        (!definition.unit_m_is(own_m)).then(|| {
            format!(
                "its unit of coordinates is {own_m} m by its key, but {unit_m} m by {system}, which counts; if it is not \
                 in its place, give it the right system with gdal_translate -a_srs"
            )
        })
    }

    /// Well-known text that Esri has in place of a citation, if it is understood.
    fn esri_text(&self) -> Option<String> {
        let texts = CITATIONS.into_iter().filter_map(|key| self.text(key));
        let mut own = texts.filter_map(|text| Some(text.split_once(ESRI_TEXT)?.1.split('|').next()?.trim().to_owned()));
        own.find(|text| resolve(text).is_ok())
    }

    /// A projection that the file defines by itself, for PROJ; what PROJ does not have is in it by a name that tells. `None` without a
    /// method, or without an ellipsoid.
    fn projection(&self) -> Option<String> {
        let zone = self.number(PROJECTION_KEY).filter(|code| *code != USER_DEFINED);
        let method = match (zone, self.number(METHOD_KEY)) {
            (Some(code @ 16_001..=16_060), _) => format!("utm +zone={}", code - 16_000),
            (Some(code @ 16_101..=16_160), _) => format!("utm +zone={} +south", code - 16_100),
            (_, Some(number)) => match METHODS.iter().find(|(known, _)| *known == number) {
                // As Switzerland has it.
                Some((_, OBLIQUE_MERCATOR)) if self.is_right(3094) && self.is_right(3096) => "somerc".to_owned(),
                Some((_, method)) => (*method).to_owned(),
                None => return Some(format!("+proj=method_{number}_of_GeoTIFF")),
            },
            (Some(code), None) => return Some(format!("+proj=EPSG_{code}")),
            (None, None) => return None,
        };
        let metres = |code: u64| metres_of(&code.to_string()).or_else(|| self.real(LINEAR_UNIT_SIZE_KEY));
        let unit_m = self.number(LINEAR_UNITS_KEY).map_or(Some(1.0), metres);
        let unit = match unit_m {
            Some(1.0) => "+units=m".to_owned(),
            Some(unit_m) => format!("+to_meter={unit_m}"),
            None => "+units=of_the_file".to_owned(),
        };
        let parameters = if method.starts_with("utm ") { String::new() } else { self.parameters(&method, unit_m) };
        Some(format!("+proj={method} {} {unit}{parameters}", self.datum()?))
    }

    fn is_right(&self, angle_key: u64) -> bool {
        self.real(angle_key).is_some_and(|angle| (angle - 90.0).abs() < 1e-9)
    }

    /// The parameters of a projection for PROJ, each with a space before it.
    fn parameters(&self, method: &str, unit_m: Option<f64>) -> String {
        let value = |keys: &[u64]| keys.iter().find_map(|key| self.real(*key));
        let number = self.number(METHOD_KEY).unwrap_or_default();
        let mut text = String::new();
        for (name, keys) in PARAMETERS {
            let Some(value) = value(keys) else { continue };
            let value = if matches!(name, "x_0" | "y_0") { value * unit_m.unwrap_or(1.0) } else { value };
            let name = match (number, method, name) {
                (POLAR_STEREOGRAPHIC, _, "lat_0") => {
                    text += &format!(" +lat_0={}", 90.0_f64.copysign(value));
                    "lat_ts"
                }
                (LAMBERT_1SP, _, "lat_0") if self.real(FIRST_PARALLEL_KEY).is_none() => {
                    text += &format!(" +lat_0={value}");
                    "lat_1"
                }
                // The parallel of true lengths.
                (_, "merc" | "eqc" | "cea", "lat_1") => "lat_ts",
                (_, OBLIQUE_MERCATOR, "lon_0") => "lonc",
                _ => name,
            };
            text += &format!(" +{name}={value}");
        }
        text + if (number, method) == (OBLIQUE_MERCATOR_A, OBLIQUE_MERCATOR) { " +no_uoff" } else { "" }
    }

    /// The datum of a projection that the file defines by itself, or only its ellipsoid, for PROJ.
    fn datum(&self) -> Option<String> {
        // Geographic systems have the numbers of their datums, less 2000.
        let of_datum = || self.number(DATUM_KEY).filter(|code| (6036..7000).contains(code)).map(|code| code - 2000);
        let code = self.number(GEOGRAPHIC_TYPE_KEY).filter(|code| *code != USER_DEFINED).or_else(of_datum);
        let meridian = self.real(MERIDIAN_KEY).filter(|longitude| *longitude != 0.0);
        let meridian = meridian.map_or_else(String::new, |longitude| format!(" +pm={longitude}"));
        if let Some(code) = code {
            let datum = datum_of(code);
            return Some(if datum.contains("+pm=") { datum } else { datum + &meridian });
        }
        let ellipsoid = match self.number(ELLIPSOID_KEY) {
            Some(7019) => "+ellps=GRS80".to_owned(),
            Some(7030) => "+ellps=WGS84".to_owned(),
            _ => format!("+a={} +rf={}", self.real(RADIUS_KEY)?, self.real(INVERSE_FLATTENING_KEY)?),
        };
        let shift: Vec<String> = self.reals_of(SHIFT_KEY).iter().map(f64::to_string).collect();
        let shift = if matches!(shift.len(), 3 | 7) { format!(" +towgs84={}", shift.join(",")) } else { String::new() };
        Some(ellipsoid + &meridian + &shift)
    }

    /// Each key has four numbers: itself, where its value is (0: here), a count, and the value.
    fn key(&self, wanted: u64) -> Option<&[u64]> {
        self.keys.chunks_exact(4).skip(1).find(|key| key[0] == wanted)
    }

    /// The value of a key that is a number.
    pub(super) fn number(&self, wanted: u64) -> Option<u64> {
        self.key(wanted).filter(|key| key[1] == 0).map(|key| key[3])
    }

    fn real(&self, wanted: u64) -> Option<f64> {
        self.reals_of(wanted).first().copied().filter(|value| value.is_finite())
    }

    /// The values of a key that has real ones.
    fn reals_of(&self, wanted: u64) -> &[f64] {
        let found = || {
            let key = self.key(wanted).filter(|key| key[1] == u64::from(GEO_REALS))?;
            let (count, start) = (usize::try_from(key[2]).ok()?, usize::try_from(key[3]).ok()?);
            self.reals.get(start..start.checked_add(count.max(1))?)
        };
        found().unwrap_or_default()
    }

    fn text(&self, wanted: u64) -> Option<String> {
        let key = self.key(wanted).filter(|key| key[1] == u64::from(GEO_TEXTS))?;
        let (count, start) = (usize::try_from(key[2]).ok()?, usize::try_from(key[3]).ok()?);
        let text = String::from_utf8_lossy(self.texts.get(start..start.checked_add(count)?)?).into_owned();
        let text = text.trim_matches(['|', '\0', ' ']);
        (!text.is_empty()).then(|| text.to_owned())
    }
}

/// The datum of a geographic system with a code, for PROJ. One that is not known, or not in degrees, has a name that PROJ does not know.
fn datum_of(code: u64) -> String {
    match code {
        4326 => return "+datum=WGS84".to_owned(),
        // Of the continents: the same as WGS84 within a metre.
        4258 | 4148 | 4283 | 4269 | 6668 | 4612 | 4674 => return "+ellps=GRS80 +towgs84=0,0,0".to_owned(),
        _ => {}
    }
    let known = resolve(&format!("EPSG:{code}")).ok().and_then(|crs| match crs.horizontal.system {
        System::Geographic { definition, unit_deg: 1.0 } => Some(definition.text()),
        _ => None,
    });
    // Without the projection.
    let datum = known.as_deref().and_then(|text| text.split_once(' ')).map(|(_, datum)| datum.trim().to_owned());
    datum.unwrap_or_else(|| format!("+datum=EPSG:{code}"))
}
