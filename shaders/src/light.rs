//! The light of sun and sky for a direction of the sun, computed once a frame and not for each pixel.
//!
//! Light is scattered once along straight lines, by molecules (Rayleigh) and by particles (Mie), and ozone absorbs
//! some. Light that is scattered more often comes from all directions alike. Coefficients and profiles: Bruneton and
//! Neyret, "Precomputed Atmospheric Scattering", 2008, section 4, and Hillaire, "A Scalable and Production Ready Sky
//! and Atmosphere Rendering Technique", 2020, table 1. Radiances are shares of the sun's irradiance above the
//! atmosphere.

use crate::{cpu::shade::SKY_FALL, layout::Light};
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::{PI, TAU};

const EARTH_M: f64 = 6_360_000.0;
const ATMOSPHERE_M: f64 = 100_000.0;
/// Height of the eye above the ground.
const EYE_M: f64 = 60.0;
/// Scattering by molecules at the ground, per metre. It falls by e every 8 km.
const RAYLEIGH: DVec3 = DVec3::new(5.802e-6, 13.558e-6, 33.1e-6);
const RAYLEIGH_HEIGHT_M: f64 = 8000.0;
/// Scattering by particles at the ground, per metre. There are twice as many over a city as over the sea, for which
/// 4e-6 is given. Small ones scatter blue more than red (Ångström's exponent, 1.3).
const MIE: DVec3 = DVec3::new(6.1e-6, 8.0e-6, 10.7e-6);
/// Share of the light that particles scatter, of what they extinguish.
const MIE_ALBEDO: f64 = 0.9;
const MIE_HEIGHT_M: f64 = 1200.0;
/// Asymmetry of scattering by particles (Henyey and Greenstein).
const MIE_G: f64 = 0.76;
/// Absorption by ozone at 25 km, per metre. It falls to nothing 15 km above and below.
const OZONE: DVec3 = DVec3::new(0.650e-6, 1.881e-6, 0.085e-6);
/// Albedo of the ground, linear RGB.
const GROUND: DVec3 = DVec3::new(0.22, 0.20, 0.18);
/// Radiance of a night sky with a moon: a full moon gives the ground about 1 / 400,000 of the sun's light.
const NIGHT: DVec3 = DVec3::new(0.45e-6, 0.65e-6, 1.1e-6);
/// Light that is scattered twice or more often, relative to that scattered twice: half is scattered again each time.
const MULTIPLE_SCATTERING: f64 = 2.0;
/// How the sky is displayed: brighter relative to what it lights, as a frame shows only a narrow part of it, and bluer,
/// as three wavelengths give less blue than the whole spectrum.
const SKY_GAIN: DVec3 = DVec3::new(1.25, 1.3, 1.6);
/// Steps along a ray to the eye.
const STEPS: u32 = 24;
/// Steps along a ray to the sun.
const SUN_STEPS: u32 = 12;
/// Exposure of a frame.
const KEY: f64 = 1.7;
/// How far the exposure follows the light: 1 would make night as bright as day.
const ADAPTATION: f64 = 0.86;
/// How far the exposure follows the light's colour: 1 would make every light white.
const WHITE_BALANCE: f64 = 0.12;
/// Weights of red, green and blue in luminance (Rec. 709).
const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Light from one direction.
struct Scattered {
    /// Scattered once.
    once: DVec3,
    /// Share of the light from all directions that is scattered to the eye.
    again: DVec3,
}

/// The sky under one sun.
struct Sky {
    sun: DVec3,
    /// Mean radiance from all directions at the eye.
    ambient: DVec3,
}

