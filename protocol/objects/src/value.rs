//! Values of attributes and their types, and calendar dates as day numbers.

use insula_protocol::text::without_sign_of_zero;
use serde::{Deserialize, Serialize, Serializer};
use std::fmt;

/// Maximum bytes of a text.
pub const MAX_TEXT_BYTES: usize = 4096;

/// A value of an attribute.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// At most [`MAX_TEXT_BYTES`] bytes.
    Text(String),
    Integer(i64),
    /// Finite.
    Float(f64),
    Bool(bool),
    /// Days since 1970-01-01 in the proleptic Gregorian calendar.
    Date(i32),
}

/// The type of an attribute's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ValueType {
    Text,
    Integer,
    Float,
    Bool,
    Date,
}

impl ValueType {
    /// Whether values are integers or floats.
    pub fn is_number(self) -> bool {
        matches!(self, Self::Integer | Self::Float)
    }
}

impl fmt::Display for ValueType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Text => "text",
            Self::Integer => "integer",
            Self::Float => "float",
            Self::Bool => "bool",
            Self::Date => "date",
        })
    }
}

impl Value {
    /// The type of the value.
    pub fn type_of(&self) -> ValueType {
        self.borrowed().type_of()
    }

    /// The value as a number: a date as its day number, `true` as 1. `None` for texts. Integers beyond 2^53 are rounded.
    pub fn as_f64(&self) -> Option<f64> {
        self.borrowed().as_f64()
    }

    pub(crate) fn borrowed(&self) -> ValueRef<'_> {
        match self {
            Self::Text(text) => ValueRef::Text(text),
            Self::Integer(value) => ValueRef::Integer(*value),
            Self::Float(value) => ValueRef::Float(*value),
            Self::Bool(value) => ValueRef::Bool(*value),
            Self::Date(days) => ValueRef::Date(*days),
        }
    }
}

/// As JSON and the like have it. Dates are texts `YYYY-MM-DD`.
impl Serialize for Value {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Text(text) => serializer.serialize_str(text),
            Self::Integer(value) => serializer.serialize_i64(*value),
            Self::Float(value) => serializer.serialize_f64(without_sign_of_zero(*value)),
            Self::Bool(value) => serializer.serialize_bool(*value),
            Self::Date(_) => serializer.collect_str(self),
        }
    }
}

/// Dates as `YYYY-MM-DD`. Floats in the shortest form that parses to the same value, zero without a sign.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.borrowed().fmt(f)
    }
}

/// A [`Value`] whose text is borrowed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum ValueRef<'a> {
    Text(&'a str),
    Integer(i64),
    Float(f64),
    Bool(bool),
    Date(i32),
}

impl ValueRef<'_> {
    pub(crate) fn type_of(self) -> ValueType {
        match self {
            Self::Text(_) => ValueType::Text,
            Self::Integer(_) => ValueType::Integer,
            Self::Float(_) => ValueType::Float,
            Self::Bool(_) => ValueType::Bool,
            Self::Date(_) => ValueType::Date,
        }
    }

    pub(crate) fn as_f64(self) -> Option<f64> {
        match self {
            Self::Text(_) => None,
            Self::Integer(value) => Some(value as f64),
            Self::Float(value) => Some(value),
            Self::Bool(value) => Some(f64::from(u8::from(value))),
            Self::Date(days) => Some(f64::from(days)),
        }
    }

    pub(crate) fn to_value(self) -> Value {
        match self {
            Self::Text(text) => Value::Text(text.to_owned()),
            Self::Integer(value) => Value::Integer(value),
            Self::Float(value) => Value::Float(value),
            Self::Bool(value) => Value::Bool(value),
            Self::Date(days) => Value::Date(days),
        }
    }
}

impl fmt::Display for ValueRef<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::Integer(value) => value.fmt(f),
            Self::Float(value) => without_sign_of_zero(*value).fmt(f),
            Self::Bool(value) => value.fmt(f),
            Self::Date(days) => {
                let (year, month, day) = civil_from_days(*days);
                write!(f, "{year:04}-{month:02}-{day:02}")
            }
        }
    }
}

/// Days of 400 years, after which the calendar repeats.
const ERA_DAYS: i64 = 146_097;
/// Days from 0000-03-01 to 1970-01-01.
const EPOCH_DAYS: i64 = 719_468;

