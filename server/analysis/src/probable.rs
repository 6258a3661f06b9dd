//! What the hours of a rule's days count: themselves, or shares of the year's probable sunlight.
//!
//! Probable sunlight hours are those in which the sun is expected to shine on open ground. BR 209 has them as points of a diagram, made of
//! how often clouds are before the sun at each hour of London's year. Here all hours of a month are equally probable: the month's mean
//! sunshine, divided by the hours in which the sun is up.

use crate::rule::{Measure, Rule};
use crate::sun::Site;
use chrono::{Datelike, NaiveDate};

/// The days of a year whose sun is looked up: every so many.
const EVERY_DAYS: usize = 3;

/// What an hour of sun counts on each day of a rule: 1, or percent of the year's probable sunlight.
#[must_use]
pub(crate) fn day_weights(site: &Site, rule: &Rule) -> Vec<f64> {
    let Measure::ProbableSunlight(sunshine) = rule.measure else { return vec![1.0; rule.days.len()] };
    let possible = possible_hours(site, rule);
    let hours: f64 = sunshine.unwrap_or(possible).iter().sum();
    let probable = |month: usize| match sunshine {
        Some(sunshine) if possible[month] > 0.0 => sunshine[month] / possible[month],
        Some(_) => 0.0,
        None => 1.0,
    };
    let stands_for = days_that_each_stands_for(&rule.days);
    let weight = |(day, days): (&NaiveDate, f64)| 100.0 * days * probable(day.month0() as usize) / hours.max(1e-9);
    rule.days.iter().zip(stands_for).map(weight).collect()
}

/// The hours of each month in which the sun counts on open ground.
fn possible_hours(site: &Site, rule: &Rule) -> [f64; 12] {
    let mut hours = [0.0; 12];
    let Some(first) = rule.days.first().and_then(|day| NaiveDate::from_ymd_opt(day.year(), 1, 1)) else { return hours };
    for day in first.iter_days().take(365).step_by(EVERY_DAYS) {
        let steps = rule.suns(site, day).len();
        hours[day.month0() as usize] += steps as f64 * rule.step_minutes / 60.0 * EVERY_DAYS as f64;
    }
    hours
}

/// How many days each of the days of a range stands for: half of those to the next ones, and itself at the ends.
fn days_that_each_stands_for(days: &[NaiveDate]) -> Vec<f64> {
    let half = |a: usize, b: usize| 0.5 * (days[b] - days[a]).num_days() as f64;
    let of_day = |i: usize| {
        let before = if i == 0 { 0.5 } else { half(i - 1, i) };
        let after = if i + 1 == days.len() { 0.5 } else { half(i, i + 1) };
        before + after
    };
    (0..days.len()).map(of_day).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONDON: Site = Site { latitude_deg: 51.5, longitude_deg: 0.0, north_deg: 0.0 };

    fn total(rule: &Rule) -> f64 {
        let hours = rule.days.iter().map(|day| rule.suns(&LONDON, *day).len() as f64 * rule.step_minutes / 60.0);
        hours.zip(day_weights(&LONDON, rule)).map(|(hours, weight)| hours * weight).sum()
    }

    /// Open ground has all of the year's probable sunlight, and about 29% of it in London's winter: of the sunshine of Greenwich, that of
    /// October to February, two thirds of March and one third of September are 427 of 1,480 hours.
    #[test]
    fn open_ground_has_all_of_the_year() {
        let rule = |name: &str| Rule::built_in(name).unwrap();
        let year = total(&rule("uk-br209-apsh"));
        // Its range has 358 of 365 days.
        assert!((97.0..101.5).contains(&year), "{year}");
        let winter = total(&rule("uk-br209-apsh-winter"));
        assert!((winter - 29.5).abs() < 1.5, "{winter}");
        let plain = Rule::parse(
            "title = \"t\"\nsource = \"s\"\nmeasure = \"probable-sunlight\"\nrange = [\"01-01\", \"12-31\"]",
        );
        assert!((total(&plain.unwrap()) - 100.0).abs() < 0.5);
    }

    #[test]
    fn each_day_stands_for_those_around_it() {
        let day = |day: u32| NaiveDate::from_ymd_opt(2025, 3, day).unwrap();
        assert_eq!(days_that_each_stands_for(&[day(1), day(8), day(15), day(17)]), [4.0, 7.0, 4.5, 1.5]);
        assert_eq!(days_that_each_stands_for(&[day(1)]), [1.0]);
    }
}
