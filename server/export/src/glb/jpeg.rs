//! Textures for programs that do not read WebP.

use super::ExportError;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use insula_protocol::mesh_tile::TileTexture;

/// Quality of JPEG files, of 100.
const QUALITY: u8 = 85;

/// A texture as a JPEG file. Fails if the texture is damaged.
pub(super) fn jpeg_of(texture: &TileTexture) -> Result<Vec<u8>, ExportError> {
    let rgb = texture.decode().map_err(|error| ExportError::Encode(error.to_string()))?;
    let [width_px, height_px] = texture.size_px.map(u32::from);
    let mut jpeg = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, QUALITY);
    let encoded = encoder.encode(&rgb, width_px, height_px, ExtendedColorType::Rgb8);
    encoded.map_err(|error| ExportError::Encode(error.to_string()))?;
    Ok(jpeg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::test_city::webp;

    #[test]
    fn a_texture_keeps_its_size_and_damage_is_an_error() {
        let jpeg = jpeg_of(&webp()).unwrap();
        let image = image::load_from_memory_with_format(&jpeg, image::ImageFormat::Jpeg).unwrap();
        assert_eq!((image.width(), image.height()), (2, 1));
        let damaged = TileTexture { bytes: vec![0; 20], ..webp() };
        assert!(matches!(jpeg_of(&damaged), Err(ExportError::Encode(_))));
    }
}