/// Days since 1970-01-01 of a date of the proleptic Gregorian calendar. `None` if the month or the day does not exist, or the
/// number does not fit.
pub fn days_from_civil(year: i32, month: u8, day: u8) -> Option<i32> {
    if !(1..=12).contains(&month) || day == 0 || day > days_of_month(year, month) {
        return None;
    }
    // Years begin on 1 March, so that a leap day is the last day of its year.
    let year = i64::from(year) - i64::from(month <= 2);
    let (era, year_of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let month_from_march = (i64::from(month) + 9) % 12;
    let day_of_year = (153 * month_from_march + 2) / 5 + i64::from(day) - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    i32::try_from(era * ERA_DAYS + day_of_era - EPOCH_DAYS).ok()
}

/// Year, month (1 to 12) and day (1 to 31) of a day number. The inverse of [`days_from_civil`].
pub fn civil_from_days(days: i32) -> (i32, u8, u8) {
    let days = i64::from(days) + EPOCH_DAYS;
    let (era, day_of_era) = (days.div_euclid(ERA_DAYS), days.rem_euclid(ERA_DAYS));
    let leap_days = day_of_era / 1460 - day_of_era / 36_524 + day_of_era / (ERA_DAYS - 1);
    let year_of_era = (day_of_era - leap_days) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = era * 400 + year_of_era + i64::from(month <= 2);
    (year as i32, month as u8, day as u8)
}

fn days_of_month(year: i32, month: u8) -> u8 {
    let is_leap = year.rem_euclid(4) == 0 && (year.rem_euclid(100) != 0 || year.rem_euclid(400) == 0);
    match month {
        2 if is_leap => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// The day number of a date `YYYY-MM-DD`. `None` for any other text.
pub(crate) fn parse_date(text: &str) -> Option<i32> {
    let mut parts = text.splitn(3, '-');
    let (year, month, day) = (parts.next()?, parts.next()?, parts.next()?);
    let is_number = |part: &str, digits| part.len() == digits && part.bytes().all(|byte| byte.is_ascii_digit());
    if !is_number(year, 4) || !is_number(month, 2) || !is_number(day, 2) {
        return None;
    }
    days_from_civil(year.parse().ok()?, month.parse().ok()?, day.parse().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn day_numbers_are_those_of_the_calendar() {
        let known = [((1970, 1, 1), 0), ((1969, 12, 31), -1), ((2000, 2, 29), 11_016), ((2024, 3, 1), 19_783)];
        for ((year, month, day), days) in known {
            assert_eq!(days_from_civil(year, month, day), Some(days));
            assert_eq!(civil_from_days(days), (year, month, day));
        }
        let wrong = [(2023, 2, 29), (1900, 2, 29), (2020, 0, 1), (2020, 13, 1), (2020, 4, 31), (2020, 1, 0)];
        assert!(wrong.iter().all(|(year, month, day)| days_from_civil(*year, *month, *day).is_none()));
        assert_eq!(days_from_civil(i32::MAX, 1, 1), None);
    }

    #[test]
    fn every_day_of_two_thousand_years_round_trips() {
        let mut expected = days_from_civil(500, 1, 1).unwrap();
        for year in 500..2500 {
            for month in 1..=12 {
                for day in 1..=days_of_month(year, month) {
                    assert_eq!(days_from_civil(year, month, day), Some(expected));
                    assert_eq!(civil_from_days(expected), (year, month, day));
                    expected += 1;
                }
            }
        }
        for days in [i32::MIN, i32::MAX] {
            let (year, month, day) = civil_from_days(days);
            assert_eq!(days_from_civil(year, month, day), Some(days));
        }
    }

    #[test]
    fn values_are_displayed_and_converted_to_numbers() {
        let date = Value::Date(parse_date("1894-07-01").unwrap());
        assert_eq!(date.to_string(), "1894-07-01");
        assert_eq!([-0.0, 8.63, -1.5].map(|number| Value::Float(number).to_string()), ["0", "8.63", "-1.5"]);
        let values = [Value::Text("x".into()), Value::Integer(-3), Value::Float(2.50), Value::Bool(true)];
        assert_eq!(values.each_ref().map(Value::to_string), ["x", "-3", "2.5", "true"]);
        assert_eq!(values.each_ref().map(Value::as_f64), [None, Some(-3.0), Some(2.5), Some(1.0)]);
        assert_eq!(
            values.map(|value| value.borrowed().to_value().type_of()).map(|kind| kind.to_string()),
            ["text", "integer", "float", "bool"]
        );
        assert!(
            ["2024-1-01", "2024-02-30", "+024-01-01", "2024-01-01Z", ""].iter().all(|text| parse_date(text).is_none())
        );
    }
}
