//! Translucency of stones by translucent shadow maps (Dachsbacher and Stamminger 2003; Mischitelli 2007, chapter 5).
//!
//! A map is an orthographic picture of a landmark from the sun: for each texel how much light enters there, the depth and the
//! normal of the surface. [`Dipole`] says how much of the light that enters at one point leaves at another.
//! [`crate::cpu::translucency`] makes maps and gathers light from them.
//!
//! A texel is two words: height (16 bits, from the far to the near end of the landmark's sphere) with the share of light that enters
//! (16 bits) above it, and the octahedral normal (24 bits) with [`OCCUPIED`]. A level has the first words of its texels, row by row,
//! then the second words. Levels of half the width follow each other, down to [`COARSEST_PX`].

use crate::stone::Stone;
use crate::words::PAGE_WORDS;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::f32::consts::TAU;

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

/// The constants of a stone's dipole, by colour: the diffuse part of the BSSRDF (Mischitelli 2007, figure 5.3). Lengths in metres.
///
/// The figure divides by the reduced extinction once more than dimensions allow. This is the form of Jensen and Buhler (A Rapid
/// Hierarchical Rendering Technique for Translucent Materials, 2002), in which the numerator is the depth of the source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dipole {
    /// Effective transport coefficient per metre: light falls to 1/e within its inverse.
    pub transport: Vec3,
    /// Depth of the real source, which is the mean free path.
    pub depth_m: Vec3,
    /// Height of the virtual source above the surface.
    pub height_m: Vec3,
    /// Reduced albedo.
    pub albedo: Vec3,
}

impl Dipole {
    /// The dipole of a stone; `None` if no light passes through it. `stone` is valid ([`Stone::check`]).
    pub fn of(stone: &Stone) -> Option<Self> {
        if stone.scattering_scale <= 0.0 {
            return None;
        }
        let per_m = 1000.0 / stone.scattering_scale;
        let (scattering, absorption) = (Vec3::from(stone.scattering) * per_m, Vec3::from(stone.absorption) * per_m);
        let extinction = scattering + absorption;
        let eta = stone.refraction;
        let reflected = -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta;
        let mismatch = (1.0 + reflected) / (1.0 - reflected);
        let depth_m = extinction.recip();
        Some(Self {
            transport: (absorption * extinction * 3.0).map(f32::sqrt),
            depth_m,
            height_m: depth_m * (1.0 + 4.0 / 3.0 * mismatch),
            albedo: scattering / extinction,
        })
    }

    /// Share of the light that enters per square metre around `entry`, where the unit normal is `normal`, and leaves at `exit`
    /// per square metre. The real source is never nearer than its depth: nearer, the dipole is no model of light.
    pub fn reflectance(&self, entry: Vec3, normal: Vec3, exit: Vec3) -> Vec3 {
        let term = |source_m: f32, offset_m: f32, least_m: f32, transport: f32| {
            let distance = (entry + normal * offset_m).distance(exit).max(least_m);
            source_m * (1.0 + transport * distance) * (-transport * distance).exp() / distance.powi(3)
        };
        let colour = |k: usize| {
            let (depth, height, transport) = (self.depth_m[k], self.height_m[k], self.transport[k]);
            self.albedo[k] / (2.0 * TAU)
                * (term(depth, -depth, depth, transport) + term(height, height, 0.0, transport))
        };
        Vec3::new(colour(0), colour(1), colour(2))
    }

    /// Share of the light on an endless plane that leaves it again.
    pub fn plane_reflectance(&self) -> Vec3 {
        let decay = |distance: Vec3| (-self.transport * distance).exp();
        self.albedo * 0.5 * (decay(self.depth_m) + decay(self.height_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marble() -> Dipole {
        Dipole::of(&Stone::preset("carrara-marble").unwrap()).unwrap()
    }

    /// The colour of marble that Jensen and others (2001, figure 5) measured, computed from their coefficients.
    #[test]
    fn marble_reflects_what_was_measured() {
        let found = marble().plane_reflectance();
        assert!((found - Vec3::new(0.83, 0.79, 0.75)).abs().max_element() < 0.01, "{found}");
    }

    #[test]
    fn reflectance_sums_up_to_that_of_a_plane() {
        let dipole = marble();
        let (rings, mut sum) = (40_000, Vec3::ZERO);
        // Rings of a plane, from 1 micrometre to 1 m.
        for k in 0..rings {
            let radius = |k: usize| 1e-6 * (1e6f32).powf(k as f32 / rings as f32);
            let (near, far) = (radius(k), radius(k + 1));
            let at = Vec3::new((near * far).sqrt(), 0.0, 0.0);
            sum += dipole.reflectance(Vec3::ZERO, Vec3::Z, at) * (TAU / 2.0 * (far * far - near * near));
        }
        assert!((sum / dipole.plane_reflectance() - 1.0).abs().max_element() < 2e-3, "{sum}");
    }

    #[test]
    fn red_light_goes_farthest_in_marble() {
        let dipole = marble();
        let reach_mm = dipole.transport.recip() * 1000.0;
        assert!(reach_mm.x > reach_mm.y && reach_mm.y > reach_mm.z && (reach_mm.x - 8.5).abs() < 0.2, "{reach_mm}");
        assert_eq!(Dipole::of(&Stone::preset("bronze").unwrap()), None);
    }
}
