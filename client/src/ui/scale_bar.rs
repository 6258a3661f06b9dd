//! The scale bar: the length of a horizontal line on the screen, at a given distance.

use egui::{Align2, Color32, FontId, Sense, Stroke, Ui, vec2};
use insula_viewer::interaction::units::length_text;

/// Longest bar, in points.
const MAX_POINTS: f32 = 150.0;
const HEIGHT: f32 = 24.0;

/// A bar of a round length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScaleBar {
    /// 1, 2 or 5 times a power of ten.
    pub length_m: f64,
    /// Length on the screen, 40% of `max_points` to all of it.
    pub points: f32,
}

impl ScaleBar {
    /// The longest bar that is at most `max_points` long. `None` if the scale is not a positive number.
    pub fn fitting(metres_per_point: f64, max_points: f32) -> Option<Self> {
        let longest_m = metres_per_point * f64::from(max_points);
        if !longest_m.is_finite() || longest_m < 1e-6 {
            return None;
        }
        let unit_m = 10f64.powf(longest_m.log10().floor());
        // The logarithm may be rounded up to the next power of ten.
        let steps = [5.0, 2.0, 1.0, 0.5].map(|step| step * unit_m);
        let length_m = steps.into_iter().find(|length_m| *length_m <= longest_m)?;
        Some(Self { length_m, points: (length_m / metres_per_point) as f32 })
    }

    fn text(&self) -> String {
        match self.length_m {
            m if m >= 1000.0 => format!("{} km", m / 1000.0),
            m if m >= 1.0 => format!("{m} m"),
            m => length_text(m),
        }
    }
}

/// Draws the bar for a scale that holds at `place`, such as "at the pointer".
pub fn show(ui: &mut Ui, metres_per_point: Option<f64>, place: &str) {
    let (area, _) = ui.allocate_exact_size(vec2(MAX_POINTS + 4.0, HEIGHT), Sense::hover());
    let Some(bar) = metres_per_point.and_then(|scale| ScaleBar::fitting(scale, MAX_POINTS)) else { return };
    let painter = ui.painter_at(area);
    let (left, bottom) = (area.left() + 1.0, area.bottom() - 3.0);
    let stroke = Stroke::new(2.0, Color32::WHITE);
    let right = left + bar.points;
    painter.hline(left..=right, bottom, stroke);
    for x in [left, right] {
        painter.vline(x, bottom - 6.0..=bottom + 1.0, stroke);
    }
    let text = format!("{} {place}", bar.text());
    let at = area.left_top() + vec2(4.0, 0.0);
    painter.text(at, Align2::LEFT_TOP, text, FontId::proportional(12.5), Color32::from_gray(225));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_have_round_lengths_and_fill_the_room() {
        for exponent in -40..60 {
            let metres_per_point = 10f64.powf(f64::from(exponent) / 10.0);
            let bar = ScaleBar::fitting(metres_per_point, 150.0).unwrap();
            assert!((59.9..=150.001).contains(&bar.points), "{metres_per_point}: {bar:?}");
            let digit = bar.length_m / 10f64.powf((bar.length_m * 1.000_001).log10().floor());
            assert!([1.0, 2.0, 5.0].iter().any(|step| (digit - step).abs() < 1e-6), "{bar:?}");
        }
        assert_eq!(ScaleBar::fitting(1.0, 150.0), Some(ScaleBar { length_m: 100.0, points: 100.0 }));
        assert_eq!(ScaleBar::fitting(20.0, 150.0).unwrap().text(), "2 km");
        assert_eq!(ScaleBar::fitting(0.2, 150.0).unwrap().text(), "20 m");
        for none in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(ScaleBar::fitting(none, 150.0), None, "{none}");
        }
    }
}
