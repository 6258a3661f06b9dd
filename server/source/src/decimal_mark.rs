//! Numbers as tables have them: with a point or a comma before the decimals, and perhaps the other one between groups of three digits.

use super::attributes::AttributeValue;

/// Larger whole numbers may not be exact.
const MAX_WHOLE: f64 = 9_007_199_254_740_992.0;

/// What is before the decimals of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DecimalMark {
    Point,
    Comma,
}

impl DecimalMark {
    fn sign(self) -> char {
        match self {
            Self::Point => '.',
            Self::Comma => ',',
        }
    }

    fn other(self) -> Self {
        match self {
            Self::Point => Self::Comma,
            Self::Comma => Self::Point,
        }
    }

    /// The number of a text whose decimals are behind this mark, and whose groups of three digits may be behind the other one; `None` if
    /// it is none.
    pub fn number(self, text: &str) -> Option<f64> {
        let text = text.trim();
        let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
        let (whole, decimals) = digits.split_once(self.sign()).unwrap_or((digits, ""));
        let is_number = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
        let mut groups = whole.split(self.other().sign());
        let first = groups.next().unwrap_or_default();
        let is_first = match first.len() == whole.len() {
            true => !first.is_empty() || !decimals.is_empty(),
            false => (1..=3).contains(&first.len()) && !first.starts_with('0'),
        };
        let is_grouped = groups.all(|group| group.len() == 3 && is_number(group));
        if !(is_first && is_grouped && is_number(first) && is_number(decimals)) {
            return None;
        }
        let sign = if text.starts_with('-') { "-" } else { "" };
        let plain = format!("{sign}{}.{decimals}", whole.replace(self.other().sign(), ""));
        plain.parse().ok().filter(|number: &f64| number.is_finite())
    }

    /// The number of a text with marks as an attribute; `None` if it has none, or is no number.
    pub fn value(self, text: &str) -> Option<AttributeValue> {
        let number = self.number(text).filter(|_| text.contains(['.', ',']))?;
        let is_whole = !text.contains(self.sign()) && number.abs() <= MAX_WHOLE;
        Some(if is_whole { AttributeValue::Integer(number as i64) } else { AttributeValue::Float(number) })
    }
}

/// The numbers of a text by both marks, if they differ, as those of `1,234` do: with decimals behind a point, and behind a comma.
pub fn both_numbers(text: &str) -> Option<[f64; 2]> {
    let point = DecimalMark::Point.number(text)?;
    let comma = DecimalMark::Comma.number(text)?;
    (point != comma).then_some([point, comma])
}

/// The mark before the decimals of a column, and how it is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColumnMark {
    pub mark: DecimalMark,
    /// A number of the column that has another value by the other mark, if no other number tells the mark.
    pub guessed_by: Option<String>,
}

/// Numbers of a column, by which the mark of all of them is known.
#[derive(Debug, Clone, Default)]
pub struct NumberColumn {
    numbers: u64,
    others: u64,
    /// Some are whole, without marks.
    has_plain: bool,
    /// Some can only have a point before their decimals, or only a comma.
    is_certain: [bool; 2],
    /// Some have several marks.
    has_groups: bool,
    /// The first ones with a single mark that may be between groups: a point, and a comma.
    either: [Option<String>; 2],
}

impl NumberColumn {
    /// Takes note of a value.
    pub fn add(&mut self, text: &str) {
        let text = text.trim();
        if text.is_empty() {
            return;
        }
        let marks = text.matches(['.', ',']).count();
        match (DecimalMark::Point.number(text), DecimalMark::Comma.number(text)) {
            (None, None) => {
                self.others += 1;
                return;
            }
            (Some(_), None) => self.is_certain[0] = true,
            // Codes have points only, too.
            (None, Some(_)) => self.is_certain[1] |= text.contains(','),
            (Some(_), Some(_)) if marks == 0 => self.has_plain = true,
            (Some(_), Some(_)) => {
                self.either[usize::from(text.contains(','))].get_or_insert_with(|| text.to_owned());
            }
        }
        self.numbers += 1;
        self.has_groups |= marks > 1;
    }

    /// Takes note of the values of another column, which has the same mark.
    pub fn join(&mut self, other: &Self) {
        self.numbers += other.numbers;
        self.others += other.others;
        self.has_plain |= other.has_plain;
        self.has_groups |= other.has_groups;
        for index in [0, 1] {
            self.is_certain[index] |= other.is_certain[index];
            self.either[index] = self.either[index].take().or_else(|| other.either[index].clone());
        }
    }

    /// The mark that some numbers can only have; `None` if none does, or if they contradict each other.
    pub fn certain(&self) -> Option<DecimalMark> {
        match self.is_certain {
            [true, false] => Some(DecimalMark::Point),
            [false, true] => Some(DecimalMark::Comma),
            _ => None,
        }
    }

