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
const ELLIPSOID_KEY: u64 = 2056;
const MERIDIAN_KEY: u64 = 2061;
const RADIUS_KEY: u64 = 2057;
const INVERSE_FLATTENING_KEY: u64 = 2059;
/// In place of a code.
const USER_DEFINED: u64 = 32767;
const METHOD_KEY: u64 = 3075;
const LINEAR_UNITS_KEY: u64 = 3076;
const VERTICAL_TYPE_KEY: u64 = 4096;
const VERTICAL_UNITS_KEY: u64 = 4099;
/// Keys of parameters, best first, with their names in PROJ.
const PARAMETERS: [(&str, &[u64]); 7] = [
    ("lat_0", &[3081, 3085, 3089]),
    ("lon_0", &[3080, 3084, 3088]),
    ("lat_1", &[3078]),
    ("lat_2", &[3079]),
    ("k_0", &[3092, 3093]),
    ("x_0", &[3082, 3086, 3090]),
    ("y_0", &[3083, 3087, 3091]),
];
/// Numbers of vertical datums, which GeoTIFF 1.0 had for systems, with those of the systems.
const VERTICAL_DATUMS: [(u64, u64); 3] = [(5101, 5701), (5102, 5702), (5103, 5703)];
const PROJECTED_MODEL: u64 = 1;
const GEOGRAPHIC_MODEL: u64 = 2;

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
    /// citation.
    pub(super) fn crs(&self) -> RasterCrs {
        let code = |key| self.number(key).filter(|code| (1024..32767).contains(code));
        let epsg = |key| code(key).map(|code| format!("EPSG:{code}"));
        let horizontal = match self.number(MODEL_TYPE_KEY) {
            Some(PROJECTED_MODEL) => epsg(PROJECTED_TYPE_KEY).or_else(|| self.projection()),
            Some(GEOGRAPHIC_MODEL) => epsg(GEOGRAPHIC_TYPE_KEY),
            Some(_) => None,
            None => epsg(PROJECTED_TYPE_KEY).or_else(|| epsg(GEOGRAPHIC_TYPE_KEY)),
        };
        // Numbers of GeoTIFF 1.0 for heights above one of its ellipsoids.
        let is_ellipsoidal = code(VERTICAL_TYPE_KEY).is_some_and(|code| (5001..=5033).contains(&code));
        let of_datum = |code| VERTICAL_DATUMS.into_iter().find_map(|(datum, system)| (datum == code).then_some(system));
        let vertical = code(VERTICAL_TYPE_KEY).filter(|_| !is_ellipsoidal);
        // That of a system with a code is known by its name.
        let is_own = horizontal.as_ref().is_some_and(|name| name.starts_with('+'));
        let unit_m = vertical.filter(|_| is_own).map(|code| VerticalDatum::from_code(code as u32).unit_m);
        let citation = [PROJECTED_CITATION_KEY, CITATION_KEY, GEOGRAPHIC_CITATION_KEY];
        let other_unit = horizontal.as_deref().filter(|_| !is_own).and_then(|name| self.other_unit(name));
        RasterCrs {
            other_unit,
            horizontal,
            vertical: vertical.map(|code| format!("EPSG:{}", of_datum(code).unwrap_or(code))),
            is_ellipsoidal,
            height_unit_m: self.number(VERTICAL_UNITS_KEY).and_then(|code| metres_of(&code.to_string())).or(unit_m),
            citation: citation.into_iter().find_map(|key| self.text(key)),
        }
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

    /// A projection that the file defines by itself, for PROJ. `None` if its method, its datum or its unit is not known.
    fn projection(&self) -> Option<String> {
        let method = match self.number(METHOD_KEY)? {
            1 => "tmerc",
            7 => "merc",
            8 | 9 => "lcc",
            10 => "laea",
            11 => "aea",
            15 => "stere",
            16 => "sterea",
            _ => return None,
        };
        let unit_m = self.number(LINEAR_UNITS_KEY).map_or(Some(1.0), |code| metres_of(&code.to_string()))?;
        let unit = if unit_m == 1.0 { "+units=m".to_owned() } else { format!("+to_meter={unit_m}") };
        let mut text = format!("+proj={method} {} {unit}", self.datum()?);
        for (name, keys) in PARAMETERS {
            if let Some(value) = keys.iter().find_map(|key| self.real(*key)) {
                let is_length = matches!(name, "x_0" | "y_0");
                text += &format!(" +{name}={}", if is_length { value * unit_m } else { value });
            }
        }
        Some(text)
    }

    /// The datum of a projection that the file defines by itself, or only its ellipsoid, for PROJ.
    fn datum(&self) -> Option<String> {
        if self.real(MERIDIAN_KEY).is_some_and(|longitude| longitude != 0.0) {
            return None;
        }
        let known = match self.number(GEOGRAPHIC_TYPE_KEY) {
            Some(4326) => Some("+datum=WGS84"),
            // Of the continents: the same as WGS84 within a metre.
            Some(4258 | 4148 | 4283 | 4269 | 6668 | 4612 | 4674) => Some("+ellps=GRS80 +towgs84=0,0,0"),
            Some(code) if code != USER_DEFINED => return None,
            _ => match self.number(ELLIPSOID_KEY) {
                Some(7019) => Some("+ellps=GRS80"),
                Some(7030) => Some("+ellps=WGS84"),
                _ => None,
            },
        };
        if let Some(known) = known {
            return Some(known.to_owned());
        }
        let (radius, inverse_flattening) = (self.real(RADIUS_KEY)?, self.real(INVERSE_FLATTENING_KEY)?);
        Some(format!("+a={radius} +rf={inverse_flattening}"))
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
        let key = self.key(wanted).filter(|key| key[1] == u64::from(GEO_REALS))?;
        self.reals.get(usize::try_from(key[3]).ok()?).copied().filter(|value| value.is_finite())
    }

    fn text(&self, wanted: u64) -> Option<String> {
        let key = self.key(wanted).filter(|key| key[1] == u64::from(GEO_TEXTS))?;
        let (count, start) = (usize::try_from(key[2]).ok()?, usize::try_from(key[3]).ok()?);
        let text = String::from_utf8_lossy(self.texts.get(start..start.checked_add(count)?)?).into_owned();
        let text = text.trim_matches(['|', '\0', ' ']);
        (!text.is_empty()).then(|| text.to_owned())
    }
}
