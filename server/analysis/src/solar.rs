//! What sun and sky give in a year to roofs, ground and walls: without clouds, or with the weather of a file.

use crate::clock::TimeSystem;
use crate::light::{SunLight, Total, total};
use crate::sky::{SkyView, sky_view};
use crate::sun::{Bearing, Site};
use crate::surface::CitySurface;
use crate::tally::{Sum, Tally};
use crate::walls::WallPoint;
use crate::weather::WeatherYear;
use chrono::{Datelike, NaiveDate};
use glam::DVec3;

/// The year without clouds, of which every so many days and minutes are computed.
const YEAR: i32 = 2025;
const EVERY_DAYS: usize = 14;
const STEP_MINUTES: u32 = 20;
/// In how many steps the sun passes through an hour of weather.
const STEPS_OF_HOUR: u32 = 60 / STEP_MINUTES;
/// Side of the squares of the sky in which the suns of a year of weather are one light, in degrees: the steps of a year without clouds are
/// as far apart.
const SQUARE_DEG: f64 = 3.0;
/// Squares around the horizon, and from there to the zenith.
const SQUARES: [usize; 2] = [120, 30];
/// A lower sun gives nothing.
const LOWEST_SUN_DEG: f64 = 0.1;
/// Mean irradiance beyond the air in W/m2.
const SOLAR_CONSTANT: f64 = 1366.1;
/// Share of the work that is the sky.
const SKY_SHARE: f64 = 0.1;
/// A wall with nothing before it has this vertical sky component, and half of an even sky.
const OPEN_WALL: f32 = 39.6;

/// Irradiation of a year in kWh/m2 of the surface as it is inclined.
#[derive(Debug, Clone)]
pub struct SolarYear {
    /// For the tops of the surface's cells; NaN where nothing was baked.
    pub tops: Vec<f32>,
    pub wall_points: Vec<WallPoint>,
    /// For each of `wall_points`.
    pub walls: Vec<f32>,
    /// On level ground with nothing around it.
    pub open: f64,
}

/// Where the light of a year is from.
#[derive(Debug, Clone, Copy)]
pub enum YearOfSky<'a> {
    /// A sky without clouds, with Linke's turbidity, 1 to 20.
    Clear(f64),
    /// The weather of a file.
    Weather(&'a WeatherYear),
}

/// Irradiance in W/m2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClearSkyLight {
    /// On a surface that faces the sun.
    pub direct: f64,
    /// On open level ground, from the sky.
    pub diffuse: f64,
}

impl ClearSkyLight {
    /// The clear sky of Ineichen and Perez (A new airmass independent formulation for the Linke turbidity coefficient, Solar Energy 73(3),
    /// 2002), for the sun at an altitude above the horizon on a day of the year, at a height above the sea.
    #[must_use]
    pub fn new(altitude_deg: f64, day_of_year: u32, turbidity: f64, height_m: f64) -> Self {
        let up = altitude_deg.to_radians().sin().max(1e-3);
        // Kasten and Young 1989, and the pressure of the standard atmosphere.
        let mass = 1.0 / (up + 0.50572 * (altitude_deg.max(0.0) + 6.07995).powf(-1.6364));
        let mass = mass * ((44_331.514 - height_m) / 11_880.516).powf(1.0 / 0.190_263_2) / 1013.25;
        let beyond = SOLAR_CONSTANT * orbit(day_of_year);
        let [f1, f2] = [8000.0, 1250.0].map(|scale: f64| (-height_m / scale).exp());
        let [c1, c2] = [5.09e-5 * height_m + 0.868, 3.92e-5 * height_m + 0.0387];
        let global = c1 * beyond * up * (-c2 * mass * (f1 + f2 * (turbidity - 1.0))).exp();
        let direct = (0.664 + 0.163 / f1) * beyond * (-0.09 * mass * (turbidity - 1.0)).exp();
        let most = global * (1.0 - (0.1 - 0.2 * (-turbidity).exp()) / (0.1 + 0.882 / f1)).max(0.0) / up;
        let direct = direct.min(most);
        Self { direct, diffuse: (global - direct * up).max(0.0) }
    }
}

