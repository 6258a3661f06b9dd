//! Systems by name: codes, URNs, URLs and the names of agencies.

use super::axes::Axes;
use super::definition::{Definition, positive, unit_m};
use super::{
    Crs, CrsError, Horizontal, LocalOrigin, System, Vertical, VerticalDatum, from_codes, horizontal_from_code,
    plain_name, registry,
};

/// Longer names are refused.
const MAX_NAME_BYTES: usize = 1024;
/// Codes below this are versions of a registry: the registry's own codes start at 1024.
const MIN_CODE: u32 = 1024;
/// Web Mercator by codes that others gave it.
const WEB_MERCATOR: [u32; 4] = [900_913, 102_100, 102_113, 3785];
/// Systems of the French IGN.
const IGNF: [(&str, u32); 10] = [
    ("LAMB93", 2154),
    ("RGF93LAMB93", 2154),
    ("RGF93G", 4171),
    ("LAMBE", 27572),
    ("RGR92UTM40S", 2975),
    ("RGAF09UTM20", 5490),
    ("UTM22RGFG95", 2972),
    ("RGFG95UTM22", 2972),
    ("RGM04UTM38S", 4471),
    ("WGS84G", 4326),
];
/// Horizontal systems of the German surveying agencies (AdV), by the start of the name.
const ADV_HORIZONTAL: [(&str, u32); 19] = [
    ("ETRS89_LAT-LON-H", 4937),
    ("ETRS89_LAT-LON", 4258),
    ("ETRS89_X-Y-Z", 4936),
    ("ETRS89_UTM31", 25831),
    ("ETRS89_UTM32", 25832),
    ("ETRS89_UTM33", 25833),
    ("DE_DHDN_LAT-LON", 4314),
    ("DE_DHDN_3GK2", 31466),
    ("DE_DHDN_3GK3", 31467),
    ("DE_DHDN_3GK4", 31468),
    ("DE_DHDN_3GK5", 31469),
    ("DE_PD-83_3GK3", 3396),
    ("DE_PD-83_3GK4", 3397),
    ("DE_RD-83_3GK4", 3398),
    ("DE_RD-83_3GK5", 3399),
    ("DE_42-83_3GK3", 2397),
    ("DE_42-83_3GK4", 2398),
    ("DE_42-83_3GK5", 2399),
    ("DE_SOLDNER-BERLIN", 3068),
];
/// Vertical systems of the AdV, by the start of the name.
const ADV_VERTICAL: [(&str, u32); 7] = [
    ("DE_DHHN2016", 7837),
    ("DE_DHHN92", 5783),
    ("DE_DHHN85", 5784),
    ("DE_DHHN12", 7699),
    ("DE_SNN76", 5785),
    ("DE_HN76", 5785),
    ("EVRF2007", 5621),
];

/// Finds a system by a name that is neither well-known text nor JSON.
pub(super) fn parse(name: &str) -> Result<Crs, CrsError> {
    if name.len() > MAX_NAME_BYTES {
        return Err(CrsError::Unknown);
    }
    let upper = name.to_ascii_uppercase();
    if upper == "ECEF" {
        return from_codes(4978, None);
    }
    if let Some(origin) = upper.strip_prefix("ENU:") {
        return local(name, origin);
    }
    if name.starts_with("+proj") || name.starts_with("proj=") {
        return proj_string(name);
    }
    if let Some(rest) = upper.strip_prefix("URN:ADV:CRS:") {
        return adv(name, rest);
    }
    if name.bytes().all(|byte| byte.is_ascii_digit()) {
        return from_codes(code(name).ok_or(CrsError::Unknown)?, None);
    }
    match (plain_name::codes(name), tokens(&upper)) {
        (Some((horizontal, vertical)), Err(_)) => from_codes(horizontal, vertical),
        (None, Err(error)) => adv(name, &upper).map_err(|_| error),
        (_, known) => known,
    }
}

fn code(text: &str) -> Option<u32> {
    let code = text.parse().ok()?;
    Some(if WEB_MERCATOR.contains(&code) { 3857 } else { code })
}

/// Local metres east, north and up around a point: `ENU:LON,LAT,H`, with `,ellipsoid` behind it if its height is above that.
fn local(name: &str, origin: &str) -> Result<Crs, CrsError> {
    let above_ellipsoid = origin.strip_suffix(",ELLIPSOID");
    let is_ellipsoidal = above_ellipsoid.is_some();
    let origin = above_ellipsoid.unwrap_or(origin);
    let numbers: Option<Vec<f64>> = origin.split(',').map(|number| number.trim().parse().ok()).collect();
    let [longitude_deg, latitude_deg, height_m] = numbers.unwrap_or_default()[..] else {
        return Err(CrsError::Unknown);
    };
    let is_valid = longitude_deg.abs() <= 360.0 && latitude_deg.abs() <= 90.0 && height_m.abs() <= 1e5;
    if !is_valid {
        return Err(CrsError::Unsupported("the longitude, latitude or height is out of range".to_owned()));
    }
    let system = System::Local(LocalOrigin { longitude_deg, latitude_deg, height_m, is_ellipsoidal });
    let horizontal =
        Horizontal { code: None, system, axes: Axes::EAST_NORTH, datum: "WGS 84".to_owned(), shift_error_m: 0.0 };
    Ok(Crs { name: name.to_owned(), horizontal, vertical: Vertical::Ellipsoidal { unit_m: 1.0 } })
}

