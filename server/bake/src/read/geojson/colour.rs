//! What a footprint's prism looks like, from the names that OpenStreetMap gives to it.
//!
//! In: a feature's properties, the palette. Out: colours of roof, walls and floor. Next: `footprint`.

use serde_json::{Map, Value};

use crate::read::palette::{Palette, parse_colour};

const ROOF: &[&str] = &["roof:colour", "roof:color"];
const WALL: &[&str] = &["building:colour", "building:color", "colour", "color"];

/// The colour that is told, else the material's, else the palette's. `note` hears of colours that are none.
pub(super) fn of(properties: &Map<String, Value>, palette: &Palette, mut note: impl FnMut(String)) -> [[u8; 3]; 3] {
    let mut look = |colours: &[&str], material: &str, surface: &str| {
        told(properties, colours, &mut note)
            .or_else(|| palette.material(properties.get(material)?.as_str()?))
            .unwrap_or_else(|| palette.colour(Some(surface), "Building"))
    };
    let roof = look(ROOF, "roof:material", "RoofSurface");
    let wall = look(WALL, "building:material", "WallSurface");
    [roof, wall, palette.colour(Some("GroundSurface"), "Building")]
}

/// Of several colours, as in `red;white`, the first.
fn told(properties: &Map<String, Value>, names: &[&str], note: &mut impl FnMut(String)) -> Option<[u8; 3]> {
    names.iter().find_map(|name| {
        let value = properties.get(*name).filter(|value| !value.is_null())?;
        let colour = value.as_str().and_then(|text| parse_colour(text.split(';').next()?));
        if colour.is_none() {
            note(format!("{name} is {value}"));
        }
        colour
    })
}
