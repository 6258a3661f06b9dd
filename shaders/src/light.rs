//! The light of sun and sky for one direction of the sun, computed when that changes and not for each pixel.
//!
//! All radiances are in units of what a white matt surface that faces the sun reflects, so that a lit city has the same
//! values at any height of the sun. [`Light::key`] says how bright its picture is to be.

use crate::atmosphere::{Atmosphere, MIE_G, PHASE_SCALE, SkyLight, hemisphere, luminance};
use crate::layout::{Light, SKY_AZIMUTHS, SKY_HEIGHTS, SkyTable};
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::{Arc, Mutex, PoisonError};

/// Sine of the height below which the sky looks as at this height: 1.7 degrees. Haze has the colour of the sky there.
pub(crate) const SKY_LOW: f32 = 0.029_666;
/// Albedo of the plane where there is no column: that of the ground between buildings
/// ([`GROUND_COLOUR`](insula_protocol::blockmap::ground::GROUND_COLOUR)).
const GROUND_ALBEDO: Vec3 = Vec3::new(0.515, 0.521, 0.491);
/// Angular radius of the sun's disc.
pub const SUN_RADIUS_RAD: f32 = 0.004_65;
/// Radiance of the sky at night at the zenith, relative to the sun's irradiance above the atmosphere: that over a city, 0.01
/// candela per square metre.
const NIGHT: DVec3 = DVec3::new(0.21e-6, 0.24e-6, 0.33e-6);
/// Irradiance from a full moon overhead, divided by pi: about 1 / 400,000 of the sun's light. It comes from all over the sky,
/// without shadows.
const MOON: DVec3 = DVec3::new(0.6e-6, 0.7e-6, 0.85e-6);
/// Share of it that walls receive.
const MOON_ON_WALLS: f64 = 0.4;
/// Albedo of the moon's lit side, and its largest radiance in a frame: photographs show it white.
const MOON_ALBEDO: f64 = 0.12;
const MOON_MAX: f64 = 6.0;
/// Irradiance from lamps on the ground of a street, divided by pi: 4 lux where the sun above the atmosphere gives 128,000. The
/// colour is that of 4000 kelvin.
const LAMPS: DVec3 = DVec3::new(1.28e-5, 0.94e-5, 0.55e-5);
/// Their least share of the light on a white surface that faces the sun: less is not seen.
const LEAST_LAMPS: f64 = 2e-3;
/// Radiance of lit windows: about 5 candela per square metre, 2700 kelvin.
const WINDOWS: DVec3 = DVec3::new(2.2e-4, 1.05e-4, 0.32e-4);
/// Height of the sun in degrees below which windows may be lit.
const WINDOWS_DEG: f64 = 4.0;
/// Radiance of the brightest stars in the dark.
const STARS: f64 = 4.0;
/// Heights of the sun in degrees at which the first stars appear and the last ones.
const STARS_DEG: [f64; 2] = [-5.0, -14.0];
/// Reference over computed radiance of the sky, overhead and (as a logarithm, falling upwards by the sine of the height) at the
/// horizon: a fit to Hosek and Wilkie's sky (2012, as in Mitsuba 3.9.1) over 26 directions, five heights of the sun and
/// turbidities 2 to 4. Multiple scattering from all sides alike misses some of the blue light along long paths.
const SKY_GAIN: DVec3 = DVec3::new(0.948, 1.124, 1.129);
const HORIZON_GAIN_LN: DVec3 = DVec3::new(0.17, 0.249, 0.316);
const HORIZON_GAIN_FALL: f64 = 0.2;
/// Mean radiance of a frame by day after exposure: 18% grey is a little darker.
const DAY_KEY: f64 = 0.3;
/// Light below this share of noon's makes darker frames, by this power of the light.
const DUSK: f64 = 0.1;
const DUSK_POWER: f64 = 0.18;
/// Albedo of ground and facades that reflect light into streets.
const GROUND_REFLECTION: f64 = 0.16;
const FACADE_REFLECTION: f64 = 0.45;
/// Sunlit facades fill more of a street's view than the stored occlusion says, which leaves out what is below the horizon.
const FACADE_SUN: f64 = 2.5;
/// Contrast at which a surface is still visible at the end of the visibility (Koschmieder): 2%.
const VISIBLE_CONTRAST_LN: f64 = 3.912;
/// Extinction of haze by colour, relative to that at 0.55 micrometres: Ångström's exponent 1.3 at 612, 549 and 465 nm.
const HAZE_TINT: DVec3 = DVec3::new(0.8704, 1.0024, 1.2438);
/// Rings of directions over which the sky's irradiance is summed.
const RINGS: u32 = 12;
const REMEMBERED: usize = 4;