fn proj_string(name: &str) -> Result<Crs, CrsError> {
    let definition = Definition::parse(name).map_err(CrsError::Unsupported)?;
    let shift_error_m = match definition.shift() {
        Some(shift) if shift == [0.0; 7] => 0.0,
        Some(_) => super::DEFAULT_SHIFT_ERROR_M,
        None => f64::INFINITY,
    };
    // Heights without a unit of their own are in that of the map.
    let (is_geocentric, map_unit_m) = (definition.is_geocentric(), definition.unit_m);
    let system = if definition.is_geographic() {
        System::Geographic { definition, unit_deg: 1.0 }
    } else if is_geocentric {
        System::Geocentric(definition)
    } else {
        System::Projected(definition)
    };
    let horizontal =
        Horizontal { code: None, system, axes: Axes::EAST_NORTH, datum: "its datum".to_owned(), shift_error_m };
    let vertical = match vertical_unit_m(name).map_err(CrsError::Unsupported)? {
        _ if is_geocentric => Vertical::Ellipsoidal { unit_m: 1.0 },
        Some(unit_m) if unit_m != map_unit_m => {
            Vertical::Orthometric(VerticalDatum { unit_m, ..VerticalDatum::named("its vertical datum") })
        }
        _ => Vertical::Unknown,
    };
    Ok(Crs { name: name.to_owned(), horizontal, vertical })
}

/// Metres in the unit of heights, if a string for PROJ tells it. Fails with the reason if the unit is not known.
fn vertical_unit_m(text: &str) -> Result<Option<f64>, String> {
    for token in text.split_ascii_whitespace() {
        match token.trim_start_matches('+').split_once('=') {
            Some(("vunits", unit)) => return unit_m(unit).map(Some).ok_or(format!("the unit {unit} is not known")),
            Some(("vto_meter", metres)) => return positive(metres).map(Some),
            _ => {}
        }
    }
    Ok(None)
}

/// Names such as `ETRS89_UTM32*DE_DHHN2016_NH*GCG2016`. Their projected coordinates are easting and northing.
fn adv(name: &str, rest: &str) -> Result<Crs, CrsError> {
    let mut parts = rest.split('*');
    let first = parts.next().unwrap_or_default();
    let (_, code) = ADV_HORIZONTAL.iter().find(|(start, _)| first.starts_with(start)).ok_or(CrsError::Unknown)?;
    let mut crs = from_codes(*code, None)?;
    if matches!(crs.horizontal.system, System::Projected(_)) {
        crs.horizontal.axes = Axes::EAST_NORTH;
    }
    if let Some(part) = parts.next() {
        let known = ADV_VERTICAL.iter().find(|(start, _)| part.starts_with(start));
        let datum = known.map_or_else(|| VerticalDatum::named(part), |(_, code)| VerticalDatum::from_code(*code));
        crs.vertical = if part.starts_with("ETRS89_H") {
            Vertical::Ellipsoidal { unit_m: 1.0 }
        } else {
            Vertical::Orthometric(datum)
        };
    }
    crs.name = match &crs.vertical {
        Vertical::Orthometric(VerticalDatum { code: Some(vertical), .. }) => format!("EPSG:{code}+{vertical}"),
        Vertical::Unknown => format!("EPSG:{code}"),
        _ => name.to_owned(),
    };
    Ok(crs)
}

/// Codes behind the names of registries, in URNs, URLs and short forms: all numbers behind `EPSG` that can be codes.
fn tokens(upper: &str) -> Result<Crs, CrsError> {
    let is_separator = |c: char| matches!(c, ':' | '/' | '#' | ',' | '?' | '&' | '=' | '+' | '_' | ' ' | '(' | ')');
    let mut registry = Registry::None;
    let mut codes = Vec::new();
    for token in upper.split(is_separator).filter(|token| !token.is_empty()) {
        match token {
            // Databases have the numbers of that registry.
            "EPSG" | "EPSG.XML" | "EPSG0" | "EPSG.IO" | "SRID" => registry = Registry::Epsg,
            "ESRI" => registry = Registry::Esri,
            "IGNF" => registry = Registry::Ignf,
            "SR-ORG" => registry = Registry::Other,
            "CRS84" | "OGC84" => return crs84(false),
            "CRS84H" => return crs84(true),
            "CRS" if registry == Registry::None => registry = Registry::Ogc,
            "84" if registry == Registry::Ogc => return crs84(false),
            _ if registry == Registry::Ignf => {
                if let Some((_, code)) = IGNF.iter().find(|(name, _)| *name == token) {
                    codes.push(*code);
                }
            }
            _ if matches!(registry, Registry::Epsg | Registry::Esri) => {
                codes.extend(code(token).filter(|code| *code >= MIN_CODE));
            }
            _ => {}
        }
    }
    match codes[..] {
        [code] if registry::vertical(code).is_none() => from_codes(code, None),
        [horizontal, vertical] => from_codes(horizontal, Some(vertical)),
        _ => Err(CrsError::Unknown),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Registry {
    None,
    Epsg,
    Esri,
    Ignf,
    Ogc,
    Other,
}

/// WGS84 with longitude first.
fn crs84(has_height: bool) -> Result<Crs, CrsError> {
    let mut horizontal = horizontal_from_code(4326)?;
    horizontal.axes = Axes::EAST_NORTH;
    let (name, vertical) = match has_height {
        true => ("OGC:CRS84h", Vertical::Ellipsoidal { unit_m: 1.0 }),
        false => ("OGC:CRS84", Vertical::Unknown),
    };
    Ok(Crs { name: name.to_owned(), horizontal, vertical })
}
