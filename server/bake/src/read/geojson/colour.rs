//! Colours of a footprint's prism, from the property names of OpenStreetMap and city offices.

use serde_json::{Map, Value};

use crate::read::palette::{Look, Palette, SurfaceFacts, parse_colour};
use crate::read::report::ColourOrigin;

const ROOF: &[&str] = &["roof:colour", "roof:color"];
const WALL: &[&str] = &["building:colour", "building:color", "colour", "color"];
/// Names of the building's use, the most telling first.
const USE: &[&str] = &["building:use", "building", "usage", "function", "class", "subtype"];

/// What follows from the building's use, as far as the properties tell.
pub(super) fn by_use<T>(properties: &Map<String, Value>, of_use: fn(&str) -> Option<T>) -> Option<T> {
    USE.iter().find_map(|name| of_use(properties.get(*name)?.as_str()?))
}

/// Colours of roof, walls and floor: the feature's own, else that of its material, else the palette's. Passes invalid
/// colours to `note`.
pub(super) fn prism_colours(
    properties: &Map<String, Value>,
    palette: &Palette,
    look: &Look,
    mut note: impl FnMut(String),
) -> [([u8; 3], ColourOrigin); 3] {
    let mut colour_of = |colours: &[&str], material: &str, semantic: &str, normal_z: f64| {
        let own = named_colour(properties, colours, &mut note);
        let material = properties.get(material).and_then(Value::as_str);
        let surface = SurfaceFacts { semantic: Some(semantic), object_type: "Building", material, normal_z };
        palette.resolve(own, &surface, look)
    };
    let roof = colour_of(ROOF, "roof:material", "RoofSurface", 1.0);
    let wall = colour_of(WALL, "building:material", "WallSurface", 0.0);
    [roof, wall, colour_of(&[], "", "GroundSurface", 1.0)]
}

/// The first valid colour among the named properties. Of several colours in one value, as in `red;white`, the first is
/// used.
fn named_colour(properties: &Map<String, Value>, names: &[&str], note: &mut impl FnMut(String)) -> Option<[u8; 3]> {
    names.iter().find_map(|name| {
        let value = properties.get(*name).filter(|value| !value.is_null())?;
        let colour = value.as_str().and_then(|text| parse_colour(text.split(';').next()?));
        if colour.is_none() {
            note(format!("{name} is {value}"));
        }
        colour
    })
}
