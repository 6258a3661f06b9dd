//! Systems from PROJJSON, as in GeoParquet.

use super::axes::Axes;
use super::definition::Shift;
use super::describe::{self, HorizontalDescription, VerticalDescription};
use super::method::{Meaning, Parameters, meaning};
use super::wkt_crs::direction;
use super::{Crs, CrsError};
use serde_json::Value;

/// Longer texts are refused.
const MAX_BYTES: usize = 1 << 20;

/// Parses a system. Fails if it has no place on Earth, or its projection is not supported.
pub(super) fn parse(text: &str) -> Result<Crs, CrsError> {
    if text.len() > MAX_BYTES {
        return Err(CrsError::Unknown);
    }
    let value: Value = serde_json::from_str(text).map_err(|_| CrsError::Unknown)?;
    let (value, shift) = unbound(&value);
    let name = value["name"].as_str().unwrap_or_default();
    let (horizontal, vertical) = match value["components"].as_array() {
        Some(parts) => (parts.first().unwrap_or(&Value::Null), parts.get(1)),
        None => (value, None),
    };
    // The parts of a compound system may be bound, too.
    let (horizontal, own_shift) = unbound(horizontal);
    let mut described = horizontal_description(horizontal).ok_or(CrsError::Unknown)?;
    described.shift = shift.or(own_shift);
    let vertical = vertical.map(|vertical| vertical_description(unbound(vertical).0));
    let code = value["components"].is_array().then(|| epsg(value)).flatten();
    describe::system(name, code, &described, vertical.as_ref())
}

/// The name of a system, and whether it has a place on Earth; `None` of other texts.
pub(super) fn name(text: &str) -> Option<(String, bool)> {
    let value: Value =
        if text.starts_with('{') && text.len() <= MAX_BYTES { serde_json::from_str(text).ok()? } else { return None };
    Some((value["name"].as_str().unwrap_or_default().trim().to_owned(), value["type"] != "EngineeringCRS"))
}

/// The system that a bound system binds, with its shift.
fn unbound(value: &Value) -> (&Value, Option<Shift>) {
    if value["type"] != "BoundCRS" {
        return (value, None);
    }
    let transformation = &value["transformation"];
    let mut shift = [0.0; 7];
    let names = [8605, 8606, 8607, 8608, 8609, 8610, 8611];
    for parameter in transformation["parameters"].as_array().into_iter().flatten() {
        let index = names.iter().position(|code| parameter["id"]["code"] == *code);
        if let (Some(index), Some(number)) = (index, parameter["value"].as_f64()) {
            shift[index] = number;
        }
    }
    let method = transformation["method"]["name"].as_str().unwrap_or_default().to_ascii_lowercase();
    if method.contains("coordinate frame") {
        shift[3..6].iter_mut().for_each(|rotation| *rotation = -*rotation);
    }
    (&value["source_crs"], Some(shift))
}

fn epsg(value: &Value) -> Option<u32> {
    let id = &value["id"];
    let is_epsg = id["authority"].as_str().is_some_and(|authority| authority.eq_ignore_ascii_case("EPSG"));
    let code = id["code"].as_u64().or_else(|| id["code"].as_str()?.parse().ok())?;
    u32::try_from(code).ok().filter(|_| is_epsg)
}

fn horizontal_description(value: &Value) -> Option<HorizontalDescription> {
    let kind = value["type"].as_str()?;
    let is_projected = kind == "ProjectedCRS";
    if !is_projected && !matches!(kind, "GeographicCRS" | "GeodeticCRS") {
        return None;
    }
    let base = if is_projected { &value["base_crs"] } else { value };
    let datum = if base["datum"].is_object() { &base["datum"] } else { &base["datum_ensemble"] };
    let system = &value["coordinate_system"];
    let axes = system["axis"].as_array().map_or(&[][..], Vec::as_slice);
    let is_geocentric = !is_projected && system["subtype"] == "Cartesian";
    let first_unit = axes.first().map_or(1.0, |axis| unit(&axis["unit"]));
    let meridian = &datum["prime_meridian"]["longitude"];
    let mut directions = axes.iter().filter_map(|axis| direction(axis["direction"].as_str()?));
    let mut description = HorizontalDescription {
        code: epsg(value).or_else(|| crs84(value)),
        datum: datum["name"].as_str().unwrap_or_default().to_owned(),
        ellipsoid: ellipsoid(&datum["ellipsoid"]),
        prime_meridian_deg: match meridian["value"].as_f64() {
            Some(value) => value * unit(&meridian["unit"]),
            None => meridian.as_f64().unwrap_or(0.0),
        },
        is_geocentric,
        unit: first_unit,
        axes: directions.next().zip(directions.next()).and_then(|(first, second)| Axes::new(first, second)),
        height_unit_m: (axes.len() == 3 && !is_geocentric).then(|| axes.get(2).map_or(1.0, |axis| unit(&axis["unit"]))),
        ..HorizontalDescription::default()
    };
    if is_projected {
        description.method = Some(value["conversion"]["method"]["name"].as_str()?.to_owned());
        description.parameters = parameters(&value["conversion"]["parameters"]);
    }
    Some(description)
}

/// WGS84 with longitude first: the default of GeoParquet.
fn crs84(value: &Value) -> Option<u32> {
    let is_ogc = value["id"]["authority"] == "OGC";
    (is_ogc && value["id"]["code"] == "CRS84").then_some(4326)
}

fn ellipsoid(value: &Value) -> Option<[f64; 2]> {
    let length_m = |value: &Value| value.as_f64().or_else(|| Some(value["value"].as_f64()? * unit(&value["unit"])));
    if let Some(radius) = length_m(&value["radius"]) {
        return Some([radius, 0.0]);
    }
    let a = length_m(&value["semi_major_axis"])?;
    let flattening = value["inverse_flattening"].as_f64().or_else(|| {
        let b = length_m(&value["semi_minor_axis"])?;
        Some(if a == b { 0.0 } else { a / (a - b) })
    });
    Some([a, flattening?])
}

/// Metres, degrees or 1 in a unit.
fn unit(value: &Value) -> f64 {
    let factor =
        value["conversion_factor"].as_f64().filter(|factor| factor.is_finite() && *factor > 1e-9 && *factor < 1e6);
    match (factor, value["type"].as_str()) {
        (Some(factor), Some("AngularUnit")) => factor.to_degrees(),
        (Some(factor), _) => factor,
        // `metre`, `degree` and `unity`.
        (None, _) => 1.0,
    }
}

fn parameters(list: &Value) -> Parameters {
    let mut found = Vec::new();
    for parameter in list.as_array().into_iter().flatten() {
        let (Some(name), Some(value)) = (parameter["name"].as_str(), parameter["value"].as_f64()) else { continue };
        match meaning(name) {
            Meaning::Degrees(name) | Meaning::Metres(name) => found.push((name, value * unit(&parameter["unit"]))),
            Meaning::Ratio(name) => found.push((name, value)),
            Meaning::Other => {}
        }
    }
    Parameters(found)
}

fn vertical_description(value: &Value) -> VerticalDescription {
    let axis = &value["coordinate_system"]["axis"][0];
    let sign = if axis["direction"] == "down" { -1.0 } else { 1.0 };
    VerticalDescription {
        code: epsg(value),
        name: value["name"].as_str().unwrap_or_default().to_owned(),
        unit_m: unit(&axis["unit"]) * sign,
        is_ellipsoidal: false,
    }
}
