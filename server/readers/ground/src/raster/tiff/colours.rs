//! What the numbers of an image mean as colours.

use super::super::error::RasterError;
use super::super::facts::SampleKind;
use super::layout::{Layout, PALETTE, YCBCR};

const ASSOCIATED_ALPHA: u64 = 1;
const ALPHA: u64 = 2;

/// How a pixel is made of its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Model {
    Grey,
    /// Grey with white as 0.
    InvertedGrey,
    Rgb,
    Palette,
    Cmyk,
}

/// How colours are made of the numbers of an image.
pub(super) struct Colours<'a> {
    model: Model,
    /// The bands with colours, then the one with alpha if there is one.
    pub(super) bands: Vec<u16>,
    colour_bands: usize,
    /// Colours are multiplied with alpha.
    is_associated: bool,
    /// The brightest number.
    max: f64,
    colour_map: &'a [u64],
    nodata: Option<f64>,
}

pub(super) fn alpha_band(layout: &Layout) -> Option<u16> {
    let extra = layout.extra_samples.iter().position(|meaning| matches!(*meaning, ALPHA | ASSOCIATED_ALPHA))?;
    let extras = u16::try_from(layout.extra_samples.len()).ok()?;
    layout.bands.checked_sub(extras)?.checked_add(extra as u16)
}

impl<'a> Colours<'a> {
    /// Colours up to `brightest`, or up to the largest number that fits. `named` are the bands of red, green and blue, if they have
    /// names.
    pub(super) fn new(
        layout: &'a Layout,
        nodata: Option<f64>,
        brightest: Option<f64>,
        named: Option<[u16; 3]>,
    ) -> Result<Self, RasterError> {
        if !matches!(layout.sample, SampleKind::U8 | SampleKind::U16 | SampleKind::U32) {
            return Err(RasterError::unsupported(format!("colours of type {:?}", layout.sample)));
        }
        let named = named.filter(|bands| bands.iter().all(|band| *band < layout.bands));
        let alpha = alpha_band(layout).filter(|alpha| named.is_none_or(|bands| !bands.contains(alpha)));
        let colour_bands = layout.bands - u16::from(alpha.is_some());
        let model = match layout.photometric {
            // Writers that do not know of colours have grey and further bands.
            0 | 1 if colour_bands >= 3 => Model::Rgb,
            0 => Model::InvertedGrey,
            1 => Model::Grey,
            2 | YCBCR => Model::Rgb,
            PALETTE => Model::Palette,
            5 => Model::Cmyk,
            other => return Err(RasterError::unsupported(format!("colours of kind {other}"))),
        };
        let used: u16 = match model {
            Model::Grey | Model::InvertedGrey | Model::Palette => 1,
            Model::Rgb => 3,
            Model::Cmyk => 4,
        };
        if colour_bands < used {
            return Err(RasterError::damaged("it has too few bands for its colours"));
        }
        let mut bands: Vec<u16> = match named.filter(|_| model == Model::Rgb) {
            Some(named) => named.to_vec(),
            None => (0..layout.bands).filter(|band| Some(*band) != alpha).take(usize::from(used)).collect(),
        };
        bands.extend(alpha);
        Ok(Self {
            model,
            bands,
            colour_bands: usize::from(used),
            is_associated: alpha.is_some() && layout.extra_samples.contains(&ASSOCIATED_ALPHA),
            max: brightest.unwrap_or_else(|| f64::from(u32::MAX >> (32 - u32::from(layout.bits)))),
            colour_map: &layout.colour_map,
            nodata,
        })
    }

    /// What pixels are before their numbers are added: with a missing value, transparent until one differs from it.
    pub(super) fn start(&self) -> [u8; 4] {
        let colour = if self.model == Model::Cmyk { 255 } else { 0 };
        [colour, colour, colour, if self.nodata.is_some() { 0 } else { 255 }]
    }

    /// Adds a number to a pixel. `slot` is the index of its band in [`Self::bands`]; they come in this order.
    pub(super) fn add(&self, pixel: &mut [u8; 4], slot: usize, number: f64) {
        let value = (number * 255.0 / self.max).round() as u8;
        if slot >= self.colour_bands {
            pixel[3] = pixel[3].min(value);
            if self.is_associated && value > 0 {
                let divided = |colour: u8| (f64::from(colour) * 255.0 / f64::from(value)).round() as u8;
                *pixel = [divided(pixel[0]), divided(pixel[1]), divided(pixel[2]), pixel[3]];
            }
            return;
        }
        if self.nodata.is_some_and(|nodata| number != nodata) {
            pixel[3] = 255;
        }
        match self.model {
            Model::Grey => pixel[..3].fill(value),
            Model::InvertedGrey => pixel[..3].fill(255 - value),
            Model::Rgb => pixel[slot] = value,
            Model::Palette => pixel[..3].copy_from_slice(&self.of_palette(number)),
            Model::Cmyk if slot < 3 => pixel[slot] = 255 - value,
            Model::Cmyk => {
                for colour in &mut pixel[..3] {
                    *colour = (u16::from(*colour) * u16::from(255 - value) / 255) as u8;
                }
            }
        }
    }

    /// All reds come first, then all greens and blues, each of 16 bits. Black after the end.
    fn of_palette(&self, number: f64) -> [u8; 3] {
        let count = self.colour_map.len() / 3;
        let index = number as usize;
        [0, 1, 2].map(|channel| {
            let entry = self.colour_map.get(channel * count + index).filter(|_| index < count);
            entry.map_or(0, |entry| (entry >> 8) as u8)
        })
    }
}
