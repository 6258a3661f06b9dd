//! Sun and sky as numbers: what a clear day's air makes of the sun at a height, worked out once and not for each pixel.
//!
//! In: the direction to the sun. Out: [`Light`]. Next: `layout::FrameUniform`, which `cpu::shade` and `shade.wgsl` read.
//!
//! The air scatters once along straight lines, by molecules (Rayleigh) and by particles (Mie), and ozone takes its part;
//! light that is scattered again comes from everywhere alike. Coefficients and profiles: Bruneton and Neyret, "Precomputed
//! Atmospheric Scattering", 2008, section 4, and Hillaire, "A Scalable and Production Ready Sky and Atmosphere Rendering
//! Technique", 2020, table 1. Radiances are shares of the sun's irradiance above the air.

use crate::layout::Light;
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::{PI, TAU};

const EARTH_M: f64 = 6_360_000.0;
const AIR_M: f64 = 100_000.0;
/// Above the ground, where the picture is taken.
const EYE_M: f64 = 60.0;
/// Scattering by molecules at the ground, per metre; it falls by e each 8 km.
const RAYLEIGH: DVec3 = DVec3::new(5.802e-6, 13.558e-6, 33.1e-6);
const RAYLEIGH_HEIGHT_M: f64 = 8000.0;
/// Scattering by particles; over a city there are twice as many as over the sea, for which 4e-6 is given. Small ones scatter
/// blue more than red (Angstrom's exponent, 1.3).
const MIE: DVec3 = DVec3::new(6.1e-6, 8.0e-6, 10.7e-6);
/// What particles scatter of what they take.
const MIE_ALBEDO: f64 = 0.9;
const MIE_HEIGHT_M: f64 = 1200.0;
/// How far particles scatter ahead (Henyey and Greenstein).
const MIE_AHEAD: f64 = 0.76;
/// Absorption by ozone at 25 km, less to nothing 15 km above and below.
const OZONE: DVec3 = DVec3::new(0.650e-6, 1.881e-6, 0.085e-6);
/// What the ground throws back, linear RGB.
const GROUND: DVec3 = DVec3::new(0.22, 0.20, 0.18);
/// Radiance of a night sky with a moon: a full moon's ground has some four hundred-thousandths of a sun's.
const NIGHT: DVec3 = DVec3::new(0.45e-6, 0.65e-6, 1.1e-6);
/// What is scattered twice, thrice and so on, for each that is scattered twice: half of it is each time.
const AGAIN: f64 = 2.0;
/// How the sky is shown: brighter beside what it lights, as a picture's frame of it is narrow, and bluer, as three wavelengths
/// tell less of it than all.
const SHOWN: DVec3 = DVec3::new(1.25, 1.3, 1.6);
/// Steps along a ray to the eye, and along one to the sun.
const STEPS: u32 = 24;
const SUN_STEPS: u32 = 12;
/// Brightness of the picture, and how far the eye follows the light: 1 would make night as bright as day.
const KEY: f64 = 1.7;
const ADAPTATION: f64 = 0.86;
/// How far it follows the light's colour: 1 would make every light white.
const WHITE_BALANCE: f64 = 0.12;
/// The red, green and blue of brightness (Rec. 709).
const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// What is told of one direction: light scattered once, and the share of light from everywhere that reaches the eye.
struct Scattered {
    once: DVec3,
    again: DVec3,
}

/// The sky of one sun.
struct Sky {
    sun: DVec3,
    /// Mean radiance around the eye.
    around: DVec3,
}

