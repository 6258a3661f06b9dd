//! Rules of sun hours: when the sun counts, where it is measured, and how much of it is asked for.
//!
//! A rule is a TOML file. Those built in are `rules/*.toml`, each with its source.

use crate::clock::TimeSystem;
use crate::sun::{Bearing, Site};
use chrono::{Datelike, Days, Months, NaiveDate};
use serde::Deserialize;

/// Most days of a rule: each is swept for itself.
const MAX_DAYS: usize = 366;

/// Names and texts of the rules that are built in.
const BUILT_IN: [(&str, &str); 11] = [
    ("au-21-june", include_str!("../rules/au-21-june.toml")),
    ("cn-great-cold", include_str!("../rules/cn-great-cold.toml")),
    ("cn-winter-solstice", include_str!("../rules/cn-winter-solstice.toml")),
    ("en-17037", include_str!("../rules/en-17037.toml")),
    ("jp-winter-solstice", include_str!("../rules/jp-winter-solstice.toml")),
    ("nl-the-hague", include_str!("../rules/nl-the-hague.toml")),
    ("nl-tno-light", include_str!("../rules/nl-tno-light.toml")),
    ("nl-tno-strict", include_str!("../rules/nl-tno-strict.toml")),
    ("uk-br209-apsh", include_str!("../rules/uk-br209-apsh.toml")),
    ("uk-br209-apsh-winter", include_str!("../rules/uk-br209-apsh-winter.toml")),
    ("uk-br209-gardens", include_str!("../rules/uk-br209-gardens.toml")),
];

/// Why a rule cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct RuleError(String);

/// How the sun's times of one day make one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CountMode {
    /// All times together.
    #[default]
    Cumulative,
    /// The longest time without shade.
    LongestRun,
}

/// Which of a rule's days counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DayMode {
    /// The day with the least sun: the rule asks for its hours on each day.
    #[default]
    Least,
    /// The day with the most sun: one day is enough.
    Most,
    /// All days together.
    Sum,
}

/// What a rule counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Measure {
    Hours,
    /// The share of the year's probable sunlight in percent: of all hours in which the sun would shine on open ground, each weighted by how
    /// probable it is that no cloud is before it. These are the mean hours of sunshine of each month; `None` counts all hours alike.
    ProbableSunlight(Option<[f64; 12]>),
}

impl Measure {
    /// A word for the names of columns.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Hours => "hours",
            Self::ProbableSunlight(_) => "percent",
        }
    }
}

