//! Times as rules and people write them: by the sun, by an offset, or by the clocks of a time zone with their summer time.

use chrono::{Datelike, NaiveDate, NaiveDateTime, TimeDelta, Timelike};
use jiff::SignedDuration;
use jiff::civil::Date;
use jiff::tz::{AmbiguousOffset, TimeZone, TimeZoneDatabase};
use std::fmt;

/// What a text for a [`TimeSystem`] may be.
const SYSTEMS: &str = "true-solar, mean-solar, an offset such as +09:00, or a time zone such as Europe/Amsterdam";

/// How hours count.
#[derive(Debug, Clone, PartialEq)]
pub enum TimeSystem {
    /// The sun stands in the meridian at 12 h on each day, as on a sundial.
    TrueSolar,
    /// 12 h is when the mean sun stands in the city's meridian.
    MeanSolar,
    /// So many hours ahead of universal time.
    Offset(f64),
    /// What the clocks of a place show, in summer time when they do.
    Zone(TimeZone),
}

impl TimeSystem {
    /// Fails with what a text may be.
    pub fn parse(text: &str) -> Result<Self, String> {
        match text {
            "true-solar" => return Ok(Self::TrueSolar),
            "mean-solar" => return Ok(Self::MeanSolar),
            _ => {}
        }
        // The zones of the program, not those of the machine: a rule gives the same hours everywhere.
        let zone = || TimeZoneDatabase::bundled().get(text).ok().map(Self::Zone);
        parse_offset(text).or_else(zone).ok_or_else(|| format!("\"{text}\" is none of {SYSTEMS}"))
    }

    /// Hours of universal time, counted from midnight of the date, of an hour of a day by clocks; `None` where clocks skip it, and of solar
    /// time. Of an hour that clocks show twice, it is the first.
    pub(crate) fn universal(&self, date: NaiveDate, hour: f64) -> Option<f64> {
        match self {
            Self::Offset(hours) => Some(hour - hours),
            Self::Zone(zone) => Some(hour - offset_of(zone, date, hour)?),
            Self::TrueSolar | Self::MeanSolar => None,
        }
    }
}

impl fmt::Display for TimeSystem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TrueSolar => f.write_str("true solar time"),
            Self::MeanSolar => f.write_str("mean solar time"),
            Self::Offset(hours) => {
                let minutes = (hours.abs() * 60.0).round() as u32;
                write!(f, "UTC{}{:02}:{:02}", if *hours < 0.0 { '-' } else { '+' }, minutes / 60, minutes % 60)
            }
            Self::Zone(zone) => write!(f, "time of {}", zone.iana_name().unwrap_or("a zone")),
        }
    }
}

fn parse_offset(text: &str) -> Option<TimeSystem> {
    let (sign, rest) =
        text.strip_prefix('+').map(|rest| (1.0, rest)).or(text.strip_prefix('-').map(|rest| (-1.0, rest)))?;
    let (hours, minutes) = rest.split_once(':')?;
    let [hours, minutes]: [u8; 2] = [hours.parse().ok()?, minutes.parse().ok()?];
    let offset = f64::from(hours) + f64::from(minutes) / 60.0;
    (hours <= 14 && minutes < 60).then_some(TimeSystem::Offset(sign * offset))
}

/// By how many hours the clocks of a zone are ahead of universal time.
fn offset_of(zone: &TimeZone, date: NaiveDate, hour: f64) -> Option<f64> {
    let [month, day] = [date.month(), date.day()].map(|part| part as i8);
    let midnight = Date::new(date.year().try_into().ok()?, month, day).ok()?.at(0, 0, 0, 0);
    let shown = midnight.checked_add(SignedDuration::from_secs((hour * 3600.0).round() as i64)).ok()?;
    let offset = match zone.to_ambiguous_timestamp(shown).offset() {
        AmbiguousOffset::Unambiguous { offset } => offset,
        AmbiguousOffset::Fold { before, .. } => before,
        AmbiguousOffset::Gap { .. } => return None,
    };
    Some(f64::from(offset.seconds()) / 3600.0)
}

