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
    pub(super) is_float: bool,
}

/// Larger floats are bytes: none of 0 to 1 are, but for rounding and light beyond white.
const MOST_OF_UNIT: f64 = 2.0;

impl ColourPlaces {
    /// 8-bit sRGB; not a number becomes 0.
    pub(super) fn of(&self, row: &PlyRow) -> [u8; 3] {
        let numbers = self.numbers(row);
        if self.is_float {
            return bytes_of(&[numbers])[0];
        }
        numbers.map(|number| (number * self.scale).round() as u8)
    }

    /// The colour as it is stored.
    pub(super) fn numbers(&self, row: &PlyRow) -> [f64; 3] {
        self.places.map(|place| row.single(place))
    }
}

/// 8-bit sRGB of floats, which some programs write from 0 to 255.
pub(super) fn bytes_of(floats: &[[f64; 3]]) -> Vec<[u8; 3]> {
    let is_of_bytes = floats.as_flattened().iter().any(|number| *number > MOST_OF_UNIT);
    let scale = if is_of_bytes { 1.0 } else { 255.0 };
    floats.iter().map(|rgb| rgb.map(|number| (number * scale).round() as u8)).collect()
}

/// The colour of an element's rows, if they have one.
pub(super) fn colour_of(element: &PlyElement) -> Option<ColourPlaces> {
    let places = COLOUR_NAMES.iter().find_map(|names| element.places(*names))?;
    let number = element.properties.get(places[0])?.number;
    let scale = if matches!(number, PlyNumber::I16 | PlyNumber::U16) { 1.0 / 257.0 } else { 1.0 };
    Some(ColourPlaces { places, scale, is_float: matches!(number, PlyNumber::F32 | PlyNumber::F64) })
}
