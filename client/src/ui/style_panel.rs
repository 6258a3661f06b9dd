//! The panel of colours and filters: how objects are drawn by their attributes.
//!
//! Styles are made from blocks of objects that stay in memory. No tile is fetched again.

use super::object_source::{ObjectWorker, SharedLookup};
use crate::language;
use egui::{Color32, RichText, Sense, Ui, vec2};
use insula_objects::Schema;
use insula_objects::color::{ColorBy, Legend, Ramp};
use insula_objects::filter::NONE_PASSES_IN_VIEW;
use insula_protocol::text::{count, printable};
use insula_viewer::objects::{FilteredOut, ObjectStyles, StyleRules, StyledObjects};

/// What a thread has found.
enum StyleAnswer {
    /// Names of attributes with their titles.
    Attributes(Result<Vec<(String, String)>, String>),
    Styles(Result<StyledObjects, String>),
}

/// Colours, filter and legend.
pub(super) struct StylePanel {
    is_open: bool,
    worker: ObjectWorker<StyleAnswer>,
    /// Names of attributes with their titles; `None` until they are asked for.
    attributes: Option<Vec<(String, String)>>,
    wanted: StyleRules,
    /// What is drawn or being made.
    requested: StyleRules,
    /// Text of the filter while it is typed.
    typed_filter: String,
    /// Smallest and largest value of the attribute.
    full_range: Option<[f64; 2]>,
    legend: Option<Legend>,
    /// Number of objects that pass the filter.
    passing: usize,
    error: Option<String>,
    /// Number of changes of the styles.
    generation: u64,
}

impl StylePanel {
    /// All objects have their own colours.
    pub(super) fn new(objects: SharedLookup) -> Self {
        Self {
            is_open: false,
            worker: ObjectWorker::new(objects),
            attributes: None,
            wanted: StyleRules::default(),
            requested: StyleRules::default(),
            typed_filter: String::new(),
            full_range: None,
            legend: None,
            passing: 0,
            error: None,
            generation: 0,
        }
    }

    /// Shows or hides the controls. What failed is tried again.
    pub(super) fn toggle(&mut self) {
        self.is_open = !self.is_open;
        self.error = None;
    }

    /// Hides the controls. Returns whether they were shown.
    pub(super) fn close(&mut self) -> bool {
        std::mem::take(&mut self.is_open)
    }

    /// Whether there is something to show.
    pub(super) fn is_shown(&self) -> bool {
        self.is_open || self.legend.is_some()
    }

    /// Whether styles or attributes are on their way.
    pub(super) fn is_waiting(&self) -> bool {
        self.worker.is_busy()
    }

    /// Number of changes of the styles.
    pub(super) fn generation(&self) -> u64 {
        self.generation
    }

    /// What explains the colours.
    pub(super) fn legend(&self) -> Option<&Legend> {
        self.legend.as_ref()
    }

    /// Takes in the answer of the thread, and starts a thread if the wanted style has changed. Returns new styles.
    pub(super) fn poll(&mut self) -> Option<ObjectStyles> {
        let mut styles = None;
        if let Some(answer) = self.worker.take() {
            match answer {
                StyleAnswer::Attributes(Ok(names)) => self.attributes = Some(names),
                StyleAnswer::Styles(Ok(styled)) => styles = Some(self.take_styles(styled)),
                StyleAnswer::Attributes(Err(reason)) | StyleAnswer::Styles(Err(reason)) => self.error = Some(reason),
            }
        }
        if self.is_open && !self.worker.is_busy() {
            if self.attributes.is_none() && self.error.is_none() {
                self.start(|objects| {
                    StyleAnswer::Attributes(objects.read(|objects| Ok(titled_names(objects.schema()))))
                });
            } else if self.attributes.is_some() && self.wanted != self.requested {
                self.requested = self.wanted.clone();
                self.error = None;
                let rules = self.requested.clone();
                self.start(move |objects| StyleAnswer::Styles(objects.read(|objects| objects.styles(&rules))));
            }
        }
        styles
    }

    fn take_styles(&mut self, styled: StyledObjects) -> ObjectStyles {
        self.generation += 1;
        self.passing = styled.passing;
        let range = styled.legend.as_ref().and_then(|legend| legend.ramp.as_ref()).map(|ramp| ramp.range);
        if self.requested.range.is_none() {
            self.full_range = range;
        }
        self.legend = styled.legend;
        styled.styles
    }

    fn start(&mut self, work: impl FnOnce(&SharedLookup) -> StyleAnswer + Send + 'static) {
        if let Err(reason) = self.worker.start(work) {
            self.error = Some(reason);
        }
    }

    pub(super) fn show(&mut self, ui: &mut Ui) {
        if self.is_open {
            self.show_controls(ui);
        }
        if let Some(legend) = &self.legend {
            show_legend(ui, legend);
        }
    }

    fn show_controls(&mut self, ui: &mut Ui) {
        ui.label(RichText::new("Colours and filter").strong().color(Color32::WHITE));
        self.show_color(ui);
        ui.horizontal(|ui| {
            ui.label("Filter");
            let hint = "height > 20";
            let field = ui.add(egui::TextEdit::singleline(&mut self.typed_filter).hint_text(hint).desired_width(200.0));
            if field.lost_focus() {
                self.wanted.filter = self.typed_filter.trim().to_owned();
            }
        });
        if !self.requested.filter.is_empty() {
            ui.horizontal(|ui| {
                if self.passing == 0 && !self.worker.is_busy() && self.error.is_none() {
                    ui.label(NONE_PASSES_IN_VIEW);
                    return;
                }
                ui.label(format!("passing: {}; others are", count(self.passing as u64, "object")));
                ui.radio_value(&mut self.wanted.filtered_out, FilteredOut::Ghost, "pale");
                ui.radio_value(&mut self.wanted.filtered_out, FilteredOut::Hide, "hidden");
            });
        }
        if self.worker.is_busy() {
            ui.spinner();
        }
        if let Some(error) = &self.error {
            ui.colored_label(Color32::from_rgb(255, 150, 130), printable(error));
        }
    }