/// Hours and minutes of an hour of a day.
pub(crate) fn clock_text(hour: f64) -> String {
    let minutes = (hour * 60.0).round().rem_euclid(1440.0) as u32;
    format!("{:02}:{:02}", minutes / 60, minutes % 60)
}

/// A date and hour of a time system.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    pub at: NaiveDateTime,
    pub system: TimeSystem,
}

impl Moment {
    /// Reads `2025-12-21T10:00`, of a time system, or of an offset that follows. Fails with what a text may be.
    pub fn parse(text: &str, system: &TimeSystem) -> Result<Self, String> {
        const WITHOUT_OFFSET: usize = "2025-12-21T10:00".len();
        let wrong = || format!("\"{text}\": write 2025-12-21T10:00, or 2025-12-21T10:00+01:00; years 1800 to 2200");
        let (at, offset) = text.split_at_checked(WITHOUT_OFFSET).ok_or_else(wrong)?;
        let at = NaiveDateTime::parse_from_str(at, "%Y-%m-%dT%H:%M").map_err(|_| wrong())?;
        let system = match offset {
            "" => system.clone(),
            "Z" | "z" => TimeSystem::Offset(0.0),
            offset => parse_offset(offset).ok_or_else(wrong)?,
        };
        if !(1800..=2200).contains(&at.year()) {
            return Err(wrong());
        }
        let moment = Self { at, system };
        if moment.is_shown() {
            Ok(moment)
        } else {
            Err(format!("\"{text}\": clocks skip this time as summer time begins"))
        }
    }

    /// The times of `FROM/TO/STEP`, with a step such as `30min` or `1h`. Those that clocks skip are none. Fails with what a text may be, and
    /// if there are more than `most`.
    pub fn range(text: &str, system: &TimeSystem, most: usize) -> Result<Vec<Self>, String> {
        let parts: Vec<&str> = text.split('/').collect();
        let [from, to, step] = parts[..] else {
            return Err(
                "write the first time, the last one and the step, as in 2025-06-21T09:00/2025-06-21T15:00/1h".into()
            );
        };
        let (from, to) = (Self::parse(from, system)?, Self::parse(to, system)?);
        if from.system != to.system || from.at > to.at {
            return Err("the last time must be after the first one, with the same offset".to_owned());
        }
        let minutes = |number: &str, factor: i64| number.parse().ok().map(|number: u16| i64::from(number) * factor);
        let step = step
            .strip_suffix("min")
            .and_then(|n| minutes(n, 1))
            .or(step.strip_suffix('h').and_then(|n| minutes(n, 60)));
        let step = step.filter(|step| *step > 0).ok_or("write the step as in 30min or 1h")?;
        let count = (to.at - from.at).num_minutes() / step + 1;
        if count > most as i64 {
            return Err(format!("{count} times, of which {most} fit in one run"));
        }
        let moment = |i: i64| Self { at: from.at + TimeDelta::minutes(i * step), system: from.system.clone() };
        Ok((0..count).map(moment).filter(Self::is_shown).collect())
    }

    /// Whether clocks show this time: they skip an hour as summer time begins.
    #[must_use]
    pub fn is_shown(&self) -> bool {
        !matches!(self.system, TimeSystem::Zone(_)) || self.system.universal(self.at.date(), self.hour()).is_some()
    }

