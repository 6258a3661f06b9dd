//! A clear-sky atmosphere with multiple scattering, for a band of wavelengths each.
//!
//! Molecules (Rayleigh) and particles (Mie) scatter light, and particles and ozone absorb some. Light that is scattered
//! once is integrated along the ray. Light that is scattered more often is taken as equal from all sides and read from
//! a table by height and height of the sun (Hillaire, "A Scalable and Production Ready Sky and Atmosphere Rendering
//! Technique", 2020, section 5.5). Radiances are relative to the sun's irradiance above the atmosphere.

pub mod irradiance;
mod spectrum;

use glam::{DVec3, Vec3};
use spectrum::Spectrum;
use std::f64::consts::{PI, TAU};

const EARTH_M: f64 = 6_360_000.0;
const ATMOSPHERE_M: f64 = 100_000.0;
/// Height of the eye above the ground.
const EYE_M: f64 = 60.0;
/// Scattering by molecules at the ground, per metre, at 0.55 micrometres. It falls by e every 8 km.
const RAYLEIGH: f64 = 1.16e-5;
const RAYLEIGH_EXPONENT: f64 = -4.08;
const RAYLEIGH_HEIGHT_M: f64 = 8000.0;
/// Absorption by ozone of 300 Dobson units at 25 km, per metre; it falls to nothing 15 km above and below. Cross-sections:
/// Serdyuchenko and others 2014.
const OZONE: Spectrum = Spectrum([
    0.0, 0.027e-6, 0.086e-6, 0.377e-6, 0.834e-6, 1.533e-6, 2.448e-6, 2.717e-6, 1.937e-6, 1.103e-6, 0.538e-6, 0.242e-6,
]);
const OZONE_HEIGHT_M: f64 = 25_000.0;
const OZONE_HALF_M: f64 = 15_000.0;
/// Share of the light that particles scatter, of what they extinguish.
const MIE_ALBEDO: f64 = 0.98;
const MIE_HEIGHT_M: f64 = 2500.0;
/// Ångström's exponent: small particles scatter blue more than red.
const MIE_EXPONENT: f64 = -1.5;
/// Asymmetry of scattering by particles (Henyey and Greenstein) in the part that has one.
pub(crate) const MIE_G: f32 = 0.7;
/// What does not depend on the angle in that phase function.
pub(crate) const PHASE_SCALE: f32 = (1.0 - MIE_G * MIE_G) / (4.0 * std::f32::consts::PI);
/// Share of the scattering by particles that goes to all sides alike.
const MIE_ISOTROPIC: f64 = 0.42;
/// Part of the turbidity's extinction that these particles have.
const MIE_SHARE: f64 = 0.5;
const GROUND: f64 = 0.25;
/// With the sun below the horizon, the last light comes along the horizon: the least sine of the sun's height.
const SUN_LOW: f64 = 0.001;
/// Steps along a ray to the eye, in the table, and to the sun.
const STEPS: u32 = 24;
const TABLE_STEPS: u32 = 16;
const SUN_STEPS: u32 = 16;
/// Heights of the table of multiple scattering.
const HEIGHTS_M: [f64; 9] = [0.0, 500.0, 1500.0, 4000.0, 8000.0, 15_000.0, 28_000.0, 50_000.0, 99_000.0];
/// Heights of the sun in that table, from [`SUN_MIN`] to 1.
const SUNS: usize = 22;
const SUN_MIN: f64 = -0.3;
/// Rings and directions per half ring over which the table's rays go.
const RINGS: u32 = 6;

/// Weights of red, green and blue in luminance (Rec. 709).
pub(crate) const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Luminance of linear sRGB.
pub(crate) fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(LUMINANCE.as_dvec3())
}

/// Light of the sky in one direction, linear sRGB.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SkyLight {
    /// Radiance that hardly depends on the angle to the sun.
    pub(crate) smooth: DVec3,
    /// Radiance per unit of the phase function of Henyey and Greenstein with [`MIE_G`].
    pub(crate) forward: DVec3,
}

#[derive(Debug)]
pub(crate) struct Atmosphere {
    rayleigh: Spectrum,
    /// Extinction by particles at the ground, per metre.
    particles: Spectrum,
    /// Share of it that is scattered.
    albedo: f64,
    /// Absorption by ozone where it is densest, per metre.
    ozone: Spectrum,
    /// Radiance from multiple scattering, per unit of scattering: [`SUNS`] for each of [`HEIGHTS_M`].
    multiple: Vec<Spectrum>,
}

