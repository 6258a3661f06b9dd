//! Image files of a rendered frame: PNG, JPEG or WebP for colours, PFM for distances and radiances.

mod caption;
mod legend;
mod picture_format;
mod picture_notes;

use crate::error::{ClientError, Result};
use image::{ImageFormat, RgbImage, RgbaImage};
use insula_archive::new_file::replace;
use insula_command_line::output::FileKind;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::tone::decode_radiance;
pub use picture_format::{PictureFormat, parse_picture_path};
pub use picture_notes::PictureNotes;
use std::io::Cursor;
use std::path::Path;

/// Writes the colours as PNG without a caption or notes, whatever the extension of `path`. For measurements. Fails if the file
/// cannot be written.
pub fn write_png(path: &Path, pixels: &Pixels) -> Result<()> {
    write_encoded(path, picture_format::encode(PictureFormat::Png, &rgb_image(path, pixels)?, &PictureNotes::default()))
}

/// Writes the colours in the format of `path`'s extension, with `notes` in the file and, if it is to have one, their caption in
/// the lower right corner. Fails if the extension is not that of a format, or if the file cannot be written.
pub fn write_picture(path: &Path, pixels: &Pixels, notes: &PictureNotes) -> Result<()> {
    let format = PictureFormat::of(path).map_err(ClientError::Usage)?;
    let mut image = rgb_image(path, pixels)?;
    if let Some(legend) = &notes.legend {
        legend::draw_legend(&mut image, legend);
    }
    if notes.has_caption {
        caption::draw_caption(&mut image, &notes.credits);
    }
    write_encoded(path, picture_format::encode(format, &image, notes))
}

fn write_encoded(path: &Path, encoded: Result<Vec<u8>, String>) -> Result<()> {
    let bytes = encoded.map_err(|e| cannot_write(path, &e))?;
    replace(path, &bytes).map_err(|e| cannot_write(path, &e))
}

fn cannot_write(path: &Path, reason: &dyn std::fmt::Display) -> ClientError {
    ClientError::Failed(format!("cannot write {}: {reason}: choose another path", path.display()))
}

fn rgb_image(path: &Path, pixels: &Pixels) -> Result<RgbImage> {
    let rgb = pixels.colour.iter().flat_map(|c| [*c as u8, (*c >> 8) as u8, (*c >> 16) as u8]).collect();
    let image = RgbImage::from_raw(pixels.width_px, pixels.height_px, rgb);
    image.ok_or_else(|| cannot_write(path, &"the frame has fewer pixels than its size says"))
}

/// Encodes the distances in metres as little-endian PFM: `Pf`, size, -1.0, then rows from bottom to top.
pub fn encode_pfm(pixels: &Pixels) -> Vec<u8> {
    let mut out = format!("Pf\n{} {}\n-1.0\n", pixels.width_px, pixels.height_px).into_bytes();
    let rows = pixels.distance.chunks_exact(pixels.width_px.max(1) as usize);
    for distance in rows.rev().flatten() {
        out.extend_from_slice(&distance.to_le_bytes());
    }
    out
}

/// Writes the radiances as little-endian colour PFM: `PF`, size, -1.0, then rows from bottom to top. Fails if the frame is not
/// lit or the file cannot be written.
pub fn write_radiance(path: &Path, pixels: &Pixels) -> Result<()> {
    if pixels.radiance.is_empty() {
        return Err(ClientError::Failed("only lit frames have light: use --radiance with --shading lit".into()));
    }
    let mut out = format!("PF\n{} {}\n-1.0\n", pixels.width_px, pixels.height_px).into_bytes();
    for word in pixels.radiance.chunks_exact(pixels.width_px.max(1) as usize).rev().flatten() {
        for component in decode_radiance(*word).to_array() {
            out.extend_from_slice(&component.to_le_bytes());
        }
    }
    replace(path, &out).map_err(ClientError::file(path))
}

/// Writes the number of each pixel's object, row by row from the top: a little-endian u32 a pixel, 4,294,967,295 where there is none. A
/// file that ends in `.png` gets the same bytes as red, green, blue and alpha. Fails if the file cannot be written.
pub fn write_objects(path: &Path, [width, height]: [u32; 2], objects: &[u32]) -> Result<()> {
    let bytes: Vec<u8> = objects.iter().flat_map(|object| object.to_le_bytes()).collect();
    if !is_png(path) {
        return replace(path, &bytes).map_err(ClientError::file(path));
    }
    let image = RgbaImage::from_raw(width, height, bytes);
    let image = image.ok_or_else(|| cannot_write(path, &"the frame has fewer pixels than its size says"))?;
    let mut png = Cursor::new(Vec::new());
    image.write_to(&mut png, ImageFormat::Png).map_err(|error| cannot_write(path, &error))?;
    replace(path, png.get_ref()).map_err(ClientError::file(path))
}

/// Whether a file of objects is a picture.
fn is_png(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
}

/// What a picture has that [`write_picture`] writes to this path.
pub fn picture_kind(path: &Path) -> FileKind {
    match PictureFormat::of(path) {
        Ok(PictureFormat::Jpeg) => FileKind::JPEG,
        Ok(PictureFormat::WebP) => FileKind::WEBP,
        _ => FileKind::PNG,
    }
}

/// What a file has that [`write_objects`] writes to this path.
pub fn objects_kind(path: &Path) -> FileKind {
    if is_png(path) { FileKind::PNG } else { FileKind::Unmarked("known to be an earlier one") }
}

/// Writes the distances as PFM. Fails if the file cannot be written.
pub fn write_pfm(path: &Path, pixels: &Pixels) -> Result<()> {
    replace(path, &encode_pfm(pixels)).map_err(ClientError::file(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pfm_rows_go_from_bottom_to_top() {
        let distance = vec![1.0, 2.0, 3.0, f32::INFINITY];
        let pixels = Pixels { width_px: 2, height_px: 2, colour: vec![0; 4], distance, ..Pixels::default() };
        let bytes = encode_pfm(&pixels);
        let (head, body) = bytes.split_at(bytes.len() - 16);
        assert_eq!(head, b"Pf\n2 2\n-1.0\n");
        let values: Vec<f32> = body.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(values, [3.0, f32::INFINITY, 1.0, 2.0]);
    }
}
