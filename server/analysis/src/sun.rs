//! Positions of the sun over a city, at times of one of four systems.

use chrono::{DateTime, Datelike, NaiveDate, NaiveDateTime, Timelike};
use insula_protocol::{Manifest, manifest::GeoLocation};
use solar_positioning::{Location, SolarPositions, time::JulianDate};

/// Terrestrial time minus universal time, 2020 to 2030. A second more or less moves the sun by .004 degrees.
const DELTA_T_SECS: f64 = 69.0;

/// Where a city lies on Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    /// Angle from the grid's north to true north, clockwise.
    pub north_deg: f64,
}

/// How the hours of a rule count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TimeSystem {
    /// The sun stands in the meridian at 12 h on each day, as on a sundial.
    TrueSolar,
    /// 12 h is when the mean sun stands in the city's meridian.
    MeanSolar,
    /// Civil time: so many hours ahead of universal time, summer time included.
    Offset(f64),
}

/// The sun at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunPosition {
    /// From the grid's north over east, 0 to 360.
    pub azimuth_deg: f64,
    /// Above the horizon, without refraction, as rules count it.
    pub altitude_deg: f64,
}

/// A moment as a person writes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    date: NaiveDate,
    hour: f64,
    system: TimeSystem,
}

impl Moment {
    /// Reads `2025-12-21T10:00+01:00`, or without an offset the city's mean solar time. Fails with what may be written.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (at, system) = DateTime::parse_from_str(&text.replace(['Z', 'z'], "+00:00"), "%Y-%m-%dT%H:%M%:z")
            .map(|at| (at.naive_utc(), TimeSystem::Offset(0.0)))
            .or_else(|_| NaiveDateTime::parse_from_str(text, "%Y-%m-%dT%H:%M").map(|at| (at, TimeSystem::MeanSolar)))
            .map_err(|_| "write 2025-12-21T10:00+01:00, or 2025-12-21T10:00 in mean solar time".to_owned())?;
        if !(1800..=2200).contains(&at.year()) {
            return Err("years 1800 to 2200".to_owned());
        }
        let hour = f64::from(at.num_seconds_from_midnight()) / 3600.0;
        Ok(Self { date: at.date(), hour, system })
    }
}

impl SunPosition {
    /// Unit vector to the sun: east, north and up of the grid.
    #[must_use]
    pub fn direction(&self) -> [f64; 3] {
        let ([sin, cos], (up, along)) = (
            [self.azimuth_deg.to_radians().sin(), self.azimuth_deg.to_radians().cos()],
            self.altitude_deg.to_radians().sin_cos(),
        );
        [sin * along, cos * along, up]
    }
}

impl Site {
    /// The sun at a moment; `None` where the algorithm has no answer.
    #[must_use]
    pub fn sun_at(&self, moment: &Moment) -> Option<SunPosition> {
        self.sun(moment.date, moment.hour, moment.system)
    }

    /// `None` if the bake did not know where the city lies.
    #[must_use]
    pub fn of(manifest: &Manifest) -> Option<Self> {
        let GeoLocation { latitude_deg, longitude_deg, north_deg } = manifest.location?;
        Some(Self { latitude_deg, longitude_deg, north_deg })
    }

    /// The sun on a day at an hour of a time system; `None` where the algorithm has no answer (years before -2000 or after 6000).
    #[must_use]
    pub fn sun(&self, date: NaiveDate, hour: f64, system: TimeSystem) -> Option<SunPosition> {
        let universal = match system {
            TimeSystem::Offset(hours) => hour - hours,
            TimeSystem::MeanSolar => hour - self.longitude_deg / 15.0,
            TimeSystem::TrueSolar => hour - self.longitude_deg / 15.0 - self.equation_of_time(date)?,
        };
        let sun = self.at(date, universal)?;
        let azimuth_deg = (sun.azimuth() + self.north_deg).rem_euclid(360.0);
        Some(SunPosition { azimuth_deg, altitude_deg: sun.elevation_angle() })
    }

