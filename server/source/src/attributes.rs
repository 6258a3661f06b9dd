//! Attributes of an object in one typed form for all formats.

use glob::{MatchOptions, Pattern};
use insula_objects::value::{Value, civil_from_days, days_from_civil};
use std::fmt;

/// Further attributes of an object are left out.
pub const MAX_ATTRIBUTES: usize = 1024;
/// Longer names are cut.
const MAX_NAME_BYTES: usize = 256;
/// Longer texts are cut.
const MAX_TEXT_BYTES: usize = 4096;

/// A value of an attribute.
#[derive(Debug, Clone, PartialEq)]
pub enum AttributeValue {
    Text(String),
    Integer(i64),
    /// Finite.
    Float(f64),
    Bool(bool),
    Date {
        year: i32,
        month: u8,
        day: u8,
    },
}

impl AttributeValue {
    /// The value of a text that is a whole number, a number, `true`/`false` or a date `YYYY-MM-DD`; the text itself otherwise.
    /// For formats without types, where the schema does not tell the type either. Numbers with leading zeros stay texts,
    /// and so do whole numbers of more than 64 bits and codes such as `12E3`.
    pub fn from_untyped(text: &str) -> Self {
        let text = text.trim();
        let digits = text.strip_prefix('-').unwrap_or(text);
        let is_code = digits.len() > 1 && digits.starts_with('0') && !digits.starts_with("0.");
        if digits.starts_with(|c: char| c.is_ascii_digit() || c == '.') && !is_code {
            if let Ok(number) = text.parse() {
                return Self::Integer(number);
            }
            let is_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
            let is_code = match digits.split_once(['e', 'E']) {
                Some((number, exponent)) => is_digits(number) && is_digits(exponent),
                None => is_digits(digits),
            };
            if let Some(number) = text.parse::<f64>().ok().filter(|number| number.is_finite() && !is_code) {
                return Self::Float(number);
            }
        }
        match text {
            "true" => return Self::Bool(true),
            "false" => return Self::Bool(false),
            _ => {}
        }
        Self::date(text).unwrap_or_else(|| Self::Text(text.to_owned()))
    }

    /// Parses the date at the start of `YYYY-MM-DD` or `YYYY-MM-DDThh:mm:ss`; `None` if it is no valid date, or if there is more than a time
    /// behind it.
    pub fn date(text: &str) -> Option<Self> {
        let (day, time) = text.split_once(['T', ' ']).unwrap_or((text, ""));
        if !time.chars().all(|c| c.is_ascii_digit() || matches!(c, ':' | '.' | '+' | '-' | 'Z' | ' ')) {
            return None;
        }
        let mut parts = day.splitn(3, '-');
        let (year, month, day) = (parts.next()?, parts.next()?, parts.next()?.trim_end_matches('Z'));
        if year.len() != 4 || month.len() != 2 || day.len() != 2 {
            return None;
        }
        let (year, month, day) = (year.parse().ok()?, month.parse().ok()?, day.parse().ok()?);
        ((1..=12).contains(&month) && (1..=31).contains(&day)).then_some(Self::Date { year, month, day })
    }

    /// The date of a number of days after 1970-01-01; `None` outside of years 1 to 9999.
    pub fn date_of_days(days: i64) -> Option<Self> {
        let days = i32::try_from(days).ok().filter(|days| (-719_162..=2_932_896).contains(days))?;
        let (year, month, day) = civil_from_days(days);
        Some(Self::Date { year, month, day })
    }

    /// A single-precision number as the decimal number that it was written for: 0.1, not 0.10000000149.
    pub fn single(number: f32) -> Self {
        Self::Float(number.to_string().parse().unwrap_or(f64::from(number)))
    }

    /// A whole number; those that need all 64 bits are texts, so that no digit of an identifier is lost.
    pub fn unsigned(number: u64) -> Self {
        i64::try_from(number).map_or_else(|_| Self::Text(number.to_string()), Self::Integer)
    }

    /// The value as a number, also of a text such as `12.5`.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Self::Integer(value) => Some(*value as f64),
            Self::Float(value) => Some(*value),
            Self::Text(text) => text.trim().parse().ok().filter(|value: &f64| value.is_finite()),
            Self::Bool(_) | Self::Date { .. } => None,
        }
    }

    /// The text of a text; `None` for other types.
    pub fn as_str(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }
}

