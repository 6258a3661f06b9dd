//! Colours of a footprint's prism, from the property names of OpenStreetMap and city offices.

use serde_json::{Map, Value};

use crate::read::palette::{Look, Palette, SurfaceFacts, parse_colour};
use crate::read::report::ColourOrigin;

const ROOF: &[&str] = &["roof:colour", "roof:color"];
const WALL: &[&str] = &["building:colour", "building:color", "colour", "color"];
/// Names of the building's use, the most telling first.
const USE: &[&str] = &["building:use", "building", "usage", "function", "class", "subtype"];

/// Properties of areas of water and their values; without values, all but `no`.
const WATER: &[(&str, &[&str])] = &[
    ("natural", &["water", "bay", "strait"]),
    ("water", &[]),
    ("waterway", &["riverbank", "dock", "river", "canal", "stream"]),
    ("landuse", &["reservoir", "basin"]),
];

/// Whether a feature is an area of water. What is said to be a building is none.
pub(super) fn is_water(properties: &Map<String, Value>) -> bool {
    let value = |name: &str| properties.get(name).and_then(Value::as_str).filter(|value| *value != "no");
    let is_any = |(name, values): &(&str, &[&str])| {
        value(name).is_some_and(|value| values.is_empty() || values.contains(&value))
    };
    value("building").is_none() && value("building:part").is_none() && WATER.iter().any(is_any)
}

/// What follows from the building's use, as far as the properties tell.
pub(super) fn by_use<T>(properties: &Map<String, Value>, of_use: fn(&str) -> Option<T>) -> Option<T> {
    USE.iter().find_map(|name| of_use(properties.get(*name)?.as_str()?))
}

/// A colour with where it comes from, and whether the surface is water or glass.
pub(super) struct PrismMaterial {
    pub(super) rgb: [u8; 3],
    pub(super) origin: ColourOrigin,
    pub(super) is_reflective: bool,
}

/// The material of water, by the palette.
pub(super) fn water_material(palette: &Palette) -> PrismMaterial {
    material(palette, None, &SurfaceFacts { object_type: "WaterBody", ..FLAT }, &Look::PLAIN)
}

const FLAT: SurfaceFacts<'static> =
    SurfaceFacts { semantic: None, object_type: "Building", material: None, normal_z: 1.0 };

fn material(palette: &Palette, own: Option<[u8; 3]>, surface: &SurfaceFacts<'_>, look: &Look) -> PrismMaterial {
    let (rgb, origin) = palette.resolve(own, surface, look);
    PrismMaterial { rgb, origin, is_reflective: surface.is_reflective() }
}

/// Materials of roof, walls and floor: the feature's own, else that of its material, else the palette's. Passes invalid
/// colours to `note`.
pub(super) fn prism_materials(
    properties: &Map<String, Value>,
    palette: &Palette,
    look: &Look,
    mut note: impl FnMut(String),
) -> [PrismMaterial; 3] {
    let mut colour_of = |colours: &[&str], of_material: &str, semantic: &str, normal_z: f64| {
        let own = named_colour(properties, colours, &mut note);
        let name = properties.get(of_material).and_then(Value::as_str);
        let surface = SurfaceFacts { semantic: Some(semantic), material: name, normal_z, ..FLAT };
        material(palette, own, &surface, look)
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
