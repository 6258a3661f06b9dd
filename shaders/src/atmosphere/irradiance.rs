//! Irradiances of a clear sky in W/m², over the whole spectrum of the sun.
//!
//! Molecules, ozone and scattering are those of the pictures, in 24 bands from 0.30 to 4.00 micrometres instead of twelve
//! visible ones. Water vapour and the uniformly mixed gases absorb, too. The amount of particles follows from the definition
//! of Linke's turbidity. Pictures have Preetham's, without absorption: at turbidity 3 an optical depth of 0.11, here 0.10.

use super::spectrum::Spectrum;
use super::{
    Amounts, Atmosphere, MIE_EXPONENT, MIE_HEIGHT_M, OZONE_HALF_M, RAYLEIGH_HEIGHT_M, SUN_LOW, by_molecules, columns,
    disc_share, hemisphere, rayleigh,
};
use glam::DVec3;
use std::f64::consts::PI;

/// Irradiance of the sun above the atmosphere, W/m² (ASTM E-490).
const SUN_W_M2: f64 = 1366.1;
/// Column of water vapour in centimetres: the mean of a summer (2.9) and a winter (0.85) of middle latitudes. Air that is more
/// transparent than such air without particles is drier.
const WATER_CM: f64 = 1.9;
/// Column of ozone in centimetres: 300 Dobson units.
const OZONE_CM: f64 = 0.3;
/// Share of the extinction by particles at 0.55 micrometres that large, grey ones have (dust). The others follow the pictures'
/// law. Chosen by irradiances: with less, a low sun is brighter than Ineichen and Perez's (2002).
const GREY: f64 = 0.6;
/// Single scattering albedo and asymmetry of a city's particles, with soot, as urban aerosol models have them. A fit of the albedo
/// to Ineichen and Perez's irradiances gives 0.67.
const ALBEDO: f64 = 0.65;
const ASYMMETRY: f64 = 0.59;
/// Air mass at which turbidity is defined, and Kasten's mean optical depth of clean, dry air there (1996).
const AIR_MASS: f64 = 2.0;
const CLEAN_DEPTH: f64 = 1.0 / (9.4 + 0.9 * AIR_MASS);
/// Limits of the optical depth of particles.
const MOST_DEPTH: f64 = 5.0;
/// Halvings of an interval in which an amount is sought.
const HALVINGS: u32 = 40;
/// Rings of directions over which the sky's radiance is summed.
const RINGS: u32 = 12;

/// Twelve bands, by increasing wavelength.
struct Bands {
    /// Mean wavelengths of the sun's light in micrometres.
    um: Spectrum,
    /// Irradiances of the sun above the atmosphere, W/m² (the extraterrestrial spectrum of ASTM G-173, integrals).
    sun: Spectrum,
    /// Absorption by ozone, per centimetre.
    ozone: Spectrum,
    /// Coefficients of absorption by water vapour (per centimetre) and by the uniformly mixed gases. These and ozone's
    /// are those for which [`Bands::gases`] has the mean transmittance of the band (Bird and Riordan 1986, table 2-1).
    water: Spectrum,
    gases: Spectrum,
}

