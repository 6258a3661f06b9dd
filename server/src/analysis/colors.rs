//! Colours of an answer's values, and classes of them.

use super::answer::{Answer, TIMES_IN_SHADOW};
use crate::args::Analysis;
use insula_objects::{Legend, LegendEntry, Ramp};
use insula_protocol::text::fixed;

/// How opaque values are: the drawing is seen through them.
const OPACITY: u8 = 190;
/// How many classes a range has, or a few less.
const CLASSES: f64 = 6.0;
/// Half a thousandth, as in shares that reach what is asked for: hours are sums of steps.
const VALUE_TOLERANCE: f64 = 0.0005;

/// Viridis, from low to high values.
const STOPS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 45, 123],
    [59, 82, 139],
    [44, 114, 142],
    [33, 145, 140],
    [40, 174, 128],
    [94, 201, 98],
    [173, 220, 48],
    [253, 231, 37],
];
/// From a plane on upwards.
const ABOVE: [[u8; 3]; 4] = [[254, 224, 144], [253, 174, 97], [244, 109, 67], [165, 0, 38]];
/// From always in the sun to never.
const TIMES: [[u8; 3]; 4] = [[255, 249, 205], [198, 196, 190], [125, 125, 155], SHADOW];
/// From less over as much as before to more.
const CHANGES: [[u8; 3]; 5] = [[178, 24, 43], [244, 165, 130], [247, 247, 247], [146, 197, 222], [33, 102, 172]];
/// Of paper.
const NO_VALUE: [u8; 3] = [255; 3];
const SHADOW: [u8; 3] = [60, 60, 110];
const SEEN: [u8; 3] = [240, 120, 20];

/// What colours mean.
pub(crate) struct Colors {
    title: String,
    /// Values of the first and the last colour; `None` of places that are or are not, which are coloured if they are.
    range: Option<[f64; 2]>,
    stops: Vec<[u8; 3]>,
    /// What the one colour means.
    word: &'static str,
}

/// Values from a border up to the next one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ValueClass {
    pub(crate) from: f64,
    pub(crate) to: f64,
    pub(crate) rgb: [u8; 3],
}

impl Colors {
    /// Of an answer with values from 0 on, and of places that are or are not.
    pub(crate) fn of(what: Analysis, answer: &Answer) -> Self {
        let places = |color: [u8; 3], word| Self { title: String::new(), range: None, stops: vec![color], word };
        let asked = answer.asked.map(|asked| format!(" (the rule asks for {asked})")).unwrap_or_default();
        match what {
            Analysis::Sun if answer.column == "percent" => {
                Self::ramp(format!("% of probable sunlight{asked}"), highest(answer), &STOPS)
            }
            Analysis::Sun => Self::ramp(format!("hours of sun{asked}"), highest(answer), &STOPS),
            Analysis::Sky => Self::ramp("share of the sky".to_owned(), 1.0, &STOPS),
            Analysis::Solar => Self::ramp("kWh/m2 a year".to_owned(), highest(answer), &STOPS),
            Analysis::Shadow if answer.column == TIMES_IN_SHADOW => {
                Self::ramp("times in shadow".to_owned(), highest(answer), &TIMES)
            }
            Analysis::Shadow => places(SHADOW, "shadow"),
            Analysis::View => places(SEEN, "seen"),
        }
    }

    /// Of what breaks into vistas.
    pub(crate) fn of_vista(answer: &Answer) -> Self {
        Self::ramp("metres above the plane".to_owned(), highest(answer), &ABOVE)
    }

    /// Of the places that see a planned building.
    pub(crate) fn of_share_seen() -> Self {
        Self::ramp("share that is seen".to_owned(), 1.0, &STOPS)
    }

    fn ramp(title: String, highest: f64, stops: &[[u8; 3]]) -> Self {
        let highest = if highest > 0.0 { highest } else { 1.0 };
        Self { title, range: Some([0.0, highest]), stops: stops.to_vec(), word: "" }
    }

