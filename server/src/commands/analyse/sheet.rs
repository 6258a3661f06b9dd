//! The PDF sheet of an analysis: the plan of the city under the colours of the values.

use super::super::error::CommandError;
use super::Question;
use crate::analysis::answer::Answer;
use crate::analysis::colors::Colors;
use crate::analysis::samples::Samples;
use crate::args::Analysis;
use insula_analysis::surface::CitySurface;
use insula_draw::file::{DrawingFormat, pdf_letters, write_drawing};
use insula_draw::picture::{ValuePicture, lay, outline};
use insula_draw::view::DrawView;
use insula_draw::{DrawRequest, draw};
use insula_export::raster::CellExtent;
use insula_export::selection::ObjectSelection;
use std::path::Path;

/// Longest side of the picture in pixels. Larger areas show every second cell, or fewer.
const MAX_SIDE: u32 = 4096;

/// Writes the sheet of an answer. Fails if the city is too large for a drawing, or if the file cannot be written.
pub(super) fn write(
    question: &Question,
    answer: &Answer,
    surface: &CitySurface,
    out: &Path,
) -> Result<(), CommandError> {
    let failed = |error: &dyn std::fmt::Display| CommandError::file(out, error);
    let area = area(question, surface);
    let request = DrawRequest {
        view: DrawView::Plan,
        selection: ObjectSelection { bbox: Some(area), ..ObjectSelection::default() },
        title: Some(format!("{}: {}", question.source.manifest().title, answer.title)),
        note: "Values are those of the legend; the drawing below them is lit from the upper left.".to_owned(),
        ..DrawRequest::default()
    };
    let mut drawing = draw(question.source, &request, &|_, _| true).map_err(|error| failed(&error))?;
    let colors = colors_of(question, answer);
    let picture = picture(question, answer, surface, &colors, area);
    outline(&mut drawing, &question.added);
    let what_is_added = (!question.added.is_empty()).then(|| "what is added is outlined".to_owned());
    let notes: Vec<String> = answer.notes.iter().cloned().chain(what_is_added).collect();
    lay(&mut drawing, picture, &colors.legend(), &notes);
    write_drawing(&drawing, DrawingFormat::Pdf, out).map_err(|error| failed(&error))?;
    pdf_letters(&drawing).messages("").iter().for_each(|message| eprintln!("{message}"));
    Ok(())
}

/// The cells of the result in world metres.
fn area(question: &Question, surface: &CitySurface) -> [[f64; 2]; 2] {
    let CellExtent { min, size } = question.extent;
    [surface.corner_of(min), surface.corner_of([0, 1].map(|k| min[k] + size[k]))]
}

fn colors_of(question: &Question, answer: &Answer) -> Colors {
    let args = question.args;
    match args.what {
        // Of vistas, values are those after the proposal.
        Analysis::View if args.vista.is_some() => Colors::of_vista(answer),
        what if answer.is_change => Colors::of_change(what, answer),
        Analysis::View if args.of.is_some() => Colors::of_share_seen(),
        what => Colors::of(what, answer),
    }
}

fn picture(
    question: &Question,
    answer: &Answer,
    surface: &CitySurface,
    colors: &Colors,
    area: [[f64; 2]; 2],
) -> ValuePicture {
    let samples = Samples::of(question.extent, MAX_SIDE);
    let size = samples.size;
    let pixel = |x: u32, y: u32| {
        let cell = samples.cell([x, size[1] - 1 - y]);
        colors.of_value(answer.tops[surface.extent.index(cell)])
    };
    let pixels = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
    // The last pixels may reach over the border.
    let reach = |k: usize| f64::from(size[k] * samples.every) * surface.cell_m;
    ValuePicture { size, pixels, area: [area[0], [0, 1].map(|k| area[0][k] + reach(k))] }
}
