//! Pixels into files: PNG for eyes, PFM for distances.
//!
//! In: [`Pixels`]. Out: files. Next: people, or a comparison with a reference renderer.

use crate::error::{ClientError, Result};
use insula_shaders::cpu::raycast::Pixels;
use std::path::Path;

/// Writes the colours as PNG, whatever the name ends with.
pub fn write_png(path: &Path, pixels: &Pixels) -> Result<()> {
    let rgb: Vec<u8> = pixels.colour.iter().flat_map(|c| [*c as u8, (*c >> 8) as u8, (*c >> 16) as u8]).collect();
    let failed =
        |e: &dyn std::fmt::Display| ClientError::Failed(format!("{}: {e}: choose another place", path.display()));
    let picture = image::RgbImage::from_raw(pixels.width_px, pixels.height_px, rgb)
        .ok_or_else(|| failed(&"the ray-caster gave no whole picture"))?;
    picture.save_with_format(path, image::ImageFormat::Png).map_err(|e| failed(&e))
}

/// Distances as little-endian PFM: `Pf`, size, -1.0, then rows from the bottom to the top.
pub fn pfm(pixels: &Pixels) -> Vec<u8> {
    let mut out = format!("Pf\n{} {}\n-1.0\n", pixels.width_px, pixels.height_px).into_bytes();
    let rows = pixels.distance.chunks_exact(pixels.width_px.max(1) as usize);
    for distance in rows.rev().flatten() {
        out.extend_from_slice(&distance.to_le_bytes());
    }
    out
}

/// Writes the distances.
pub fn write_pfm(path: &Path, pixels: &Pixels) -> Result<()> {
    std::fs::write(path, pfm(pixels)).map_err(ClientError::file(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_go_from_the_bottom_up() {
        let distance = vec![1.0, 2.0, 3.0, f32::INFINITY];
        let pixels = Pixels { width_px: 2, height_px: 2, colour: vec![0; 4], distance, hit: vec![0; 4] };
        let bytes = pfm(&pixels);
        let (head, body) = bytes.split_at(bytes.len() - 16);
        assert_eq!(head, b"Pf\n2 2\n-1.0\n");
        let values: Vec<f32> = body.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(values, [3.0, f32::INFINITY, 1.0, 2.0]);
    }
}
