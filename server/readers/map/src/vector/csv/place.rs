//! Which columns have the place of a line.

use super::NO_GEOMETRY;
use crate::vector::geometry::{Geometry, MALFORMED};
use insula_source::decimal_mark::DecimalMark;
use std::borrow::Cow;

/// Names of columns of longitudes and latitudes, in lower case without what separates words.
const LONGITUDES: [&str; 10] =
    ["lon", "lng", "long", "longitude", "longitud", "londeg", "lonwgs84", "longitudewgs84", "geolon", "laengengrad"];
const LATITUDES: [&str; 8] =
    ["lat", "latitude", "latitud", "latdeg", "latwgs84", "latitudewgs84", "geolat", "breitengrad"];
/// Names of columns of coordinates of a map, or of degrees. A name of the first list goes with the one at the same place in the second.
const EASTINGS: [&str; 11] =
    ["x", "easting", "east", "e", "coordx", "xcoord", "xcoordinate", "pointx", "xkoordinate", "rechtswert", "posx"];
const NORTHINGS: [&str; 11] =
    ["y", "northing", "north", "n", "coordy", "ycoord", "ycoordinate", "pointy", "ykoordinate", "hochwert", "posy"];
/// Names of columns with a latitude and a longitude in one text.
const PAIRS: [&str; 4] = ["geopoint2d", "geopoint", "latlon", "latlng"];

/// Which columns have the place of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// A geometry as text.
    Text(usize),
    Degrees {
        lon: usize,
        lat: usize,
    },
    Map {
        x: usize,
        y: usize,
    },
    /// A latitude and a longitude in one text.
    Pair(usize),
}

impl Place {
    /// The columns by their names in lower case.
    pub(super) fn of_names(lower: &[String]) -> Option<Self> {
        let keys: Vec<String> =
            lower.iter().map(|name| name.chars().filter(|c| c.is_alphanumeric()).collect()).collect();
        let find = |known: &str| keys.iter().position(|key| key == known);
        let first = |known: &[&str]| known.iter().find_map(|known| find(known));
        if let (Some(lon), Some(lat)) = (first(&LONGITUDES), first(&LATITUDES)) {
            return Some(Self::Degrees { lon, lat });
        }
        let mut pairs = EASTINGS.iter().zip(&NORTHINGS);
        let map = pairs.find_map(|(x, y)| Some(Self::Map { x: find(x)?, y: find(y)? }));
        map.or_else(|| first(&PAIRS).map(Self::Pair))
    }

    /// Whether names say that the coordinates are longitudes and latitudes.
    pub(super) fn is_in_degrees(self) -> bool {
        matches!(self, Self::Degrees { .. } | Self::Pair(_))
    }

    /// Whether the column with this number is one of it.
    pub(super) fn is_of(self, index: usize) -> bool {
        match self {
            Self::Text(column) | Self::Pair(column) => index == column,
            Self::Degrees { lon: x, lat: y } | Self::Map { x, y } => index == x || index == y,
        }
    }

    /// The first of two columns of coordinates of a map.
    pub(super) fn map_column(self) -> Option<usize> {
        match self {
            Self::Map { x, .. } => Some(x),
            Self::Text(_) | Self::Degrees { .. } | Self::Pair(_) => None,
        }
    }

    /// Adds the point of a line. `mark` is before the decimals of its numbers, if that is known. Fails with the reason if it has none.
    pub(super) fn add_point<'f>(
        self,
        field: impl Fn(usize) -> Cow<'f, str>,
        delimiter: u8,
        mark: Option<DecimalMark>,
        geometry: &mut Geometry,
    ) -> Result<(), &'static str> {
        let [x, y] = match self {
            Self::Text(_) => return Err(MALFORMED),
            Self::Degrees { lon: x, lat: y } | Self::Map { x, y } => [field(x), field(y)],
            Self::Pair(column) => {
                let text = field(column);
                let text = text.trim().trim_matches(['(', ')', '[', ']']);
                let pair = text.split_once(',').or_else(|| text.split_once(char::is_whitespace));
                let (lat, lon) = pair.unwrap_or((text, ""));
                [lon.to_owned().into(), lat.to_owned().into()]
            }
        };
        if x.trim().is_empty() && y.trim().is_empty() {
            return Err(NO_GEOMETRY);
        }
        let number = |text: &str| {
            let text = text.trim().trim_end_matches('\u{b0}');
            let is_comma = delimiter != b',' && !text.contains('.');
            let plain = || if is_comma { text.replace(',', ".").parse::<f64>() } else { text.parse() };
            let number = mark.and_then(|mark| mark.number(text)).or_else(|| plain().ok());
            number.filter(|number| number.is_finite()).ok_or("coordinate not a number")
        };
        geometry.push_point([number(&x)?, number(&y)?, f64::NAN]);
        geometry.settle_heights();
        Ok(())
    }
}
