//! The diffuse part of the BSSRDF: a dipole of light sources (Mischitelli 2007, figure 5.3).
//!
//! The figure divides by the reduced extinction once more than dimensions allow. This is the form of Jensen and Buhler (A Rapid
//! Hierarchical Rendering Technique for Translucent Materials, 2002), in which the numerator is the depth of the source.

use crate::stone::Stone;
use glam::Vec3;
use std::f32::consts::TAU;

/// The constants of a stone's dipole, by colour. Lengths in metres.
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
