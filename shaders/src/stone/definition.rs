//! A stone as shaders read it, and the ranges of its parameters.

use bytemuck::{Pod, Zeroable};
use std::ops::RangeInclusive;

/// Stones that a frame's uniform holds.
pub const MAX_STONES: usize = 16;
/// Most octaves of veins, and of other sums of noise.
pub const MAX_OCTAVES: u32 = 6;
/// Bit of [`Stone::veins`]: broad soft veins (`turb1` in Mischitelli's section 4.3.3).
pub const BROAD_VEINS: u32 = 1;
/// Bit of [`Stone::veins`]: thin sharp veins (`turb2`).
pub const FINE_VEINS: u32 = 2;
/// Both bits.
pub const BOTH_VEINS: u32 = BROAD_VEINS | FINE_VEINS;

/// What a stone consists of, which decides its pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum StoneKind {
    /// No stone: the surface keeps the colour of its source.
    #[default]
    None = 0,
    /// Veins through a cloudy ground.
    Marble = 1,
    /// Grains of three minerals.
    Granite = 2,
    /// Metal below a patina.
    Bronze = 3,
    /// Fine grains in faint level beds.
    Limestone = 4,
    /// Rings around an upright axis, with fibres along it.
    Wood = 5,
}

/// A stone, 128 bytes. Colours are linear RGB, 0 to 1. [`Stone::check`] says which values are valid.
///
/// | field | marble | granite | bronze | limestone | wood |
/// |---|---|---|---|---|---|
/// | `base` | ground | feldspar | tarnish on bare metal | ground | early wood |
/// | `vein` | broad veins | quartz | patina | beds | rings |
/// | `grain` | fine veins | mica | thin patina | grains | fibres |
/// | `blend` | strength of broad and of fine veins | share of quartz and of mica | share of patina, of thin patina in it | strength of beds and of grains | strength of rings and of fibres |
/// | `cells_per_m` | broad veins | grains | patches of patina | beds | rings |
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Stone {
    pub base: [f32; 3],
    /// A [`StoneKind`].
    pub kind: u32,
    pub vein: [f32; 3],
    /// Cells of the pattern per metre: 1 / its scale in metres.
    pub cells_per_m: f32,
    pub grain: [f32; 3],
    /// Octaves of noise, 1 to [`MAX_OCTAVES`].
    pub octaves: u32,
    /// Reflectance seen from straight ahead. Metals have colours here, and almost none in `base`.
    pub f0: [f32; 3],
    /// Index of refraction, 1.1 to 2.5.
    pub refraction: f32,
    /// Ward's roughness along the grain and across it: standard deviations of the slopes of the surface, 0.02 to 1.
    pub alpha: [f32; 2],
    /// Half width of broad veins in units of the noise, 0.005 to 0.2. Fine ones have 0.22 of it (`FINE_WIDTH`).
    pub vein_width: f32,
    /// Bits of vein functions: [`BROAD_VEINS`], [`FINE_VEINS`].
    pub veins: u32,
    /// Strengths or shares of `vein` and `grain`, 0 to 1.
    pub blend: [f32; 2],
    /// How much the tone varies, 0 to 1.
    pub variation: f32,
    /// How far veins and grains are bent, in cells, 0 to 1.
    pub bend: f32,
    /// Reduced scattering coefficient per millimetre, 0.001 to 1000.
    pub scattering: [f32; 3],
    /// Factor of the lengths that light goes in the stone, at most 100. 0: no light passes through.
    pub scattering_scale: f32,
    /// Absorption coefficient per millimetre, 0.00001 to 1000.
    pub absorption: [f32; 3],
    pub unused: f32,
}

/// A parameter outside of its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StoneError {
    /// A number.
    #[error("{field} of a stone is {found}, it can be {low} to {high}")]
    Range { field: &'static str, found: f32, low: f32, high: f32 },
    /// A colour that is not `#rrggbb`.
    #[error("{field} of a stone is {found:?}, not a colour like #d8c8b0")]
    Colour { field: &'static str, found: String },
    /// No preset has that name.
    #[error("there is no stone {found:?}: choose one of {known}")]
    Preset { found: String, known: String },
    /// No [`StoneKind`] has that number.
    #[error("a stone has kind {0}, which is unknown")]
    Kind(u32),
}

fn within(field: &'static str, found: f32, range: RangeInclusive<f32>) -> Result<(), StoneError> {
    let (low, high) = (*range.start(), *range.end());
    // A NaN is in no range.
    if range.contains(&found) { Ok(()) } else { Err(StoneError::Range { field, found, low, high }) }
}

impl Stone {
    /// No stone.
    pub const NONE: Self = Self {
        base: [0.0; 3],
        kind: StoneKind::None as u32,
        vein: [0.0; 3],
        cells_per_m: 1.0,
        grain: [0.0; 3],
        octaves: 1,
        f0: [0.04; 3],
        refraction: 1.5,
        alpha: [0.2; 2],
        vein_width: 0.05,
        veins: BOTH_VEINS,
        blend: [0.0; 2],
        variation: 0.0,
        bend: 0.0,
        scattering: [1.0; 3],
        scattering_scale: 0.0,
        absorption: [1.0; 3],
        unused: 0.0,
    };

    /// Fails at the first parameter outside of its range. To be called with stones from outside before a shader reads them.
    pub fn check(&self) -> Result<(), StoneError> {
        if self.kind > StoneKind::Wood as u32 {
            return Err(StoneError::Kind(self.kind));
        }
        for (field, colour) in [("base", self.base), ("vein", self.vein), ("grain", self.grain), ("f0", self.f0)] {
            colour.into_iter().try_for_each(|v| within(field, v, 0.0..=1.0))?;
        }
        within("scale_m", 1.0 / self.cells_per_m, 0.001..=100.0)?;
        within("octaves", self.octaves as f32, 1.0..=MAX_OCTAVES as f32)?;
        self.alpha.into_iter().try_for_each(|v| within("roughness", v, 0.02..=1.0))?;
        within("vein_width", self.vein_width, 0.005..=0.2)?;
        within("veins", self.veins as f32, 0.0..=BOTH_VEINS as f32)?;
        self.blend.into_iter().try_for_each(|v| within("blend", v, 0.0..=1.0))?;
        within("variation", self.variation, 0.0..=1.0)?;
        within("bend", self.bend, 0.0..=1.0)?;
        within("refraction", self.refraction, 1.1..=2.5)?;
        self.scattering.into_iter().try_for_each(|v| within("scattering_per_mm", v, 0.001..=1000.0))?;
        self.absorption.into_iter().try_for_each(|v| within("absorption_per_mm", v, 1e-5..=1000.0))?;
        within("scattering_scale", self.scattering_scale, 0.0..=100.0)?;
        Ok(())
    }
}
