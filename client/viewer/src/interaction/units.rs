//! Lengths and areas as text.

use insula_protocol::text::fixed;

/// A length in metres, kilometres from 1000 m on: to the centimetre below 100 m, else to four digits or more.
pub fn length_text(metres: f64) -> String {
    match metres.abs() {
        m if m < 99.995 => fixed(metres, 2) + " m",
        m if m < 999.95 => fixed(metres, 1) + " m",
        m if m < 99_995.0 => fixed(metres / 1000.0, 2) + " km",
        _ => fixed(metres / 1000.0, 1) + " km",
    }
}

/// An area in square metres, hectares from 10,000 square metres on, square kilometres from 100 hectares on.
pub fn area_text(square_metres: f64) -> String {
    match square_metres.abs() {
        m2 if m2 < 9999.95 => fixed(square_metres, 1) + " m\u{b2}",
        m2 if m2 < 999_950.0 => fixed(square_metres / 1e4, 2) + " ha",
        _ => fixed(square_metres / 1e6, 2) + " km\u{b2}",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_grow_with_the_value() {
        for (metres, text) in [
            (0.0, "0.00 m"),
            (-0.004, "0.00 m"),
            (-2.345, "-2.35 m"),
            (99.999, "100.0 m"),
            (999.96, "1.00 km"),
            (123_456.0, "123.5 km"),
        ] {
            assert_eq!(length_text(metres), text);
        }
        for (area, text) in [(12.34, "12.3 m\u{b2}"), (9999.96, "1.00 ha"), (999_960.0, "1.00 km\u{b2}")] {
            assert_eq!(area_text(area), text);
        }
    }
}
