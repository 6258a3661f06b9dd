//! Coordinate systems: what a source's name of one means, as a horizontal and a vertical part.
//!
//! Names are codes and names of the EPSG registry, URNs, URLs, well-known text of all dialects, PROJJSON, strings for PROJ, the
//! lines of Arc/Info, the names of the German AdV, and the own names `ECEF` and `ENU:LON,LAT,H`.

mod axes;
mod definition;
mod describe;
pub mod geoid;
mod method;
mod name;
mod plain_name;
mod projjson;
mod registry;
#[cfg(test)]
mod tests;
mod wkt;
mod wkt_crs;

pub use axes::Axes;
pub use definition::Definition;
use definition::parse_shift;
use registry::Base;

/// Expected error of a datum's shift of which nothing else is known.
pub const DEFAULT_SHIFT_ERROR_M: f64 = 10.0;

/// A coordinate system.
#[derive(Debug, Clone, PartialEq)]
pub struct Crs {
    /// `EPSG:6697`, `EPSG:25832+7837`, `OGC:CRS84`, or as the source has it.
    pub name: String,
    pub horizontal: Horizontal,
    pub vertical: Vertical,
}

/// Where positions are on the map.
#[derive(Debug, Clone, PartialEq)]
pub struct Horizontal {
    /// Of the EPSG registry.
    pub code: Option<u32>,
    pub system: System,
    /// Order of the coordinates by the registry.
    pub axes: Axes,
    /// Name of its datum.
    pub datum: String,
    /// Expected error of the datum's shift to WGS84: 0 for modern datums, infinite if no shift is known.
    pub shift_error_m: f64,
}

/// Kinds of horizontal systems.
#[derive(Debug, Clone, PartialEq)]
pub enum System {
    /// Longitude and latitude.
    Geographic {
        definition: Definition,
        unit_deg: f64,
    },
    Projected(Definition),
    /// From the centre of the Earth.
    Geocentric(Definition),
    /// Metres east, north and up around a point.
    Local(LocalOrigin),
}

/// The origin of a local system.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalOrigin {
    pub longitude_deg: f64,
    pub latitude_deg: f64,
    /// Above the geoid, or above the ellipsoid.
    pub height_m: f64,
    pub is_ellipsoidal: bool,
}

/// What heights count from.
#[derive(Debug, Clone, PartialEq)]
pub enum Vertical {
    Unknown,
    Ellipsoidal {
        unit_m: f64,
    },
    /// The sea level of a datum.
    Orthometric(VerticalDatum),
}

/// A vertical datum.
#[derive(Debug, Clone, PartialEq)]
pub struct VerticalDatum {
    /// Of the EPSG registry.
    pub code: Option<u32>,
    pub name: String,
    /// Metres in a unit; negative if depths count down.
    pub unit_m: f64,
}

impl VerticalDatum {
    /// The datum with an EPSG code.
    pub fn from_code(code: u32) -> Self {
        let entry = registry::vertical(code);
        let name = entry.and_then(|entry| entry.names.first()).map(|name| (*name).to_owned());
        Self {
            code: Some(code),
            name: name.unwrap_or_else(|| format!("EPSG:{code}")),
            unit_m: entry.map_or(1.0, |entry| entry.unit_m),
        }
    }

    /// The datum with a name.
    pub fn named(name: &str) -> Self {
        Self { code: None, name: name.to_owned(), unit_m: 1.0 }
    }

    /// The same datum with heights in metres.
    pub fn in_metres(&self) -> Self {
        match registry::vertical_by_name(&self.name) {
            Some(code) if self.unit_m != 1.0 => Self::from_code(code),
            _ => Self { unit_m: 1.0, ..self.clone() },
        }
    }

    /// `EPSG:5709`, or the name.
    pub fn label(&self) -> String {
        self.code.map_or_else(|| self.name.clone(), |code| format!("EPSG:{code}"))
    }

    /// File names of its geoid grids in PROJ-data, best first.
    pub fn grids(&self) -> &'static [&'static str] {
        self.code.and_then(registry::vertical).map_or(&[], |entry| &entry.grids)
    }

    /// Typical and largest error of heights by EGM96 in place of its grid.
    pub fn egm96_error_m(&self) -> Option<[f64; 2]> {
        self.code.and_then(registry::vertical)?.egm96_error_m
    }
}

impl Horizontal {
    /// The definition; `None` for local systems.
    pub fn definition(&self) -> Option<&Definition> {
        match &self.system {
            System::Geographic { definition, .. } | System::Projected(definition) | System::Geocentric(definition) => {
                Some(definition)
            }
            System::Local(_) => None,
        }
    }

    /// Where it may be used; `None` for all of the Earth, or if it is not known.
    pub fn area(&self) -> Option<Area> {
        registry::area(self.code?)
    }