/// How clear the air is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Air {
    /// Linke's turbidity, 1 to 20: 2 very clear, 3 clear, 6 hazy. It colours sun and sky.
    pub turbidity: f32,
    /// Distance in metres at which haze leaves 2% of the contrast.
    pub visibility_m: f32,
}

impl Default for Air {
    fn default() -> Self {
        Self { turbidity: 3.0, visibility_m: 45_000.0 }
    }
}

/// What shines besides the sun and the sky.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NightLights {
    /// Unit vector towards the moon, which may be below the horizon. `None`: unknown. Nights are then lit by a full moon that is
    /// not visible.
    pub moon: Option<Vec3>,
    /// Whether walls have lit windows after sunset.
    pub lit_windows: bool,
}

/// Light of a full moon by its phase: magnitudes by Allen (Astrophysical Quantities, 1976). `angle_deg` is the angle between sun
/// and earth as seen from the moon.
fn moonlight_by_phase(angle_deg: f64) -> f64 {
    10f64.powf(-0.4 * (0.026 * angle_deg + 4e-9 * angle_deg.powi(4)))
}

/// The atmosphere of a turbidity. Its table takes some ten milliseconds.
fn atmosphere(turbidity: f32) -> Arc<Atmosphere> {
    static MADE: Mutex<Vec<(f32, Arc<Atmosphere>)>> = Mutex::new(Vec::new());
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, air)) = made.iter().find(|(of, _)| *of == turbidity) {
        return air.clone();
    }
    let air = Arc::new(Atmosphere::new(f64::from(turbidity)));
    made.truncate(REMEMBERED - 1);
    made.insert(0, (turbidity, air.clone()));
    air
}

/// Irradiances of surfaces from the sky, divided by pi.
struct SkyIrradiance {
    up: DVec3,
    /// Walls towards the sun, across, and away from it.
    walls: [DVec3; 3],
    /// A surface that faces the sun.
    sunward: DVec3,
}

/// The sky as tables by height and by azimuth from the sun: [`SKY_AZIMUTHS`] for each of [`SKY_HEIGHTS`].
struct SkyTables {
    smooth: Vec<DVec3>,
    forward: Vec<DVec3>,
}

impl SkyTables {
    fn new(air: &Atmosphere, sun: DVec3) -> Self {
        let (flat, mut tables) = (side_of(sun), Self { smooth: Vec::new(), forward: Vec::new() });
        for row in 0..SKY_HEIGHTS {
            let v = row as f64 / (SKY_HEIGHTS - 1) as f64;
            let z = f64::from(SKY_LOW) + (1.0 - f64::from(SKY_LOW)) * v * v;
            for column in 0..SKY_AZIMUTHS {
                let along = column as f64 / (SKY_AZIMUTHS - 1) as f64 * 2.0 - 1.0;
                let across = (1.0 - along * along).sqrt();
                let level = DVec2::new(flat.x * along - flat.y * across, flat.y * along + flat.x * across);
                let SkyLight { smooth, forward } = air.sky((level * (1.0 - z * z).sqrt()).extend(z), sun);
                let gain = SKY_GAIN * (HORIZON_GAIN_LN * (-z / HORIZON_GAIN_FALL).exp()).exp();
                tables.smooth.push(smooth * gain + NIGHT * (1.0 + 2.0 * (1.0 - z).powi(4)));
                tables.forward.push(forward * gain);
            }
        }
        tables
    }

