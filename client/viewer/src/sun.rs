//! The position of the sun over a city, at a date and hour or as given.
//!
//! Hours are the city's own mean solar time: 12 when the sun is about highest, whatever the clocks there show. A time with an
//! offset (`Z`, `+09:00`) is converted by the city's longitude.

use crate::frame::RenderSettings;
use crate::moon;
use crate::select::shadow_casters::MAX_SHADOW_M;
use crate::translucency::Translucency;
use chrono::{Datelike, Days, NaiveDate, NaiveDateTime, TimeDelta, Timelike};
use glam::{DQuat, DVec3};
use insula_protocol::Manifest;
use insula_protocol::manifest::GeoLocation;
use insula_shaders::layout::Shading;
use insula_shaders::light::{Air, NightLights};
use insula_shaders::look::Look;
use solar_positioning::time::JulianDate;
use solar_positioning::{Location, RefractionCorrection, SolarPositions};

const YEARS: std::ops::RangeInclusive<i32> = 1800..=2200;
/// Terrestrial time minus universal time. A minute more or less moves no shadow visibly.
const DELTA_T_SECS: f64 = 69.0;
/// Assumed location of a city whose location is not known: a temperate latitude.
const DEFAULT_LOCATION: Location = Location { latitude: 40.0, longitude: 0.0 };
/// What the user asks for. `None` takes the default.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SunOptions {
    pub time: Option<SunTime>,
    /// A fixed position of the sun, independent of date and hour.
    pub bearing: Option<Bearing>,
    /// Whether the sun casts shadows; on by default.
    pub shadows: Option<bool>,
    /// Whether surfaces that see less of the sky are darker; on by default.
    pub occlusion: Option<bool>,
    /// Factor from radiance to display; by default, the frame's mean decides.
    pub exposure: Option<f32>,
    /// Linke's turbidity of the air, 1 to 20.
    pub turbidity: Option<f32>,
    /// Distance at which haze leaves 2% of the contrast.
    pub visibility_km: Option<f32>,
    /// Whether walls have lit windows after sunset.
    pub lit_windows: bool,
    /// Sunlight through landmarks of stone.
    pub translucency: Translucency,
    /// How the lit city is shown.
    pub look: Look,
    /// Whether there are lines at silhouettes; by default as the look has them.
    pub lines: Option<bool>,
    /// Whether there is shade where surfaces meet; by default as the look has it.
    pub contact: Option<bool>,
}

/// A date and hour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunTime {
    at: NaiveDateTime,
    /// Whether `at` is universal time; otherwise, it is the city's solar time.
    is_universal: bool,
}

impl std::fmt::Display for SunTime {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let zone = if self.is_universal { "UTC" } else { "solar time" };
        write!(f, "{} {zone}", self.at.format("%Y-%m-%d %H:%M"))
    }
}

/// A direction in the sky.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bearing {
    /// From north over east, 0 to 360.
    pub azimuth_deg: f64,
    /// Above the horizon, -90 to 90.
    pub altitude_deg: f64,
}

/// Where a city lies on Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiteLocation {
    location: Location,
    /// Angle from the grid's north to true north, clockwise.
    north_deg: f64,
    /// Whether the bake knew the location; otherwise, it is assumed.
    pub is_known: bool,
}

/// Date, hour and light over a city.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Daylight {
    pub site: SiteLocation,
    pub date: NaiveDate,
    /// Mean solar time, 0 to 24.
    pub hour: f64,
    /// Overrides date and hour.
    pub fixed_bearing: Option<Bearing>,
    /// Whether the sun casts shadows.
    pub shadows: bool,
    /// Whether surfaces that see less of the sky are darker.
    pub occlusion: bool,
    /// Whether walls have lit windows after sunset.
    pub lit_windows: bool,
    /// Sunlight through landmarks of stone.
    pub translucency: Translucency,
    /// How the lit city is shown.
    pub look: Look,
    /// Whether there are the look's lines at silhouettes, and its shade where surfaces meet.
    edges: [bool; 2],
    air: Air,
    /// Whether the user has set the visibility; otherwise, a look may replace haze.
    is_haze_set: bool,
    /// Factor from radiance to display; 0: by the frame's mean.
    exposure: f32,
}

/// Parses the value of `--time`. Fails with a description of the format.
pub fn parse_time(text: &str) -> Result<SunTime, String> {
    let invalid =
        || format!("write 2024-06-21T17:00, or 2024-06-21T17:00+09:00; years {} to {}", YEARS.start(), YEARS.end());
    parsed_time(text).filter(|time| YEARS.contains(&time.at.year())).ok_or_else(invalid)
}