impl Light {
    /// Light under a sun in direction `sun` (any length; below the horizon it is twilight, then night), in air that takes
    /// half of what a surface `half_m` metres away sends.
    pub fn of_sun(sun: Vec3, half_m: f32) -> Self {
        let sun = sun.as_dvec3().normalize_or(DVec3::Z);
        let sky = Sky::new(sun);
        let sun_light = sun_light(sun);
        let (up, walls, side) = sky.irradiance();
        let exposure = exposure(sun_light * sun.z.max(0.3) + up);
        let flat = DVec2::new(sun.x, sun.y).normalize_or(DVec2::Y);
        let ahead = flat.extend(0.0);
        let horizon = |along: DVec3| sky.radiance(along + DVec3::Z * 0.03);
        let zenith = sky.radiance(DVec3::Z - ahead * 0.15);
        let (horizon_sun, horizon_away) = (horizon(ahead), horizon(-ahead));
        // The sky near the sun beyond what the horizon's brightness says, at 4 degrees from it.
        let low = sun.with_z(sun.z.max(0.02)).normalize_or(ahead);
        let beside = (low + low.cross(DVec3::Z).normalize_or(DVec3::X) * BESIDE_RAD).normalize_or(DVec3::Z);
        let glow = (sky.radiance(beside) - blend(zenith, horizon_sun, beside.z)).max(DVec3::ZERO);
        let bounce = GROUND * (sun_light * sun.z.max(0.0) + up);
        let scaled = |v: DVec3| (v * exposure).as_vec3().extend(0.0).to_array();
        let shade = |v: DVec3| scaled(v.lerp(DVec3::splat(luminance(v)), SHADE_NEUTRAL) * SHADE_SHOWN);
        let haze = HAZE_TINT * (std::f64::consts::LN_2 / f64::from(half_m.max(1.0)));
        Self {
            sun: scaled(sun_light / PI),
            sky_up: shade(up / PI),
            sky_wall: shade(walls / PI),
            sky_side: shade(side / PI),
            bounce: scaled(bounce / PI),
            zenith: scaled(zenith * SHOWN),
            horizon_sun: scaled(horizon_sun * SHOWN),
            horizon_away: scaled(horizon_away * SHOWN),
            glow: scaled(glow * GLOW_SHOWN),
            haze: haze.as_vec3().extend(0.0).to_array(),
            side: flat.as_vec2().to_array(),
            disc: f32::from(u8::from(sun_light.x > 0.0)),
            pad: 0.0,
        }
    }
}

/// How the sky's light on surfaces is shown: less blue, and brighter, for what reaches shade from lit ground, walls and haze has
/// the sun's colour.
const SHADE_NEUTRAL: f64 = 0.5;
const SHADE_SHOWN: f64 = 1.3;
/// Haze takes a little more of the blue than of the red, as air does, though less than air alone.
const HAZE_TINT: DVec3 = DVec3::new(0.85, 1.0, 1.2);
/// Where the glow is measured, and what is left of it there (`cpu::shade`).
const BESIDE_RAD: f64 = 0.07;
const GLOW_BESIDE: f64 = 0.90;
/// How much of it is shown: less than there is, or it leaves no colour in the sky.
const GLOW_SHOWN: f64 = 0.5 / GLOW_BESIDE;

/// How a clear sky goes over from the horizon to the zenith; `cpu::shade` does the same.
fn blend(zenith: DVec3, horizon: DVec3, up: f64) -> DVec3 {
    zenith.lerp(horizon, (-4.5 * up).exp())
}

fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(LUMINANCE)
}

/// What makes a picture of light: it is brighter and its colour more even than what there is.
fn exposure(light: DVec3) -> DVec3 {
    let bright = luminance(light).max(1e-7);
    let balance = (light / bright).powf(-WHITE_BALANCE);
    balance / luminance(balance * light / bright) * (KEY * PI.sqrt() / bright.powf(ADAPTATION))
}

/// What of the sun arrives: irradiance of a surface that faces it. The disc sets while its height goes from +0.3 to -0.8
/// degrees, air's refraction included.
fn sun_light(sun: DVec3) -> DVec3 {
    let height_deg = sun.z.clamp(-1.0, 1.0).asin().to_degrees();
    let share = ((height_deg + 0.8) / 1.1).clamp(0.0, 1.0);
    // Below the horizon the last light comes along it.
    let seen = sun.with_z(sun.z.max(0.001)).normalize_or(DVec3::Z);
    transmittance(EYE_M, seen.z) * share
}