/// Amounts of molecules, particles and ozone: densities relative to [`Atmosphere`]'s values, or columns in metres of those.
type Amounts = [f64; 3];

impl Atmosphere {
    /// Air with this turbidity (Linke's by Preetham and others 1999: 1 is pure air, 2 very clear, 3 clear, 6 hazy).
    pub(crate) fn new(turbidity: f64) -> Self {
        // Ångström's coefficient by turbidity (Preetham and others 1999, appendix 1).
        let beta = (0.046_08 * turbidity.clamp(1.0, 20.0) - 0.045_86).max(0.0) * MIE_SHARE;
        let air = Self {
            rayleigh: Spectrum::from_um(rayleigh),
            particles: Spectrum::from_um(|um| beta * um.powf(MIE_EXPONENT) / MIE_HEIGHT_M),
            albedo: MIE_ALBEDO,
            ozone: OZONE,
            multiple: Vec::new(),
        };
        air.with_multiple_scattering()
    }

    fn with_multiple_scattering(mut self) -> Self {
        let suns = (0..SUNS).map(|k| SUN_MIN + (1.0 - SUN_MIN) * k as f64 / (SUNS - 1) as f64);
        let places = HEIGHTS_M.iter().flat_map(|height_m| suns.clone().map(move |sun_z| (*height_m, sun_z)));
        self.multiple = places.map(|(height_m, sun_z)| self.multiple_scattering(height_m, sun_z)).collect();
        self
    }

    /// Irradiance of a surface that faces the sun, from its disc. `sun_z` is the sine of the sun's height.
    pub(crate) fn sun(&self, sun_z: f64) -> DVec3 {
        self.transmittance(EYE_M, sun_z.max(SUN_LOW)).sunlight_rgb() * disc_share(sun_z)
    }

    /// Radiance of the sky in direction `dir` above the horizon, under a sun in direction `sun`.
    pub(crate) fn sky(&self, dir: DVec3, sun: DVec3) -> SkyLight {
        let cos = dir.dot(sun);
        let [molecules, particles, multiple] = self.scattered(EYE_M, dir, sun);
        let smooth =
            multiple.add_scaled(molecules, by_molecules(cos)).add_scaled(particles, MIE_ISOTROPIC / (4.0 * PI));
        SkyLight {
            smooth: smooth.sunlight_rgb().max(DVec3::ZERO),
            forward: (particles.sunlight_rgb() * (1.0 - MIE_ISOTROPIC)).max(DVec3::ZERO),
        }
    }

    /// Radiance of the sky from a height: of light that molecules and particles scatter once, per unit of their phase
    /// functions, and of light that is scattered more often.
    fn scattered(&self, height_m: f64, dir: DVec3, sun: DVec3) -> [Spectrum; 3] {
        let ray = AirRay { height_m, up: dir.z, sun_z: sun.z, sun_cos: dir.dot(sun) };
        let (mut molecules, mut particles, mut multiple) = (Spectrum::ZERO, Spectrum::ZERO, Spectrum::ZERO);
        self.march(&ray, STEPS, |point| {
            let lit = point.seen.zip(self.transmittance(point.height_m, point.sun_z), |seen, lit| seen * lit);
            let again = self.multiple_at(point.height_m, point.sun_z).zip(point.seen, |a, b| a * b);
            molecules = molecules.zip(point.molecules.zip(lit, |a, b| a * b), |a, b| a + b);
            particles = particles.zip(point.particles.zip(lit, |a, b| a * b), |a, b| a + b);
            let scattered = point.molecules.add_scaled(point.particles, 1.0);
            multiple = multiple.zip(scattered.zip(again, |a, b| a * b), |a, b| a + b);
        });
        [molecules, particles, multiple]
    }

    /// Share of the light from a direction that reaches a height; none through the Earth.
    fn transmittance(&self, height_m: f64, up: f64) -> Spectrum {
        match columns(height_m, up) {
            Some(columns) => self.extinction(columns).map(|depth| (-depth).exp()),
            None => Spectrum::ZERO,
        }
    }