/// By hand: the general parser of formats is a fiftieth of what browsers download.
fn parsed_time(text: &str) -> Option<SunTime> {
    let numbers = |text: &str, separator: char| -> Option<Vec<u32>> {
        text.split(separator).map(|digits| digits.parse().ok().filter(|_| !digits.starts_with('+'))).collect()
    };
    let (date, clock) = text.split_once('T')?;
    let (clock, offset_min) = match (clock.strip_suffix(['Z', 'z']), clock.find(['+', '-'])) {
        (Some(clock), _) => (clock, Some(0)),
        (None, Some(at)) => {
            let [hours @ ..=23, minutes @ ..=59] = numbers(&clock[at + 1..], ':')?[..] else { return None };
            let minutes = i64::from(60 * hours + minutes);
            (&clock[..at], Some(if clock[at..].starts_with('-') { -minutes } else { minutes }))
        }
        (None, None) => (clock, None),
    };
    let [year, month, day] = numbers(date, '-')?[..] else { return None };
    let (hour, minute, second) = match numbers(clock, ':')?[..] {
        [hour, minute] => (hour, minute, 0),
        [hour, minute, second] => (hour, minute, second),
        _ => return None,
    };
    let at = NaiveDate::from_ymd_opt(year.try_into().ok()?, month, day)?.and_hms_opt(hour, minute, second)?;
    let at = at.checked_sub_signed(TimeDelta::minutes(offset_min.unwrap_or(0)))?;
    Some(SunTime { at, is_universal: offset_min.is_some() })
}

/// Parses the value of `--sun`. Fails with a description of the format.
pub fn parse_bearing(text: &str) -> Result<Bearing, String> {
    let invalid = || "write AZIMUTH,ALTITUDE in degrees, like 250,20: -360 to 360, and -90 to 90".to_owned();
    let (azimuth, altitude) = text.split_once(',').ok_or_else(invalid)?;
    let number = |t: &str, max: f64| t.trim().parse().ok().filter(|v: &f64| v.abs() <= max).ok_or_else(invalid);
    Ok(Bearing { azimuth_deg: number(azimuth, 360.0)?.rem_euclid(360.0), altitude_deg: number(altitude, 90.0)? })
}

fn julian_date(date: NaiveDate, universal_hour: f64) -> Option<JulianDate> {
    let midnight = JulianDate::from_utc(date.year(), date.month(), date.day(), 0, 0, 0.0, DELTA_T_SECS).ok()?;
    JulianDate::new(midnight.julian_date() + universal_hour / 24.0, DELTA_T_SECS).ok()
}

fn bearing_at(time: JulianDate, location: Location, refraction: Option<RefractionCorrection>) -> Option<Bearing> {
    let sun = SolarPositions::new().at_from_julian(time, location, 0.0, refraction).ok()?;
    Some(Bearing { azimuth_deg: sun.azimuth(), altitude_deg: sun.elevation_angle() })
}

/// Position of the sun from true north, without the refraction of the air, on a day at an hour of universal time, seen from degrees north
/// and east; `None` where the algorithm has no answer.
pub fn true_bearing(date: NaiveDate, universal_hour: f64, [latitude, longitude]: [f64; 2]) -> Option<Bearing> {
    bearing_at(julian_date(date, universal_hour)?, Location { latitude, longitude }, None)
}

impl Bearing {
    /// Unit vector: x east, y north, z up.
    pub fn direction(&self) -> DVec3 {
        let (sin_azimuth, cos_azimuth) = self.azimuth_deg.to_radians().sin_cos();
        let (sin, cos) = self.altitude_deg.to_radians().sin_cos();
        DVec3::new(sin_azimuth * cos, cos_azimuth * cos, sin)
    }
}

impl SiteLocation {
    /// Location of the city's centre; if the bake does not know it, 40 degrees north.
    fn from_manifest(manifest: &Manifest) -> Self {
        match manifest.location {
            Some(GeoLocation { latitude_deg, longitude_deg, north_deg }) => Self {
                location: Location { latitude: latitude_deg, longitude: longitude_deg },
                north_deg,
                is_known: true,
            },
            None => Self { location: DEFAULT_LOCATION, north_deg: 0.0, is_known: false },
        }
    }

    /// Latitude and longitude: degrees north and east.
    pub fn degrees(&self) -> [f64; 2] {
        [self.location.latitude, self.location.longitude]
    }
}

