//! The PDF sheet of an analysis: the plan of the city under the colours of the values.

use super::{super::error::CommandError, Answer, Question};
use crate::args::Analysis;
use insula_analysis::surface::CitySurface;
use insula_draw::{
    DrawLimits, DrawRequest, draw,
    file::{DrawingFormat, write_drawing},
    picture::{ValuePicture, lay, outline},
    sheet::Paper,
    style::Stylesheet,
    view::DrawView,
};
use insula_export::selection::ObjectSelection;
use insula_objects::{Legend, LegendEntry, Ramp};
use insula_protocol::text::fixed;
use std::path::Path;

/// Longest side of the picture in pixels. Larger areas show every second cell, or fewer.
const MAX_SIDE: u32 = 4096;
/// How opaque values are: the drawing is seen through them.
const OPACITY: u8 = 190;
const PAPER: &str = "A3";

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
/// From less over as much as before to more.
const CHANGES: [[u8; 3]; 5] = [[178, 24, 43], [244, 165, 130], [247, 247, 247], [146, 197, 222], [33, 102, 172]];
const SHADOW: [u8; 3] = [60, 60, 110];
const SEEN: [u8; 3] = [240, 120, 20];

/// What colours mean.
struct Colors {
    title: String,
    /// Values of the first and the last colour; `None` of places that are or are not, which are coloured if they are.
    range: Option<[f64; 2]>,
    stops: Vec<[u8; 3]>,
    /// What the one colour means.
    word: &'static str,
}

/// Writes the sheet of an answer. Fails if the city is too large for a drawing, or if the file cannot be written.
pub(super) fn write(
    question: &Question,
    answer: &Answer,
    surface: &CitySurface,
    out: &Path,
) -> Result<(), CommandError> {
    let failed =
        |error: &dyn std::fmt::Display| CommandError::Export { path: out.to_owned(), reason: error.to_string() };
    let paper = Paper::parse(PAPER).map_err(|error| failed(&error))?;
    let area = area(question, surface);
    let request = DrawRequest {
        view: DrawView::Plan,
        selection: ObjectSelection { bbox: Some(area), ..ObjectSelection::default() },
        paper,
        scale: None,
        is_bare: false,
        title: Some(format!("{}: {}", question.source.manifest().title, answer.title)),
        style: Stylesheet::default(),
        is_checked: false,
        is_sheet: false,
        date: String::new(),
        note: "Values are those of the legend; the drawing below them is lit from the upper left.".to_owned(),
        color_by: None,
        limits: DrawLimits::default(),
    };
    let mut drawing = draw(question.source, &request, &|_, _| true).map_err(|error| failed(&error))?;
    let colors = Colors::of(question, answer);
    let picture = picture(question, answer, surface, &colors, area);
    outline(&mut drawing, &question.added);
    let what_is_added = (!question.added.is_empty()).then(|| "what is added is outlined".to_owned());
    let notes: Vec<String> = answer.notes.iter().cloned().chain(what_is_added).collect();
    lay(&mut drawing, picture, &colors.legend(), &notes);
    write_drawing(&drawing, DrawingFormat::Pdf, out).map_err(|error| failed(&error))?;
    Ok(())
}

/// The cells of the result in world metres.
fn area(question: &Question, surface: &CitySurface) -> [[f64; 2]; 2] {
    let corner = |cells: [u32; 2]| {
        let from = [0, 1].map(|k| f64::from(cells[k]) - f64::from(surface.extent.min[k]));
        [0, 1].map(|k| surface.corner[k] + from[k] * surface.cell_m)
    };
    let extent = question.extent;
    [corner(extent.min), corner([0, 1].map(|k| extent.min[k] + extent.size[k]))]
}

fn picture(
    question: &Question,
    answer: &Answer,
    surface: &CitySurface,
    colors: &Colors,
    area: [[f64; 2]; 2],
) -> ValuePicture {
    let extent = question.extent;
    let every = extent.size.map(|side| side.div_ceil(MAX_SIDE)).into_iter().max().unwrap_or(1);
    let size = extent.size.map(|side| side.div_ceil(every));
    let pixel = |x: u32, y: u32| {
        let cell = [x, size[1] - 1 - y].map(|k| k * every + every / 2);
        let cell = [0, 1].map(|k| extent.min[k] + cell[k].min(extent.size[k] - 1));
        colors.of_value(answer.tops[surface.extent.index(cell)])
    };
    let pixels = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
    // The last pixels may reach over the border.
    let reach = |k: usize| f64::from(size[k] * every) * surface.cell_m;
    ValuePicture { size, pixels, area: [area[0], [0, 1].map(|k| area[0][k] + reach(k))] }
}