    /// Radiance in a direction above the horizon. The shaders read the tables in the same way.
    fn radiance(&self, dir: DVec3, sun: DVec3) -> DVec3 {
        let low = f64::from(SKY_LOW);
        let row = (((dir.z - low) / (1.0 - low)).max(0.0)).sqrt() * (SKY_HEIGHTS - 1) as f64;
        let along = DVec2::new(dir.x, dir.y).dot(side_of(sun)) / dir.truncate().length().max(1e-4);
        let column = (0.5 + 0.5 * along.clamp(-1.0, 1.0)) * (SKY_AZIMUTHS - 1) as f64;
        let (y, x) = ((row as usize).min(SKY_HEIGHTS - 2), (column as usize).min(SKY_AZIMUTHS - 2));
        let (fy, fx) = (row - y as f64, column - x as f64);
        let read = |table: &[DVec3]| {
            let at = |y: usize| table[y * SKY_AZIMUTHS + x].lerp(table[y * SKY_AZIMUTHS + x + 1], fx);
            at(y).lerp(at(y + 1), fy)
        };
        read(&self.smooth) + read(&self.forward) * phase(dir.dot(sun))
    }

    /// Irradiances from the sky, and from a moon that gives surfaces that face up `moonlight`.
    fn irradiance(&self, sun: DVec3, moonlight: DVec3) -> SkyIrradiance {
        let ahead = side_of(sun).extend(0.0);
        let across = DVec3::new(-ahead.y, ahead.x, 0.0);
        let mut sums = [DVec3::ZERO; 5];
        let normals = [DVec3::Z, ahead, across, -ahead, sun.with_z(sun.z.max(0.0)).normalize_or(ahead)];
        hemisphere(RINGS, |dir, solid_angle| {
            let radiance = self.radiance(dir, sun) * (solid_angle / PI);
            for (sum, normal) in sums.iter_mut().zip(normals) {
                *sum += radiance * dir.dot(normal).max(0.0);
            }
        });
        let [up, towards, across, away, sunward] = sums;
        let walls = [towards, across, away].map(|wall| wall + moonlight * MOON_ON_WALLS);
        SkyIrradiance { up: up + moonlight, walls, sunward: sunward + moonlight }
    }
}

/// The phase function of Henyey and Greenstein.
fn phase(cos: f64) -> f64 {
    let g = f64::from(MIE_G);
    f64::from(PHASE_SCALE) / (1.0 + g * g - 2.0 * g * cos).powf(1.5)
}

/// The horizontal unit vector towards the sun.
fn side_of(sun: DVec3) -> DVec2 {
    sun.truncate().normalize_or(DVec2::Y)
}

struct Moon {
    direction: DVec3,
    /// Radiance of its lit side.
    radiance: f64,
    /// Irradiance on surfaces that face up, divided by pi.
    irradiance: DVec3,
}

impl Moon {
    fn new(atmosphere: &Atmosphere, direction: Option<DVec3>, sun: DVec3) -> Self {
        let Some(direction) = direction else {
            return Self { direction: DVec3::Z, radiance: 0.0, irradiance: MOON };
        };
        let passed = if direction.z > 0.0 { atmosphere.sun(direction.z) } else { DVec3::ZERO };
        let phase_deg = (-direction.dot(sun)).clamp(-1.0, 1.0).acos().to_degrees();
        Self {
            direction,
            radiance: MOON_ALBEDO * luminance(passed) / PI,
            irradiance: MOON * passed * (direction.z.max(0.0) * moonlight_by_phase(phase_deg)),
        }
    }
}

impl Light {
    /// Light under a sun in direction `sun`, with no more known of the night.
    pub fn of_sun(sun: Vec3, air: Air) -> Self {
        Self::new(sun, air, &NightLights::default())
    }