    /// The system with the same datum and projection whose unit is the metre.
    pub fn in_metres(&self) -> Option<(Option<u32>, Definition)> {
        let System::Projected(definition) = &self.system else { return None };
        if definition.unit_m_is(1.0) {
            return Some((self.code, definition.clone()));
        }
        let definition = definition.clone().in_metres();
        let base = self.code.and_then(registry::horizontal).map(|entry| entry.base);
        let code = match base {
            Some(Base::Projected(base)) => describe::projected_code(&definition, &[base]),
            _ => None,
        };
        Some((code, definition))
    }
}

/// Area of use of a horizontal system by its code; `None` for all of the Earth, or if it is not known.
pub fn area_of_use(code: u32) -> Option<Area> {
    registry::area(code)
}

/// Whether a longitude and latitude is on land, or near it, as far as the registry's areas of use tell.
pub fn is_near_land(place: [f64; 2]) -> bool {
    registry::is_near_land(place)
}

/// The geographic system of a projected one, both by their codes.
pub fn projected_base(code: u32) -> Option<u32> {
    match registry::horizontal(code)?.base {
        Base::Projected(base) => Some(base),
        _ => None,
    }
}

/// Why a name gives no system.
#[derive(Debug, Clone, PartialEq)]
pub enum CrsError {
    /// The name is not understood.
    Unknown,
    /// The name is understood, but positions cannot be computed, for this reason.
    Unsupported(String),
}

/// The system with a name.
pub fn resolve(name: &str) -> Result<Crs, CrsError> {
    let name = name.trim().trim_start_matches('\u{feff}').trim_end_matches('\0').trim();
    if name.is_empty() {
        return Err(CrsError::Unknown);
    }
    if name.starts_with('{') {
        projjson::parse(name)
    } else if wkt_crs::is_wkt(name) {
        wkt_crs::parse(name)
    } else if is_arc_info(name) {
        parse_arc_info(name)
    } else {
        name::parse(name)
    }
}

/// Whether a name says that the system is not known, as programs write it that have to name one.
pub fn is_undefined(name: &str) -> bool {
    let name = name.trim();
    let (own, is_on_earth) = if let Some((own, is_on_earth)) = projjson::name(name) {
        (own, is_on_earth)
    } else if wkt_crs::is_wkt(name) {
        (wkt_crs::name(name), !wkt_crs::is_local(name))
    } else {
        (name.to_owned(), false)
    };
    let own = own.to_ascii_lowercase();
    let says_so =
        matches!(&*own, "" | "none") || ["undefined", "unknown", "unnamed"].iter().any(|word| own.starts_with(word));
    says_so && !is_on_earth
}

/// Whether a name is that of a system in longitude and latitude.
pub fn is_geographic(name: &str) -> bool {
    resolve(name).is_ok_and(|crs| matches!(crs.horizontal.system, System::Geographic { .. }))
}

/// The system with a code, or with a horizontal and a vertical one.
fn from_codes(code: u32, vertical: Option<u32>) -> Result<Crs, CrsError> {
    if let (None, Some((horizontal, vertical))) = (vertical, registry::compound(code)) {
        let horizontal = horizontal_from_code(horizontal)?;
        return Ok(Crs { name: format!("EPSG:{code}"), horizontal, vertical: vertical_from_code(vertical) });
    }
    let horizontal = horizontal_from_code(code)?;
    if let Some(vertical) = vertical {
        let name = format!("EPSG:{code}+{vertical}");
        return Ok(Crs { name, horizontal, vertical: vertical_from_code(vertical) });
    }
    let vertical = if is_ellipsoidal(code) { Vertical::Ellipsoidal { unit_m: 1.0 } } else { Vertical::Unknown };
    Ok(Crs { name: format!("EPSG:{code}"), horizontal, vertical })
}

/// Whether heights of a system are above the ellipsoid.
fn is_ellipsoidal(code: u32) -> bool {
    let base = registry::horizontal(code).map(|entry| entry.base);
    matches!(base, Some(Base::Geographic3d | Base::Geocentric))
}

/// The vertical part of a compound system. GDAL and others name a system of longitude, latitude and height there, which has heights
/// above its ellipsoid.
fn vertical_from_code(code: u32) -> Vertical {
    if is_ellipsoidal(code) {
        return Vertical::Ellipsoidal { unit_m: 1.0 };
    }
    Vertical::Orthometric(VerticalDatum::from_code(code))
}