/// The square of the mean distance of the sun, divided by that of a day (Spencer 1971).
fn orbit(day_of_year: u32) -> f64 {
    let angle = std::f64::consts::TAU * (f64::from(day_of_year) - 1.0) / 365.0;
    1.00011
        + 0.034221 * angle.cos()
        + 0.00128 * angle.sin()
        + 0.000719 * (2.0 * angle).cos()
        + 0.000077 * (2.0 * angle).sin()
}

/// Computes the irradiation of a year: the sun itself by sweeps of shadows, and an even sky by the share of it that a place sees. Light that
/// the ground or walls reflect is left out. `progress` is as that of [`sky_view`].
#[must_use]
pub fn solar_year(
    surface: &mut CitySurface,
    site: &Site,
    sky: YearOfSky<'_>,
    wall_heights_m: &[f64],
    progress: &(dyn Fn(f64) -> bool + Sync),
) -> SolarYear {
    let (lights, diffuse) = match sky {
        YearOfSky::Clear(turbidity) => clear_lights(site, turbidity, surface.base_m.clamp(0.0, 5000.0)),
        YearOfSky::Weather(weather) => weather_lights(site, weather),
    };
    let on_level = |light: &SunLight| light.strength * light.sun.altitude_deg.to_radians().sin();
    let open = diffuse + lights.iter().map(on_level).sum::<f64>();
    let SkyView { mut tops, wall_points, mut walls } =
        sky_view(surface, wall_heights_m, &|share| progress(SKY_SHARE * share));
    let of_sun = |share: f64| progress(SKY_SHARE + (1.0 - SKY_SHARE) * share);
    let sun: Total<Sum> = total(surface, &wall_points, lights, &of_sun);
    let diffuse = diffuse as f32;
    // The share of an even sky that a level cell sees is that of a slope, too, which has its own higher part before it.
    tops.iter_mut().zip(sun.tops).for_each(|(value, sun)| *value = *value * diffuse + sun.value());
    walls.iter_mut().zip(sun.walls).for_each(|(value, sun)| *value = 0.5 * *value / OPEN_WALL * diffuse + sun.value());
    SolarYear { tops, wall_points, walls, open }
}

/// The suns of a year without clouds with what each of them gives in kWh/m2, and what the sky gives to open level ground.
fn clear_lights(site: &Site, turbidity: f64, height_m: f64) -> (Vec<SunLight>, f64) {
    let (mut lights, mut diffuse) = (Vec::new(), 0.0);
    let Some(first) = NaiveDate::from_ymd_opt(YEAR, 1, 1) else { return (lights, diffuse) };
    let days: Vec<NaiveDate> = first.iter_days().take(365).skip(EVERY_DAYS / 2).step_by(EVERY_DAYS).collect();
    let kilowatt_hours = 365.0 / days.len() as f64 * f64::from(STEP_MINUTES) / 60.0 / 1000.0;
    for day in days {
        for step in 0..24 * 60 / STEP_MINUTES {
            let hour = (f64::from(step) + 0.5) * f64::from(STEP_MINUTES) / 60.0;
            let sun = site.sun(day, hour, &TimeSystem::TrueSolar).filter(|sun| sun.altitude_deg > LOWEST_SUN_DEG);
            let Some(sun) = sun else { continue };
            let sky = ClearSkyLight::new(sun.altitude_deg, day.ordinal(), turbidity, height_m);
            diffuse += sky.diffuse * kilowatt_hours;
            lights.push(SunLight { sun, strength: sky.direct * kilowatt_hours });
        }
    }
    (lights, diffuse)
}