    /// A number with a single comma that may be between groups.
    pub fn either(&self) -> Option<&str> {
        self.either[1].as_deref()
    }

    /// The mark of a column with numbers that have another value, or none, without it; `None` for all others. `likely` is that of the rest
    /// of the table, and counts if nothing in the column tells.
    pub fn mark(&self, likely: DecimalMark) -> Option<ColumnMark> {
        let certain = self.certain();
        // A point alone is before decimals, unless others have a comma there.
        let has_either = self.either[1].is_some() || certain == Some(DecimalMark::Comma) && self.either[0].is_some();
        let is_needed = has_either || self.has_groups;
        let is_contradicted = self.is_certain == [true; 2] || certain.is_none() && self.either[0].is_some();
        let is_untold = certain.is_none() && self.either[1].is_none();
        if !is_needed || is_contradicted || is_untold || self.others > self.numbers {
            return None;
        }
        let guessed_by = self.either[1].clone().filter(|_| certain.is_none());
        let guess = if self.has_plain { DecimalMark::Point } else { likely };
        Some(ColumnMark { mark: certain.unwrap_or(guess), guessed_by })
    }
}

/// What to tell of a guess of the mark of a column.
pub fn guessed_mark(column: &str, number: &str, mark: DecimalMark) -> String {
    let value = mark.number(number).unwrap_or_default();
    format!("{column}: numbers such as {number} are taken as {value}; write them without a comma if that is wrong")
}

#[cfg(test)]
mod tests {
    use super::DecimalMark::{Comma, Point};
    use super::*;

    #[test]
    fn numbers_have_groups_and_decimals() {
        for (text, by_point, by_comma) in [
            ("1,234", Some(1234.0), Some(1.234)),
            ("1.234", Some(1.234), Some(1234.0)),
            ("1,234.5", Some(1234.5), None),
            ("-1.234,5", None, Some(-1234.5)),
            ("1,234,567", Some(1_234_567.0), None),
            ("12,5", None, Some(12.5)),
            ("12.5", Some(12.5), None),
            ("0,750", None, Some(0.75)),
            ("1234,567", None, Some(1234.567)),
            (" 12 ", Some(12.0), Some(12.0)),
            (",5", None, Some(0.5)),
            ("", None, None),
            (",", None, None),
            ("1,23,456", None, None),
            ("12 m", None, None),
            ("1e3", None, None),
            ("--1", None, None),
        ] {
            assert_eq!((Point.number(text), Comma.number(text)), (by_point, by_comma), "{text}");
        }
        assert_eq!((both_numbers("1,234"), both_numbers("12,5")), (Some([1234.0, 1.234]), None));
        assert_eq!(Point.value("1,234"), Some(AttributeValue::Integer(1234)));
        assert_eq!(Comma.value("1.234,50"), Some(AttributeValue::Float(1234.5)));
        assert_eq!((Comma.value("12"), Comma.value("007")), (None, None), "as without marks");
    }

    fn mark(values: &[&str], likely: DecimalMark) -> Option<(DecimalMark, bool)> {
        let mut column = NumberColumn::default();
        values.iter().for_each(|value| column.add(value));
        column.mark(likely).map(|mark| (mark.mark, mark.guessed_by.is_some()))
    }

    #[test]
    fn other_numbers_of_a_column_tell_its_mark() {
        for (values, expected) in [
            (&["1,234", "12.5"][..], Some((Point, false))),
            (&["1,234", "1,234,567"], Some((Point, false))),
            (&["1,234", "12,5", ""], Some((Comma, false))),
            (&["1.234", "950,5"], Some((Comma, false))),
            (&["1.234,5", "n/a"], Some((Comma, false))),
            (&["1,234", "0,750"], Some((Comma, false))),
            (&["1,234", "950"], Some((Point, true))),
            (&["1,234", "2,345"], Some((Comma, true))),
            // Nothing to decide.
            (&["1.234", "12.5"], None),
            (&["12,5", "7,25"], None),
            (&["1", "2"], None),
            (&["1,234", "1.234"], None),
            (&["1,234", "12,5", "12.5"], None),
            (&["1,234", "a", "b"], None),
            (&["192.168.100.200", "123.456.789"], None),
        ] {
            assert_eq!(mark(values, Comma), expected, "{values:?}");
        }
        assert_eq!(mark(&["1,234"], Point), Some((Point, true)));
    }

    #[test]
    fn columns_of_coordinates_are_joined() {
        let [mut x, mut y] = [NumberColumn::default(), NumberColumn::default()];
        x.add("691,000");
        y.add("5,334,000");
        x.join(&y);
        assert_eq!(x.mark(Comma), Some(ColumnMark { mark: Point, guessed_by: None }));
        assert_eq!(x.either(), Some("691,000"));
        assert!(guessed_mark("X", "691,000", Point).starts_with("X: numbers such as 691,000 are taken as 691000;"));
    }
}