    fn extinction(&self, [molecules, particles, ozone]: Amounts) -> Spectrum {
        self.rayleigh.map(|v| v * molecules).add_scaled(self.particles, particles).add_scaled(self.ozone, ozone)
    }

    /// Visits the points of a ray up to the ground or the end of the atmosphere. Returns the share of the light that passes it.
    fn march(&self, ray: &AirRay, steps: u32, mut visit: impl FnMut(RayPoint)) -> Spectrum {
        let r = EARTH_M + ray.height_m;
        let mut depth = Spectrum::ZERO;
        along(ray.length_m(), steps, |t, step| {
            let to_point = (r * r + t * t + 2.0 * r * t * ray.up).sqrt();
            let height_m = (to_point - EARTH_M).max(0.0);
            let amounts = densities(height_m);
            let taken = self.extinction(amounts).map(|v| v * step);
            visit(RayPoint {
                height_m,
                sun_z: (r * ray.sun_z + t * ray.sun_cos) / to_point,
                seen: depth.zip(taken, |depth, taken| (-(depth + taken * 0.5)).exp() * step),
                molecules: self.rayleigh.map(|v| v * amounts[0]),
                particles: self.particles.map(|v| v * self.albedo * amounts[1]),
            });
            depth = depth.add_scaled(taken, 1.0);
        });
        depth.map(|depth| (-depth).exp())
    }

    /// Radiance at a height from light that was scattered twice or more often: what is scattered once from all sides, times
    /// the sum of a geometric series (Hillaire 2020, equations 5 to 10).
    fn multiple_scattering(&self, height_m: f64, sun_z: f64) -> Spectrum {
        let (mut second, mut share) = (Spectrum::ZERO, Spectrum::ZERO);
        let weight = 1.0 / f64::from(RINGS * RINGS);
        for (ring, azimuth) in (0..RINGS).flat_map(|ring| (0..RINGS).map(move |azimuth| (ring, azimuth))) {
            let up = (f64::from(ring) + 0.5) / f64::from(RINGS) * 2.0 - 1.0;
            let across = ((1.0 - up * up) * (1.0 - sun_z * sun_z)).sqrt();
            let angle = (f64::from(azimuth) + 0.5) / f64::from(RINGS) * PI;
            let ray = AirRay { height_m, up, sun_z, sun_cos: up * sun_z + across * angle.cos() };
            let passed = self.march(&ray, TABLE_STEPS, |point| {
                let scattered = point.molecules.add_scaled(point.particles, 1.0).zip(point.seen, |a, b| a * b);
                let lit = self.transmittance(point.height_m, point.sun_z);
                second = second.add_scaled(scattered.zip(lit, |a, b| a * b), weight / (4.0 * PI));
                share = share.add_scaled(scattered, weight);
            });
            if ray.meets_ground() {
                let length_m = ray.length_m();
                let ground_sun_z = ((EARTH_M + height_m) * sun_z + length_m * ray.sun_cos) / EARTH_M;
                let lit = self.transmittance(0.0, ground_sun_z).zip(passed, |a, b| a * b);
                second = second.add_scaled(lit, weight * GROUND / PI * ground_sun_z.max(0.0));
            }
        }
        second.zip(share, |second, share| second / (1.0 - share.min(0.95)))
    }

    /// The table's value, interpolated.
    fn multiple_at(&self, height_m: f64, sun_z: f64) -> Spectrum {
        let above = HEIGHTS_M.partition_point(|h| *h <= height_m).clamp(1, HEIGHTS_M.len() - 1);
        let row = above - 1;
        let up = ((height_m - HEIGHTS_M[row]) / (HEIGHTS_M[above] - HEIGHTS_M[row])).clamp(0.0, 1.0);
        let place = ((sun_z - SUN_MIN) / (1.0 - SUN_MIN)).clamp(0.0, 1.0) * (SUNS - 1) as f64;
        let column = (place as usize).min(SUNS - 2);
        let right = place - column as f64;
        let at = |row: usize| {
            let values = &self.multiple[row * SUNS + column..];
            values[0].zip(values[1], |a, b| a + (b - a) * right)
        };
        at(row).zip(at(above), |a, b| a + (b - a) * up)
    }
}

