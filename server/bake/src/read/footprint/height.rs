//! Height of a footprint's prism, from the attribute names of OpenStreetMap, city offices and Overture.

use std::ops::RangeInclusive;

use crate::read::attributes::{AttributeValue, Attributes};

/// Names of the top's height above the ground, best first.
const TOP: &[&str] = &["height", "building:height", "measuredHeight", "est_height"];
const LEVELS: &[&str] = &["building:levels", "levels", "num_floors"];
const ROOF_LEVELS: &[&str] = &["roof:levels"];
/// Names of the base's height above the ground, for suspended parts such as gangways.
const BASE: &[&str] = &["min_height", "building:min_height"];
const BASE_LEVEL: &[&str] = &["building:min_level", "min_level", "min_floor"];

/// Height of a storey, where only the number of storeys is known.
pub(super) const LEVEL_M: f64 = 3.0;
/// Default height: two storeys.
const UNKNOWN_M: f64 = 6.0;
/// Valid heights. Many files write 0 for an unknown height.
const TOP_RANGE_M: RangeInclusive<f64> = 0.01..=2000.0;
const BASE_RANGE_M: RangeInclusive<f64> = -500.0..=2000.0;
/// A building may have all of its storeys in its roof, and a roof may have none.
const LEVELS_RANGE: RangeInclusive<f64> = 0.0..=400.0;
const BASE_LEVEL_RANGE: RangeInclusive<f64> = -20.0..=400.0;
const FOOT_M: f64 = 0.3048;
const INCH_M: f64 = 0.0254;

/// Base and top of a prism in metres above the ground; the top is above the base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BuildingHeight {
    pub(crate) base_m: f64,
    pub(crate) top_m: f64,
    /// Whether a roof is on top of it: the height is that of counted storeys below the roof.
    pub(crate) is_without_roof: bool,
}

impl BuildingHeight {
    /// Determines the height, with a default if nothing is known. Passes guesses and invalid values to `note`, with
    /// their kind and details.
    ///
    /// `field` is the name of the attribute that has the height, if the user gives it.
    pub(crate) fn of(attributes: &Attributes, field: Option<&str>, mut note: impl FnMut(&str, &str)) -> Self {
        let mut first = |names: &[&str], range| first_in_range(attributes, names, range, &mut note);
        let base_m = first(BASE, BASE_RANGE_M)
            .or_else(|| first(BASE_LEVEL, BASE_LEVEL_RANGE).map(|levels| levels * LEVEL_M))
            .unwrap_or(0.0);
        if let Some(top_m) = field.and_then(|name| first(&[name], TOP_RANGE_M)).or_else(|| first(TOP, TOP_RANGE_M)) {
            if base_m < top_m {
                return Self { base_m, top_m, is_without_roof: false };
            }
            note("base not below the top, taken as 0", &format!("{base_m} to {top_m}"));
            return Self { base_m: 0.0, top_m, is_without_roof: false };
        }
        if let Some(levels) = first(LEVELS, LEVELS_RANGE) {
            let roof_levels = first(ROOF_LEVELS, LEVELS_RANGE);
            let top_m = (levels + roof_levels.unwrap_or(0.0)) * LEVEL_M;
            if base_m < top_m {
                note("height guessed from levels", &format!("{top_m} m"));
                return Self { base_m, top_m, is_without_roof: roof_levels.is_none() };
            }
        }
        note("height guessed", &format!("{UNKNOWN_M} m"));
        Self { base_m, top_m: base_m + UNKNOWN_M, is_without_roof: false }
    }
}

/// Whether attributes tell the top of an area, in metres or storeys.
pub(crate) fn has_height(attributes: &Attributes, field: Option<&str>) -> bool {
    let is_number = |value: &AttributeValue| value.as_str().map_or_else(|| value.as_f64(), length_m).is_some();
    let mut names = field.into_iter().chain(TOP.iter().chain(LEVELS).copied());
    names.any(|name| attributes.get(name).is_some_and(is_number))
}

/// The first of the named attributes that is a number in the range. Passes the others to `note`.
fn first_in_range(
    attributes: &Attributes,
    names: &[&str],
    range: RangeInclusive<f64>,
    note: &mut impl FnMut(&str, &str),
) -> Option<f64> {
    for name in names {
        let number = match attributes.get(name) {
            None => continue,
            Some(AttributeValue::Text(text)) if text.trim().is_empty() => continue,
            Some(AttributeValue::Text(text)) => length_m(text),
            Some(value) => value.as_f64(),
        };
        match number.filter(|number| range.contains(number)) {
            Some(number) => return Some(number),
            None => note(
                "height not understood",
                &attributes.get(name).map_or(String::new(), |value| format!("{name} is {value}")),
            ),
        }
    }
    None
}

