//! JPEG 2000 pictures, with their place by GeoJP2.

use super::error::RasterError;
use super::facts::{RasterFacts, RasterSize, SampleKind};
use super::source::Source;
use super::tiff;
use hayro_jpeg2000::{ColorSpace, DecodeSettings, DecoderContext, Image};
use std::io::Cursor;

/// Marks the box with a GeoTIFF file without pixels.
const GEO_JP2: [u8; 16] =
    [0xb1, 0x4b, 0xf8, 0xbd, 0x08, 0x3d, 0x4b, 0x43, 0xa5, 0xae, 0x8c, 0xd7, 0xd5, 0xa6, 0xce, 0x03];

/// Whether a file starts like a JPEG 2000 file, or a stream without one.
pub(super) fn is_jpeg2000(start: &[u8]) -> bool {
    start.starts_with(b"\0\0\0\x0cjP  \r\n\x87\n") || start.starts_with(b"\xff\x4f\xff\x51")
}

/// What is known before the pixels are unpacked.
pub(super) fn facts(bytes: &[u8]) -> Result<RasterFacts, RasterError> {
    let image = Image::new(bytes, &DecodeSettings::default()).map_err(damaged)?;
    let size = RasterSize { width: image.width(), height: image.height() };
    let sample = if image.original_bit_depth() > 8 { SampleKind::U16 } else { SampleKind::U8 };
    let mut facts = RasterFacts::new(size, sample);
    facts.bands = u16::from(image.color_space().num_channels()) + u16::from(image.has_alpha());
    if let Some(geo) =
        boxes(bytes).find_map(|(kind, content)| content.strip_prefix(&GEO_JP2).filter(|_| kind == b"uuid"))
    {
        (facts.place, facts.crs) = tiff::read_geo(Source::new(Box::new(Cursor::new(geo.to_vec())))?)?;
    }
    Ok(facts)
}

/// Red, green, blue and alpha of all pixels.
pub(super) fn rgba(bytes: &[u8]) -> Result<Vec<u8>, RasterError> {
    let image = Image::new(bytes, &DecodeSettings::default()).map_err(damaged)?;
    let (colours, has_alpha) = (usize::from(image.color_space().num_channels()), image.has_alpha());
    let is_rgb = match image.color_space() {
        ColorSpace::CMYK => {
            return Err(RasterError::unsupported("colours of JPEG 2000 other than grey and red-green-blue"));
        }
        _ => colours >= 3,
    };
    let mut context = DecoderContext::default();
    let numbers = image.decode(&mut context).map_err(damaged)?.data_u8();
    let pixels = numbers.chunks_exact(colours + usize::from(has_alpha));
    let green_and_blue = if is_rgb { [1, 2] } else { [0, 0] };
    Ok(pixels
        .flat_map(|pixel| {
            let alpha = if has_alpha { pixel[colours] } else { 255 };
            [pixel[0], pixel[green_and_blue[0]], pixel[green_and_blue[1]], alpha]
        })
        .collect())
}

/// The boxes of a file: their kind and content. A stream without a file has none.
fn boxes(bytes: &[u8]) -> impl Iterator<Item = (&[u8], &[u8])> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        let (length, after) = rest.split_first_chunk::<4>()?;
        let (kind, after) = after.split_at_checked(4)?;
        let (head, length) = match u32::from_be_bytes(*length) {
            0 => (8, rest.len()),
            1 => (16, usize::try_from(u64::from_be_bytes(*after.first_chunk()?)).ok()?),
            length => (8, length as usize),
        };
        let content = rest.get(head..length)?;
        rest = rest.get(length..)?;
        Some((kind, content))
    })
}

fn damaged(error: hayro_jpeg2000::error::DecodeError) -> RasterError {
    RasterError::Damaged(error.to_string())
}
