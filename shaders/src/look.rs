//! Looks of a lit city: light as it is measured, or graded so that the city reads like a white model.
//!
//! A look changes the light of a frame ([`Look::grade`]), its exposure and its tone curve ([`crate::tone`]). Rays are the same in all
//! looks, and so is `--shading`. The constants are those of a set of target pictures: sunlit plaster is white, shade has little colour,
//! far land takes the colour of the sky above it.

use crate::atmosphere::LUMINANCE;
use crate::layout::{Light, SKY_AZIMUTHS, SKY_HEIGHTS};
use crate::light::SKY_LOW;
use glam::{Vec3, Vec4, Vec4Swizzles};

/// How a lit city is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum Look {
    /// The light of sun and sky as it is measured, exposed by the frame's mean, with the tone curve of film.
    Physical = 0,
    /// A white model in daylight: clear, with little colour in light and shade, and fog around the city.
    #[default]
    Model = 1,
    /// Even light on paper, without sun, sky and fog: for reports.
    Paper = 2,
}

/// Heights of the sun in degrees at which the grade of a day begins and at which it is complete.
const DAY_DEG: [f32; 2] = [6.0, 28.0];
/// Heights of the sun in degrees between which the grade of sky and shade sets in, and between which the picture brightens from
/// [`NIGHT_SHOWN`] to [`PLASTER_SHOWN`].
const DUSK_DEG: [f32; 2] = [-4.0, 6.0];
const TWILIGHT_DEG: [f32; 2] = [-9.0, 4.0];
/// Share of the sun's colour that becomes grey, at a low sun and by day.
const SUN_GREY: [f32; 2] = [0.22, 0.62];
/// Share of the colour of the sky's light and of returned light that becomes grey, and what that light is multiplied by: what reaches
/// surfaces that face up by least, so that the lightness of shadows on open ground is lower by a quarter to three tenths, of which fog
/// takes some. What reaches walls from sky and ground is multiplied by most: a wall in shade is not darker than the street before it.
const FILL_GREY: [f32; 2] = [0.30, 0.50];
const SKY_UP_GAIN: [f32; 2] = [1.25; 2];
const FILL_GAIN: [f32; 2] = [1.25, 1.4];
const WALL_GAIN: [f32; 2] = [1.25, 1.64];
/// Factors of the visible sky's light and of its saturation.
const SKY_GAIN: [f32; 2] = [1.2, 1.75];
const SKY_SATURATION: [f32; 2] = [1.0, 1.12];
/// The horizon takes this colour of the picture, linear RGB, by this share, at a low sun and by day: clear air at a low sun is yellow
/// and green, which looks like smog. The sky reaches it within some degrees: the sine of the height at which the part of the horizon's
/// colour has fallen to 1 / e.
const HORIZON_WHITE: [Vec3; 2] = [Vec3::new(0.92, 0.76, 0.68), Vec3::new(0.86, 0.90, 0.93)];
const HORIZON_SHARE: [f32; 2] = [0.5, 0.28];
const HORIZON_HEIGHT: f32 = 0.045;
/// Albedo of sunlit plaster, and its value in the picture.
const PLASTER: f32 = 0.80;
const PLASTER_SHOWN: f32 = 0.97 * 0.92;
/// The value of plaster beside a street's lamps at night.
const NIGHT_SHOWN: f32 = 0.2;
/// The exposure takes the sun for at least this high: sine of 35 degrees. Evenings stay evenings.
const LEAST_SUN: f32 = 0.57;
/// Mean light on a city, relative to open ground, below which a frame is exposed longer; with this power of the difference, up to
/// this factor. Then the mean albedo of a city of which it is not known.
const OPEN_LIGHT: f32 = 0.60;
const MEAN_ALBEDO: f32 = 0.55;
const ADAPTATION: f32 = 0.65;
const LONGEST: f32 = 1.7;
/// Least share of the sky that a surface sees: stored occlusion leaves deep streets too dark.
const LEAST_OPEN: f32 = 0.24;
/// Light on paper from above and on walls, and how much the walls of one side differ from those of the other.
const PAPER_UP: f32 = 0.98;
const PAPER_WALL: f32 = 0.86;
const PAPER_SIDE: f32 = 0.16;

impl Look {
    /// All looks.
    pub const ALL: [Self; 3] = [Self::Model, Self::Physical, Self::Paper];

    /// The word on command lines and in links.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Physical => "physical",
            Self::Model => "model",
            Self::Paper => "paper",
        }
    }

    /// The look with a word; `None` if there is none.
    pub fn of_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|look| look.word() == word)
    }

    /// The light of a frame in this look under a sun in direction `sun`, which is a unit vector.
    pub fn grade(self, light: Light, sun: Vec3) -> Light {
        match self {
            Self::Physical => light,
            Self::Model => model(light, sun.z),
            Self::Paper => paper(light),
        }
    }

    /// Strength of lines at silhouettes and of shade where surfaces meet.
    pub fn edges(self) -> [f32; 2] {
        match self {
            Self::Physical => [0.0; 2],
            Self::Model => [0.34, 0.85],
            Self::Paper => [0.6, 0.6],
        }
    }

    /// Whether the air around the city has fog.
    pub fn has_fog(self) -> bool {
        self == Self::Model
    }
}

