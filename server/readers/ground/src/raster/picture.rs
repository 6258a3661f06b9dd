//! PNG, JPEG, WebP and JPEG 2000: unpacked whole when their first pixel is read.

use super::error::RasterError;
use super::facts::{RasterFacts, RasterLimits, RasterSize, SampleKind, Window};
use super::jpeg2000;
use super::source::Source;
use image::{DynamicImage, ImageDecoder, ImageReader};
use std::io::{BufReader, Seek};

pub(super) struct Picture {
    source: Source,
    is_jpeg2000: bool,
    size: RasterSize,
    limits: RasterLimits,
    /// Red, green, blue and alpha of all pixels, once they are unpacked.
    pixels: Option<Vec<u8>>,
}

/// Whether a file starts like a PNG, JPEG or WebP picture.
pub(super) fn is_picture(start: &[u8]) -> bool {
    let is_webp = start.starts_with(b"RIFF") && start.get(8..12) == Some(b"WEBP");
    start.starts_with(b"\x89PNG\r\n\x1a\n") || start.starts_with(b"\xff\xd8\xff") || is_webp
}

impl Picture {
    /// Reads the header.
    pub(super) fn open(
        mut source: Source,
        start: &[u8],
        limits: RasterLimits,
    ) -> Result<(Self, RasterFacts), RasterError> {
        let is_jpeg2000 = jpeg2000::is_jpeg2000(start);
        let facts = if is_jpeg2000 {
            jpeg2000::facts(&jpeg2000_bytes(&mut source, &limits)?)?
        } else {
            let decoder = decoder(&mut source, &limits)?;
            let (width, height) = decoder.dimensions();
            let colours = decoder.color_type();
            let is_wide = colours.bytes_per_pixel() > colours.channel_count();
            let sample = if is_wide { SampleKind::U16 } else { SampleKind::U8 };
            let mut facts = RasterFacts::new(RasterSize { width, height }, sample);
            facts.bands = u16::from(colours.channel_count());
            facts
        };
        let limit = limits.max_whole_pixels;
        if facts.size.pixels() > limit {
            return Err(RasterError::TooLarge { what: "the number of pixels", limit });
        }
        Ok((Self { source, is_jpeg2000, size: facts.size, limits, pixels: None }, facts))
    }

    pub(super) fn read_colours(&mut self, window: Window, len: usize) -> Result<Vec<[u8; 4]>, RasterError> {
        let all = match &mut self.pixels {
            Some(pixels) => pixels,
            empty => {
                let pixels = if self.is_jpeg2000 {
                    jpeg2000::rgba(&jpeg2000_bytes(&mut self.source, &self.limits)?)?
                } else {
                    let decoder = decoder(&mut self.source, &self.limits)?;
                    DynamicImage::from_decoder(decoder).map_err(damaged)?.into_rgba8().into_raw()
                };
                empty.insert(pixels)
            }
        };
        let (all, width) = (all.as_chunks::<4>().0, self.size.width as usize);
        let mut pixels = Vec::with_capacity(len);
        for row in window.y..window.y + window.height {
            let first = row as usize * width + window.x as usize;
            let row = all.get(first..first + window.width as usize);
            pixels.extend_from_slice(row.ok_or_else(|| RasterError::damaged("it has too few pixels"))?);
        }
        Ok(pixels)
    }
}

fn decoder<'s>(source: &'s mut Source, limits: &RasterLimits) -> Result<impl ImageDecoder + 's, RasterError> {
    source.rewind()?;
    let mut reader = ImageReader::new(BufReader::new(source)).with_guessed_format()?;
    let mut bounds = image::Limits::default();
    // Pixels of four numbers of 16 bits.
    bounds.max_alloc = Some(limits.max_whole_pixels.saturating_mul(8));
    reader.limits(bounds);
    reader.into_decoder().map_err(damaged)
}

fn jpeg2000_bytes(source: &mut Source, limits: &RasterLimits) -> Result<Vec<u8>, RasterError> {
    let limit = limits.max_chunk_bytes;
    if source.len() > limit {
        return Err(RasterError::TooLarge { what: "the number of bytes of a JPEG 2000 file", limit });
    }
    source.read_at(0, source.len())
}

fn damaged(error: image::ImageError) -> RasterError {
    match error {
        image::ImageError::IoError(error) => error.into(),
        other => RasterError::Damaged(other.to_string()),
    }
}