/// Shares of the ground's densities: molecules, particles, ozone (of its own most).
fn densities(height_m: f64) -> [f64; 3] {
    let ozone = 1.0 - (height_m - 25_000.0).abs() / 15_000.0;
    [(-height_m / RAYLEIGH_HEIGHT_M).exp(), (-height_m / MIE_HEIGHT_M).exp(), ozone.max(0.0)]
}

/// What the air takes away per metre.
fn extinction([molecules, particles, ozone]: [f64; 3]) -> DVec3 {
    RAYLEIGH * molecules + MIE * (particles / MIE_ALBEDO) + OZONE * ozone
}

/// Metres to the end of the air from a height, along a ray with the cosine `up` to the vertical.
fn way_m(height_m: f64, up: f64) -> f64 {
    let r = EARTH_M + height_m;
    let b = r * up;
    (b * b + (EARTH_M + AIR_M).powi(2) - r * r).max(0.0).sqrt() - b
}

/// Light that comes through the air to a height from a direction; none through the Earth.
fn transmittance(height_m: f64, up: f64) -> DVec3 {
    let r = EARTH_M + height_m;
    let nearest_m = r * (1.0 - up * up).max(0.0).sqrt();
    if up < 0.0 && nearest_m < EARTH_M {
        return DVec3::ZERO;
    }
    let mut depth = DVec3::ZERO;
    along(way_m(height_m, up), SUN_STEPS, |t, step| {
        let h = (r * r + t * t + 2.0 * r * t * up).sqrt() - EARTH_M;
        depth += extinction(densities(h.max(0.0))) * step;
    });
    (-depth).exp()
}

/// Visits a way in steps that grow, as the air is thickest where it begins: middle and length of each.
fn along(way_m: f64, steps: u32, mut visit: impl FnMut(f64, f64)) {
    let at = |k: u32| (f64::from(k) / f64::from(steps)).powi(2) * way_m;
    for k in 0..steps {
        let (begin, end) = (at(k), at(k + 1));
        visit((begin + end) * 0.5, end - begin);
    }
}

impl Sky {
    fn new(sun: DVec3) -> Self {
        let mut sky = Self { sun, around: DVec3::ZERO };
        let (mut once, mut weight) = (DVec3::ZERO, 0.0);
        sky.hemisphere(|_, light, share| {
            once += light.once * share;
            weight += share;
        });
        let lit_ground = GROUND * (sun_light(sun) * sun.z.max(0.0) + once / weight * PI) / PI;
        sky.around = (once / weight + lit_ground) * 0.5 * AGAIN;
        sky
    }

    /// Directions over the horizon, with their solid angles.
    fn hemisphere(&self, mut visit: impl FnMut(DVec3, Scattered, f64)) {
        const RINGS: u32 = 4;
        const ROUND: u32 = 8;
        for ring in 0..RINGS {
            let z = (f64::from(ring) + 0.5) / f64::from(RINGS);
            for turn in 0..ROUND {
                let angle = (f64::from(turn) + 0.5) / f64::from(ROUND) * TAU;
                let flat = (1.0 - z * z).sqrt();
                let dir = DVec3::new(angle.cos() * flat, angle.sin() * flat, z);
                visit(dir, self.scattered(dir), TAU / f64::from(RINGS * ROUND));
            }
        }
    }

    /// Irradiance of a surface that looks up; of one that sees the horizon's half of the sky, doubled as a wall sees but
    /// half of it; and how much more than that walls towards the sun have.
    fn irradiance(&self) -> (DVec3, DVec3, DVec3) {
        let flat = DVec2::new(self.sun.x, self.sun.y).normalize_or(DVec2::Y);
        let (mut up, mut towards, mut away) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        self.hemisphere(|dir, light, share| {
            let radiance = self.sum(&light, dir.z) * share;
            let facing = DVec2::new(dir.x, dir.y).dot(flat);
            up += radiance * dir.z;
            towards += radiance * facing.max(0.0);
            away += radiance * (-facing).max(0.0);
        });
        (up, towards + away, towards - away)
    }

