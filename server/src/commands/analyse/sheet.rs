//! The PDF sheet of an analysis.

use super::super::error::CommandError;
use super::Question;
use crate::analysis::answer::Answer;
use crate::analysis::colors::Colors;
use crate::analysis::sheet::AnalysisSheet;
use crate::args::Analysis;
use insula_analysis::surface::CitySurface;
use insula_draw::DrawLimits;
use insula_draw::file::{DrawingFormat, pdf_letters, write_drawing};
use std::path::Path;

/// Writes the sheet of an answer. Fails if the city is too large for a drawing, or if the file cannot be written.
pub(super) fn write(
    question: &Question,
    answer: &Answer,
    surface: &CitySurface,
    out: &Path,
) -> Result<(), CommandError> {
    let failed = |error: &dyn std::fmt::Display| CommandError::file(out, error);
    let sheet = AnalysisSheet {
        source: question.source,
        surface,
        answer,
        colors: &colors_of(question, answer),
        extent: question.extent,
        added: &question.added,
        limits: DrawLimits::default(),
    };
    let drawing = sheet.draw(&|_, _| true).map_err(|error| failed(&error))?;
    write_drawing(&drawing, DrawingFormat::Pdf, out).map_err(|error| failed(&error))?;
    pdf_letters(&drawing).messages("").iter().for_each(|message| eprintln!("{message}"));
    Ok(())
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
