//! Positions of the sun over a city, at times of several systems.

use crate::clock::{Moment, TimeSystem};
use chrono::NaiveDate;
use insula_protocol::Manifest;
use insula_protocol::manifest::GeoLocation;
pub use insula_viewer::sun::Bearing;
use insula_viewer::sun::true_bearing;

/// Where a city lies on Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    pub latitude_deg: f64,
    pub longitude_deg: f64,
    /// Angle from the grid's north to true north, clockwise.
    pub north_deg: f64,
}

impl Site {
    /// `None` if the bake did not know where the city lies.
    #[must_use]
    pub fn of(manifest: &Manifest) -> Option<Self> {
        let GeoLocation { latitude_deg, longitude_deg, north_deg } = manifest.location?;
        Some(Self { latitude_deg, longitude_deg, north_deg })
    }

    /// The sun at a moment, as [`Self::sun`].
    #[must_use]
    pub fn sun_at(&self, moment: &Moment) -> Option<Bearing> {
        self.sun(moment.at.date(), moment.hour(), &moment.system)
    }

    /// The sun on a day at an hour of a time system, from the grid's north and without refraction, as rules count it. `None` where the
    /// algorithm has no answer, and at hours that clocks skip.
    #[must_use]
    pub fn sun(&self, date: NaiveDate, hour: f64, system: &TimeSystem) -> Option<Bearing> {
        let universal = match system {
            TimeSystem::Offset(_) | TimeSystem::Zone(_) => system.universal(date, hour)?,
            TimeSystem::MeanSolar => hour - self.longitude_deg / 15.0,
            TimeSystem::TrueSolar => hour - self.longitude_deg / 15.0 - self.equation_of_time(date)?,
        };
        let sun = true_bearing(date, universal, [self.latitude_deg, self.longitude_deg])?;
        Some(Bearing { azimuth_deg: (sun.azimuth_deg + self.north_deg).rem_euclid(360.0), ..sun })
    }

    /// Degrees from true north of a bearing from the grid's.
    #[must_use]
    pub fn from_true_north(&self, sun: Bearing) -> f64 {
        (sun.azimuth_deg - self.north_deg).rem_euclid(360.0)
    }

    /// By how many hours true solar time is ahead of mean solar time at noon: the sun's hour angle when the mean sun culminates. It changes
    /// by up to 15 s within half a day.
    fn equation_of_time(&self, date: NaiveDate) -> Option<f64> {
        // On the equator, azimuth and altitude give the hour angle directly.
        let sun = true_bearing(date, 12.0 - self.longitude_deg / 15.0, [0.0, self.longitude_deg])?;
        let [east, _, up] = sun.direction().to_array();
        Some((-east).atan2(up).to_degrees() / 15.0)
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
            let noon = TOKYO.sun(day(month, date), 12.0, &TimeSystem::TrueSolar).unwrap();
            assert!((noon.azimuth_deg - 180.0).abs() < 0.05, "{noon:?}");
        }
    }

    /// 90 - 35.68 - 23.44 degrees at noon; Japan's clocks are 9 h ahead.
    #[test]
    fn the_winter_sun_stands_low_over_tokyo() {
        let noon = TOKYO.sun(day(12, 21), 12.0, &TimeSystem::MeanSolar).unwrap();
        assert!((noon.altitude_deg - 30.88).abs() < 0.05, "{noon:?}");
        let civil = TOKYO.sun(day(12, 21), 12.0 - (139.76 - 135.0) / 15.0, &TimeSystem::Offset(9.0)).unwrap();
        assert!((civil.azimuth_deg - noon.azimuth_deg).abs() < 1e-6);
        let at = |text: &str| TOKYO.sun_at(&Moment::parse(text, &TimeSystem::MeanSolar).unwrap());
        assert_eq!(at("2025-12-21T11:40+09:00"), TOKYO.sun(day(12, 21), 2.0 + 40.0 / 60.0, &TimeSystem::Offset(0.0)));
        assert_eq!(at("2025-12-21T12:00"), Some(noon));
        let clock = Moment::parse("2025-12-21T11:40", &TimeSystem::parse("Asia/Tokyo").unwrap()).unwrap();
        let azimuths = [TOKYO.sun_at(&clock), at("2025-12-21T11:40+09:00")].map(|sun| sun.unwrap().azimuth_deg);
        assert!((azimuths[0] - azimuths[1]).abs() < 1e-6);
        let turned = Site { north_deg: 5.0, ..TOKYO }.sun(day(12, 21), 12.0, &TimeSystem::MeanSolar).unwrap();
        assert!((turned.azimuth_deg - noon.azimuth_deg - 5.0).abs() < 1e-9);
    }
}
