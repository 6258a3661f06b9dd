//! Encoding of V-BlockMaps (`docs/formats.md`, "V-BlockMap tile").
//!
//! In: a [`BlockMap`]. Out: the bytes of its tile. Next: the bake stores them in an archive.

use super::texel_coder::QuantisationSteps;
use super::{BlockMap, COLUMNS, appearance, facades, flag, ground, objects, reflective, thin};
use crate::TileKind;
use crate::codec::range::{NullEncoder, RangeEncoder};
use crate::error::DecodeError;
use crate::texel::Texel;
use crate::tile::TileWriter;

pub(super) const TAG_META: u8 = 1;
pub(super) const TAG_COLUMNS: u8 = 2;
pub(super) const TAG_GROUND: u8 = 3;
pub(super) const TAG_REFLECTIVE: u8 = 4;
pub(super) const TAG_OBJECTS: u8 = 5;
pub(super) const TAG_THIN: u8 = 6;

/// Loss of a map's colours and occlusion. Shapes are always lossless.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quality {
    Lossless,
    /// Minimum peak signal-to-noise ratio in dB of the node's opaque texels (8-bit sRGB, all three channels). The
    /// occlusion is off by at most 2 of 63.
    Decibels(f32),
}

/// Step of the occlusion if it is lossy.
const LOSSY_AO_STEP: u8 = 5;
/// Largest step of the colours, in quarters.
pub(super) const MAX_COLOUR_STEP: u16 = 512;

impl BlockMap {
    /// Encodes without loss. Fails like [`BlockMap::encode_at`].
    pub fn encode(&self) -> Result<Vec<u8>, DecodeError> {
        self.encode_at(Quality::Lossless)
    }

    /// Encodes the tile. The same map and quality give the same bytes. The coverage of roofs and the colour and
    /// occlusion of transparent texels are not kept. Fails on a map that [`BlockMap::from_columns`] would refuse.
    pub fn encode_at(&self, quality: Quality) -> Result<Vec<u8>, DecodeError> {
        self.check()?;
        let steps = self.quantisation_steps(quality);
        let mut coder = RangeEncoder::default();
        self.clone().walk(&mut coder, steps)?;
        let mut writer = TileWriter::new(TileKind::BlockMap, None);
        let mut meta = Vec::with_capacity(12);
        meta.extend_from_slice(&self.cell_m.to_le_bytes());
        meta.extend_from_slice(&self.z_base_cells.to_le_bytes());
        meta.push(self.z_shift);
        meta.extend_from_slice(&steps.colour.to_le_bytes());
        meta.push(steps.ao);
        writer.add_raw_section(TAG_META, &meta)?;
        writer.add_raw_section(TAG_COLUMNS, &coder.finish())?;
        if let Some(ground) = self.ground.as_ref().filter(|ground| ground.squares != 0) {
            let mut coder = RangeEncoder::default();
            ground::code(&mut coder, &mut ground.clone())?;
            writer.add_raw_section(TAG_GROUND, &coder.finish())?;
        }
        if self.has_reflective() {
            let mut coder = RangeEncoder::default();
            reflective::code(&mut coder, &mut self.clone())?;
            writer.add_raw_section(TAG_REFLECTIVE, &coder.finish())?;
        }
        if let Some(value) = self.objects.as_ref().filter(|value| !value.is_empty()) {
            let mut coder = RangeEncoder::default();
            objects::code(&mut coder, self, value)?;
            writer.add_raw_section(TAG_OBJECTS, &coder.finish())?;
        }
        if !self.thin.is_empty() {
            let mut coder = RangeEncoder::default();
            thin::code(&mut coder, &mut self.clone())?;
            writer.add_raw_section(TAG_THIN, &coder.finish())?;
        }
        writer.finish()
    }

    /// The largest quantisation steps that keep a quality.
    pub fn quantisation_steps(&self, quality: Quality) -> QuantisationSteps {
        let Quality::Decibels(db) = quality else { return QuantisationSteps::LOSSLESS };
        let max_error = 255.0 * 255.0 / libm::pow(10f64, f64::from(db) / 10.0);
        let facade = facades::facade_order(self);
        let steps = |colour| QuantisationSteps { colour, ao: LOSSY_AO_STEP };
        let keeps_quality = |colour: u16| {
            let mut map = self.clone();
            appearance::code(&mut NullEncoder, &mut map, &facade, steps(colour));
            self.colour_error(&map) <= max_error
        };
        // A map with a palette keeps its quality at any step.
        if keeps_quality(MAX_COLOUR_STEP) {
            return steps(MAX_COLOUR_STEP);
        }
        let (mut good, mut bad) = (QuantisationSteps::LOSSLESS.colour, MAX_COLOUR_STEP);
        while good + 1 < bad {
            let step = (good + bad) / 2;
            if keeps_quality(step) { good = step } else { bad = step }
        }
        steps(good)
    }

    /// Mean squared difference per channel (8-bit sRGB) of the opaque texels of two maps with the same shapes.
    pub fn colour_error(&self, other: &Self) -> f64 {
        let (mut sum, mut count) = (0u64, 0u64);
        let mut add = |a: Texel, b: Texel| {
            let squares = a.rgb().into_iter().zip(b.rgb()).map(|(a, b)| u64::from(a.abs_diff(b)).pow(2));
            sum += squares.sum::<u64>();
            count += 3;
        };
        for i in (0..COLUMNS).filter(|i| self.flags[*i] & flag::OCCUPIED != 0) {
            add(self.roof[i], other.roof[i]);
        }
        let strips = self.strips.iter().zip(&other.strips).filter(|(a, _)| !a.is_open());
        strips.for_each(|(a, b)| add(*a, *b));
        for (a, b) in self.clips.iter().zip(&other.clips) {
            if let (Some(a), Some(b)) = (a.outer, b.outer) {
                add(a.roof, b.roof);
            }
        }
        sum as f64 / count.max(1) as f64
    }
}
