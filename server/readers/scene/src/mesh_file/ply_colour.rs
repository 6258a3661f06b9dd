//! Where the colour of a PLY row is, by the names of its properties.

use insula_simplify::model::ply_header::{PlyElement, PlyNumber};
use insula_simplify::model::ply_values::PlyRow;

/// Names of colours.
const COLOUR_NAMES: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

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
    let places = COLOUR_NAMES.iter().find_map(|names| element.places(*names))?;
    let scale = match element.properties.get(places[0])?.number {
        PlyNumber::F32 | PlyNumber::F64 => 255.0,
        PlyNumber::I16 | PlyNumber::U16 => 1.0 / 257.0,
        _ => 1.0,
    };
    Some(ColourPlaces { places, scale })
}
