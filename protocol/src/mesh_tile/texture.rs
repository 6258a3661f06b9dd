//! Decoding of mesh textures.

use super::TileTexture;
use crate::error::{DecodeError, invalid_if};
use image::{ImageFormat, ImageReader, Limits};
use std::io::Cursor;

/// Most bytes that decoding may take beyond the texels: per texel, and in all.
const DECODING_BYTES_PER_TEXEL: u64 = 16;
const DECODING_BYTES: u64 = 1 << 20;

impl TileTexture {
    /// Decodes the texture: three bytes per texel in sRGB, row by row from the upper left.
    ///
    /// Fails as [`decode_webp`] does.
    pub fn decode(&self) -> Result<Vec<u8>, DecodeError> {
        decode_webp(&self.bytes, self.size_px.map(u32::from))
    }
}

/// Decodes a WebP file of a stated width and height, which bound the memory that is taken: three bytes per texel in sRGB.
///
/// Fails if the file is damaged, takes more memory than an image of that size needs, or is of another size.
pub fn decode_webp(file: &[u8], size_px: [u32; 2]) -> Result<Vec<u8>, DecodeError> {
    let damaged = |_| DecodeError::Invalid("a mesh's texture is damaged");
    let [width_px, height_px] = size_px;
    let texels = u64::from(width_px) * u64::from(height_px);
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(width_px), Some(height_px));
    limits.max_alloc = Some(texels.saturating_mul(DECODING_BYTES_PER_TEXEL).saturating_add(DECODING_BYTES));
    let mut reader = ImageReader::with_format(Cursor::new(file), ImageFormat::WebP);
    reader.limits(limits);
    let rgb = reader.decode().map_err(damaged)?.into_rgb8();
    invalid_if(rgb.dimensions() != (width_px, height_px), "a mesh's texture is not of its stated size")?;
    Ok(rgb.into_raw())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    #[test]
    fn decodes_a_webp_of_the_stated_size_only() {
        let image = RgbImage::from_fn(70, 30, |x, y| Rgb([x as u8, y as u8, 9]));
        let mut webp = Cursor::new(Vec::new());
        image.write_to(&mut webp, ImageFormat::WebP).unwrap();
        let webp = webp.into_inner();
        let decode = |size_px, bytes: &[u8]| TileTexture { size_px, bytes: bytes.to_vec() }.decode();
        assert_eq!(decode([70, 30], &webp).unwrap(), image.into_raw());
        for (size_px, bytes) in
            [([70, 31], &webp[..]), ([71, 30], &webp), ([35, 15], &webp), ([70, 30], &webp[..60]), ([70, 30], &[])]
        {
            assert!(matches!(decode(size_px, bytes), Err(DecodeError::Invalid(_))), "{size_px:?}");
        }
    }
}
