//! Where a city ends in the sea: a part of the manifest.

use serde::{Deserialize, Serialize};

/// Parts of each end of a city that are land or sea.
pub const PARTS: usize = 64;

/// A digit, 0 to 15, for each part of the west, south, east and north end, from south to north and from west to east.
pub type SeaSides = [[u8; PARTS]; 4];

/// The ends of what the sources describe, and where the sea goes on beyond them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SeaEnds {
    /// World x and y of the south-west and north-east corner of what the sources describe, in metres.
    pub ends: [[f64; 2]; 2],
    /// Length in metres of a step inwards from an end.
    pub step_m: f64,
    /// [`SeaSides`] as hexadecimal digits: steps inwards from a part in which ground that no source describes is sea; 0 for land.
    pub sides: String,
    /// Colour of most of the sea, sRGB.
    pub rgb: [u8; 3],
}

impl SeaEnds {
    /// Sides as their text.
    pub fn text_of(sides: &SeaSides) -> String {
        let digit = |value: &u8| char::from_digit(u32::from(*value).min(15), 16).unwrap_or('0');
        sides.as_flattened().iter().map(digit).collect()
    }

    /// The sides; `None` if the text has other characters than digits, or not as many as there are parts.
    pub fn sides(&self) -> Option<SeaSides> {
        if self.sides.len() != 4 * PARTS {
            return None;
        }
        let mut sides = [[0; PARTS]; 4];
        for (part, byte) in sides.as_flattened_mut().iter_mut().zip(self.sides.bytes()) {
            *part = u8::try_from(char::from(byte).to_digit(16)?).ok()?;
        }
        Some(sides)
    }

    /// All lengths and positions.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = &f64> + Clone {
        self.ends.as_flattened().iter().chain([&self.step_m])
    }

    /// Fails unless the ends are an area, its steps have a length, and there is a digit for each part.
    pub(crate) fn check(&self) -> Result<(), String> {
        let [low, high] = self.ends;
        // Comparisons with NaN are false.
        let is_area = low[0] < high[0] && low[1] < high[1] && self.step_m > 0.0;
        if !is_area {
            return Err("the ends of its sea are no area".into());
        }
        match self.sides() {
            Some(_) => Ok(()),
            None => Err(format!("the sides of its sea are not {} hexadecimal digits", 4 * PARTS)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_come_back_from_their_text_and_others_are_refused() {
        let sides: SeaSides = std::array::from_fn(|side| std::array::from_fn(|part| ((side + part) % 16) as u8));
        let sea = SeaEnds {
            ends: [[-5.0, 3.0], [7.0, 4.0]],
            step_m: 2.5,
            sides: SeaEnds::text_of(&sides),
            rgb: [74, 129, 152],
        };
        assert_eq!(sea.sides(), Some(sides));
        assert_eq!(sea.check(), Ok(()));
        let text = |sides: String| SeaEnds { sides, ..sea.clone() };
        let ends = |ends: [[f64; 2]; 2]| SeaEnds { ends, ..sea.clone() };
        let step = |step_m: f64| SeaEnds { step_m, ..sea.clone() };
        for (i, wrong) in [
            text(String::new()),
            text("0".repeat(255)),
            text("0".repeat(257)),
            text("g".repeat(256)),
            // As many bytes, of fewer characters.
            text("é".repeat(128)),
            ends([[0.0; 2]; 2]),
            ends([[f64::NAN, 0.0], [1.0; 2]]),
            step(0.0),
            step(f64::NAN),
        ]
        .into_iter()
        .enumerate()
        {
            assert!(wrong.check().is_err(), "{i}");
        }
    }
}
