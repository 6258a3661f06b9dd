//! Coordinate systems as PROJJSON (<https://proj.org/specifications/projjson.html>), which GeoParquet asks for.
//!
//! Usual methods have their names in the registry, by which readers see that the system is that of the code. Others are given as
//! definitions of PROJ. Readers find the shift of the datum by the code of the geographic system.

use crate::format::PlaneDefinition;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Words of definitions that the datum has, or nobody.
const OF_DATUM: [&str; 12] =
    ["towgs84", "nadgrids", "geoidgrids", "no_defs", "type", "vunits", "ellps", "datum", "a", "b", "rf", "R"];

/// A parameter of a method: its name in the registry, the one of PROJ, the value where a definition has none, and the unit.
type Parameter = (&'static str, &'static str, f64, &'static str);

const TRANSVERSE_MERCATOR: &str = "Transverse Mercator";
/// Of methods with a natural origin. The last one is not of all.
static NATURAL: [Parameter; 5] = [
    ("Latitude of natural origin", "lat_0", 0.0, "degree"),
    ("Longitude of natural origin", "lon_0", 0.0, "degree"),
    ("False easting", "x_0", 0.0, "metre"),
    ("False northing", "y_0", 0.0, "metre"),
    ("Scale factor at natural origin", "k", 1.0, "unity"),
];
/// Of Lambert's cone with two parallels.
static CONE: [Parameter; 6] = [
    ("Latitude of false origin", "lat_0", 0.0, "degree"),
    ("Longitude of false origin", "lon_0", 0.0, "degree"),
    ("Latitude of 1st standard parallel", "lat_1", 0.0, "degree"),
    ("Latitude of 2nd standard parallel", "lat_2", 0.0, "degree"),
    ("Easting at false origin", "x_0", 0.0, "metre"),
    ("Northing at false origin", "y_0", 0.0, "metre"),
];
/// Of the oblique cylinder of Switzerland.
static CENTRE: [Parameter; 7] = [
    ("Latitude of projection centre", "lat_0", 0.0, "degree"),
    ("Longitude of projection centre", "lon_0", 0.0, "degree"),
    ("Azimuth at projection centre", "azimuth", 90.0, "degree"),
    ("Angle from Rectified to Skew Grid", "angle", 90.0, "degree"),
    ("Scale factor at projection centre", "k", 1.0, "unity"),
    ("Easting at projection centre", "x_0", 0.0, "metre"),
    ("Northing at projection centre", "y_0", 0.0, "metre"),
];

/// The conversion of a definition in the words of the registry; `None` if its method is not known here.
fn conversion(proj: &str) -> Option<Value> {
    let (mut projection, mut values) = ("", BTreeMap::new());
    for word in proj.split_whitespace() {
        let word = word.trim_start_matches('+');
        match word.split_once('=').unwrap_or((word, "1")) {
            ("proj", text) => projection = text,
            ("units", "m") => {}
            (name, _) if OF_DATUM.contains(&name) => {}
            (name, text) => {
                let name = if name == "k_0" { "k" } else { name };
                values.insert(name, text.parse::<f64>().ok()?);
            }
        }
    }
    let (method, parameters) = match projection {
        "utm" => {
            let (zone, is_south) = (values.remove("zone")?, values.remove("south").is_some());
            let northing_m = if is_south { 1e7 } else { 0.0 };
            values.extend([("lon_0", 6.0 * zone - 183.0), ("k", 0.9996), ("x_0", 500_000.0), ("y_0", northing_m)]);
            (TRANSVERSE_MERCATOR, &NATURAL[..])
        }
        "tmerc" => (TRANSVERSE_MERCATOR, &NATURAL[..]),
        "sterea" => ("Oblique Stereographic", &NATURAL[..]),
        "laea" => ("Lambert Azimuthal Equal Area", &NATURAL[..4]),
        "lcc" if values.contains_key("lat_2") => ("Lambert Conic Conformal (2SP)", &CONE[..]),
        "lcc" => {
            if values.remove("lat_1") != values.get("lat_0").copied() {
                return None;
            }
            ("Lambert Conic Conformal (1SP)", &NATURAL[..])
        }
        "somerc" => ("Hotine Oblique Mercator (variant B)", &CENTRE[..]),
        _ => return None,
    };
    // What has more than that is of another method.
    if values.keys().any(|name| !parameters.iter().any(|(_, known, ..)| known == name)) {
        return None;
    }
    let parameter = |(name, known, default, unit): &Parameter| {
        let value = values.get(*known).unwrap_or(default);
        json!({ "name": name, "value": value, "unit": unit })
    };
    let parameters: Vec<Value> = parameters.iter().map(parameter).collect();
    Some(json!({ "name": "unknown", "method": { "name": method }, "parameters": parameters }))
}

/// The conversion of any definition as PROJ has it. `None` if it has no `+proj`.
fn plain_conversion(proj: &str) -> Option<Value> {
    let method = proj.split_whitespace().find_map(|word| word.strip_prefix("+proj="))?;
    // Datum and type are those of other members.
    let is_kept = |word: &&str| {
        !["+proj=", "+towgs84=", "+nadgrids=", "+geoidgrids=", "+no_defs", "+type=", "+vunits="]
            .iter()
            .any(|name| word.starts_with(name))
    };
    let parameters: Vec<&str> = proj.split_whitespace().filter(is_kept).collect();
    let method = format!("PROJ {method} {}", parameters.join(" "));
    Some(json!({ "name": "unknown", "method": { "name": method }, "parameters": [] }))
}

/// A projected system with its code. `None` if its definition has no `+proj`.
pub(super) fn projected(epsg: u32, definition: &PlaneDefinition) -> Option<Value> {
    let conversion = conversion(&definition.proj).or_else(|| plain_conversion(&definition.proj))?;
    let base = definition.base_epsg;
    let [semi_major_axis, inverse_flattening] = definition.ellipsoid;
    let ellipsoid = if inverse_flattening.is_finite() {
        json!({ "name": "unknown", "semi_major_axis": semi_major_axis, "inverse_flattening": inverse_flattening })
    } else {
        json!({ "name": "unknown", "radius": semi_major_axis })
    };
    let axis = |name: &str, abbreviation: &str, direction: &str, unit: &str| json!({ "name": name, "abbreviation": abbreviation, "direction": direction, "unit": unit });
    let mut axes = [axis("Easting", "E", "east", "metre"), axis("Northing", "N", "north", "metre")];
    if definition.is_north_first {
        axes.reverse();
    }
    Some(json!({
        "$schema": "https://proj.org/schemas/v0.7/projjson.schema.json",
        "type": "ProjectedCRS",
        "name": format!("EPSG:{epsg}"),
        "base_crs": {
            "name": format!("EPSG:{base}"),
            "datum": { "type": "GeodeticReferenceFrame", "name": "unknown", "ellipsoid": ellipsoid },
            "coordinate_system": {
                "subtype": "ellipsoidal",
                "axis": [
                    axis("Geodetic latitude", "Lat", "north", "degree"),
                    axis("Geodetic longitude", "Lon", "east", "degree"),
                ],
            },
            "id": { "authority": "EPSG", "code": base },
        },
        "conversion": conversion,
        "coordinate_system": { "subtype": "Cartesian", "axis": axes },
        "id": { "authority": "EPSG", "code": epsg },
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn definition(proj: &str) -> PlaneDefinition {
        let ellipsoid = [6_378_137.0, 298.257_222_101];
        PlaneDefinition { base_epsg: 4258, proj: proj.to_owned(), ellipsoid, is_north_first: false }
    }

    #[test]
    fn usual_methods_have_the_names_and_values_of_the_registry() {
        let utm = "+proj=utm +zone=32 +south +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m +no_defs +type=crs";
        let json = projected(25832, &definition(utm)).unwrap();
        assert_eq!((&json["id"]["code"], &json["base_crs"]["id"]["code"]), (&json!(25832), &json!(4258)));
        assert_eq!(json["conversion"]["method"]["name"], "Transverse Mercator");
        let of = |json: &Value, member: &str| -> Vec<Value> {
            json["conversion"]["parameters"].as_array().unwrap().iter().map(|one| one[member].clone()).collect()
        };
        assert_eq!(of(&json, "value"), [json!(0.0), json!(9.0), json!(500_000.0), json!(1e7), json!(0.9996)]);
        assert_eq!(of(&json, "unit"), ["degree", "degree", "metre", "metre", "unity"]);
        for (proj, method, count) in [
            ("+proj=sterea +lat_0=52.1 +lon_0=5.3 +k=0.9999079 +x_0=1 +ellps=bessel", "Oblique Stereographic", 5),
            ("+proj=lcc +lat_0=46.5 +lon_0=3 +lat_1=49 +lat_2=44 +x_0=7e5", "Lambert Conic Conformal (2SP)", 6),
            ("+proj=lcc +lat_1=46.5 +lat_0=46.5 +k_0=0.999", "Lambert Conic Conformal (1SP)", 5),
            ("+proj=laea +lat_0=52 +lon_0=10", "Lambert Azimuthal Equal Area", 4),
            ("+proj=somerc +lat_0=46.9 +lon_0=7.4", "Hotine Oblique Mercator (variant B)", 7),
        ] {
            let json = projected(1, &definition(proj)).unwrap();
            assert_eq!((json["conversion"]["method"]["name"].as_str(), of(&json, "name").len()), (Some(method), count));
        }
        // New Zealand has the northing first.
        let north_first = PlaneDefinition { is_north_first: true, ..definition("+proj=tmerc +lon_0=173") };
        let json = projected(2193, &north_first).unwrap();
        assert_eq!(json["coordinate_system"]["axis"][0]["direction"], "north");
    }

    #[test]
    fn other_methods_have_the_parameters_and_no_shift() {
        for (proj, name) in [
            ("+proj=cass +lat_0=1 +towgs84=0,0,0 +units=m +no_defs", "PROJ cass +lat_0=1 +units=m"),
            // More than the registry's methods of this projection have.
            ("+proj=tmerc +lat_0=1 +pm=paris", "PROJ tmerc +lat_0=1 +pm=paris"),
            ("+proj=lcc +lat_1=2 +lat_0=1", "PROJ lcc +lat_1=2 +lat_0=1"),
        ] {
            assert_eq!(projected(1, &definition(proj)).unwrap()["conversion"]["method"]["name"], name);
        }
        assert_eq!(projected(25832, &definition("")), None);
    }
}
