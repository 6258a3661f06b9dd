//! Coordinates in texts.

use std::borrow::Cow;

/// Reads the positions of a `posList` or `pos`, which may have two or three numbers each; heights that are missing are
/// 0. `declared` is the dimension that the file declares. It is not believed where only the other one makes the list
/// whole, or closes the ring: files that declare 2 for positions with heights exist. What is no number becomes NaN.
pub(super) fn push_positions(text: &str, declared: Option<u8>, points: &mut Vec<[f64; 3]>) {
    let start = points.len();
    let (mut rest, mut rest_len) = ([f64::NAN; 3], 0);
    for number in text.split_ascii_whitespace().map(number) {
        rest[rest_len] = number;
        rest_len += 1;
        if rest_len == 3 {
            points.push(rest);
            rest_len = 0;
        }
    }
    let numbers = points[start..].as_flattened();
    let is_flat = match (declared, (numbers.len() + rest_len).is_multiple_of(2), rest_len == 0) {
        (_, true, false) => true,
        (Some(2), true, true) => is_closed(numbers, 2) || !is_closed(numbers, 3),
        (_, true, true) => is_closed(numbers, 2) && !is_closed(numbers, 3),
        _ => false,
    };
    if is_flat {
        let numbers: Vec<f64> = numbers.iter().chain(&rest[..rest_len]).copied().collect();
        points.truncate(start);
        points.extend(numbers.chunks_exact(2).map(|position| [position[0], position[1], 0.0]));
    } else if rest_len > 0 {
        points.push([f64::NAN; 3]);
    }
}

/// Reads `coordinates` of GML 2: positions separated by white space, their numbers by commas, or by the marks that its attributes tell.
pub(super) fn push_tuples(text: &str, marks: Marks, points: &mut Vec<[f64; 3]>) {
    let is_mark = |mark: char, c: char| if mark == ' ' { c.is_ascii_whitespace() } else { c == mark };
    let text = text.trim();
    for tuple in text.split(|c| is_mark(marks.tuple, c)).map(str::trim).filter(|tuple| !tuple.is_empty()) {
        let mut numbers = tuple
            .split(|c| is_mark(marks.coordinate, c))
            .filter(|text| marks.coordinate != ' ' || !text.is_empty())
            .map(|text| number(&with_point(text.trim(), marks.decimal)));
        let (x, y) = (numbers.next().unwrap_or(f64::NAN), numbers.next().unwrap_or(f64::NAN));
        points.push([x, y, numbers.next().unwrap_or(0.0)]);
    }
}

/// Characters between numbers, and within them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Marks {
    pub(super) decimal: char,
    pub(super) coordinate: char,
    pub(super) tuple: char,
}

impl Default for Marks {
    fn default() -> Self {
        Self { decimal: '.', coordinate: ',', tuple: ' ' }
    }
}

/// The text with points as decimal marks.
pub(super) fn with_point(text: &str, decimal: char) -> Cow<'_, str> {
    if decimal == '.' { text.into() } else { text.replace(decimal, ".").into() }
}

/// Reads the numbers of a text; what is no number becomes NaN.
pub(super) fn numbers(text: &str) -> impl Iterator<Item = f64> {
    text.split(|c: char| c.is_ascii_whitespace() || c == ',').filter(|part| !part.is_empty()).map(number)
}

fn number(text: &str) -> f64 {
    text.parse().unwrap_or(f64::NAN)
}

/// Whether the last position is the first again.
fn is_closed(numbers: &[f64], size: usize) -> bool {
    numbers.len() >= 4 * size && numbers[..size] == numbers[numbers.len() - size..]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn positions(text: &str, dimension: Option<u8>) -> Vec<[f64; 3]> {
        let mut points = Vec::new();
        push_positions(text, dimension, &mut points);
        points
    }

    #[test]
    fn reads_two_and_three_dimensions() {
        assert_eq!(positions("1 2 3\n\t4 5 6", None), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
        assert_eq!(positions("1 2", Some(3)), [[1.0, 2.0, 0.0]]);
        assert_eq!(positions("1 2 3 4 5 6", Some(2)).len(), 3);
        assert_eq!(positions("", None).len(), 0);
    }

    #[test]
    fn closed_ring_tells_the_dimension() {
        let with_heights = "0 0 5 1 0 5 1 1 5 0 0 5";
        assert_eq!(positions(with_heights, Some(2)).len(), 4);
        let flat = "0 0 1 0 1 1 0 1 0.5 0.5 0 0";
        assert_eq!(positions(flat, Some(3)), positions(flat, Some(2)));
        assert_eq!(positions(flat, Some(3)).len(), 6);
    }

    #[test]
    fn faults_become_nan() {
        assert!(positions("1 x 3", None)[0][1].is_nan());
        assert!(positions("1 2 3 4 5", None).last().unwrap()[0].is_nan());
        let mut points = Vec::new();
        push_tuples("1,2,3 4,5 6", Marks::default(), &mut points);
        assert_eq!(points[..2], [[1.0, 2.0, 3.0], [4.0, 5.0, 0.0]]);
        assert!(points[2][1].is_nan());
    }

    #[test]
    fn marks_are_those_that_are_told() {
        for (text, decimal, coordinate, tuple) in [
            ("1,5 2 3;4 5 6,5", ',', ' ', ';'),
            ("1,5;2;3\n 4;5;6,5 ", ',', ';', ' '),
            (" 1.5 2 3, 4 5 6.5", '.', ' ', ','),
        ] {
            let mut points = Vec::new();
            push_tuples(text, Marks { decimal, coordinate, tuple }, &mut points);
            assert_eq!(points, [[1.5, 2.0, 3.0], [4.0, 5.0, 6.5]], "{text}");
        }
    }
}
