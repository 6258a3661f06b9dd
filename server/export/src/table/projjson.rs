//! Coordinate systems as PROJJSON (<https://proj.org/specifications/projjson.html>), which GeoParquet asks for.
//!
//! Methods are given as definitions of PROJ. Readers find the shift of the datum by the code of the geographic system.

use crate::format::PlaneDefinition;
use serde_json::{Value, json};

/// A projected system with its code. `None` if its definition has no `+proj`.
pub(super) fn projected(epsg: u32, definition: &PlaneDefinition) -> Option<Value> {
    let method = definition.proj.split_whitespace().find_map(|word| word.strip_prefix("+proj="))?;
    // Datum and type are those of the members below.
    let is_kept = |word: &&str| {
        !["+proj=", "+towgs84=", "+nadgrids=", "+geoidgrids=", "+no_defs", "+type=", "+vunits="]
            .iter()
            .any(|name| word.starts_with(name))
    };
    let parameters: Vec<&str> = definition.proj.split_whitespace().filter(is_kept).collect();
    let base = definition.base_epsg;
    let [semi_major_axis, inverse_flattening] = definition.ellipsoid;
    let ellipsoid = if inverse_flattening.is_finite() {
        json!({ "name": "unknown", "semi_major_axis": semi_major_axis, "inverse_flattening": inverse_flattening })
    } else {
        json!({ "name": "unknown", "radius": semi_major_axis })
    };
    let axis = |name: &str, abbreviation: &str, direction: &str, unit: &str| json!({ "name": name, "abbreviation": abbreviation, "direction": direction, "unit": unit });
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
        "conversion": {
            "name": "unknown",
            "method": { "name": format!("PROJ {method} {}", parameters.join(" ")) },
            "parameters": [],
        },
        "coordinate_system": {
            "subtype": "Cartesian",
            "axis": [axis("Easting", "E", "east", "metre"), axis("Northing", "N", "north", "metre")],
        },
        "id": { "authority": "EPSG", "code": epsg },
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_method_has_the_parameters_and_no_shift() {
        let proj = "+proj=utm +zone=32 +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m +no_defs +type=crs".to_owned();
        let mut definition = PlaneDefinition { base_epsg: 4258, proj, ellipsoid: [6_378_137.0, 298.257_222_101] };
        let json = projected(25832, &definition).unwrap();
        assert_eq!(json["conversion"]["method"]["name"], "PROJ utm +zone=32 +ellps=GRS80 +units=m");
        assert_eq!((&json["id"]["code"], &json["base_crs"]["id"]["code"]), (&json!(25832), &json!(4258)));
        definition.proj = String::new();
        assert_eq!(projected(25832, &definition), None);
    }
}