    /// Of changes, some of which are less than 0.
    pub(crate) fn of_change(what: Analysis, answer: &Answer) -> Self {
        let mut sizes: Vec<f32> = answer.tops.iter().map(|value| value.abs()).filter(|size| *size > 1e-3).collect();
        sizes.sort_unstable_by(f32::total_cmp);
        // A few places beside what is new lose all: they would make the rest pale.
        let most = f64::from(sizes.get(sizes.len() * 49 / 50).copied().unwrap_or(1.0));
        let word = match what {
            Analysis::Sun if answer.column == "percent" => "% of probable sunlight",
            Analysis::Sun => "hours of sun",
            Analysis::Sky => "share of the sky",
            Analysis::Solar => "kWh/m2 a year",
            Analysis::Shadow if answer.column == TIMES_IN_SHADOW => "times in shadow",
            Analysis::Shadow => "shadow: 1 is new",
            Analysis::View => "visibility: 1 is newly visible",
        };
        Self { title: format!("change in {word}"), range: Some([-most, most]), stops: CHANGES.to_vec(), word: "" }
    }

    /// The colour of a value, and how opaque it is.
    pub(crate) fn of_value(&self, value: f32) -> ([u8; 3], u8) {
        let first = self.stops.first().copied().unwrap_or_default();
        match self.range {
            // Pictures are resampled: a colour of no meaning would be a rim where values end.
            Some(_) if value.is_nan() => (NO_VALUE, 0),
            None => (first, if value > 0.5 { OPACITY } else { 0 }),
            Some([low, high]) => {
                let at = ((f64::from(value) - low) / (high - low)).clamp(0.0, 1.0) * (self.stops.len() - 1) as f64;
                let [a, b] = [at.floor(), at.ceil()].map(|at| self.stops[at as usize]);
                let mixed = [0, 1, 2].map(|k| f64::from(a[k]) + (f64::from(b[k]) - f64::from(a[k])) * at.fract());
                (mixed.map(|value| value.round() as u8), OPACITY)
            }
        }
    }

    /// The legend on white paper.
    pub(crate) fn legend(&self) -> Legend {
        // On white paper, colours are as light as on the map.
        let shown = |rgb: [u8; 3]| {
            let share = f64::from(OPACITY) / 255.0;
            rgb.map(|value| (255.0 + (f64::from(value) - 255.0) * share).round() as u8)
        };
        let entry = |rgb: [u8; 3], label: String| LegendEntry { rgb: shown(rgb), label };
        let stops: Vec<[u8; 3]> = self.stops.iter().map(|rgb| shown(*rgb)).collect();
        let first = self.stops.first().copied().unwrap_or_default();
        let (entries, ramp) = match self.range {
            None => (vec![entry(first, self.word.to_owned())], None),
            Some([low, high]) => {
                let digits = if high >= 100.0 { 0 } else { 2 };
                // Of a change, the ends have what lies beyond them, too. The letters of a PDF are Latin.
                let sign = |value: f64| match low < 0.0 {
                    true if value == low => "<=",
                    true if value == high => ">=",
                    _ => "",
                };
                let label = |value: f64| format!("{}{}", sign(value), fixed(value, digits));
                let ends =
                    [low, 0.5 * (low + high), high].map(|value| entry(self.of_value(value as f32).0, label(value)));
                let none = LegendEntry { rgb: NO_VALUE, label: "no value".to_owned() };
                (ends.into_iter().chain([none]).collect(), Some(Ramp { range: [low, high], stops }))
            }
        };
        Legend { title: self.title.clone(), titles: Default::default(), unit: None, entries, ramp }
    }

    /// Classes of all values, from low to high, with round borders and one at what is asked for; of places that are or are not, those that
    /// are.
    pub(crate) fn classes(&self, asked: Option<f64>) -> Vec<ValueClass> {
        let Some([low, high]) = self.range else {
            return vec![ValueClass { from: 0.5, to: 1.0, rgb: self.of_value(1.0).0 }];
        };
        let step = round_step((high - low) / CLASSES);
        let is_apart = |border: &f64| asked.is_none_or(|asked| (border - asked).abs() > 0.25 * step);
        let borders = (1..).map(|i| low + f64::from(i) * step).take_while(|border| *border < high - 0.25 * step);
        let mut borders: Vec<f64> = borders.filter(is_apart).collect();
        borders.extend(asked.filter(|asked| low < *asked && *asked < high));
        borders.extend([low, high]);
        borders.sort_unstable_by(f64::total_cmp);
        let class = |ends: &[f64]| ValueClass {
            from: ends[0],
            to: ends[1],
            rgb: self.of_value((0.5 * (ends[0] + ends[1])) as f32).0,
        };
        borders.windows(2).map(class).collect()
    }
}

