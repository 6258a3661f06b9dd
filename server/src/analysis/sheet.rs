//! The sheet of paper of an analysis: the plan of the city under the colours of the values.

use super::answer::Answer;
use super::colors::Colors;
use super::samples::Samples;
use insula_analysis::surface::CitySurface;
use insula_draw::drawing::Drawing;
use insula_draw::error::DrawProgress;
use insula_draw::picture::{ValuePicture, lay, outline};
use insula_draw::view::DrawView;
use insula_draw::{DrawError, DrawLimits, DrawRequest, draw};
use insula_export::raster::CellExtent;
use insula_export::selection::ObjectSelection;
use insula_export::source::ExportSource;

/// Longest side of the picture in pixels. Larger areas show every second cell, or fewer.
const MAX_SIDE: u32 = 4096;

/// What a sheet is made of.
pub(crate) struct AnalysisSheet<'a> {
    pub(crate) source: &'a dyn ExportSource,
    pub(crate) surface: &'a CitySurface,
    /// Of the cells of the surface.
    pub(crate) answer: &'a Answer,
    pub(crate) colors: &'a Colors,
    /// The cells of the result.
    pub(crate) extent: CellExtent,
    /// Borders of what a proposal adds, in world metres.
    pub(crate) added: &'a [Vec<[f64; 2]>],
    pub(crate) limits: DrawLimits,
}

impl AnalysisSheet<'_> {
    /// Draws it. Fails if the city cannot be read, if there is nothing or too much to draw, or if `progress` stops it.
    pub(crate) fn draw(&self, progress: DrawProgress<'_>) -> Result<Drawing, DrawError> {
        let area = self.area();
        let request = DrawRequest {
            view: DrawView::Plan,
            selection: ObjectSelection { bbox: Some(area), ..ObjectSelection::default() },
            title: Some(format!("{}: {}", self.source.manifest().title, self.answer.title)),
            note: "Values are those of the legend; the drawing below them is lit from the upper left.".to_owned(),
            limits: self.limits,
            ..DrawRequest::default()
        };
        let mut drawing = draw(self.source, &request, progress)?;
        outline(&mut drawing, self.added);
        let what_is_added = (!self.added.is_empty()).then(|| "what is added is outlined".to_owned());
        let notes: Vec<String> = self.answer.notes.iter().cloned().chain(what_is_added).collect();
        lay(&mut drawing, self.picture(area), &self.colors.legend(), &notes);
        Ok(drawing)
    }

    /// The cells of the result in world metres.
    fn area(&self) -> [[f64; 2]; 2] {
        let CellExtent { min, size } = self.extent;
        [self.surface.corner_of(min), self.surface.corner_of([0, 1].map(|k| min[k] + size[k]))]
    }

    fn picture(&self, area: [[f64; 2]; 2]) -> ValuePicture {
        let samples = Samples::of(self.extent, MAX_SIDE);
        let size = samples.size;
        let pixel = |x: u32, y: u32| {
            let cell = samples.cell([x, size[1] - 1 - y]);
            self.colors.of_value(self.answer.tops[self.surface.extent.index(cell)])
        };
        let pixels = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
        // The last pixels may reach over the border.
        let reach = |k: usize| f64::from(size[k] * samples.every) * self.surface.cell_m;
        ValuePicture { size, pixels, area: [area[0], [0, 1].map(|k| area[0][k] + reach(k))] }
    }
}
