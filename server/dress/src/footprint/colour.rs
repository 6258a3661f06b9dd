//! Colours of a footprint's building, from the attribute names of OpenStreetMap, city offices and Overture.

use crate::palette::{BuildingLook, Palette, SurfaceFacts, parse_colour};
use insula_source::attributes::Attributes;
use insula_source::report::ColourOrigin;
use insula_source::text::{first_value, values_of};

const ROOF: &[&str] = &["roof:colour", "roof:color", "roof_color"];
const WALL: &[&str] = &["building:colour", "building:color", "colour", "color", "facade_color"];
/// Names of the building's use, the most telling first.
const USE: &[&str] = &["building:use", "building", "usage", "function", "class", "subtype"];

/// What follows from the building's use, as far as the attributes tell. Of several uses in one value, the first that is known counts.
pub fn by_use<T>(attributes: &Attributes, of_use: fn(&str) -> Option<T>) -> Option<T> {
    USE.iter().find_map(|name| values_of(attributes.named(name)?.as_str()?).find_map(of_use))
}

/// A colour with where it comes from, and whether the surface is water or glass.
#[derive(Debug, Clone, Copy)]
pub struct ResolvedColour {
    pub rgb: [u8; 3],
    pub origin: ColourOrigin,
    pub is_reflective: bool,
}

const FLAT: SurfaceFacts<'static> =
    SurfaceFacts { semantic: None, object_type: "Building", material: None, normal_z: 1.0 };

fn material(
    palette: &Palette,
    own: Option<[u8; 3]>,
    surface: &SurfaceFacts<'_>,
    look: &BuildingLook,
) -> ResolvedColour {
    let (rgb, origin) = palette.resolve(own, surface, look);
    ResolvedColour { rgb, origin, is_reflective: surface.is_reflective() }
}

/// Colours of a building's parts.
pub struct BuildingColours {
    pub roof: ResolvedColour,
    pub wall: ResolvedColour,
    pub floor: ResolvedColour,
}

/// Colours of roof, walls and floor: the feature's own, else that of its material, else the palette's. Passes invalid
/// colours to `note`.
pub fn building_colours(
    attributes: &Attributes,
    palette: &Palette,
    look: &BuildingLook,
    mut note: impl FnMut(String),
) -> BuildingColours {
    let mut colour_of = |colours: &[&str], materials: &[&str], semantic: &str, normal_z: f64| {
        let own = named_colour(attributes, colours, &mut note);
        let name = materials.iter().find_map(|name| attributes.named(name)?.as_str());
        let surface = SurfaceFacts { semantic: Some(semantic), material: name, normal_z, ..FLAT };
        material(palette, own, &surface, look)
    };
    let roof = colour_of(ROOF, &["roof:material", "roof_material"], "RoofSurface", 1.0);
    let wall = colour_of(WALL, &["building:material", "facade_material"], "WallSurface", 0.0);
    BuildingColours { roof, wall, floor: colour_of(&[], &[], "GroundSurface", 1.0) }
}

/// The first valid colour among the named properties. Of several colours in one value, as in `red;white`, the first is
/// used.
fn named_colour(attributes: &Attributes, names: &[&str], note: &mut impl FnMut(String)) -> Option<[u8; 3]> {
    names.iter().find_map(|name| {
        let value = attributes.named(name)?;
        let colour = value.as_str().and_then(|text| parse_colour(first_value(text)));
        if colour.is_none() {
            note(format!("{name} is {value}"));
        }
        colour
    })
}