/// The class of a value among those from low to high; `None` without one.
pub(crate) fn class_of(classes: &[ValueClass], value: f32) -> Option<usize> {
    classes.iter().rposition(|class| f64::from(value) >= class.from - VALUE_TOLERANCE)
}

fn highest(answer: &Answer) -> f64 {
    f64::from(answer.tops.iter().copied().filter(|value| value.is_finite()).fold(0.0, f32::max))
}

/// The next of 1, 2, 2.5, 3, 4, 5 and 10, and of their tenfolds and tenths.
fn round_step(step: f64) -> f64 {
    let unit = 10f64.powf(step.log10().floor());
    [1.0, 2.0, 2.5, 3.0, 4.0, 5.0]
        .into_iter()
        .map(|factor| factor * unit)
        .find(|next| *next >= step)
        .unwrap_or(10.0 * unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_run_from_end_to_end_and_leave_out_what_has_no_value() {
        let hours = Colors { title: String::new(), range: Some([0.0, 8.0]), stops: STOPS.to_vec(), word: "" };
        assert_eq!([0.0, 8.0, 9.0].map(|value| hours.of_value(value).0), [STOPS[0], STOPS[8], STOPS[8]]);
        assert_eq!((hours.of_value(1.0), hours.of_value(f32::NAN)), ((STOPS[1], OPACITY), (NO_VALUE, 0)));
        let labels: Vec<String> = hours.legend().entries.into_iter().map(|entry| entry.label).collect();
        assert_eq!(labels, ["0.00", "4.00", "8.00", "no value"]);
        let change = Colors { range: Some([-2.0, 2.0]), ..hours };
        let labels: Vec<String> = change.legend().entries.into_iter().map(|entry| entry.label).collect();
        assert_eq!(labels, ["<=-2.00", "0.00", ">=2.00", "no value"]);
        let seen = Colors { title: String::new(), range: None, stops: vec![SEEN], word: "seen" };
        let [is, is_not, unknown] = [1.0, 0.0, f32::NAN].map(|value| seen.of_value(value));
        assert_eq!([is, is_not, unknown], [(SEEN, OPACITY), (SEEN, 0), (SEEN, 0)], "no rim around what is");
        assert_eq!(seen.legend().entries.len(), 1);
    }

    #[test]
    fn classes_have_round_borders_and_one_at_what_is_asked_for() {
        let of = |high: f64, asked| {
            let classes = Colors::ramp(String::new(), high, &STOPS).classes(asked);
            assert!(classes.windows(2).all(|pair| pair[0].to == pair[1].from && pair[0].rgb != pair[1].rgb));
            classes.iter().map(|class| (class.to * 1e6).round() / 1e6).collect::<Vec<f64>>()
        };
        assert_eq!(of(12.08, None), [2.5, 5.0, 7.5, 10.0, 12.08]);
        assert_eq!(of(12.08, Some(2.0)), [2.0, 5.0, 7.5, 10.0, 12.08]);
        assert_eq!(of(12.08, Some(1.5)), [1.5, 2.5, 5.0, 7.5, 10.0, 12.08]);
        assert_eq!(of(1.2, Some(2.0)), [0.2, 0.4, 0.6, 0.8, 1.0, 1.2]);
        assert_eq!(of(1700.0, None), [300.0, 600.0, 900.0, 1200.0, 1500.0, 1700.0]);
        let classes = Colors::ramp(String::new(), 10.0, &STOPS).classes(Some(2.0));
        assert_eq!(classes[1].from, 2.0);
        let found = [0.0, 1.9, 1.9999, 2.0, 10.0].map(|value| class_of(&classes, value));
        assert_eq!(found, [Some(0), Some(0), Some(1), Some(1), Some(classes.len() - 1)]);
        assert_eq!(class_of(&classes, f32::NAN), None);
        let seen = Colors { title: String::new(), range: None, stops: vec![SEEN], word: "seen" }.classes(None);
        assert_eq!([0.0, 1.0].map(|value| class_of(&seen, value)), [None, Some(0)]);
    }
}