    /// Hours from midnight.
    #[must_use]
    pub fn hour(&self) -> f64 {
        f64::from(self.at.num_seconds_from_midnight()) / 3600.0
    }
}

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}", self.at.format("%Y-%m-%d %H:%M"), self.system)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn day(month: u32, day: u32) -> NaiveDate {
        NaiveDate::from_ymd_opt(2025, month, day).unwrap()
    }

    /// Europe's clocks go forward at 2 h on 30 March 2025 and back at 3 h on 26 October; Sydney's summer is in December.
    #[test]
    fn clocks_know_summer_time() {
        let zone = |name: &str| TimeSystem::parse(name).unwrap();
        for (name, date, hour, wanted) in [
            ("Europe/Amsterdam", day(6, 21), 12.0, Some(10.0)),
            ("Europe/Amsterdam", day(12, 21), 12.0, Some(11.0)),
            ("Europe/Amsterdam", day(3, 30), 1.5, Some(0.5)),
            ("Europe/Amsterdam", day(3, 30), 2.5, None),
            ("Europe/Amsterdam", day(3, 30), 3.5, Some(1.5)),
            ("Europe/Amsterdam", day(10, 26), 2.5, Some(0.5)),
            ("Australia/Sydney", day(6, 21), 9.0, Some(-1.0)),
            ("Australia/Sydney", day(12, 21), 9.0, Some(-2.0)),
            ("Asia/Kolkata", day(6, 21), 9.0, Some(3.5)),
            ("-03:30", day(6, 21), 9.0, Some(12.5)),
        ] {
            assert_eq!(zone(name).universal(date, hour), wanted, "{name} {date} {hour}");
        }
        let later = NaiveDate::from_ymd_opt(2150, 7, 1).unwrap();
        assert_eq!(zone("Europe/Amsterdam").universal(later, 12.0), Some(10.0), "rules go on");
        for wrong in ["Europe/Delft", "", "9", "+25:00", "../zone"] {
            assert!(TimeSystem::parse(wrong).unwrap_err().contains("Europe/Amsterdam"), "{wrong}");
        }
        assert_eq!(zone("Europe/Amsterdam").to_string(), "time of Europe/Amsterdam");
        assert_eq!([zone("-03:30"), zone("true-solar")].map(|s| s.to_string()), ["UTC-03:30", "true solar time"]);
    }

    #[test]
    fn moments_are_of_the_given_system_or_of_their_offset() {
        let zone = TimeSystem::parse("Europe/Amsterdam").unwrap();
        let parse = |text: &str| Moment::parse(text, &zone);
        let moment = parse("2025-06-21T10:30").unwrap();
        assert_eq!((moment.hour(), &moment.system), (10.5, &zone));
        assert_eq!(parse("2025-06-21T10:30+09:00").unwrap().system, TimeSystem::Offset(9.0));
        assert_eq!(parse("2025-06-21T10:30Z").unwrap().to_string(), "2025-06-21 10:30, UTC+00:00");
        for (wrong, word) in [
            ("noon", "2025-12-21T10:00+01:00"),
            ("2025-06-21T25:00", "2025-12-21"),
            ("2025-06-21T10:30Europe", "2025-12-21"),
            ("1025-06-21T10:30", "1800"),
            ("2025-03-30T02:30", "summer time"),
            ("２０２５-06-21T10:30", "2025-12-21"),
        ] {
            let error = parse(wrong).unwrap_err();
            assert!(error.contains(word), "{wrong}: {error}");
        }
    }

    #[test]
    fn ranges_have_both_ends_and_leave_out_what_clocks_skip() {
        let zone = TimeSystem::parse("Europe/Amsterdam").unwrap();
        let hours =
            |text: &str| Moment::range(text, &zone, 1000).map(|all| all.iter().map(Moment::hour).collect::<Vec<_>>());
        assert_eq!(hours("2025-06-21T09:00/2025-06-21T10:00/30min"), Ok(vec![9.0, 9.5, 10.0]));
        assert_eq!(hours("2025-03-30T00:30/2025-03-30T04:00/1h"), Ok(vec![0.5, 1.5, 3.5]));
        for (wrong, word) in [
            ("2025-06-21T09:00", "the step"),
            ("2025-06-21T09:00/2025-06-21T08:00/1h", "after"),
            ("2025-06-21T09:00Z/2025-06-21T10:00/1h", "offset"),
            ("2025-06-21T09:00/2025-06-21T10:00/0min", "30min"),
            ("2025-06-21T09:00/2025-06-21T10:00/1", "30min"),
            ("2025-06-21T09:00/2026-06-21T10:00/1min", "times"),
        ] {
            let error = hours(wrong).unwrap_err();
            assert!(error.contains(word), "{wrong}: {error}");
        }
    }
}
