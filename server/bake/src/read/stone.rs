//! The stone of a landmark: its parameters, and the colour that it has from afar.

use glam::Vec3;
use insula_shaders::cpu::shade::encode_srgb;
use insula_shaders::cpu::stone::stone_surface;
use insula_shaders::stone::StoneParameters;
use insula_source::error::InputError;

/// A pixel that covers so much of a stone sees its mean colour.
const FAR_M: f32 = 1e6;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::read) struct CityStone {
    /// Index into the manifest's stones.
    pub(in crate::read) number: u8,
    /// Mean colour in 8-bit sRGB.
    pub(in crate::read) rgb: [u8; 3],
}

/// Mean colour of a stone in 8-bit sRGB. Fails if the text is not that of a stone's parameters.
pub(in crate::read) fn mean_colour(label: &str, text: &str) -> Result<[u8; 3], InputError> {
    let refused = |what: String| InputError::unsupported(label, format!("its stone is not known: {what}"));
    let parameters: StoneParameters = serde_json::from_str(text).map_err(|error| refused(error.to_string()))?;
    let stone = parameters.stone().map_err(|error| refused(error.to_string()))?;
    let far = stone_surface(&stone, Vec3::ZERO, Vec3::X, 1.0, FAR_M);
    let word = encode_srgb(far.matt_colour());
    Ok([0, 8, 16].map(|shift| (word >> shift & 255) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stones_have_their_colours_and_errors_name_them() {
        let [r, g, b] = mean_colour("a", r#"{"preset":"carrara-marble"}"#).unwrap();
        assert!(r > 180 && g > 180 && b > 180 && r >= b, "{r} {g} {b}");
        let [r, g, _] = mean_colour("a", r#"{"preset":"red-granite"}"#).unwrap();
        assert!(r > g + 20, "{r} {g}");
        let error = mean_colour("a.json", r#"{"preset":"chalk"}"#).unwrap_err().to_string();
        assert!(error.contains("a.json") && error.contains("carrara-marble"), "{error}");
        assert!(mean_colour("a", r#"{"preset":"bronze","roughness":[0,2]}"#).is_err());
    }
}
