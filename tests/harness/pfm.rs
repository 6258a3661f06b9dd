//! Images of distances as PFM files: little-endian, rows from the bottom.

use anyhow::{Context, Result, ensure};
use std::fs;
use std::path::Path;

/// One number per pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Pfm {
    pub width_px: u32,
    pub height_px: u32,
    /// Row by row from the top.
    pub values: Vec<f32>,
}

impl Pfm {
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = fs::read(path).with_context(|| path.display().to_string())?;
        let mut at = 0;
        let mut words = Vec::new();
        while words.len() < 4 {
            let end = at + bytes[at..].iter().position(u8::is_ascii_whitespace).context("a header that never ends")?;
            words.push(std::str::from_utf8(&bytes[at..end])?.to_owned());
            at = end + 1;
        }
        let (width_px, height_px): (u32, u32) = (words[1].parse()?, words[2].parse()?);
        ensure!(words[0] == "Pf" && words[3].parse::<f32>()? < 0.0, "not a little-endian Pf: {words:?}");
        let data = &bytes[at..];
        let is_whole = data.len() == width_px as usize * height_px as usize * 4 && !data.is_empty();
        ensure!(is_whole, "{} bytes for {width_px} x {height_px}", data.len());
        let rows = data.chunks_exact(width_px as usize * 4).rev().flatten().copied().collect::<Vec<u8>>();
        let values = rows.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        Ok(Self { width_px, height_px, values })
    }
}
