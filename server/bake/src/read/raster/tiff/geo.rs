//! Where a GeoTIFF is, and in which coordinate system (OGC 19-008).

use super::super::error::RasterError;
use super::super::facts::RasterCrs;
use super::super::place::GeoPlace;
use super::directory::{Directory, TiffFile};

const MODEL_PIXEL_SCALE: u16 = 33550;
const MODEL_TIE_POINT: u16 = 33922;
const MODEL_TRANSFORMATION: u16 = 34264;
const GEO_KEYS: u16 = 34735;
const GEO_REALS: u16 = 34736;
const GEO_TEXTS: u16 = 34737;

const MODEL_TYPE_KEY: u64 = 1024;
const RASTER_TYPE_KEY: u64 = 1025;
const CITATION_KEY: u64 = 1026;
const GEOGRAPHIC_TYPE_KEY: u64 = 2048;
const GEOGRAPHIC_CITATION_KEY: u64 = 2049;
const PROJECTED_TYPE_KEY: u64 = 3072;
const PROJECTED_CITATION_KEY: u64 = 3073;
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
const PROJECTED_MODEL: u64 = 1;
const GEOGRAPHIC_MODEL: u64 = 2;
const PIXEL_IS_POINT: u64 = 2;

/// The geographic tags of an image.
pub(super) struct GeoTags {
    keys: Vec<u64>,
    reals: Vec<f64>,
    texts: Vec<u8>,
    scale: Vec<f64>,
    tie_points: Vec<f64>,
    transformation: Vec<f64>,
}

impl GeoTags {
    pub(super) fn read(file: &mut TiffFile, directory: &Directory) -> Result<Self, RasterError> {
        Ok(Self {
            keys: file.integers(directory, GEO_KEYS)?,
            reals: file.reals(directory, GEO_REALS)?,
            texts: file.bytes(directory, GEO_TEXTS)?,
            scale: file.reals(directory, MODEL_PIXEL_SCALE)?,
            tie_points: file.reals(directory, MODEL_TIE_POINT)?,
            transformation: file.reals(directory, MODEL_TRANSFORMATION)?,
        })
    }

    /// Where the pixels are; `None` if the tags do not tell, or only by control points.
    pub(super) fn place(&self) -> Option<GeoPlace> {
        let (corner, column, row) = self.corner()?;
        let is_point = self.number(RASTER_TYPE_KEY) == Some(PIXEL_IS_POINT);
        if is_point { GeoPlace::checked(corner, column, row) } else { GeoPlace::from_corner(corner, column, row) }
    }

    /// The position of the place (0, 0), and the steps to the next column and row.
    fn corner(&self) -> Option<([f64; 2], [f64; 2], [f64; 2])> {
        if let ([width, height, ..], [x, y, _, east, north, ..]) = (&self.scale[..], &self.tie_points[..]) {
            // The height is positive although rows go south; some writers have it negative.
            let height = height.abs();
            return Some(([east - x * width, north + y * height], [*width, 0.0], [0.0, -height]));
        }
        let [a, b, _, east, d, e, _, north, ..] = self.transformation[..] else { return None };
        Some(([east, north], [a, d], [b, e]))
    }

    /// A projection that the file defines by itself, for PROJ. `None` if its method or its datum is not known, or its
    /// unit is not the metre.
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
        if self.number(LINEAR_UNITS_KEY).is_some_and(|unit| unit != 9001) {
            return None;
        }
        let datum = match self.number(GEOGRAPHIC_TYPE_KEY)? {
            4326 => "+datum=WGS84",
            // Of the continents: the same as WGS84 within a metre.
            4258 | 4148 | 4283 | 4269 | 6668 | 4612 | 4674 => "+ellps=GRS80 +towgs84=0,0,0",
            _ => return None,
        };
        let mut text = format!("+proj={method} {datum} +units=m");
        for (name, keys) in PARAMETERS {
            if let Some(value) = keys.iter().find_map(|key| self.real(*key)) {
                text += &format!(" +{name}={value}");
            }
        }
        Some(text)
    }

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
        let citation = [PROJECTED_CITATION_KEY, CITATION_KEY, GEOGRAPHIC_CITATION_KEY];
        RasterCrs {
            horizontal,
            vertical: epsg(VERTICAL_TYPE_KEY).filter(|_| !is_ellipsoidal),
            is_ellipsoidal,
            height_unit_m: self.number(VERTICAL_UNITS_KEY).and_then(metres_of_unit),
            citation: citation.into_iter().find_map(|key| self.text(key)),
        }
    }

    /// Each key has four numbers: itself, where its value is (0: here), a count, and the value.
    fn key(&self, wanted: u64) -> Option<&[u64]> {
        self.keys.chunks_exact(4).skip(1).find(|key| key[0] == wanted)
    }

    fn number(&self, wanted: u64) -> Option<u64> {
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

/// Metres of a unit of length by its EPSG code.
fn metres_of_unit(code: u64) -> Option<f64> {
    match code {
        9001 => Some(1.0),
        9002 => Some(0.3048),
        9003 => Some(1200.0 / 3937.0),
        _ => None,
    }
}
