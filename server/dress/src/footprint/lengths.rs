//! Lengths in attributes: numbers, and texts with a unit.

use super::height_names::{counts_storeys, unit_after};
use crate::roof::{self, RoofShape};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::decimal_mark::{DecimalMark, both_numbers};
use insula_source::text::first_value;
use insula_source::units::{FOOT_M, metres_of};

/// Names, also as Shapefiles cut them.
pub(super) const ROOF_SHAPE: &[&str] = &["roof:shape", "building:roof:shape"];
pub(super) const ROOF_HEIGHT: &[&str] = &["roof:height", "building:roof:height", "roof_heigh"];
/// Valid heights of roofs.
pub(super) const ROOF_HEIGHT_RANGE_M: std::ops::RangeInclusive<f64> = 0.1..=200.0;
const INCH_M: f64 = 0.0254;
/// Words and signs before a number that is about right, in lower case.
const ABOUT: &[&str] = &["~", "≈", "ca.", "ca ", "circa ", "approx.", "approx ", "about ", "etwa ", "env."];
/// Before the number of storeys above the one on the ground: `R+2` in French, `G+2` in English.
const GROUND_FLOOR: [char; 4] = ['R', 'r', 'G', 'g'];

/// The height of a roof that is not flat, as attributes give it in metres; `None` if they do not, or only in storeys.
/// A plain number is in a unit of `plain_m` metres.
pub(super) fn roof_height_m(attributes: &Attributes, plain_m: f64) -> Option<f64> {
    let shape = text(attributes, ROOF_SHAPE).and_then(roof::roof_shape_by_name);
    named_lengths(attributes, ROOF_HEIGHT, plain_m)
        .find_map(|(_, value, unit_m)| metres(value, unit_m))
        .filter(|height_m| shape != Some(RoofShape::Flat) && ROOF_HEIGHT_RANGE_M.contains(height_m))
}

/// Names and values of the named lengths, also with a unit at the end of the name, and metres in the unit of plain numbers.
pub(super) fn named_lengths<'a>(
    attributes: &'a Attributes,
    names: &'static [&'static str],
    plain_m: f64,
) -> impl Iterator<Item = (&'a str, &'a AttributeValue, f64)> {
    let plain = names.iter().filter_map(move |name| Some((*name, attributes.named(name)?, plain_m)));
    plain.chain(attributes.iter().filter_map(move |(name, value)| Some((name, value, unit_after(name, names)?))))
}

pub(super) fn text<'a>(attributes: &'a Attributes, names: &[&str]) -> Option<&'a str> {
    names.iter().find_map(|name| attributes.named(name)?.as_str())
}

/// The first of the named values that is a number. A plain number is in a unit of `plain_m` metres.
pub(super) fn number(attributes: &Attributes, names: &[&str], plain_m: f64) -> Option<f64> {
    names.iter().find_map(|name| metres(attributes.named(name)?, plain_m))
}

/// A length in metres; a plain number is in a unit of `plain_m` metres.
pub(super) fn metres(value: &AttributeValue, plain_m: f64) -> Option<f64> {
    match value {
        AttributeValue::Text(text) => length_in(text, plain_m),
        value => value.as_f64().map(|number| number * plain_m),
    }
}

/// The number in a text such as `3 floors`, `G+2` or, with an attic, `R+2+C`.
pub(super) fn storeys(value: &AttributeValue) -> Option<f64> {
    let text = first_value(value.as_str()?);
    if let Some(upper) = text.strip_prefix(GROUND_FLOOR).and_then(|rest| rest.trim_start().strip_prefix('+')) {
        let upper = upper.split('+').next().unwrap_or_default();
        return upper.trim().parse::<f64>().ok().map(|upper| upper + 1.0);
    }
    let (number, word) = text.split_at(text.find(char::is_alphabetic)?);
    let number = number.trim_end().replace(',', ".").parse().ok()?;
    counts_storeys(word).then_some(number)
}

/// Parses a length such as `12`, `~12.5 m`, `12,5`, `40 ft`, `40'`, `12'6"` or `12 ft 6 in`, in metres.
pub fn length_m(text: &str) -> Option<f64> {
    length_in(text, 1.0)
}

/// The length in metres of a text whose comma may also be between groups of digits, as in `1,776 ft`, by that reading.
pub(super) fn grouped_metres(value: &AttributeValue, plain_m: f64) -> Option<f64> {
    let number_of = |text: &str| both_numbers(text).filter(|_| text.contains(',')).map(|[grouped, _]| grouped);
    length_by(value.as_str()?, plain_m, number_of)
}

/// Parses a length as [`length_m`] does; a plain number is in a unit of `plain_m` metres.
fn length_in(text: &str, plain_m: f64) -> Option<f64> {
    let by_marks = |text: &str| DecimalMark::Comma.number(text).or_else(|| DecimalMark::Point.number(text));
    length_by(text, plain_m, |text| text.parse().ok().or_else(|| by_marks(text)))
}

/// Parses a length whose number `number_of` reads.
fn length_by(text: &str, plain_m: f64, number_of: impl Fn(&str) -> Option<f64>) -> Option<f64> {
    let text = first_value(text).to_lowercase();
    let text = ABOUT.iter().find_map(|about| text.strip_prefix(about)).unwrap_or(&text).trim_start();
    let end = text.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | ',' | '+' | '-'))).unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    // Primes, and what word processors make of straight marks.
    let unit = unit.trim().replace(',', ".").replace(['\u{2032}', '\u{2019}', '\u{b4}'], "'");
    let unit = unit.replace(['\u{2033}', '\u{201d}'], "\"");
    let (factor, rest_m) = match unit.as_str() {
        "" => (plain_m, 0.0),
        "\"" => (INCH_M, 0.0),
        unit => match (unit.strip_prefix('\''), metres_of(unit)) {
            (Some(inches), _) => (FOOT_M, inches_m(inches)?),
            (None, Some(metres)) => (metres, 0.0),
            (None, None) => feet_and_inches(unit)?,
        },
    };
    number_of(number).map(|number| number * factor + rest_m)
}

/// Parses a unit of feet with inches after it, as in `ft 4 in`: metres of a foot, and of the inches.
fn feet_and_inches(text: &str) -> Option<(f64, f64)> {
    let (word, inches) = text.split_at(text.find(|c: char| c.is_ascii_digit())?);
    let foot_m = metres_of(word).filter(|metres| (metres - FOOT_M).abs() < 1e-4)?;
    let number = inches.trim_end_matches(char::is_alphabetic);
    let unit = &inches[number.len()..];
    let is_inches = unit.is_empty() || metres_of(unit).is_some_and(|metres| (metres - INCH_M).abs() < 1e-6);
    Some((foot_m, inches_m(number).filter(|_| is_inches)?))
}

/// Parses what follows the mark of feet: nothing, or inches as in `6"`; the mark of inches may be missing, or be `''`.
fn inches_m(text: &str) -> Option<f64> {
    let number = text.trim().trim_end_matches(['"', '\'']).trim_end();
    if number.is_empty() {
        return Some(0.0);
    }
    number.parse::<f64>().ok().filter(|inches| (0.0..12.0).contains(inches)).map(|inches| inches * INCH_M)
}