/// From 0.30, 0.32, 0.35, 0.38, 0.41, 0.45, 0.49, 0.53, 0.57, 0.61, 0.65 and 0.69 to 0.74 micrometres, and from there, 0.80, 0.86,
/// 0.89, 0.99, 1.09, 1.19, 1.31, 1.51, 1.77, 2.05 and 2.45 to 4.00.
const HALVES: [Bands; 2] = [
    Bands {
        um: Spectrum([0.3104, 0.3351, 0.3653, 0.3966, 0.4302, 0.4695, 0.5095, 0.5496, 0.5895, 0.6295, 0.6696, 0.7142]),
        sun: Spectrum([12.6, 27.7, 32.5, 38.8, 69.6, 80.1, 75.7, 74.3, 71.8, 66.2, 60.6, 68.8]),
        ozone: Spectrum([2.291, 0.1588, 0.0012, 0.0, 0.0004, 0.01, 0.0395, 0.0879, 0.1195, 0.0932, 0.0495, 0.0173]),
        water: Spectrum([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0026, 0.0, 0.0, 0.26]),
        gases: Spectrum::ZERO,
    },
    Bands {
        um: Spectrum([0.7691, 0.8289, 0.8746, 0.9379, 1.0378, 1.1383, 1.2475, 1.4042, 1.6291, 1.8975, 2.2281, 2.9963]),
        sun: Spectrum([73.3, 63.4, 28.7, 84.3, 67.7, 55.4, 54.8, 68.1, 60.2, 38.8, 30.8, 35.7]),
        ozone: Spectrum([0.0042, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        water: Spectrum([0.0035, 0.33, 0.0033, 6.3, 0.0083, 16.0, 0.16, 86.0, 0.11, 75.0, 1.3, 130.0]),
        gases: Spectrum([0.016, 0.0, 0.0, 0.0, 0.0, 0.0, 0.026, 0.002, 0.0094, 0.11, 0.018, 0.46]),
    },
];

impl Bands {
    /// Molecules, ozone, and particles of an optical depth at 0.55 micrometres; without a table of multiple scattering.
    fn air(&self, depth: f64) -> Atmosphere {
        let particles = |um: f64| depth / MIE_HEIGHT_M * (GREY + (1.0 - GREY) * (um / 0.55).powf(MIE_EXPONENT));
        Atmosphere {
            rayleigh: self.um.map(rayleigh),
            particles: self.um.map(particles),
            albedo: ALBEDO,
            ozone: self.ozone.map(|v| v * OZONE_CM / OZONE_HALF_M),
            multiple: Vec::new(),
        }
    }

    /// Irradiances after absorption by water vapour and the mixed gases on the way from the sun (Bird and Riordan 1986,
    /// equations 2-8 and 2-11). Water vapour lies as low as particles do.
    fn gases(&self, [molecules, particles, _]: Amounts, water_cm: f64) -> Spectrum {
        let air_mass = molecules / RAYLEIGH_HEIGHT_M;
        let water_cm = water_cm * particles / MIE_HEIGHT_M;
        let water = self.water.map(|v| 0.2385 * v * water_cm / (1.0 + 20.07 * v * water_cm).powf(0.45));
        let gases = self.gases.map(|v| 1.41 * v * air_mass / (1.0 + 118.93 * v * air_mass).powf(0.45));
        self.sun.zip(water.add_scaled(gases, 1.0), |sun, depth| sun * (-depth).exp())
    }
}

/// What a horizontal surface at sea level receives under a clear sky, W/m².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClearSky {
    /// From the sun's disc, for a surface that faces it.
    pub direct_normal_w_m2: f64,
    /// From the sky.
    pub diffuse_w_m2: f64,
    /// From both.
    pub global_w_m2: f64,
}

/// Clear air of one turbidity over ground of albedo 0.25 at sea level.
#[derive(Debug)]
pub struct ClearAir {
    /// Optical depth of the particles at 0.55 micrometres.
    pub depth: f64,
    /// Column of water vapour in centimetres.
    pub water_cm: f64,
    halves: [Atmosphere; 2],
}

impl ClearAir {
    /// Air with Linke's turbidity, 1 to 20. By its definition, air of turbidity T transmits as much of the sun's energy as T
    /// clean, dry atmospheres, here at an air mass of 2. Takes some ten milliseconds, as does [`ClearAir::sky`].
    pub fn new(turbidity: f64) -> Self {
        let least = SUN_W_M2 * (-CLEAN_DEPTH * AIR_MASS * turbidity.clamp(1.0, 20.0)).exp();
        let sun_z = 1.0 / AIR_MASS;
        let bright = |depth, water_cm| direct(&HALVES.map(|bands| bands.air(depth)), water_cm, sun_z) >= least;
        let water_cm = most(WATER_CM, |water_cm| bright(0.0, water_cm));
        let depth = most(MOST_DEPTH, |depth| bright(depth, water_cm));
        Self { depth, water_cm, halves: HALVES.map(|bands| bands.air(depth).with_multiple_scattering()) }
    }

    /// Irradiances under a sun at this height over the horizon, with refraction; below it, there is twilight.
    pub fn sky(&self, sun_height_rad: f64) -> ClearSky {
        let sun = DVec3::new(sun_height_rad.cos(), 0.0, sun_height_rad.sin());
        let direct_normal_w_m2 = direct(&self.halves, self.water_cm, sun.z) * disc_share(sun.z);
        let mut diffuse_w_m2 = 0.0;
        for (bands, air) in HALVES.iter().zip(&self.halves) {
            let mut sky = Spectrum::ZERO;
            hemisphere(RINGS, |dir, solid_angle| {
                let cos = dir.dot(sun);
                let [molecules, particles, multiple] = air.scattered(0.0, dir, sun);
                let radiance =
                    multiple.add_scaled(molecules, by_molecules(cos)).add_scaled(particles, by_particles(cos));
                sky = sky.add_scaled(radiance, dir.z * solid_angle);
            });
            diffuse_w_m2 += sum(sky.zip(lit(bands, self.water_cm, sun.z), |a, b| a * b));
        }
        let global_w_m2 = direct_normal_w_m2 * sun.z.max(0.0) + diffuse_w_m2;
        ClearSky { direct_normal_w_m2, diffuse_w_m2, global_w_m2 }
    }
}

/// Irradiance of the sun's disc, as if it were above the horizon.
fn direct(halves: &[Atmosphere; 2], water_cm: f64, sun_z: f64) -> f64 {
    let of = |(bands, air): (&Bands, &Atmosphere)| {
        let passed = air.transmittance(0.0, sun_z.max(SUN_LOW));
        sum(passed.zip(lit(bands, water_cm, sun_z), |a, b| a * b))
    };
    HALVES.iter().zip(halves).map(of).sum()
}

/// The sun's irradiances after absorption by gases.
fn lit(bands: &Bands, water_cm: f64, sun_z: f64) -> Spectrum {
    columns(0.0, sun_z.max(SUN_LOW)).map_or(Spectrum::ZERO, |columns| bands.gases(columns, water_cm))
}

/// The phase function of the particles (Henyey and Greenstein).
fn by_particles(cos: f64) -> f64 {
    let g = ASYMMETRY;
    (1.0 - g * g) / (4.0 * PI) / (1.0 + g * g - 2.0 * g * cos).powf(1.5)
}

fn sum(values: Spectrum) -> f64 {
    values.0.iter().sum()
}

/// The greatest amount from 0 to `limit` that is still good; less is good, too.
fn most(limit: f64, good: impl Fn(f64) -> bool) -> f64 {
    if good(limit) {
        return limit;
    }
    let (mut low, mut high) = (0.0, limit);
    for _ in 0..HALVINGS {
        let middle = (low + high) * 0.5;
        *(if good(middle) { &mut low } else { &mut high }) = middle;
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(turbidity: f64, heights_deg: &[f64]) -> Vec<ClearSky> {
        let air = ClearAir::new(turbidity);
        heights_deg.iter().map(|height_deg| air.sky(height_deg.to_radians())).collect()
    }

    fn parts(sky: &ClearSky) -> [f64; 3] {
        [sky.direct_normal_w_m2, sky.diffuse_w_m2, sky.global_w_m2]
    }

    #[test]
    fn bands_have_the_energy_of_the_sun() {
        let all: f64 = HALVES.iter().map(|bands| sum(bands.sun)).sum();
        // 1% lies below 0.30 micrometres and 1% above 4.00.
        assert!((0.975 * SUN_W_M2..0.985 * SUN_W_M2).contains(&all), "{all}");
    }

    /// pvlib 0.16.1, `clearsky.ineichen` at sea level with `dni_extra` of 1366.1 and air masses by Kasten and Young:
    /// direct normal, diffuse and global irradiance.
    #[test]
    fn irradiances_agree_with_ineichen_and_perez() {
        for (turbidity, height_deg, theirs) in [
            (3.0, 10.0, [413.3, 35.9, 107.7]),
            (3.0, 30.0, [789.0, 75.8, 470.3]),
            (3.0, 90.0, [943.7, 112.1, 1055.8]),
            (4.0, 10.0, [250.0, 43.3, 86.7]),
            (4.0, 20.0, [515.9, 82.3, 258.7]),
            (4.0, 60.0, [827.3, 142.4, 858.9]),
            (5.0, 10.0, [151.2, 43.6, 69.9]),
            (5.0, 20.0, [397.3, 95.4, 231.3]),
            (5.0, 90.0, [788.3, 188.9, 977.2]),
        ] {
            for (ours, theirs) in parts(&at(turbidity, &[height_deg])[0]).into_iter().zip(theirs) {
                let ratio = ours / theirs;
                assert!((0.85..1.15).contains(&ratio), "turbidity {turbidity}, {height_deg}: {ours}, not {theirs}");
            }
        }
    }

    #[test]
    fn turbid_air_has_less_sun_and_more_sky() {
        let heights_deg = [15.0, 40.0, 90.0];
        let airs: Vec<Vec<ClearSky>> =
            [1.0, 2.0, 3.0, 4.0, 6.0, 10.0].map(|turbidity| at(turbidity, &heights_deg)).into();
        for (clear, turbid) in airs.iter().zip(&airs[1..]) {
            // Up to turbidity 2, air differs by its water, which hardly scatters.
            let more_sky = turbid[2].diffuse_w_m2 / clear[2].diffuse_w_m2;
            assert!(more_sky > 0.99 && (clear == &airs[0] || more_sky > 1.1), "{clear:?} {turbid:?}");
            for (clear, turbid) in clear.iter().zip(turbid) {
                assert!(turbid.direct_normal_w_m2 < clear.direct_normal_w_m2, "{clear:?} {turbid:?}");
                assert!(turbid.global_w_m2 < clear.global_w_m2, "{clear:?} {turbid:?}");
            }
        }
    }

    #[test]
    fn every_height_of_the_sun_adds_up() {
        for turbidity in [-1.0, 1.0, 3.0, 20.0, 1e9] {
            let heights_deg: Vec<f64> = (-90..=90).step_by(15).map(f64::from).collect();
            for (sky, height_deg) in at(turbidity, &heights_deg).iter().zip(&heights_deg) {
                assert!(parts(sky).iter().all(|v| (0.0..SUN_W_M2).contains(v)), "{turbidity} {height_deg}: {sky:?}");
                let global = sky.direct_normal_w_m2 * height_deg.to_radians().sin().max(0.0) + sky.diffuse_w_m2;
                assert!((global - sky.global_w_m2).abs() < 1e-6, "{turbidity} {height_deg}: {sky:?}");
                assert!(*height_deg >= 0.0 || sky.direct_normal_w_m2 == 0.0, "{turbidity} {height_deg}: {sky:?}");
            }
        }
    }
}
