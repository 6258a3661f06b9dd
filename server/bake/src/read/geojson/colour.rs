//! Colours of a footprint's prism, from the property names of OpenStreetMap.

use serde_json::{Map, Value};

use crate::read::palette::{Palette, parse_colour};

const ROOF: &[&str] = &["roof:colour", "roof:color"];
const WALL: &[&str] = &["building:colour", "building:color", "colour", "color"];

/// Colours of roof, walls and floor: the feature's own, else that of its material, else the palette's. Passes invalid
/// colours to `note`.
pub(super) fn prism_colours(
    properties: &Map<String, Value>,
    palette: &Palette,
    mut note: impl FnMut(String),
) -> [[u8; 3]; 3] {
    let mut colour_of = |colours: &[&str], material: &str, surface: &str| {
        named_colour(properties, colours, &mut note)
            .or_else(|| palette.material(properties.get(material)?.as_str()?))
            .unwrap_or_else(|| palette.colour(Some(surface), "Building"))
    };
    let roof = colour_of(ROOF, "roof:material", "RoofSurface");
    let wall = colour_of(WALL, "building:material", "WallSurface");
    [roof, wall, palette.colour(Some("GroundSurface"), "Building")]
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