impl Daylight {
    /// The user's options over a city. By default, it is an afternoon in September, when the sun stands behind the first view.
    pub fn new(options: &SunOptions, manifest: &Manifest) -> Self {
        let clear = Air::default();
        let mut daylight = Self {
            site: SiteLocation::from_manifest(manifest),
            date: NaiveDate::from_ymd_opt(2024, 9, 15).unwrap_or_default(),
            hour: 14.5,
            fixed_bearing: options.bearing,
            shadows: options.shadows.unwrap_or(true),
            occlusion: options.occlusion.unwrap_or(true),
            lit_windows: options.lit_windows,
            translucency: options.translucency,
            air: Air {
                turbidity: options.turbidity.unwrap_or(clear.turbidity),
                visibility_m: options.visibility_km.map_or(clear.visibility_m, |km| km * 1000.0),
            },
            is_haze_set: options.visibility_km.is_some(),
            look: options.look,
            edges: [options.lines, options.contact].map(|is_on| is_on.unwrap_or(true)),
            exposure: options.exposure.unwrap_or(0.0),
        };
        if let Some(time) = options.time {
            daylight.set_time(&time);
        }
        daylight
    }

    /// Moves the hour forwards or backwards, and the date with it.
    pub fn advance(&mut self, hours: f64) {
        let hour = self.hour + hours;
        let days = (hour / 24.0).floor();
        let moved = if days < 0.0 {
            self.date.checked_sub_days(Days::new(-days as u64))
        } else {
            self.date.checked_add_days(Days::new(days as u64))
        };
        self.date = moved.filter(|date| YEARS.contains(&date.year())).unwrap_or(self.date);
        self.hour = hour - days * 24.0;
    }

    /// Position of the sun, from true north.
    pub fn bearing(&self) -> Bearing {
        let fallback = Bearing { azimuth_deg: 225.0, altitude_deg: 45.0 };
        self.fixed_bearing.or_else(|| self.computed_bearing()).unwrap_or(fallback)
    }

    fn julian_date(&self) -> Option<JulianDate> {
        julian_date(self.date, self.hour - self.site.location.longitude / 15.0)
    }

    fn computed_bearing(&self) -> Option<Bearing> {
        bearing_at(self.julian_date()?, self.site.location, Some(RefractionCorrection::standard()))
    }

    /// The sun as the map shows it: clockwise from the map's north.
    pub fn map_bearing(&self) -> Bearing {
        let Bearing { azimuth_deg, altitude_deg } = self.bearing();
        // A fixed bearing is measured from there.
        let north_deg = if self.fixed_bearing.is_some() { 0.0 } else { self.site.north_deg };
        Bearing { azimuth_deg: (azimuth_deg + north_deg).rem_euclid(360.0), altitude_deg }
    }

    /// Unit vector towards the sun, in the city's coordinates.
    pub fn direction(&self) -> DVec3 {
        self.map_bearing().direction()
    }

    /// Unit vector towards the moon, in the city's coordinates. `None` with a fixed bearing of the sun, which has no date.
    pub fn moon_direction(&self) -> Option<DVec3> {
        let time = self.julian_date().filter(|_| self.fixed_bearing.is_none())?;
        let moon = moon::direction(time.julian_date(), self.site.degrees());
        Some(DQuat::from_rotation_z(-self.site.north_deg.to_radians()) * moon)
    }

    /// Date and hour in the format of `--time`, to the minute.
    pub fn time_text(&self) -> String {
        let minutes = ((self.hour * 60.0).round() as u32).min(24 * 60 - 1);
        format!("{}T{:02}:{:02}", self.date, minutes / 60, minutes % 60)
    }

    /// Sets date and hour, and releases a fixed bearing.
    pub fn set_time(&mut self, time: &SunTime) {
        let since_midnight = f64::from(time.at.num_seconds_from_midnight()) / 3600.0;
        let ahead = if time.is_universal { self.site.location.longitude / 15.0 } else { 0.0 };
        (self.date, self.hour, self.fixed_bearing) = (time.at.date(), 0.0, None);
        self.advance(since_midnight + ahead);
    }

