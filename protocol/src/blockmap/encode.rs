//! A V-BlockMap's bytes. They are described in `docs/formats.md`.

use super::{
    BlockMap, COLUMNS,
    appearance::{self, Loss},
    flag, walls,
};
use crate::{
    TileKind,
    codec::range::{NullEncoder, RangeEncoder},
    error::DecodeError,
    texel::{ALPHA_MAX, Texel},
    tile::TileWriter,
};

/// Section tags.
pub(super) mod tag {
    pub(in super::super) const META: u8 = 1;
    pub(in super::super) const COLUMNS: u8 = 2;
}

/// What a map's colours and occlusion may lose; its shapes lose nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quality {
    /// Nothing.
    Lossless,
    /// Colours as much as keeps the peak signal-to-noise ratio of the node's opaque texels (8-bit sRGB, all three channels)
    /// at or above so many dB; occlusion at most 3 of 63.
    Decibels(f32),
}

/// Step of the occlusion where loss is allowed.
const AO_STEP: u8 = 4;
/// Largest step of the colours, in quarters.
pub(super) const COLOUR_STEP_MAX: u16 = 512;

impl BlockMap {
    /// [`BlockMap::encode_at`] without loss.
    pub fn encode(&self) -> Result<Vec<u8>, DecodeError> {
        self.encode_at(Quality::Lossless)
    }

    /// The tile's bytes; the same map and quality give the same bytes. A roof's coverage is not kept (roofs are opaque), nor
    /// are colour and occlusion of transparent texels. Errors: a map that [`BlockMap::from_columns`] would refuse.
    pub fn encode_at(&self, quality: Quality) -> Result<Vec<u8>, DecodeError> {
        self.check()?;
        let loss = self.loss_at(quality);
        let mut coder = RangeEncoder::default();
        self.clone().walk(&mut coder, loss)?;
        let mut writer = TileWriter::new(TileKind::BlockMap, None);
        let mut meta = Vec::with_capacity(12);
        meta.extend_from_slice(&self.cell_m.to_le_bytes());
        meta.extend_from_slice(&self.z_base_cells.to_le_bytes());
        meta.push(self.z_shift);
        meta.extend_from_slice(&loss.colour.to_le_bytes());
        meta.push(loss.ao);
        writer.coded_section(tag::META, &meta)?;
        writer.coded_section(tag::COLUMNS, &coder.finish())?;
        writer.finish()
    }

    /// The largest steps that keep the quality.
    pub fn loss_at(&self, quality: Quality) -> Loss {
        let Quality::Decibels(db) = quality else { return Loss::NONE };
        let worst = 255.0 * 255.0 / 10f64.powf(f64::from(db) / 10.0);
        let steps = walls::facades(self);
        let loss = |colour| Loss { colour, ao: AO_STEP };
        let keeps = |colour: u16| {
            let mut map = self.clone();
            appearance::code(&mut NullEncoder, &mut map, &steps, loss(colour));
            self.colour_error(&map) <= worst
        };
        // Where there is a palette, any step does.
        if keeps(COLOUR_STEP_MAX) {
            return loss(COLOUR_STEP_MAX);
        }
        let (mut good, mut bad) = (Loss::NONE.colour, COLOUR_STEP_MAX);
        while good + 1 < bad {
            let step = (good + bad) / 2;
            if keeps(step) { good = step } else { bad = step }
        }
        loss(good)
    }

    /// Mean squared difference of the opaque texels' colours, of a channel (8-bit sRGB); `other` has the same shapes.
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
        let strips = self.strips.iter().zip(&other.strips).filter(|(a, _)| a.alpha() == ALPHA_MAX);
        strips.for_each(|(a, b)| add(*a, *b));
        for (a, b) in self.clips.iter().zip(&other.clips) {
            if let (Some(a), Some(b)) = (a.outer, b.outer) {
                add(a.roof, b.roof);
            }
        }
        sum as f64 / count.max(1) as f64
    }
}