impl Light {
    /// Light under a sun in direction `sun` (any length; below the horizon it is twilight, then night), in air that
    /// takes half of the light of a surface `half_m` metres away.
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
        // The sky 4 degrees from the sun, above what horizon and zenith give.
        let low = sun.with_z(sun.z.max(0.02)).normalize_or(ahead);
        let near_sun = (low + low.cross(DVec3::Z).normalize_or(DVec3::X) * GLOW_AT_RAD).normalize_or(DVec3::Z);
        let glow = (sky.radiance(near_sun) - blend(zenith, horizon_sun, near_sun.z)).max(DVec3::ZERO);
        let bounce = GROUND * (sun_light * sun.z.max(0.0) + up);
        let scaled = |v: DVec3| (v * exposure).as_vec3().extend(0.0).to_array();
        let shade = |v: DVec3| scaled(v.lerp(DVec3::splat(luminance(v)), SHADE_NEUTRAL) * SHADE_GAIN);
        let haze = HAZE_TINT * (std::f64::consts::LN_2 / f64::from(half_m.max(1.0)));
        Self {
            sun: scaled(sun_light / PI),
            sky_up: shade(up / PI),
            sky_wall: shade(walls / PI),
            sky_side: shade(side / PI),
            bounce: scaled(bounce / PI),
            zenith: scaled(zenith * SKY_GAIN),
            horizon_sun: scaled(horizon_sun * SKY_GAIN),
            horizon_away: scaled(horizon_away * SKY_GAIN),
            glow: scaled(glow * GLOW_GAIN),
            haze: haze.as_vec3().extend(0.0).to_array(),
            side: flat.as_vec2().to_array(),
            disc: f32::from(u8::from(sun_light.x > 0.0)),
            zero: 0.0,
        }
    }
}

/// Share of its colour that the sky's light on surfaces loses: light that reaches shade from lit ground, walls and haze
/// has the sun's colour.
const SHADE_NEUTRAL: f64 = 0.5;
/// How much brighter the sky's light on surfaces is displayed, for the same reason.
const SHADE_GAIN: f64 = 1.3;
/// Haze takes more blue than red, as air does, but less so than pure air.
const HAZE_TINT: DVec3 = DVec3::new(0.85, 1.0, 1.2);
/// Angle from the sun at which the glow is measured.
const GLOW_AT_RAD: f64 = 0.07;
/// Share of the glow at that angle (`cpu::shade`).
const GLOW_SHARE: f64 = 0.90;
/// How much of the glow is displayed: more would leave no colour in the sky.
const GLOW_GAIN: f64 = 0.5 / GLOW_SHARE;

/// The clear sky between horizon and zenith, as `cpu::shade` draws it.
fn blend(zenith: DVec3, horizon: DVec3, up: f64) -> DVec3 {
    zenith.lerp(horizon, (-f64::from(SKY_FALL) * up).exp())
}

fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(LUMINANCE)
}

/// Factors from radiance to displayed light.
fn exposure(light: DVec3) -> DVec3 {
    let bright = luminance(light).max(1e-7);
    let balance = (light / bright).powf(-WHITE_BALANCE);
    balance / luminance(balance * light / bright) * (KEY * PI.sqrt() / bright.powf(ADAPTATION))
}

/// Irradiance of a surface that faces the sun. The disc sets while its height goes from +0.3 to -0.8 degrees, with the
/// refraction of the air.
fn sun_light(sun: DVec3) -> DVec3 {
    let height_deg = sun.z.clamp(-1.0, 1.0).asin().to_degrees();
    let share = ((height_deg + 0.8) / 1.1).clamp(0.0, 1.0);
    // With the sun below the horizon, the last light comes along the horizon.
    let visible = sun.with_z(sun.z.max(0.001)).normalize_or(DVec3::Z);
    transmittance(EYE_M, visible.z) * share
}

/// Densities of molecules and particles relative to the ground, and of ozone relative to its maximum.
fn densities(height_m: f64) -> [f64; 3] {
    let ozone = 1.0 - (height_m - 25_000.0).abs() / 15_000.0;
    [(-height_m / RAYLEIGH_HEIGHT_M).exp(), (-height_m / MIE_HEIGHT_M).exp(), ozone.max(0.0)]
}

/// Extinction of the air per metre.
fn extinction([molecules, particles, ozone]: [f64; 3]) -> DVec3 {
    RAYLEIGH * molecules + MIE * (particles / MIE_ALBEDO) + OZONE * ozone
}

/// Metres to the end of the atmosphere from a height, along a ray with the cosine `up` to the vertical.
fn path_m(height_m: f64, up: f64) -> f64 {
    let r = EARTH_M + height_m;
    let b = r * up;
    (b * b + (EARTH_M + ATMOSPHERE_M).powi(2) - r * r).max(0.0).sqrt() - b
}