    /// Render settings for this light.
    pub fn render_settings(&self, shading: Shading, samples: u32) -> RenderSettings {
        let shadow_m = if self.shadows { MAX_SHADOW_M } else { 0.0 };
        let night =
            NightLights { moon: self.moon_direction().map(|moon| moon.as_vec3()), lit_windows: self.lit_windows };
        let mut lit = RenderSettings::lit_by(self.direction(), self.air, &night);
        lit.light.sky_up[3] = if self.occlusion { 0.0 } else { 1.0 };
        let haze = lit.light.haze;
        let mut lit = lit.in_look(self.look);
        if self.is_haze_set {
            lit.light.haze = haze;
        }
        RenderSettings {
            shading,
            samples,
            shadow_m,
            exposure: self.exposure,
            translucency: self.translucency,
            edges: self.edges,
            ..lit
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn daylight(location: Option<GeoLocation>, args: &SunOptions) -> Daylight {
        Daylight::new(args, &Manifest { location, ..insula_test_support::small_city::empty_manifest(0) })
    }

    fn at(text: &str) -> SunOptions {
        SunOptions { time: Some(parse_time(text).unwrap()), ..SunOptions::default() }
    }

    const DELFT: Option<GeoLocation> =
        Some(GeoLocation { latitude_deg: 52.0123, longitude_deg: 4.3609, north_deg: 0.81 });

    #[test]
    fn bearing_agrees_with_almanacs() {
        // Solstice noon: 90 - 52.01 + 23.44 degrees, in the south.
        let noon = daylight(DELFT, &at("2024-06-21T12:00")).bearing();
        assert!((noon.altitude_deg - 61.43).abs() < 0.1 && (noon.azimuth_deg - 180.0).abs() < 2.0, "{noon:?}");
        let late = daylight(None, &at("2024-03-20T17:00")).bearing();
        assert!((late.azimuth_deg - 260.0).abs() < 3.0 && (5.0..15.0).contains(&late.altitude_deg), "{late:?}");
        assert!(daylight(None, &at("2024-12-21T23:59:30")).bearing().altitude_deg < -60.0);
    }

    #[test]
    fn time_with_an_offset_is_the_same_moment_everywhere() {
        let direction = |text: &str| daylight(DELFT, &at(text)).direction();
        let a = direction("2024-06-21T23:30+09:00");
        assert!((a - direction("2024-06-21T14:30Z")).length() < 1e-12);
        // 4.36 degrees east are 17 and a half minutes.
        assert!((a - direction("2024-06-21T14:47:26")).length() < 1e-3);
        let mut day = daylight(None, &at("2024-02-28T23:00"));
        day.advance(1.5);
        assert_eq!((day.date, day.hour), (NaiveDate::from_ymd_opt(2024, 2, 29).unwrap(), 0.5));
        day.advance(-1.0);
        assert_eq!((day.date, day.hour), (NaiveDate::from_ymd_opt(2024, 2, 28).unwrap(), 23.5));
    }

    #[test]
    fn occlusion_can_be_off() {
        let least = |occlusion| {
            let daylight = daylight(None, &SunOptions { occlusion, ..SunOptions::default() });
            daylight.render_settings(Shading::Lit, 1).light.sky_up[3]
        };
        assert_eq!([None, Some(true), Some(false)].map(least), [0.24, 0.24, 1.0]);
    }

    #[test]
    fn the_moon_follows_the_date() {
        let full = daylight(DELFT, &at("2024-09-18T00:30"));
        let moon = full.moon_direction().unwrap();
        assert!(moon.z > 0.3 && moon.dot(full.direction()) < -0.97, "{moon}");
        let new = daylight(DELFT, &at("2024-10-02T12:00"));
        assert!(new.moon_direction().unwrap().dot(new.direction()) > 0.97);
        let fixed = SunOptions { bearing: parse_bearing("90,-20").ok(), ..SunOptions::default() };
        assert_eq!(daylight(None, &fixed).moon_direction(), None);
    }

    #[test]
    fn refuses_invalid_times_and_bearings() {
        for wrong in ["17:00", "2024-06-21", "2024-13-01T00:00", "1200-01-01T00:00", "2024-06-21T25:00", "tomorrow"] {
            assert!(parse_time(wrong).is_err(), "{wrong}");
        }
        let west = parse_bearing("-90, 0").unwrap();
        assert!((west.direction() + DVec3::X).length() < 1e-12);
        for wrong in ["1", "1,91", "x,1", "NaN,1", "1,2,3"] {
            assert!(parse_bearing(wrong).is_err(), "{wrong}");
        }
        let fixed = SunOptions { bearing: Some(west), ..SunOptions::default() };
        assert!((daylight(DELFT, &fixed).direction() + DVec3::X).length() < 1e-12);
    }
}