impl From<&AttributeValue> for Value {
    fn from(value: &AttributeValue) -> Self {
        match value {
            AttributeValue::Text(text) => Self::Text(text.clone()),
            AttributeValue::Integer(value) => Self::Integer(*value),
            AttributeValue::Float(value) => Self::Float(*value),
            AttributeValue::Bool(value) => Self::Bool(*value),
            AttributeValue::Date { year, month, day } => match days_from_civil(*year, *month, *day) {
                Some(day) => Self::Date(day),
                // A day that no calendar has, such as 31 June.
                None => Self::Text(value.to_string()),
            },
        }
    }
}

impl fmt::Display for AttributeValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            Self::Integer(value) => value.fmt(f),
            Self::Float(value) => value.fmt(f),
            Self::Bool(value) => value.fmt(f),
            Self::Date { year, month, day } => write!(f, "{year:04}-{month:02}-{day:02}"),
        }
    }
}

/// Whether a number is one of single precision in the digits of double precision, as 8.630000114440918 is for 8.63. Numbers of few digits,
/// such as 0.333251953125, were written so.
fn is_widened(number: f64) -> bool {
    /// Double precision has 15 to 17 digits.
    const FULL_DIGITS: usize = 15;
    /// Writers with fewer digits round more. Those of single precision are 9 at most.
    const ROUNDED_DIGITS: usize = 12;
    /// People write no more digits into single precision, so only numbers with as few are taken for rounded ones.
    const WRITTEN_DIGITS: usize = 7;
    let digits_of = |text: String| text.bytes().take_while(|byte| *byte != b'e').filter(u8::is_ascii_digit).count();
    let (single, digits) = (number as f32, digits_of(format!("{number:e}")));
    let is_within = |share: f64| (f64::from(single) - number).abs() <= share * number.abs();
    // The last of the digits may be cut or rounded.
    let is_all = digits >= FULL_DIGITS && is_within(1e-15);
    let is_rounded = digits >= ROUNDED_DIGITS && is_within(1e-12) && digits_of(format!("{single:e}")) <= WRITTEN_DIGITS;
    number.fract() != 0.0 && (is_all || is_rounded)
}

/// Patterns of names, such as `owner*`. Upper and lower case are the same.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NamePatterns(Vec<Pattern>);

impl NamePatterns {
    /// Parses patterns with `*`, `?` and `[...]`. Fails with the first that is invalid.
    pub fn parse(patterns: &[String]) -> Result<Self, String> {
        let parse = |text: &String| Pattern::new(text).map_err(|error| format!("{text}: {error}"));
        patterns.iter().map(parse).collect::<Result<_, _>>().map(Self)
    }

    /// Whether a name fits one of the patterns.
    pub fn contains(&self, name: &str) -> bool {
        let options = MatchOptions { case_sensitive: false, ..MatchOptions::default() };
        self.0.iter().any(|pattern| pattern.matches_with(name, options))
    }
}

/// Attributes in the order of the source. Of equal names the first counts. Lists are flattened to `name.0`, `name.1`, nested
/// members to `outer.inner`. Missing values (null) are left out.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Attributes {
    entries: Vec<(String, AttributeValue)>,
}

impl Attributes {
    /// Adds an attribute. Cuts long names and texts, and gives numbers of single precision their shortest form. Leaves out floats that
    /// are not finite, equal names, and all beyond [`MAX_ATTRIBUTES`].
    pub fn push(&mut self, name: &str, value: AttributeValue) {
        let name = &name[..name.floor_char_boundary(MAX_NAME_BYTES)];
        let is_invalid = matches!(value, AttributeValue::Float(value) if !value.is_finite());
        if self.entries.len() >= MAX_ATTRIBUTES || is_invalid || self.get(name).is_some() {
            return;
        }
        let value = match value {
            AttributeValue::Float(number) if is_widened(number) => AttributeValue::single(number as f32),
            AttributeValue::Text(text) if text.len() > MAX_TEXT_BYTES => {
                AttributeValue::Text(text[..text.floor_char_boundary(MAX_TEXT_BYTES)].to_owned())
            }
            value => value,
        };
        self.entries.push((name.to_owned(), value));
    }

    /// The value of an attribute.
    pub fn get(&self, name: &str) -> Option<&AttributeValue> {
        self.entries.iter().find(|(known, _)| known == name).map(|(_, value)| value)
    }