/// The same of a year of weather. What the file has of an hour's sun is divided evenly among the steps in which the sun is up over the
/// city. Suns in one square of the sky are one light. Its direction and strength are those of the sum of them as vectors, so that a
/// surface which it reaches has the same of it as of all of them.
fn weather_lights(site: &Site, weather: &WeatherYear) -> (Vec<SunLight>, f64) {
    let zone = TimeSystem::Offset(weather.zone_hours);
    let mut squares = vec![DVec3::ZERO; SQUARES[0] * SQUARES[1]];
    let mut diffuse = 0.0;
    for hour in &weather.hours {
        diffuse += hour.diffuse_wh / 1000.0;
        if hour.direct_wh <= 0.0 {
            continue;
        }
        let step = |step: u32| f64::from(hour.begin) + (f64::from(step) + 0.5) / f64::from(STEPS_OF_HOUR);
        let suns = (0..STEPS_OF_HOUR).filter_map(|number| site.sun(hour.date, step(number), &zone));
        let suns: Vec<Bearing> = suns.filter(|sun| sun.altitude_deg > LOWEST_SUN_DEG).collect();
        let each = hour.direct_wh / 1000.0 / suns.len() as f64;
        suns.iter().for_each(|sun| squares[square(sun)] += sun.direction() * each);
    }
    let light = |sum: &DVec3| {
        let [east, north, up] = sum.to_array();
        let azimuth_deg = east.atan2(north).to_degrees().rem_euclid(360.0);
        SunLight {
            sun: Bearing { azimuth_deg, altitude_deg: up.atan2(east.hypot(north)).to_degrees() },
            strength: sum.length(),
        }
    };
    (squares.iter().filter(|sum| **sum != DVec3::ZERO).map(light).collect(), diffuse)
}