/// Share of the light from a direction that reaches a height; none through the Earth.
fn transmittance(height_m: f64, up: f64) -> DVec3 {
    let r = EARTH_M + height_m;
    let nearest_m = r * (1.0 - up * up).max(0.0).sqrt();
    if up < 0.0 && nearest_m < EARTH_M {
        return DVec3::ZERO;
    }
    let mut depth = DVec3::ZERO;
    along(path_m(height_m, up), SUN_STEPS, |t, step| {
        let h = (r * r + t * t + 2.0 * r * t * up).sqrt() - EARTH_M;
        depth += extinction(densities(h.max(0.0))) * step;
    });
    (-depth).exp()
}

/// Visits middle and length of steps along a path. They grow, as the air is thickest where the path begins.
fn along(path_m: f64, steps: u32, mut visit: impl FnMut(f64, f64)) {
    let at = |k: u32| (f64::from(k) / f64::from(steps)).powi(2) * path_m;
    for k in 0..steps {
        let (begin, end) = (at(k), at(k + 1));
        visit((begin + end) * 0.5, end - begin);
    }
}

impl Sky {
    fn new(sun: DVec3) -> Self {
        let mut sky = Self { sun, ambient: DVec3::ZERO };
        let (mut once, mut weight) = (DVec3::ZERO, 0.0);
        sky.hemisphere(|_, light, share| {
            once += light.once * share;
            weight += share;
        });
        let lit_ground = GROUND * (sun_light(sun) * sun.z.max(0.0) + once / weight * PI) / PI;
        sky.ambient = (once / weight + lit_ground) * 0.5 * MULTIPLE_SCATTERING;
        sky
    }

    /// Visits directions above the horizon, their light and their solid angle.
    fn hemisphere(&self, mut visit: impl FnMut(DVec3, Scattered, f64)) {
        const RINGS: u32 = 4;
        const ROUND: u32 = 8;
        for ring in 0..RINGS {
            let z = (f64::from(ring) + 0.5) / f64::from(RINGS);
            for azimuth in 0..ROUND {
                let angle = (f64::from(azimuth) + 0.5) / f64::from(ROUND) * TAU;
                let flat = (1.0 - z * z).sqrt();
                let dir = DVec3::new(angle.cos() * flat, angle.sin() * flat, z);
                visit(dir, self.scattered(dir), TAU / f64::from(RINGS * ROUND));
            }
        }
    }

    /// Irradiance of a surface that faces up; of walls, as the mean of all azimuths and doubled, as a wall sees half of
    /// the sky; and of walls towards the sun above that mean.
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
        light.once + light.again * self.ambient + NIGHT * (1.4 - up)
    }

    /// Radiance of the sky in a direction above the horizon.
    fn radiance(&self, dir: DVec3) -> DVec3 {
        let dir = dir.normalize_or(DVec3::Z);
        self.sum(&self.scattered(dir), dir.z)
    }

    fn scattered(&self, dir: DVec3) -> Scattered {
        let cos = dir.dot(self.sun);
        let by_molecules = 3.0 / (16.0 * PI) * (1.0 + cos * cos);
        let g = MIE_G;
        let by_particles = (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cos).powf(1.5));
        let eye = DVec3::Z * (EARTH_M + EYE_M);
        let (mut once, mut again, mut depth) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
        along(path_m(EYE_M, dir.z), STEPS, |t, step| {
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
    fn every_height_of_the_sun_gives_finite_light() {
        for height_deg in -90..=90 {
            let light = at(height_deg as f32);
            for value in bytemuck::cast_slice::<Light, f32>(&[light]) {
                assert!(value.is_finite(), "{height_deg}: {light:?}");
            }
            assert!(brightness(light.sky_up) > 0.02 && brightness(light.zenith) > 0.003, "{height_deg}: {light:?}");
            assert!(
                brightness(light.sky_wall) > brightness(light.sky_side).abs(),
                "{height_deg}: a wall receives negative light"
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
        // A clear sky gives a surface that faces up about a tenth to a fifth of what the high sun gives it.
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