/// Parses a length such as `12`, `12.5 m`, `12,5`, `40 ft`, `40'` or `12'6"`, in metres.
pub(crate) fn length_m(text: &str) -> Option<f64> {
    // Of several values the first.
    let text = text.split(';').next().unwrap_or_default().trim().replace(',', ".");
    let end = text.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '+' | '-'))).unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    let unit = unit.trim().to_ascii_lowercase().replace('\u{2032}', "'").replace('\u{2033}', "\"");
    let (factor, rest_m) = match unit.as_str() {
        "" | "m" | "metre" | "metres" | "meter" | "meters" => (1.0, 0.0),
        "ft" | "foot" | "feet" => (FOOT_M, 0.0),
        "\"" | "in" | "inch" | "inches" => (INCH_M, 0.0),
        unit => (FOOT_M, inches_m(unit.strip_prefix('\'')?)?),
    };
    number.parse::<f64>().ok().map(|number| number * factor + rest_m)
}

/// Parses what follows the mark of feet: nothing, or inches as in `6"`; the mark of inches may be missing, or be `''`.
fn inches_m(text: &str) -> Option<f64> {
    let number = text.trim().trim_end_matches(['"', '\'']).trim_end();
    if number.is_empty() {
        return Some(0.0);
    }
    number.parse::<f64>().ok().filter(|inches| (0.0..12.0).contains(inches)).map(|inches| inches * INCH_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::json;

    fn height(properties: &str) -> (f64, f64, Vec<String>) {
        let mut notes = Vec::new();
        let mut attributes = Attributes::default();
        json::attributes::flatten(&serde_json::from_str(properties).unwrap(), &mut attributes);
        let height = BuildingHeight::of(&attributes, None, |kind, _| notes.push(kind.to_owned()));
        (height.base_m, height.top_m, notes)
    }

    #[test]
    fn height_is_understood_in_every_spelling() {
        for (text, metres) in [
            ("14.5", 14.5),
            (r#""12""#, 12.0),
            (r#"" 12.5 m""#, 12.5),
            (r#""12,5m""#, 12.5),
            (r#""40 ft""#, 12.192),
            (r#""10'""#, 3.048),
            (r#""12'6\"""#, 3.81),
            (r#""12' 6.5''""#, 3.8227),
            (r#""12′6″""#, 3.81),
            (r#""6'4""#, 1.9304),
            (r#""100\"""#, 2.54),
            (r#""12;15""#, 12.0),
            (r#""12,5""#, 12.5),
        ] {
            let (base_m, top_m, notes) = height(&format!(r#"{{"height": {text}}}"#));
            assert!(base_m == 0.0 && (top_m - metres).abs() < 1e-9 && notes.is_empty(), "{text}: {top_m} {notes:?}");
        }
    }

    #[test]
    fn height_takes_precedence_over_levels_and_levels_over_the_default() {
        let all = r#"{"building:levels": 9, "height": null, "building:height": "21", "min_height": 3}"#;
        assert_eq!(height(all), (3.0, 21.0, vec![]));
        let levels = r#"{"levels": "4", "roof:levels": 1, "building:min_level": 1}"#;
        assert_eq!(height(levels), (3.0, 15.0, vec!["height guessed from levels".to_owned()]));
        // All storeys are in the roof, or none.
        let attic = r#"{"building:levels": 0, "roof:levels": 2}"#;
        assert_eq!(height(attic), (0.0, 6.0, vec!["height guessed from levels".to_owned()]));
        let flat = r#"{"building:levels": 3, "roof:levels": 0}"#;
        assert_eq!(height(flat), (0.0, 9.0, vec!["height guessed from levels".to_owned()]));
        assert_eq!(height(r#"{"building:levels": 0}"#), (0.0, 6.0, vec!["height guessed".to_owned()]));
        assert_eq!(height("{}"), (0.0, 6.0, vec!["height guessed".to_owned()]));
        assert_eq!(height(r#"{"min_height": 10}"#), (10.0, 16.0, vec!["height guessed".to_owned()]));
    }

    #[test]
    fn invalid_heights_are_reported_and_ignored() {
        for text in
            ["0", "-3", "1e9", "true", r#""tall""#, r#""12 km""#, r#""5-7""#, r#""nan""#, r#""5'x""#, r#""5'99\"""#]
        {
            let (base_m, top_m, notes) = height(&format!(r#"{{"height": {text}, "levels": 2}}"#));
            assert_eq!((base_m, top_m), (0.0, 6.0), "{text}");
            assert_eq!(notes, ["height not understood", "height guessed from levels"], "{text}");
        }
        let upside_down = height(r#"{"height": 5, "min_height": 5}"#);
        assert_eq!(upside_down, (0.0, 5.0, vec!["base not below the top, taken as 0".to_owned()]));
    }
}