    fn sum(&self, light: &Scattered, up: f64) -> DVec3 {
        light.once + light.again * self.around + NIGHT * (1.4 - up)
    }

    /// Radiance of the sky in a direction over the horizon.
    fn radiance(&self, dir: DVec3) -> DVec3 {
        let dir = dir.normalize_or(DVec3::Z);
        self.sum(&self.scattered(dir), dir.z)
    }

    fn scattered(&self, dir: DVec3) -> Scattered {
        let cos = dir.dot(self.sun);
        let by_molecules = 3.0 / (16.0 * PI) * (1.0 + cos * cos);
        let g = MIE_AHEAD;
        let by_particles = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cos).powf(1.5));
        let eye = DVec3::Z * (EARTH_M + EYE_M);
        let (mut once, mut again, mut depth) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        along(way_m(EYE_M, dir.z), STEPS, |t, step| {
            let p = eye + dir * t;
            let r = p.length();
            let density = densities((r - EARTH_M).max(0.0));
            let taken = extinction(density) * step;
            let seen = (-(depth + taken * 0.5)).exp() * step;
            depth += taken;
            let (molecules, particles) = (RAYLEIGH * density[0], MIE * density[1]);
            let lit = transmittance((r - EARTH_M).max(0.0), p.dot(self.sun) / r);
            once += seen * lit * (molecules * by_molecules + particles * by_particles);
            again += seen * (molecules + particles);
        });
        Scattered { once, again }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(height_deg: f32) -> Light {
        let (sin, cos) = height_deg.to_radians().sin_cos();
        Light::of_sun(Vec3::new(cos, 0.0, sin), 5000.0)
    }

    fn brightness([r, g, b, _]: [f32; 4]) -> f32 {
        luminance(Vec3::new(r, g, b).as_dvec3()) as f32
    }

    #[test]
    fn every_hour_has_light_and_all_numbers_are_finite() {
        for height_deg in -90..=90 {
            let light = at(height_deg as f32);
            for value in bytemuck::cast_slice::<Light, f32>(&[light]) {
                assert!(value.is_finite(), "{height_deg}: {light:?}");
            }
            assert!(brightness(light.sky_up) > 0.02 && brightness(light.zenith) > 0.003, "{height_deg}: {light:?}");
            assert!(
                brightness(light.sky_wall) > brightness(light.sky_side).abs(),
                "{height_deg}: a wall in minus light"
            );
        }
    }

    #[test]
    fn the_sky_is_blue_by_day_and_the_low_sun_is_warm() {
        let (noon, late) = (at(60.0), at(8.0));
        assert!(noon.zenith[2] > 1.5 * noon.zenith[0], "{:?}", noon.zenith);
        let warmth = |light: &Light| light.sun[0] / light.sun[2];
        assert!(warmth(&late) > 1.5 * warmth(&noon) && warmth(&noon) < 1.4, "{} {}", warmth(&noon), warmth(&late));
        assert!(late.horizon_sun[0] > late.horizon_away[0]);
        // A clear sky gives a surface that looks up about a tenth to a fifth of what the high sun gives it.
        let share = brightness(noon.sky_up) / brightness(noon.sun);
        assert!((0.08..0.25).contains(&share), "{share}");
    }

    #[test]
    fn the_sun_sets_and_the_night_is_darker_than_the_day() {
        assert_eq!(at(-1.0).sun, [0.0; 4]);
        let lights: Vec<f32> = [40.0, 0.0, -6.0, -40.0].map(|deg| at(deg).sky_up).map(brightness).to_vec();
        assert!(lights[3] < lights[1] && lights[3] < 0.6 * brightness(at(40.0).sun), "{lights:?}");
    }
}