    /// Light under a sun in direction `sun` (any length; below the horizon it is twilight, then night).
    pub fn new(sun: Vec3, air: Air, night: &NightLights) -> Self {
        let sun = sun.as_dvec3().normalize_or(DVec3::Z);
        let atmosphere = atmosphere(air.turbidity);
        let tables = SkyTables::new(&atmosphere, sun);
        let moon = Moon::new(&atmosphere, night.moon.map(Vec3::as_dvec3), sun);
        let sky = tables.irradiance(sun, moon.irradiance);
        let sunlight = atmosphere.sun(sun.z) / PI;
        let white = luminance(sunlight + sky.sunward);
        let noon = luminance(atmosphere.sun(1.0)) / PI;
        let sun_deg = sun.z.asin().to_degrees();
        let darkness = ((sun_deg - STARS_DEG[0]) / (STARS_DEG[1] - STARS_DEG[0])).clamp(0.0, 1.0);
        let rgb = |v: DVec3| (v / white).as_vec3().extend(0.0).to_array();
        let has_windows = night.lit_windows && sun_deg < WINDOWS_DEG;
        let [window_r, window_g, window_b, _] = rgb(WINDOWS);
        let [lamp_r, lamp_g, lamp_b, _] = rgb(LAMPS);
        let are_lamps_seen = luminance(LAMPS) > LEAST_LAMPS * white;
        // Lamps brighten a city at night, so its frames are not as dark as those of a landscape.
        let seen = white + 0.5 * luminance(LAMPS);
        let table = |values: &[DVec3]| -> SkyTable {
            std::array::from_fn(|row| std::array::from_fn(|column| rgb(values[row * SKY_AZIMUTHS + column])))
        };
        // A parabola in the cosine of a wall's azimuth from the sun, through three walls. The factor 2 is that of the
        // stored occlusion: a wall in the open sees half of the sky, so its occlusion is 1/2.
        let [towards, across, away] = sky.walls;
        let ahead = (towards - away) * 0.5;
        let axis = (towards + away) * 0.5 - across;
        let flat = (1.0 - sun.z * sun.z).max(0.0).sqrt();
        let level_sun = sunlight * sun.z.max(0.0);
        Self {
            sun: rgb(sunlight),
            sky_up: rgb(sky.up),
            sky_wall: rgb(across * 2.0),
            sky_wall_ahead: rgb(ahead * 2.0),
            sky_wall_axis: rgb(axis * 2.0),
            ground_sun: rgb(level_sun * GROUND_REFLECTION),
            ground_sky: rgb(sky.up * GROUND_REFLECTION),
            facade_sun: rgb(sunlight * (flat * FACADE_SUN * FACADE_REFLECTION)),
            facade_sky: rgb(sky.up * (0.5 * FACADE_REFLECTION)),
            haze: (HAZE_TINT * (VISIBLE_CONTRAST_LN / f64::from(air.visibility_m.max(1.0))))
                .as_vec3()
                .extend(0.0)
                .to_array(),
            street: [lamp_r, lamp_g, lamp_b, f32::from(u8::from(are_lamps_seen))],
            window: [window_r, window_g, window_b, f32::from(u8::from(has_windows))],
            moon: moon.direction.extend((moon.radiance / white).min(MOON_MAX)).as_vec4().to_array(),
            side: side_of(sun).as_vec2().to_array(),
            disc: f32::from(u8::from(sunlight.x > 0.0)),
            zero: 0.0,
            sun_tan: (sun.z.max(0.0) / flat.max(1e-3)) as f32,
            facade_ground: (FACADE_REFLECTION * 0.5) as f32,
            key: (DAY_KEY * (seen / noon / DUSK).min(1.0).powf(DUSK_POWER)) as f32,
            stars: (STARS * darkness) as f32,
            plane: GROUND_ALBEDO.extend(0.0).to_array(),
            grade: [0.0; 4],
            sky: table(&tables.smooth),
            glow: table(&tables.forward),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(height_deg: f32) -> Light {
        let (sin, cos) = height_deg.to_radians().sin_cos();
        Light::of_sun(Vec3::new(cos, 0.0, sin), Air::default())
    }

    fn brightness([r, g, b, _]: [f32; 4]) -> f32 {
        luminance(Vec3::new(r, g, b).as_dvec3()) as f32
    }

    #[test]
    fn every_height_of_the_sun_gives_finite_light() {
        for height_deg in (-90..=90).step_by(5) {
            let light = at(height_deg as f32);
            for value in bytemuck::cast_slice::<Light, f32>(&[light]) {
                assert!(value.is_finite(), "{height_deg}: {light:?}");
            }
            assert!(brightness(light.sky_up) > 0.02 && brightness(light.sky[0][0]) > 0.003, "{height_deg}: {light:?}");
            let darkest_wall = brightness(light.sky_wall) - brightness(light.sky_wall_ahead).abs();
            assert!(darkest_wall + brightness(light.sky_wall_axis).min(0.0) > 0.0, "{height_deg}");
        }
    }

    /// Ratios of Hosek and Wilkie's sky with turbidity 3 over ground of albedo 0.25 (Mitsuba 3.9.1, plugin `sunsky`).
    #[test]
    fn sun_and_sky_agree_with_a_reference_model() {
        for (height_deg, sun, up) in [
            (12.88, [1.115, 0.735, 0.322], [0.105, 0.152, 0.202]),
            (77.8, [0.958, 0.810, 0.638], [0.112, 0.172, 0.291]),
        ] {
            let light = at(height_deg);
            for (ours, theirs) in [(light.sun, sun), (light.sky_up, up)] {
                for i in 0..3 {
                    assert!((0.7..1.4).contains(&(ours[i] / theirs[i])), "{height_deg}: {ours:?}, not {theirs:?}");
                }
            }
        }
    }

    #[test]
    fn the_sky_is_blue_by_day_and_the_low_sun_is_warm() {
        let (noon, late) = (at(60.0), at(8.0));
        let zenith = noon.sky[SKY_HEIGHTS - 1][0];
        assert!(zenith[2] > 1.5 * zenith[0], "{zenith:?}");
        let warmth = |light: &Light| light.sun[0] / light.sun[2];
        assert!(warmth(&late) > 1.5 * warmth(&noon), "{} {}", warmth(&noon), warmth(&late));
        // A clear sky gives a surface that faces up about a tenth to a fifth of what the high sun gives it.
        let share = brightness(noon.sky_up) / brightness(noon.sun);
        assert!((0.08..0.25).contains(&share), "{share}");
    }

    #[test]
    fn the_sun_sets_and_frames_become_darker_towards_night() {
        assert_eq!(at(-1.0).sun, [0.0; 4]);
        let keys: Vec<f32> = [40.0, 5.0, 0.0, -6.0, -12.0, -40.0].map(|deg| at(deg).key).to_vec();
        assert!(keys.is_sorted_by(|a, b| a >= b) && keys[5] < 0.5 * keys[0] && keys[1] > 0.9 * keys[0], "{keys:?}");
    }

    #[test]
    fn the_moon_lights_nights_by_its_phase() {
        let sun = Vec3::new(0.6, 0.0, -0.8);
        let at = |moon: Vec3| Light::new(sun, Air::default(), &NightLights { moon: Some(moon), lit_windows: false });
        let (full, new, quarter) = (at(-sun), at(sun), at(Vec3::new(0.8, 0.0, 0.6)));
        // Relative to the lamps, which are the same in all of them.
        let level = |light: &Light| brightness(light.sky_up) / brightness(light.street);
        assert!(
            level(&full) > 2.0 * level(&quarter) && level(&quarter) > 1.05 * level(&new),
            "{} {}",
            level(&full),
            level(&quarter)
        );
        assert!(full.moon[3] > 0.0 && new.moon[3] == 0.0);
        assert!((moonlight_by_phase(0.0), moonlight_by_phase(90.0) < 0.1) == (1.0, true));
    }

    #[test]
    fn windows_are_lit_only_after_sunset_and_on_demand() {
        let windows = |z: f32, lit_windows| {
            Light::new(Vec3::new(0.9, 0.0, z), Air::default(), &NightLights { moon: None, lit_windows }).window
        };
        assert_eq!([windows(0.9, true)[3], windows(-0.2, false)[3], windows(-0.2, true)[3]], [0.0, 0.0, 1.0]);
        // By day, lamps are invisible.
        assert!(brightness(at(20.0).street) < 1e-3 && brightness(at(-20.0).street) > 1.0);
    }

    #[test]
    fn clearer_air_has_a_stronger_sun() {
        let sun = |turbidity| {
            let light = Light::of_sun(Vec3::new(0.6, 0.0, 0.8), Air { turbidity, ..Air::default() });
            brightness(light.sun) / brightness(light.sky_up)
        };
        assert!(sun(2.0) > 1.2 * sun(3.0) && sun(3.0) > 1.5 * sun(6.0));
    }
}