/// A rule of sun hours.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    pub title: String,
    /// Where the rule is written.
    pub source: String,
    pub days: Vec<NaiveDate>,
    /// Days of the rule that are not among `days`, because it asks for every one of a range.
    pub left_out: usize,
    pub day_mode: DayMode,
    /// First and last hour.
    pub hours: [f64; 2],
    pub time: TimeSystem,
    /// The sun counts from this altitude on.
    pub lowest_sun_deg: f64,
    pub step_minutes: f64,
    pub mode: CountMode,
    /// Heights above the ground in metres at which walls are measured.
    pub wall_heights_m: Vec<f64>,
    /// Height above the ground in metres at which the ground is measured.
    pub ground_height_m: f64,
    pub measure: Measure,
    /// What the rule asks for, in hours or percent; `None` if it asks for a diagram only.
    pub asked: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RuleFile {
    title: String,
    source: String,
    year: Option<i32>,
    /// Days as MM-DD.
    #[serde(default)]
    days: Vec<String>,
    /// First and last day as MM-DD; `every_days` apart, and the last one.
    range: Option<[String; 2]>,
    every_days: Option<u64>,
    #[serde(default)]
    day_mode: DayMode,
    hours: Option<[f64; 2]>,
    /// `true-solar`, `mean-solar`, an offset such as `+09:00`, or a time zone.
    time: Option<String>,
    #[serde(default)]
    lowest_sun_deg: f64,
    step_minutes: Option<f64>,
    #[serde(default)]
    mode: CountMode,
    wall_heights_m: Option<Vec<f64>>,
    #[serde(default)]
    ground_height_m: f64,
    asked_hours: Option<f64>,
    /// `hours`, or `probable-sunlight`.
    #[serde(default)]
    measure: MeasureName,
    /// Mean sunshine of each month.
    sunshine_hours: Option<[f64; 12]>,
    asked_percent: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum MeasureName {
    #[default]
    Hours,
    ProbableSunlight,
}

impl Rule {
    /// Names of the rules that are built in.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(name, _)| *name)
    }

    /// The rule of a name; `None` if there is none.
    #[must_use]
    pub fn built_in(name: &str) -> Option<Self> {
        let (_, text) = BUILT_IN.iter().find(|(known, _)| *known == name)?;
        // A test parses all of them.
        Self::parse(text).ok()
    }

    /// Reads a rule's file. Fails with the key that is wrong and what it may be.
    pub fn parse(text: &str) -> Result<Self, RuleError> {
        let mut file: RuleFile = toml::from_str(text).map_err(|error| RuleError(error.message().to_owned()))?;
        let (days, left_out) = days(&file)?;
        let hours @ [from, to] = file.hours.unwrap_or([0.0, 24.0]);
        if !(0.0 <= from && from < to && to <= 24.0) {
            return wrong("hours: write the first and the last one, as in [8, 16]");
        }
        let step_minutes = file.step_minutes.unwrap_or(5.0);
        if !(1.0..=60.0).contains(&step_minutes) {
            return wrong("step_minutes: 1 to 60");
        }
        if !(0.0..90.0).contains(&file.lowest_sun_deg) {
            return wrong("lowest_sun_deg: 0 to 90");
        }
        let is_height = |height: &f64| (0.0..=1000.0).contains(height);
        let wall_heights_m = file.wall_heights_m.take().unwrap_or_else(|| vec![1.6]);
        if wall_heights_m.len() > 16 || !wall_heights_m.iter().all(is_height) {
            return wrong("wall_heights_m: at most 16 heights of 0 to 1000 m");
        }
        if !is_height(&file.ground_height_m) {
            return wrong("ground_height_m: 0 to 1000 m");
        }
        let (measure, asked) = measure(&file)?;
        let is_share = matches!(measure, Measure::ProbableSunlight(_));
        let time = TimeSystem::parse(file.time.as_deref().unwrap_or("true-solar"));
        Ok(Self {
            title: file.title,
            source: file.source,
            days,
            left_out,
            day_mode: if is_share { DayMode::Sum } else { file.day_mode },
            hours,
            time: time.map_err(|reason| RuleError(format!("time: {reason}")))?,
            lowest_sun_deg: file.lowest_sun_deg,
            step_minutes,
            mode: file.mode,
            wall_heights_m,
            ground_height_m: file.ground_height_m,
            measure,
            asked,
        })
    }

    /// The sun in the middle of each step of a day in which it counts, with the hour of the rule's time.
    pub(crate) fn suns(&self, site: &Site, day: NaiveDate) -> Vec<(f64, Bearing)> {
        let [from, to] = self.hours;
        let step = self.step_minutes / 60.0;
        let steps = ((to - from) / step).round().max(1.0) as usize;
        let hours = (0..steps).map(|i| from + (i as f64 + 0.5) * step);
        let suns = hours.filter_map(|hour| Some((hour, site.sun(day, hour, &self.time)?)));
        // A sun on the horizon itself lights nothing.
        suns.filter(|(_, sun)| sun.altitude_deg >= self.lowest_sun_deg.max(0.1)).collect()
    }
}

fn wrong<T>(reason: &str) -> Result<T, RuleError> {
    Err(RuleError(reason.to_owned()))
}

/// What a rule counts, and how much of it is asked for.
fn measure(file: &RuleFile) -> Result<(Measure, Option<f64>), RuleError> {
    let (measure, asked, other) = match file.measure {
        MeasureName::Hours => (Measure::Hours, file.asked_hours, file.asked_percent),
        MeasureName::ProbableSunlight => {
            (Measure::ProbableSunlight(file.sunshine_hours), file.asked_percent, file.asked_hours)
        }
    };
    let is_number = |value: f64| (0.0..=1000.0).contains(&value);
    if other.is_some() || measure == Measure::Hours && file.sunshine_hours.is_some() {
        return wrong("measure: \"hours\" has asked_hours, \"probable-sunlight\" has asked_percent and sunshine_hours");
    }
    if file.sunshine_hours.is_some_and(|months| !months.iter().all(|hours| is_number(*hours)) || months == [0.0; 12]) {
        return wrong("sunshine_hours: the mean sunshine of each of twelve months, in hours");
    }
    if file.measure == MeasureName::ProbableSunlight && file.mode != CountMode::Cumulative {
        return wrong("mode: probable sunlight is cumulative");
    }
    if asked.is_some_and(|asked| !(asked > 0.0 && is_number(asked))) {
        return wrong("asked_hours or asked_percent: more than 0");
    }
    Ok((measure, asked))
}