/// The square of the sky in which a sun stands that is above the horizon.
fn square(sun: &Bearing) -> usize {
    let [around, up] = [sun.azimuth_deg.rem_euclid(360.0), sun.altitude_deg].map(|deg| (deg / SQUARE_DEG) as usize);
    up.min(SQUARES[1] - 1) * SQUARES[0] + around.min(SQUARES[0] - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_surface::surface;
    use crate::weather::WeatherHour;

    const DELFT: Site = Site { latitude_deg: 52.0, longitude_deg: 4.36, north_deg: 0.0 };

    /// The mean of the walls that look there.
    fn of_side(year: &SolarYear, azimuth: f32) -> f32 {
        let walls = year.wall_points.iter().zip(&year.walls).filter(|(point, _)| point.azimuth_deg == azimuth);
        let values: Vec<f32> = walls.map(|(_, value)| *value).collect();
        values.iter().sum::<f32>() / values.len() as f32
    }

    /// A year in Delft in which the hours of a day from the one to the other have the same sun and sky, in Wh/m2.
    fn weather(sunny: std::ops::Range<u32>, [direct_wh, diffuse_wh]: [f64; 2]) -> WeatherYear {
        let first = NaiveDate::from_ymd_opt(2025, 1, 1).unwrap();
        let hour = |date: NaiveDate, begin: u32| match sunny.contains(&begin) {
            true => WeatherHour { date, begin, direct_wh, diffuse_wh },
            false => WeatherHour { date, begin, direct_wh: 0.0, diffuse_wh: 0.0 },
        };
        let hours = first.iter_days().take(365).flat_map(|date| (0..24).map(move |begin| (date, begin)));
        WeatherYear {
            place: "Delft".to_owned(),
            latitude_deg: 52.0,
            longitude_deg: 4.36,
            zone_hours: 1.0,
            hours: hours.map(|(date, begin)| hour(date, begin)).collect(),
            missing: 0,
        }
    }

    /// Those of pvlib 0.16 (`clearsky.ineichen` with `get_absolute_airmass`, `get_extra_radiation` and turbidity 3) on 21 June.
    #[test]
    fn the_clear_sky_is_that_of_the_formula() {
        let noon = ClearSkyLight::new(61.4, 172, 3.0, 0.0);
        let global = noon.direct * 61.4f64.to_radians().sin() + noon.diffuse;
        assert!((800.0..950.0).contains(&noon.direct) && (60.0..130.0).contains(&noon.diffuse), "{noon:?}");
        assert!((850.0..930.0).contains(&global), "{global}");
        let high = ClearSkyLight::new(61.4, 172, 3.0, 2000.0);
        assert!(high.direct > noon.direct + 50.0, "{high:?}");
        assert!(ClearSkyLight::new(61.4, 172, 6.0, 0.0).direct < noon.direct - 150.0);
        let low = ClearSkyLight::new(0.5, 355, 3.0, 0.0);
        assert!(low.direct >= 0.0 && low.diffuse >= 0.0 && low.diffuse < 20.0, "{low:?}");
    }

    /// A house of 12 m: its roof has all of the sun, and its southern wall more than the northern one; the ground in its shadow has less.
    #[test]
    fn roofs_have_more_than_what_is_in_shadow() {
        let house = |x: usize, y: usize| (30..40).contains(&x) && (30..38).contains(&y);
        let mut surface = surface(70, 70, |x, y| if house(x, y) { 12.0 } else { 0.0 });
        let year = solar_year(&mut surface, &DELFT, YearOfSky::Clear(3.0), &[6.0], &|_| true);
        let at = |x: usize, y: usize| year.tops[y * 70 + x];
        // pvlib has 1,660 kWh/m2 on open ground; its mean turbidity there is a little higher.
        assert!((1550.0..1800.0).contains(&at(35, 34)), "{}", at(35, 34));
        assert!((year.open - f64::from(at(35, 34))).abs() < 0.01 * year.open, "{}", year.open);
        assert!(at(35, 40) < 0.6 * at(35, 34) && at(35, 5) > 0.97 * at(35, 34));
        let side = |azimuth: f32| of_side(&year, azimuth);
        assert!(side(180.0) > 3.0 * side(0.0) && side(0.0) > 100.0, "{} {}", side(180.0), side(0.0));
        assert!((side(90.0) - side(270.0)).abs() < 0.03 * side(90.0));
    }
    /// Level ground has the sun of each hour, as high as it stands in the middle of the hour, and all of the sky.
    #[test]
    fn open_ground_has_all_that_the_weather_gives() {
        let weather = weather(10..15, [400.0, 100.0]);
        let year = solar_year(&mut surface(21, 21, |_, _| 0.0), &DELFT, YearOfSky::Weather(&weather), &[], &|_| true);
        let zone = TimeSystem::Offset(1.0);
        let of_hour = |hour: &WeatherHour| {
            let sun = DELFT.sun(hour.date, f64::from(hour.begin) + 0.5, &zone).unwrap();
            (hour.direct_wh * sun.direction().z + hour.diffuse_wh) / 1000.0
        };
        let wanted: f64 = weather.hours.iter().map(of_hour).sum();
        let found = f64::from(year.tops[10 * 21 + 10]);
        assert!((found - wanted).abs() < 0.01 * wanted, "{found}, not {wanted}");
        assert!((year.open - wanted).abs() < 0.01 * wanted, "{}, not {wanted}", year.open);
    }

    #[test]
    fn weather_shades_as_a_clear_sky_does() {
        let house = |x: usize, y: usize| (30..40).contains(&x) && (30..38).contains(&y);
        let mut surface = surface(70, 70, |x, y| if house(x, y) { 12.0 } else { 0.0 });
        let midday = weather(10..15, [400.0, 100.0]);
        let year = solar_year(&mut surface, &DELFT, YearOfSky::Weather(&midday), &[6.0], &|_| true);
        let at = |x: usize, y: usize| year.tops[y * 70 + x];
        assert!(at(35, 40) < 0.6 * at(35, 34), "{} {}", at(35, 40), at(35, 34));
        assert!(of_side(&year, 180.0) > 3.0 * of_side(&year, 0.0), "{:?}", year.walls);
        // Half of the sky is before a wall: 5 hours with 50 Wh/m2 on 365 days.
        assert!((of_side(&year, 0.0) - 91.25).abs() < 3.0, "{}", of_side(&year, 0.0));
        // With clocks of the other side of the Earth, all of that sun is below the horizon here, and does not count.
        let night = WeatherYear { zone_hours: 13.0, ..midday };
        let year = solar_year(&mut surface, &DELFT, YearOfSky::Weather(&night), &[6.0], &|_| true);
        assert!((year.open - 182.5).abs() < 1e-6, "{}", year.open);
    }
}
