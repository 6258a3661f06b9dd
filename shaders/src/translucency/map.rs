//! The constants of a translucency map in a frame's uniform, and the place of its texels in the atlas.
//!
//! A texel is two words: height (16 bits, from the far to the near end of the landmark's sphere) with the share of light that enters
//! (16 bits) above it, and the octahedral normal (24 bits) with [`OCCUPIED`]. A level has the first words of its texels, row by row,
//! then the second words. Levels of half the width follow each other, down to [`COARSEST_PX`].

use super::Dipole;
use crate::stone::Stone;
use crate::words::PAGE_WORDS;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Maps that a frame has at most.
pub const MAX_MAPS: usize = 2;
/// Least width of a map, in texels.
pub const MIN_MAP_PX: u32 = 256;
/// Largest width of a map, in texels.
pub const MAX_MAP_PX: u32 = 512;
pub(crate) const COARSEST_PX: u32 = 8;
/// In the second word of a texel: there is a surface.
pub(crate) const OCCUPIED: u32 = 1 << 24;
/// Taps of the faster filter (section 5.2.1).
pub const FAST_TAPS: u32 = 9;
/// Taps of the finer filter.
pub const FINE_TAPS: u32 = 21;
/// Rings are not wider than this many transport lengths beyond the thickness.
const REACH: f32 = 3.0;
const MIN_REACH_TEXELS: f32 = 6.0;

/// Words of the level whose width is `px`.
pub const fn level_words(px: u32) -> u32 {
    2 * px * px
}

/// Words of all levels of a map whose finest width is `px`.
pub const fn map_words(px: u32) -> u32 {
    let (mut px, mut words) = (px, 0);
    while px >= COARSEST_PX {
        words += level_words(px);
        px /= 2;
    }
    words
}

/// Words that the atlas keeps for a map: whole pages.
pub const MAP_WORDS: u32 = map_words(MAX_MAP_PX).next_multiple_of(PAGE_WORDS as u32);

/// A translucency map, as shaders read it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TranslucencyMap {
    /// Centre of the landmark's sphere, relative to the camera.
    pub centre: [f32; 3],
    /// Radius of the sphere: half of the map's side.
    pub radius_m: f32,
    /// Origin of the landmark's stone pattern, relative to the camera: whose map this is.
    pub anchor: [f32; 3],
    /// First word of the map in the atlas.
    pub address: u32,
    /// [`Dipole::transport`].
    pub transport: [f32; 3],
    /// Width in texels, a power of two; 0: there is no map.
    pub width_px: u32,
    /// [`Dipole::depth_m`].
    pub depth_m: [f32; 3],
    /// Taps: [`FAST_TAPS`] or [`FINE_TAPS`].
    pub taps: u32,
    /// [`Dipole::height_m`].
    pub height_m: [f32; 3],
    /// Radius in metres that taps reach on a thin surface.
    pub reach_m: f32,
    /// Half of the reduced albedo over the reflectance of a plane: light in these units replaces that on a matt surface.
    pub share: [f32; 3],
    /// Roughness of the stone, which light passes on its way in.
    pub alpha: f32,
}

/// Where a landmark is, relative to the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPlace {
    /// Centre and radius in metres of a sphere around the landmark.
    pub centre: Vec3,
    pub radius_m: f32,
    /// Origin of the stone's pattern.
    pub anchor: Vec3,
}

impl TranslucencyMap {
    /// The map of a landmark. `None` if no light passes through its stone, or not far enough for the texels of a map so wide:
    /// what is smaller than a few of them would be noise.
    pub fn new(stone: &Stone, place: &MapPlace, width_px: u32, taps: u32, address: u32) -> Option<Self> {
        let dipole = Dipole::of(stone)?;
        let reach_m = REACH * dipole.transport.recip().max_element();
        let texel_m = 2.0 * place.radius_m / width_px as f32;
        let map = Self {
            centre: place.centre.into(),
            radius_m: place.radius_m,
            anchor: place.anchor.into(),
            address,
            transport: dipole.transport.into(),
            width_px,
            depth_m: dipole.depth_m.into(),
            taps,
            height_m: dipole.height_m.into(),
            reach_m,
            share: (dipole.albedo * 0.5 / dipole.plane_reflectance()).into(),
            alpha: (stone.alpha[0] * stone.alpha[1]).sqrt(),
        };
        (texel_m * MIN_REACH_TEXELS <= reach_m).then_some(map)
    }
}