fn horizontal_from_code(code: u32) -> Result<Horizontal, CrsError> {
    let text = registry::definition(code);
    let entry = registry::horizontal(code);
    let text = match (text, entry) {
        (Some(text), _) => text,
        (None, Some(_)) => return Err(CrsError::Unsupported("its projection is not supported".to_owned())),
        (None, None) => return Err(CrsError::Unknown),
    };
    let mut definition = Definition::parse(text).map_err(CrsError::Unsupported)?;
    let geographic = match entry.map(|entry| entry.base) {
        Some(Base::Projected(base)) => Some(base),
        Some(Base::Geographic2d) => Some(code),
        _ => None,
    };
    let known = geographic.and_then(registry::shift);
    let better = known.and_then(|known| parse_shift(known.towgs84));
    let of_base = || Definition::parse(registry::definition(geographic?)?).ok()?.own_shift();
    let shift = better.or(definition.own_shift()).or_else(of_base).or(definition.shift());
    definition = definition.with_shift(shift);
    let shift_error_m = match (known, shift) {
        (_, None) => f64::INFINITY,
        (Some(known), _) if known.error_m.is_finite() => known.error_m,
        (_, Some(shift)) if shift == [0.0; 7] => 0.0,
        _ => DEFAULT_SHIFT_ERROR_M,
    };
    let system = if definition.is_geographic() {
        System::Geographic { definition, unit_deg: if entry.is_some_and(|entry| entry.in_grads) { 0.9 } else { 1.0 } }
    } else if definition.is_geocentric() {
        System::Geocentric(definition)
    } else {
        System::Projected(definition)
    };
    let axes = entry.map_or(Axes::EAST_NORTH, |entry| entry.axes);
    let datum = geographic.and_then(registry::datum_name).unwrap_or("its datum").to_owned();
    Ok(Horizontal { code: Some(code), system, axes, datum, shift_error_m })
}

/// An area between two meridians and two parallels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// West, south, east and north in degrees; east is more than 180 if the area crosses the antimeridian.
    degrees: [f64; 4],
}

impl Area {
    /// The area of west, south, east and north in degrees.
    pub fn new(degrees: [f64; 4]) -> Self {
        Self { degrees }
    }

    /// Whether it is that of a continent, with seas.
    pub fn is_wide(self) -> bool {
        const WIDE_DEG: f64 = 20.0;
        let [west, south, east, north] = self.degrees;
        east - west > WIDE_DEG && north - south > WIDE_DEG
    }

    /// Whether a longitude and latitude is in it, or at most `reach_deg` outside of it.
    pub fn contains(self, [lon, lat]: [f64; 2], reach_deg: f64) -> bool {
        let [west, south, east, north] = self.degrees;
        let is_between = |lon: f64| (west - reach_deg..=east + reach_deg).contains(&lon);
        let is_in_turn = [lon - 360.0, lon, lon + 360.0].into_iter().any(is_between);
        is_in_turn && (south - reach_deg..=north + reach_deg).contains(&lat)
    }
}

/// Whether a text is such a description: several lines, the first of which names a projection.
fn is_arc_info(text: &str) -> bool {
    let mut words = text.split_ascii_whitespace();
    words.next().is_some_and(|word| word.eq_ignore_ascii_case("projection")) && text.contains('\n')
}

/// The system of a description. Fails if it is neither UTM nor longitude and latitude, in metres or degrees.
fn parse_arc_info(text: &str) -> Result<Crs, CrsError> {
    let value = |wanted: &str| {
        let of_line = |line: &str| {
            let (word, value) = line.trim().split_once(char::is_whitespace)?;
            word.eq_ignore_ascii_case(wanted).then(|| value.trim().to_ascii_uppercase())
        };
        text.lines().find_map(of_line).unwrap_or_default()
    };
    let unsupported = |word: &str| CrsError::Unsupported(format!("its {word} is {}", value(word)));
    let is_shifted = |word: &str| value(word).parse::<f64>().is_ok_and(|shift| shift != 0.0);
    if let Some(word) = ["xshift", "yshift"].into_iter().find(|word| is_shifted(word)) {
        return Err(unsupported(word));
    }
    if !matches!(&*value("zunits"), "" | "NO" | "METERS" | "1" | "1.0") {
        return Err(unsupported("zunits"));
    }
    // Code in degrees, and what the zone is added to for UTM.
    let (degrees, zones) = match &*value("datum") {
        "WGS84" | "WGS_1984" | "WGS 84" => (4326, 32_600),
        "ETRS89" | "ETRS_1989" | "ETRF89" => (4258, 25_800),
        "NAD83" => (4269, 26_900),
        "NAD27" => (4267, 26_700),
        "" | "NONE" if matches!(&*value("spheroid"), "WGS84" | "GRS80" | "GRS1980") => (4326, 32_600),
        _ => return Err(unsupported("datum")),
    };
    match (&*value("projection"), &*value("units")) {
        ("GEOGRAPHIC", "DD" | "DEGREES") => from_codes(degrees, None),
        ("UTM", "METERS" | "METRES" | "1" | "1.0") => {
            let zone = value("zone").parse::<i32>().ok().filter(|zone| (1..=60).contains(&zone.abs()));
            let zone = zone.ok_or_else(|| unsupported("zone"))?;
            // Zones of the south are negative. Only WGS 84 has all of them.
            match (zone < 0, zones) {
                (false, _) => from_codes(zones + zone.unsigned_abs(), None),
                (true, 32_600) => from_codes(32_700 + zone.unsigned_abs(), None),
                (true, _) => Err(unsupported("zone")),
            }
        }
        ("GEOGRAPHIC" | "UTM", _) => Err(unsupported("units")),
        _ => Err(unsupported("projection")),
    }
}
