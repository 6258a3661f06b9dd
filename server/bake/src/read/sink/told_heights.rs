//! Heights that attributes tell without a unit: those of a whole source tell whether they can be metres.

use insula_source::problems::UNIT_GUESSED;
use insula_source::report::SourceReport;

/// In no city are most buildings higher.
const TALL_M: f64 = 150.0;
/// No building is higher.
const HIGHEST_M: f64 = 830.0;
/// The median of fewer heights tells nothing.
const MIN_COUNT: u64 = 5;

/// What is known of the heights of a source.
#[derive(Debug, Default)]
pub(super) struct ToldHeights {
    count: u64,
    tall: u64,
    /// The highest, and whose it is.
    highest: Option<(f64, String)>,
}

impl ToldHeights {
    pub(super) fn add(&mut self, id: &str, height_m: f64) {
        self.count += 1;
        self.tall += u64::from(height_m > TALL_M);
        if self.highest.as_ref().is_none_or(|(highest_m, _)| height_m > *highest_m) {
            self.highest = Some((height_m, id.to_owned()));
        }
    }

    /// Names heights that are too large for metres.
    pub(super) fn note_in(&self, report: &mut SourceReport) {
        let Some((highest_m, id)) = &self.highest else { return };
        if self.count >= MIN_COUNT && 2 * self.tall > self.count {
            let (tall, count) = (self.tall, self.count);
            report.problem(UNIT_GUESSED, || {
                format!(
                    "{tall} of {count} heights over {TALL_M} look like centimetres, taken as metres (--height-unit cm)"
                )
            });
        } else if *highest_m > HIGHEST_M {
            report.problem(UNIT_GUESSED, || {
                format!("{id} is {highest_m} m high; if heights are in centimetres, give --height-unit cm")
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::report::SourceFormat;

    #[test]
    fn heights_that_cannot_be_metres_are_named() {
        let noted = |heights: &[f64]| {
            let mut told = ToldHeights::default();
            heights.iter().for_each(|height_m| told.add("b", *height_m));
            let mut report = SourceReport::new("a", SourceFormat::GeoJson, 1);
            told.note_in(&mut report);
            report.problems.get(UNIT_GUESSED).map(|fault| fault.first[0].clone())
        };
        let mostly = noted(&[850.0, 1200.0, 640.0, 320.0, 90.0]).unwrap();
        assert_eq!(mostly, "4 of 5 heights over 150 look like centimetres, taken as metres (--height-unit cm)");
        assert!(noted(&[12.0, 9.0, 831.0]).unwrap().starts_with("b is 831 m high"));
        assert_eq!(
            (noted(&[200.0, 300.0, 828.0]), noted(&[9.0, 160.0, 12.0, 8.0, 7.0]), noted(&[])),
            (None, None, None)
        );
    }
}