/// The days of a rule, and how many of its range are left out.
fn days(file: &RuleFile) -> Result<(Vec<NaiveDate>, usize), RuleError> {
    let year = file.year.unwrap_or(2025);
    let date = |text: &String| {
        let parts = text.split_once('-').and_then(|(month, day)| Some((month.parse().ok()?, day.parse().ok()?)));
        let date = parts.and_then(|(month, day)| NaiveDate::from_ymd_opt(year, month, day));
        date.filter(|date| (1800..=2200).contains(&date.year()))
            .ok_or_else(|| RuleError(format!("\"{text}\" is no day of {year}: write 06-21; years 1800 to 2200")))
    };
    let mut days = file.days.iter().map(date).collect::<Result<Vec<_>, _>>()?;
    let mut left_out = 0;
    if let Some([first, last]) = &file.range {
        let (first, mut last) = (date(first)?, date(last)?);
        if first > last {
            // Over the turn of the year; only a 29 February has no such day in the next one.
            last = last.checked_add_months(Months::new(12)).unwrap_or(last);
        }
        let every_days = file.every_days.unwrap_or(7);
        if every_days == 0 {
            return wrong("range: write every_days from 1 on");
        }
        let swept = std::iter::successors(Some(first), |day| day.checked_add_days(Days::new(every_days)));
        let before = days.len();
        days.extend(swept.take_while(|day| *day < last));
        days.push(last);
        left_out = (last - first).num_days() as usize + 1 - (days.len() - before);
    }
    if days.is_empty() || days.len() > MAX_DAYS {
        return wrong("days or range: 1 to 366 days");
    }
    Ok((days, left_out))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_that_are_built_in_are_valid() {
        for name in Rule::names() {
            let rule = Rule::built_in(name).unwrap_or_else(|| {
                panic!("{name}: {:?}", Rule::parse(BUILT_IN.iter().find(|(known, _)| *known == name).unwrap().1))
            });
            assert!(!rule.source.is_empty() && !rule.title.is_empty(), "{name}");
        }
        assert_eq!(Rule::built_in("nl"), None);
        let light = Rule::built_in("nl-tno-light").unwrap();
        assert_eq!((light.asked, light.day_mode), (Some(2.0), DayMode::Least));
        let ends = [(2, 19), (10, 21)].map(|(month, day)| NaiveDate::from_ymd_opt(2025, month, day).unwrap());
        assert_eq!([light.days[0], *light.days.last().unwrap()], ends);
        assert_eq!(light.left_out + light.days.len(), 245);
    }

    #[test]
    fn wrong_rules_say_what_is_wrong() {
        let parse = |lines: &str| Rule::parse(&format!("title = \"t\"\nsource = \"s\"\n{lines}"));
        let rule = parse("days = [\"02-28\"]\ntime = \"-03:30\"\nhours = [8, 16.5]").unwrap();
        let winter = parse("range = [\"12-30\", \"01-02\"]\nevery_days = 1").unwrap();
        let wanted = [(2025, 12, 30), (2025, 12, 31), (2026, 1, 1), (2026, 1, 2)];
        assert_eq!(winter.days, wanted.map(|(year, month, day)| NaiveDate::from_ymd_opt(year, month, day).unwrap()));
        assert_eq!((rule.time, rule.hours, rule.mode), (TimeSystem::Offset(-3.5), [8.0, 16.5], CountMode::Cumulative));
        for (lines, word) in [
            ("", "days"),
            ("days = [\"02-29\"]", "02-29"),
            ("days = [\"x\"]", "06-21"),
            ("range = [\"01-01\", \"02-01\"]\nevery_days = 0", "every_days"),
            ("days = [\"06-21\"]\nhours = [16, 8]", "hours"),
            ("days = [\"06-21\"]\nhours = [nan, 8]", "hours"),
            ("days = [\"06-21\"]\nstep_minutes = 0", "step_minutes"),
            ("days = [\"06-21\"]\nlowest_sun_deg = -1", "lowest_sun_deg"),
            ("days = [\"06-21\"]\ntime = \"9\"", "true-solar"),
            ("days = [\"06-21\"]\ntime = \"+25:00\"", "true-solar"),
            ("days = [\"06-21\"]\nwall_heights_m = [-1]", "wall_heights_m"),
            ("days = [\"06-21\"]\nground_height_m = nan", "ground_height_m"),
            ("days = [\"06-21\"]\nasked_hours = 0", "asked_hours"),
            ("days = [\"06-21\"]\nasked_percent = 5", "measure"),
            ("days = [\"06-21\"]\nmeasure = \"probable-sunlight\"\nasked_hours = 5", "measure"),
            ("days = [\"06-21\"]\nmeasure = \"probable-sunlight\"\nmode = \"longest-run\"", "cumulative"),
            ("days = [\"06-21\"]\nmeasure = \"probable-sunlight\"\nsunshine_hours = [1, 2]", "length"),
            ("days = [\"06-21\"]\nmode = \"most\"", "longest-run"),
            ("day = [\"06-21\"]", "day"),
            ("days = [\"06-21\"]\nyear = 99999", "99999"),
        ] {
            let error = parse(lines).unwrap_err().to_string();
            assert!(error.contains(word), "{lines}: {error}");
        }
    }
}