    /// The value of an attribute in any case, with `_` where the name has `:`, as databases and Shapefiles spell it. The exact
    /// name comes first.
    pub fn named(&self, name: &str) -> Option<&AttributeValue> {
        let plain = |byte: u8| if byte == b':' { b'_' } else { byte.to_ascii_lowercase() };
        let fits = |known: &str| known.len() == name.len() && known.bytes().map(plain).eq(name.bytes().map(plain));
        self.get(name).or_else(|| self.entries.iter().find(|(known, _)| fits(known)).map(|(_, value)| value))
    }

    /// Names and values, in the order of the source.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &AttributeValue)> {
        self.entries.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of attributes.
    pub fn len(&self) -> usize {
        self.entries.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_dates() {
        let text = |days: i64| AttributeValue::date_of_days(days).map(|date| date.to_string());
        assert_eq!(text(0).as_deref(), Some("1970-01-01"));
        assert_eq!(text(19_782).as_deref(), Some("2024-02-29"));
        assert_eq!(text(-1).as_deref(), Some("1969-12-31"));
        assert_eq!(text(-719_162).as_deref(), Some("0001-01-01"));
        assert_eq!(text(2_932_896).as_deref(), Some("9999-12-31"));
        assert_eq!((text(i64::MIN), text(i64::MAX)), (None, None));
    }

    #[test]
    fn single_precision_keeps_its_decimals() {
        assert_eq!(AttributeValue::single(8.63), AttributeValue::Float(8.63));
        assert_eq!(AttributeValue::single(14.1).to_string(), "14.1");
        let mut attributes = Attributes::default();
        for (name, number) in
            [("a", 8.630000114440918), ("b", 8.63), ("c", 0.1 + 0.2), ("d", 0.333251953125), ("e", 1_099_511_627_776.0)]
        {
            attributes.push(name, AttributeValue::Float(number));
        }
        let texts: Vec<String> = attributes.iter().map(|(_, value)| value.to_string()).take(4).collect();
        assert_eq!(texts, ["8.63", "8.63", "0.30000000000000004", "0.333251953125"]);
        // Whole numbers may be identifiers.
        assert_eq!(attributes.get("e"), Some(&AttributeValue::Float(1_099_511_627_776.0)));
        assert!(matches!(AttributeValue::single(f32::NAN), AttributeValue::Float(number) if number.is_nan()));
    }

    #[test]
    fn texts_behind_a_date_are_kept() {
        let date = Some(AttributeValue::Date { year: 2020, month: 1, day: 2 });
        for text in ["2020-01-02", "2020-01-02Z", "2020-01-02T03:04:05.678+01:00", "2020-01-02 03:04"] {
            assert_eq!(AttributeValue::date(text), date, "{text}");
        }
        let note = "2020-01-02 roof rebuilt";
        assert_eq!(AttributeValue::from_untyped(note), AttributeValue::Text(note.to_owned()));
    }

    #[test]
    fn codes_of_digits_stay_texts() {
        let text = |text: &str| AttributeValue::Text(text.to_owned());
        for code in ["12E3", "6e04", "123456789012345678901", "-99999999999999999999", "0712"] {
            assert_eq!(AttributeValue::from_untyped(code), text(code));
        }
        for (number, value) in [("1.2E3", 1200.0), ("1e+05", 100_000.0), ("12.", 12.0), ("-0.5", -0.5)] {
            assert_eq!(AttributeValue::from_untyped(number), AttributeValue::Float(value));
        }
        assert_eq!(AttributeValue::from_untyped("9223372036854775807"), AttributeValue::Integer(i64::MAX));
    }

    #[test]
    fn single_precision_is_found_behind_rounded_last_digits() {
        let shown = |number| {
            let mut attributes = Attributes::default();
            attributes.push("a", AttributeValue::Float(number));
            attributes.get("a").unwrap().to_string()
        };
        for (number, text) in [
            (11.68000030517578, "11.68"),
            (11.899999618530272, "11.9"),
            (-11.899999618530274, "-11.9"),
            (11.680000305176, "11.68"),
            (12.345678329467772, "12.345678"),
            // Of double precision, or with all of the digits that were written.
            (11.6800003, "11.6800003"),
            (84_533.267_812_345_1, "84533.2678123451"),
            (52.0115770, "52.011577"),
            (1.0 / 3.0, "0.3333333333333333"),
        ] {
            assert_eq!(shown(number), text);
        }
    }
}
