//! Tiles and strips that are JPEG or WebP pictures.

use super::super::error::RasterError;
use super::super::facts::RasterSize;
use image::ImageDecoder;
use image::codecs::webp::WebPDecoder;
use std::io::Cursor;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Unpacks a JPEG picture to the numbers it stores: what they mean, such as YCbCr, is known to the TIFF alone.
///
/// `tables` are the parts that all pictures of the image share. `size` is that of the chunk.
pub(super) fn jpeg(packed: &[u8], tables: &[u8], size: RasterSize, lanes: u16) -> Result<Vec<u8>, RasterError> {
    let damaged = |what: String| RasterError::damaged(format!("a JPEG tile or strip: {what}"));
    // Both have marks of their start and end, of two bytes each.
    let whole = match (tables.len().checked_sub(2), packed.get(2..)) {
        (Some(end), Some(rest)) => [&tables[..end], rest].concat(),
        _ => packed.to_vec(),
    };
    let (width, height) = (size.width as usize, size.height as usize);
    let options = DecoderOptions::default().set_max_width(width).set_max_height(height);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(whole), options);
    decoder.decode_headers().map_err(|error| damaged(error.to_string()))?;
    let stored = decoder.input_colorspace().ok_or_else(|| damaged("its colours are unknown".to_owned()))?;
    decoder.set_options(options.jpeg_set_out_colorspace(stored));
    if stored.num_components() != usize::from(lanes) || decoder.dimensions().is_none_or(|size| size.0 != width) {
        return Err(damaged("it has another size than the file says".to_owned()));
    }
    decoder.decode().map_err(|error| damaged(error.to_string()))
}

/// Unpacks a WebP picture to red, green, blue and, with four lanes, alpha.
pub(super) fn webp(packed: Vec<u8>, size: RasterSize, lanes: u16) -> Result<Vec<u8>, RasterError> {
    let damaged = |what: String| RasterError::damaged(format!("a WebP tile or strip: {what}"));
    let decoder = WebPDecoder::new(Cursor::new(packed)).map_err(|error| damaged(error.to_string()))?;
    let (stored, dimensions) = (decoder.color_type().channel_count(), decoder.dimensions());
    if dimensions.0 != size.width || dimensions.1 > size.height || !matches!(lanes, 3 | 4) {
        return Err(damaged("it has another size than the file says".to_owned()));
    }
    let mut bytes = vec![0; decoder.total_bytes() as usize];
    decoder.read_image(&mut bytes).map_err(|error| damaged(error.to_string()))?;
    if stored == lanes as u8 {
        return Ok(bytes);
    }
    // An opaque tile may have no alpha.
    let pixels = bytes.chunks_exact(usize::from(stored));
    Ok(pixels.flat_map(|pixel| (0..usize::from(lanes)).map(|lane| pixel.get(lane).copied().unwrap_or(255))).collect())
}

/// Converts pixels from YCbCr to red, green and blue (ITU-R BT.601, full range, as in JPEG).
pub(super) fn rgb_of_ycbcr(bytes: &mut [u8]) {
    for pixel in bytes.as_chunks_mut::<3>().0 {
        let [y, cb, cr] = pixel.map(f32::from);
        let (cb, cr) = (cb - 128.0, cr - 128.0);
        *pixel = [y + 1.402 * cr, y - 0.344_136 * cb - 0.714_136 * cr, y + 1.772 * cb].map(|value| value.round() as u8);
    }
}
