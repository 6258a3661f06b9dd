//! Spectra of visible light in bands, and their colour.

use glam::DVec3;
use std::sync::LazyLock;

/// Bands of a [`Spectrum`].
pub(super) const BANDS: usize = 12;
/// Centre of the first band in nanometres.
const FIRST_NM: f64 = 390.0;
/// Width of a band in nanometres.
const BAND_NM: f64 = 30.0;

/// One value per band of wavelengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spectrum(pub(super) [f64; BANDS]);

/// Irradiance of the sun above the atmosphere, W/m²/nm (ASTM E-490, means of the bands).
const SUN: Spectrum = Spectrum([1.20, 1.72, 2.03, 2.04, 1.92, 1.86, 1.82, 1.75, 1.65, 1.55, 1.46, 1.36]);

impl Spectrum {
    pub(super) const ZERO: Self = Self([0.0; BANDS]);

    /// The values that `of` has at the bands' centres, in micrometres.
    pub(super) fn from_um(of: impl Fn(f64) -> f64) -> Self {
        Self(std::array::from_fn(|i| of((FIRST_NM + BAND_NM * i as f64) / 1000.0)))
    }

    pub(super) fn map(self, of: impl Fn(f64) -> f64) -> Self {
        Self(self.0.map(of))
    }

    pub(super) fn zip(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        Self(std::array::from_fn(|i| of(self.0[i], other.0[i])))
    }

    /// `self + other * factor`.
    pub(super) fn add_scaled(self, other: Self, factor: f64) -> Self {
        self.zip(other, |a, b| a + b * factor)
    }

    /// Colour of the sun's light after it was multiplied by this, linear sRGB. 1 in all bands has about luminance 1.
    pub(super) fn sunlight_rgb(self) -> DVec3 {
        static WEIGHTS: LazyLock<[DVec3; BANDS]> = LazyLock::new(rgb_weights);
        (0..BANDS).map(|i| WEIGHTS[i] * self.0[i]).sum()
    }
}

/// Linear sRGB of the sun's light in each band. The sum has luminance 1.
fn rgb_weights() -> [DVec3; BANDS] {
    /// Points of a band at which the matching functions are read.
    const POINTS: u32 = 16;
    let weights: [DVec3; BANDS] = std::array::from_fn(|band| {
        let first_nm = FIRST_NM + BAND_NM * (band as f64 - 0.5);
        let at = |k: u32| first_nm + BAND_NM * (f64::from(k) + 0.5) / f64::from(POINTS);
        (0..POINTS).map(|k| srgb_of_xyz(matching_functions(at(k)))).sum::<DVec3>() * SUN.0[band]
    });
    let luminance: f64 = weights.iter().map(|rgb| super::luminance(*rgb)).sum();
    weights.map(|rgb| rgb / luminance)
}

/// The CIE 1931 colour matching functions, as sums of Gaussians (Wyman, Sloan and Shirley, "Simple Analytic
/// Approximations to the CIE XYZ Color Matching Functions", 2013).
fn matching_functions(nm: f64) -> DVec3 {
    let lobe = |height: f64, centre: f64, below: f64, above: f64| {
        let t = (nm - centre) * if nm < centre { below } else { above };
        height * (-0.5 * t * t).exp()
    };
    DVec3::new(
        lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(-0.065, 501.1, 0.0490, 0.0382),
        lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
        lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
    )
}

/// Linear sRGB (IEC 61966-2-1).
fn srgb_of_xyz(xyz: DVec3) -> DVec3 {
    DVec3::new(
        DVec3::new(3.2406, -1.5372, -0.4986).dot(xyz),
        DVec3::new(-0.9689, 1.8758, 0.0415).dot(xyz),
        DVec3::new(0.0557, -0.2040, 1.0570).dot(xyz),
    )
}