    fn show_color(&mut self, ui: &mut Ui) {
        let names = self.attributes.iter().flatten().map(|(name, title)| (name.as_str(), title.as_str()));
        let before = self.wanted.attribute.clone();
        ui.horizontal(|ui| {
            ui.label("Colour by");
            choose(ui, "attribute", "own colours", names, &mut self.wanted.attribute);
            if !self.wanted.attribute.is_empty() {
                let palettes: Vec<_> = ColorBy::palettes().map(|name| (name, name)).collect();
                choose(ui, "palette", "default palette", palettes.into_iter(), &mut self.wanted.palette);
            }
        });
        if self.wanted.attribute != before {
            (self.wanted.range, self.wanted.up_to, self.full_range) = (None, None, None);
        }
        if let Some([low, high]) = self.full_range {
            self.show_range(ui, [low, high]);
        }
    }

    /// The ends of the palette, and the largest shown value, between the values `low` and `high` of the city.
    fn show_range(&mut self, ui: &mut Ui, [low, high]: [f64; 2]) {
        ui.horizontal(|ui| {
            ui.label("From");
            let mut range = self.wanted.range.unwrap_or([low, high]);
            let speed = ((high - low) / 200.0).max(f64::MIN_POSITIVE);
            ui.add(egui::DragValue::new(&mut range[0]).speed(speed).range(low..=high));
            ui.label("to");
            ui.add(egui::DragValue::new(&mut range[1]).speed(speed).range(low..=high));
            self.wanted.range = Some(range).filter(|range| *range != [low, high]);
        });
        ui.horizontal(|ui| {
            let mut is_limited = self.wanted.up_to.is_some();
            ui.checkbox(&mut is_limited, "Only up to").on_hover_text("with years, the city grows");
            let mut value = self.wanted.up_to.unwrap_or(high);
            if is_limited {
                ui.add(egui::Slider::new(&mut value, low..=high).step_by(if high - low > 50.0 { 1.0 } else { 0.0 }));
            }
            self.wanted.up_to = is_limited.then_some(value);
        });
    }
}

/// Names by which objects can be coloured, with the titles that people read. Hidden attributes are left out.
fn titled_names(schema: &Schema) -> Vec<(String, String)> {
    let language = language::of_environment();
    let names = schema.names_to_color_by().into_iter().filter(|name| schema.is_shown(name));
    names.map(|name| (name.clone(), schema.title_of(&name, &language).to_owned())).collect()
}

/// A list to choose from, names with their titles. The first entry, `none`, is an empty text.
fn choose<'a>(
    ui: &mut Ui,
    id: &str,
    none: &str,
    names: impl Iterator<Item = (&'a str, &'a str)> + Clone,
    chosen: &mut String,
) {
    let title = names.clone().find(|(name, _)| *name == chosen).map_or(chosen.as_str(), |(_, title)| title);
    let label = if chosen.is_empty() { none.to_owned() } else { printable(title).into_owned() };
    egui::ComboBox::from_id_salt(id).selected_text(label).show_ui(ui, |ui| {
        ui.selectable_value(chosen, String::new(), none);
        for (name, title) in names {
            ui.selectable_value(chosen, name.to_owned(), printable(title));
        }
    });
}

fn show_legend(ui: &mut Ui, legend: &Legend) {
    let unit = legend.unit.as_ref().map(|unit| format!(" ({unit})")).unwrap_or_default();
    ui.label(RichText::new(printable(&format!("{}{unit}", legend.title))).strong());
    if let Some(Ramp { stops, .. }) = &legend.ramp {
        let (rect, _) = ui.allocate_exact_size(vec2(180.0, 10.0), Sense::hover());
        let width = rect.width() / stops.len().max(1) as f32;
        for (i, [r, g, b]) in stops.iter().enumerate() {
            let left = rect.left_top() + vec2(width * i as f32, 0.0);
            let stop = egui::Rect::from_min_size(left, vec2(width, rect.height()));
            ui.painter().rect_filled(stop, 0.0, Color32::from_rgb(*r, *g, *b));
        }
    }
    for entry in &legend.entries {
        ui.horizontal(|ui| {
            let [r, g, b] = entry.rgb;
            let (rect, _) = ui.allocate_exact_size(vec2(12.0, 12.0), Sense::hover());
            ui.painter().rect_filled(rect, 2.0, Color32::from_rgb(r, g, b));
            ui.label(printable(&entry.label));
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ClientError;

    fn panel() -> StylePanel {
        StylePanel::new(SharedLookup::new(Box::new(|| Err(ClientError::Failed("no objects here".into())))))
    }

    #[test]
    fn a_failure_is_shown_with_its_reason_and_ends_the_wait() {
        let mut panel = panel();
        assert!(panel.poll().is_none() && !panel.is_waiting());
        panel.toggle();
        panel.poll();
        while panel.is_waiting() {
            panel.poll();
            std::thread::yield_now();
        }
        assert!(panel.error.as_deref().is_some_and(|reason| reason.contains("no objects here")));
        assert_eq!(panel.generation(), 0);
    }
}