/// A ray through the air: where it begins, and cosines to the vertical and to the sun.
struct AirRay {
    height_m: f64,
    up: f64,
    sun_z: f64,
    sun_cos: f64,
}

impl AirRay {
    fn meets_ground(&self) -> bool {
        let r = EARTH_M + self.height_m;
        self.up < 0.0 && r * (1.0 - self.up * self.up).max(0.0).sqrt() < EARTH_M
    }

    fn length_m(&self) -> f64 {
        if !self.meets_ground() {
            return path_m(self.height_m, self.up);
        }
        let (r, b) = (EARTH_M + self.height_m, (EARTH_M + self.height_m) * self.up);
        -b - (b * b - (r * r - EARTH_M * EARTH_M)).max(0.0).sqrt()
    }
}

struct RayPoint {
    height_m: f64,
    sun_z: f64,
    /// Share of the light from here that reaches the ray's beginning, times the step's length.
    seen: Spectrum,
    /// Scattering per metre.
    molecules: Spectrum,
    particles: Spectrum,
}

/// Scattering by molecules at the ground, per metre, of light with a wavelength in micrometres.
fn rayleigh(um: f64) -> f64 {
    RAYLEIGH * (um / 0.55).powf(RAYLEIGH_EXPONENT)
}

fn by_molecules(cos: f64) -> f64 {
    3.0 / (16.0 * PI) * (1.0 + cos * cos)
}

/// Share of the sun's disc above the horizon, by the sine of the sun's height. The disc sets while its height goes from +0.3 to
/// -0.8 degrees, with the refraction of the air.
fn disc_share(sun_z: f64) -> f64 {
    ((sun_z.clamp(-1.0, 1.0).asin().to_degrees() + 0.8) / 1.1).clamp(0.0, 1.0)
}

/// Densities of molecules and particles relative to the ground, and of ozone relative to its maximum.
fn densities(height_m: f64) -> Amounts {
    let ozone = 1.0 - (height_m - OZONE_HEIGHT_M).abs() / OZONE_HALF_M;
    [(-height_m / RAYLEIGH_HEIGHT_M).exp(), (-height_m / MIE_HEIGHT_M).exp(), ozone.max(0.0)]
}

/// Columns from a height to the end of the atmosphere, along a ray with the cosine `up` to the vertical; none through the Earth.
fn columns(height_m: f64, up: f64) -> Option<Amounts> {
    let r = EARTH_M + height_m;
    if up < 0.0 && r * (1.0 - up * up).max(0.0).sqrt() < EARTH_M {
        return None;
    }
    let mut columns = [0.0; 3];
    along(path_m(height_m, up), SUN_STEPS, |t, step| {
        let h = (r * r + t * t + 2.0 * r * t * up).sqrt() - EARTH_M;
        let amounts = densities(h.max(0.0));
        (0..3).for_each(|i| columns[i] += amounts[i] * step);
    });
    Some(columns)
}

/// Metres to the end of the atmosphere from a height, along a ray with the cosine `up` to the vertical.
fn path_m(height_m: f64, up: f64) -> f64 {
    let r = EARTH_M + height_m;
    let b = r * up;
    (b * b + (EARTH_M + ATMOSPHERE_M).powi(2) - r * r).max(0.0).sqrt() - b
}

/// Visits middle and length of steps along a path. They grow, as the air is thickest where the path begins.
fn along(path_m: f64, steps: u32, mut visit: impl FnMut(f64, f64)) {
    let at = |k: u32| (f64::from(k) / f64::from(steps)).powi(2) * path_m;
    for k in 0..steps {
        let (begin, end) = (at(k), at(k + 1));
        visit((begin + end) * 0.5, end - begin);
    }
}

/// Visits directions over a hemisphere around +z with their solid angles.
pub(crate) fn hemisphere(rings: u32, mut visit: impl FnMut(DVec3, f64)) {
    let around = 4 * rings;
    for ring in 0..rings {
        let z = (f64::from(ring) + 0.5) / f64::from(rings);
        for azimuth in 0..around {
            let angle = (f64::from(azimuth) + 0.5) / f64::from(around) * TAU;
            let flat = (1.0 - z * z).sqrt();
            visit(DVec3::new(angle.cos() * flat, angle.sin() * flat, z), TAU / f64::from(rings * around));
        }
    }
}