impl Light {
    /// Sets the mean log2 of the albedos of what a graded frame shows. Then its exposure follows the light on the city, and dark photos do
    /// not brighten the ground.
    pub fn set_albedo_log2(&mut self, mean: f32) {
        if self.grade[0] > 0.0 {
            self.grade[1] += mean - MEAN_ALBEDO.log2();
        }
    }
}

fn rgb(v: [f32; 4]) -> Vec3 {
    Vec4::from(v).xyz()
}

/// A colour that is multiplied by `gain`, of which `grey` becomes grey. Keeps what stands in its fourth place.
fn graded(colour: [f32; 4], grey: f32, gain: f32) -> [f32; 4] {
    let v = rgb(colour);
    (v.lerp(Vec3::splat(v.dot(LUMINANCE)), grey) * gain).extend(colour[3]).to_array()
}

fn smooth([from, to]: [f32; 2], v: f32) -> f32 {
    let t = ((v - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn height_deg(sun_z: f32) -> f32 {
    sun_z.clamp(-1.0, 1.0).asin().to_degrees()
}

/// How much of an evening or a morning it is under a sun in direction `sun`, a unit vector: 0 by day and at night, 1 when the sun is low.
pub fn low_sun(sun: Vec3) -> f32 {
    let height_deg = height_deg(sun.z);
    smooth(DUSK_DEG, height_deg) * (1.0 - smooth(DAY_DEG, height_deg))
}

fn model(mut light: Light, sun_z: f32) -> Light {
    let height_deg = height_deg(sun_z);
    let day = smooth(DAY_DEG, height_deg);
    let by_day = |[low, high]: [f32; 2]| low + (high - low) * day;
    light.sun = graded(light.sun, by_day(SUN_GREY), 1.0);
    let awake = smooth(DUSK_DEG, height_deg);
    let grey = by_day(FILL_GREY);
    let [up_gain, gain, wall_gain] = [SKY_UP_GAIN, FILL_GAIN, WALL_GAIN].map(|gain| 1.0 + (by_day(gain) - 1.0) * awake);
    light.sky_up = graded(light.sky_up, grey, up_gain);
    for colour in [&mut light.facade_sun, &mut light.facade_sky] {
        *colour = graded(*colour, grey, gain);
    }
    for colour in [
        &mut light.sky_wall, &mut light.sky_wall_ahead, &mut light.sky_wall_axis, &mut light.ground_sun,
        &mut light.ground_sky,
    ] {
        *colour = graded(*colour, grey, wall_gain);
    }
    light.sky_up[3] = light.sky_up[3].max(LEAST_OPEN);
    light.haze = [0.0; 4];
    let lamps = rgb(light.street).dot(LUMINANCE) * light.street[3];
    let open = rgb(light.sun).dot(LUMINANCE) * sun_z.max(LEAST_SUN) + rgb(light.sky_up).dot(LUMINANCE) + lamps;
    let shown = NIGHT_SHOWN + (PLASTER_SHOWN - NIGHT_SHOWN) * smooth(TWILIGHT_DEG, height_deg);
    let white = shown / (PLASTER * open);
    let horizon = HORIZON_WHITE[0].lerp(HORIZON_WHITE[1], day) / white;
    let sky = [1.0 + (by_day(SKY_GAIN) - 1.0) * awake, by_day(SKY_SATURATION)];
    grade_sky(&mut light, sky, horizon, by_day(HORIZON_SHARE) * awake);
    light.grade = [white, (OPEN_LIGHT * MEAN_ALBEDO * open).log2(), ADAPTATION, LONGEST.log2()];
    light
}

/// Brightens the visible sky, and leads it to the colour of the horizon that fog has, of which `whitened` is `horizon`.
fn grade_sky(light: &mut Light, [gain, saturation]: [f32; 2], horizon: Vec3, whitened: f32) {
    let low = light.sky[0];
    let low_glow = light.glow[0];
    for row in 0..SKY_HEIGHTS {
        let v = row as f32 / (SKY_HEIGHTS - 1) as f32;
        // As `light::SkyTables` has the rows.
        let near = (-(1.0 - SKY_LOW) * v * v / HORIZON_HEIGHT).exp();
        for column in 0..SKY_AZIMUTHS {
            let clear = |colour| rgb(graded(colour, 1.0 - saturation, gain));
            let at_horizon = clear(low[column]).lerp(horizon, whitened);
            let smooth = clear(light.sky[row][column]).lerp(at_horizon, near);
            let glow = clear(light.glow[row][column]).lerp(clear(low_glow[column]) * (1.0 - whitened), near);
            light.sky[row][column] = smooth.extend(0.0).to_array();
            light.glow[row][column] = glow.extend(0.0).to_array();
        }
    }
}

fn paper(mut light: Light) -> Light {
    let grey = |v: f32| [v, v, v, 0.0];
    let least = light.sky_up[3];
    for colour in [
        &mut light.sun, &mut light.sky_wall_axis, &mut light.ground_sun, &mut light.ground_sky, &mut light.facade_sun,
        &mut light.facade_sky, &mut light.haze, &mut light.street, &mut light.window, &mut light.moon,
    ] {
        *colour = [0.0; 4];
    }
    light.sky_up = [PAPER_UP, PAPER_UP, PAPER_UP, least.max(LEAST_OPEN)];
    // A wall in the open sees half of the sky.
    light.sky_wall = grey(PAPER_WALL * 2.0);
    light.sky_wall_ahead = grey(PAPER_SIDE * 2.0);
    (light.disc, light.stars) = (0.0, 0.0);
    light.sky = [[grey(1.0); SKY_AZIMUTHS]; SKY_HEIGHTS];
    light.glow = [[[0.0; 4]; SKY_AZIMUTHS]; SKY_HEIGHTS];
    light.plane = Vec3::ONE.extend(0.0).to_array();
    light.grade = [1.0, 0.0, 0.0, 0.0];
    light
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Air;

    fn at(look: Look, height_deg: f32) -> Light {
        let (sin, cos) = height_deg.to_radians().sin_cos();
        let sun = Vec3::new(cos, 0.0, sin);
        look.grade(Light::of_sun(sun, Air::default()), sun)
    }

    #[test]
    fn words_name_looks() {
        for look in Look::ALL {
            assert_eq!(Look::of_word(look.word()), Some(look));
        }
        assert_eq!(Look::of_word("Model"), None);
    }

    #[test]
    fn evenings_are_neither_day_nor_night() {
        let at =
            |height_deg: f32| low_sun(Vec3::new(height_deg.to_radians().cos(), 0.0, height_deg.to_radians().sin()));
        assert_eq!([-90.0, -5.0, 30.0, 90.0].map(at), [0.0; 4]);
        assert!((at(6.0) - 1.0).abs() < 1e-3 && at(1.0) > 0.3 && at(17.0) > 0.3, "{}", at(6.0));
    }

    #[test]
    fn sunlit_plaster_is_nearly_white_by_day() {
        for height_deg in [35.0, 50.0, 80.0] {
            let light = at(Look::Model, height_deg);
            let open = rgb(light.sun) * height_deg.to_radians().sin() + rgb(light.sky_up);
            let shown = PLASTER * open.dot(LUMINANCE) * light.grade[0];
            assert!((shown - PLASTER_SHOWN).abs() < 0.02, "{height_deg}: {shown}");
        }
    }

    #[test]
    fn shadows_on_open_ground_are_clear_and_not_black() {
        for height_deg in [30.0, 37.0, 45.0] {
            let light = at(Look::Model, height_deg);
            let shade = rgb(light.sky_up).dot(LUMINANCE);
            let lit = rgb(light.sun).dot(LUMINANCE) * height_deg.to_radians().sin() + shade;
            // Lightness goes with the cube root; that of sunlit ground is 0.84.
            let darker = 0.84 * (1.0 - (shade / lit).cbrt());
            assert!((0.22..0.36).contains(&darker), "{height_deg}: {darker}");
        }
    }

    #[test]
    fn the_horizon_has_the_colour_of_fog_and_is_light() {
        let light = at(Look::Model, 35.0);
        let shown = rgb(light.sky[0][SKY_AZIMUTHS / 2]) * light.grade[0];
        assert!(shown.dot(LUMINANCE) > 0.6, "{shown}");
        let zenith = rgb(light.sky[SKY_HEIGHTS - 1][0]);
        assert!(zenith.z > 1.5 * zenith.x, "{zenith}");
    }

    #[test]
    fn every_height_of_the_sun_gives_finite_light() {
        for look in Look::ALL {
            for height_deg in (-90..=90).step_by(5) {
                let light = at(look, height_deg as f32);
                let all: &[f32] = bytemuck::cast_slice(std::slice::from_ref(&light));
                assert!(all.iter().all(|v| v.is_finite()), "{look:?} {height_deg}");
            }
        }
    }

    #[test]
    fn dark_photos_are_expected_to_be_dark() {
        let mut light = at(Look::Model, 35.0);
        let usual = light.grade[1];
        light.set_albedo_log2((MEAN_ALBEDO / 4.0).log2());
        assert!((light.grade[1] - usual + 2.0).abs() < 1e-5);
    }

    #[test]
    fn physical_light_stays_as_it_is() {
        let sun = Vec3::new(0.6, 0.0, 0.8);
        let light = Light::of_sun(sun, Air::default());
        assert_eq!(Look::Physical.grade(light, sun), light);
        assert_eq!(light.grade, [0.0; 4]);
    }
}