impl Colors {
    fn of(question: &Question, answer: &Answer) -> Self {
        // Of vistas, values are those after the proposal.
        if question.args.proposal.is_some() && question.args.vista.is_none() {
            return Self::of_change(question.args.what, answer);
        }
        let highest = answer.tops.iter().copied().filter(|value| value.is_finite()).fold(0.0, f32::max);
        let ramp = |title: &str, highest: f64, stops: &[[u8; 3]]| {
            let highest = if highest > 0.0 { highest } else { 1.0 };
            Self { title: title.to_owned(), range: Some([0.0, highest]), stops: stops.to_vec(), word: "" }
        };
        let places = |color: [u8; 3], word| Self { title: String::new(), range: None, stops: vec![color], word };
        let asked = answer.asked.map(|asked| format!(" (the rule asks for {asked})")).unwrap_or_default();
        match question.args.what {
            Analysis::Sun if answer.column == "percent" => {
                ramp(&format!("% of probable sunlight{asked}"), f64::from(highest), &STOPS)
            }
            Analysis::Sun => ramp(&format!("hours of sun{asked}"), f64::from(highest), &STOPS),
            Analysis::Sky => ramp("share of the sky", 1.0, &STOPS),
            Analysis::Solar => ramp("kWh/m2 a year", f64::from(highest), &STOPS),
            Analysis::Shadow => places(SHADOW, "shadow"),
            Analysis::View if question.args.vista.is_some() => {
                ramp("metres above the plane", f64::from(highest), &ABOVE)
            }
            Analysis::View if question.args.of.is_some() => ramp("share that is seen", 1.0, &STOPS),
            Analysis::View => places(SEEN, "seen"),
        }
    }

    fn of_change(what: Analysis, answer: &Answer) -> Self {
        let mut sizes: Vec<f32> = answer.tops.iter().map(|value| value.abs()).filter(|size| *size > 1e-3).collect();
        sizes.sort_unstable_by(f32::total_cmp);
        // A few places beside what is new lose all: they would make the rest pale.
        let most = f64::from(sizes.get(sizes.len() * 49 / 50).copied().unwrap_or(1.0));
        let word = match what {
            Analysis::Sun if answer.column == "percent" => "% of probable sunlight",
            Analysis::Sun => "hours of sun",
            Analysis::Sky => "share of the sky",
            Analysis::Solar => "kWh/m2 a year",
            Analysis::Shadow => "shadow: 1 is new",
            Analysis::View => "visibility: 1 is newly visible",
        };
        Self { title: format!("change in {word}"), range: Some([-most, most]), stops: CHANGES.to_vec(), word: "" }
    }

    fn of_value(&self, value: f32) -> ([u8; 3], u8) {
        let first = self.stops.first().copied().unwrap_or_default();
        match self.range {
            _ if value.is_nan() => (first, 0),
            None => (first, if value > 0.5 { OPACITY } else { 0 }),
            Some([low, high]) => {
                let at = ((f64::from(value) - low) / (high - low)).clamp(0.0, 1.0) * (self.stops.len() - 1) as f64;
                let [a, b] = [at.floor(), at.ceil()].map(|at| self.stops[at as usize]);
                let mixed = [0, 1, 2].map(|k| f64::from(a[k]) + (f64::from(b[k]) - f64::from(a[k])) * at.fract());
                (mixed.map(|value| value.round() as u8), OPACITY)
            }
        }
    }

    fn legend(&self) -> Legend {
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
                let none = LegendEntry { rgb: [255; 3], label: "no value".to_owned() };
                (ends.into_iter().chain([none]).collect(), Some(Ramp { range: [low, high], stops }))
            }
        };
        Legend { title: self.title.clone(), titles: Default::default(), unit: None, entries, ramp }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_run_from_end_to_end_and_leave_out_what_has_no_value() {
        let hours = Colors { title: String::new(), range: Some([0.0, 8.0]), stops: STOPS.to_vec(), word: "" };
        assert_eq!([0.0, 8.0, 9.0].map(|value| hours.of_value(value).0), [STOPS[0], STOPS[8], STOPS[8]]);
        assert_eq!((hours.of_value(1.0), hours.of_value(f32::NAN).1), ((STOPS[1], OPACITY), 0));
        let labels: Vec<String> = hours.legend().entries.into_iter().map(|entry| entry.label).collect();
        assert_eq!(labels, ["0.00", "4.00", "8.00", "no value"]);
        let change = Colors { range: Some([-2.0, 2.0]), ..hours };
        let labels: Vec<String> = change.legend().entries.into_iter().map(|entry| entry.label).collect();
        assert_eq!(labels, ["<=-2.00", "0.00", ">=2.00", "no value"]);
        let seen = Colors { title: String::new(), range: None, stops: vec![SEEN], word: "seen" };
        assert_eq!([seen.of_value(1.0).1, seen.of_value(0.0).1], [OPACITY, 0]);
        assert_eq!(seen.legend().entries.len(), 1);
    }
}
