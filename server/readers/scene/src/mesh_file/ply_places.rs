//! Where the values of a PLY row are that several elements have: by their properties' names.

use super::ply_header::{PlyElement, PlyNumber};
use super::ply_values::PlyRow;

/// Names of colours.
const COLOUR_NAMES: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// Places of properties that are single values.
pub(super) fn places<const N: usize>(element: &PlyElement, names: [&str; N]) -> Option<[usize; N]> {
    let mut found = [0; N];
    for (place, name) in found.iter_mut().zip(names) {
        *place = element.properties.iter().position(|property| property.name == name && property.length.is_none())?;
    }
    Some(found)
}

/// Where the colour of a row is, and how it is stored.
pub(super) struct ColourPlaces {
    places: [usize; 3],
    /// To 8 bits.
    scale: f64,
}

impl ColourPlaces {
    /// 8-bit sRGB; not a number becomes 0.
    pub(super) fn of(&self, row: &PlyRow) -> [u8; 3] {
        self.places.map(|place| (row.single(place) * self.scale).round() as u8)
    }
}

/// The colour of an element's rows, if they have one.
pub(super) fn colour_of(element: &PlyElement) -> Option<ColourPlaces> {
    let places = COLOUR_NAMES.iter().find_map(|names| places(element, *names))?;
    let scale = match element.properties.get(places[0])?.number {
        PlyNumber::F32 | PlyNumber::F64 => 255.0,
        PlyNumber::I16 | PlyNumber::U16 => 1.0 / 257.0,
        _ => 1.0,
    };
    Some(ColourPlaces { places, scale })
}