    fn at(&self, date: NaiveDate, universal_hour: f64) -> Option<solar_positioning::SolarPosition> {
        let midnight = JulianDate::from_utc(date.year(), date.month(), date.day(), 0, 0, 0.0, DELTA_T_SECS).ok()?;
        let time = JulianDate::new(midnight.julian_date() + universal_hour / 24.0, DELTA_T_SECS).ok()?;
        let location = Location { latitude: self.latitude_deg, longitude: self.longitude_deg };
        SolarPositions::new().at_from_julian(time, location, 0.0, None).ok()
    }

    /// By how many hours true solar time is ahead of mean solar time at noon: the sun's hour angle when the mean sun culminates. It changes
    /// by up to 15 s within half a day.
    fn equation_of_time(&self, date: NaiveDate) -> Option<f64> {
        // On the equator the sun's place in the sky is its hour angle, wherever it stands: azimuth and altitude give it.
        let equator = Self { latitude_deg: 0.0, ..*self };
        let sun = equator.at(date, 12.0 - self.longitude_deg / 15.0)?;
        let (azimuth, altitude) = (sun.azimuth().to_radians(), sun.elevation_angle().to_radians());
        // Westward positive.
        let hour_angle = (-azimuth.sin() * altitude.cos()).atan2(altitude.sin());
        Some(hour_angle.to_degrees() / 15.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKYO: Site = Site { latitude_deg: 35.68, longitude_deg: 139.76, north_deg: 0.0 };

    fn day(month: u32, day: u32) -> NaiveDate {
        NaiveDate::from_ymd_opt(2025, month, day).unwrap()
    }

    /// The equation of time as almanacs have it: -14.2 min on 11 February, +16.4 on 3 November, +1.8 on 21 December, 0 on 15 April.
    #[test]
    fn true_solar_time_follows_the_almanac() {
        for (month, date, minutes) in [(2, 11, -14.2), (11, 3, 16.4), (12, 21, 1.8), (4, 15, 0.0)] {
            let found = TOKYO.equation_of_time(day(month, date)).unwrap() * 60.0;
            assert!((found - minutes).abs() < 0.3, "{month}-{date}: {found}");
            let noon = TOKYO.sun(day(month, date), 12.0, TimeSystem::TrueSolar).unwrap();
            assert!((noon.azimuth_deg - 180.0).abs() < 0.05, "{noon:?}");
        }
    }

    /// 90 - 35.68 - 23.44 degrees at noon; Japan's clocks are 9 h ahead.
    #[test]
    fn the_winter_sun_stands_low_over_tokyo() {
        let noon = TOKYO.sun(day(12, 21), 12.0, TimeSystem::MeanSolar).unwrap();
        assert!((noon.altitude_deg - 30.88).abs() < 0.05, "{noon:?}");
        let civil = TOKYO.sun(day(12, 21), 12.0 - (139.76 - 135.0) / 15.0, TimeSystem::Offset(9.0)).unwrap();
        assert!((civil.azimuth_deg - noon.azimuth_deg).abs() < 1e-6);
        let moment = Moment::parse("2025-12-21T11:40+09:00").unwrap();
        assert_eq!(TOKYO.sun_at(&moment), TOKYO.sun(day(12, 21), 2.0 + 40.0 / 60.0, TimeSystem::Offset(0.0)));
        assert!(Moment::parse("2025-12-21T12:00").is_ok());
        for wrong in ["", "12:00", "2025-12-21", "1700-01-01T00:00", "2025-13-01T00:00"] {
            assert!(Moment::parse(wrong).is_err(), "{wrong}");
        }
        let turned = Site { north_deg: 5.0, ..TOKYO }.sun(day(12, 21), 12.0, TimeSystem::MeanSolar).unwrap();
        assert!((turned.azimuth_deg - noon.azimuth_deg - 5.0).abs() < 1e-9);
    }
}
