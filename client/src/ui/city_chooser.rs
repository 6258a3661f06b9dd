//! A choice of the cities of a server: name, extent, size, attribution and a picture of each.

use super::{overlay::panel, window_surface::color_image};
use crate::error::ListedCity;
use egui::{Align2, Color32, Context, RichText, ScrollArea, TextureHandle, TextureOptions, Ui, vec2};
use insula_protocol::text::printable;
use insula_shaders::cpu::raycast::Pixels;

/// Width of the list in points.
const WIDTH: f32 = 520.0;
/// Size of a picture in points.
const PICTURE: [f32; 2] = [160.0, 90.0];

/// A small picture of a city.
#[derive(Debug)]
pub struct CityPreview {
    pub name: String,
    /// Extent from west to east and from south to north.
    pub size_m: [f64; 2],
    pub pixels: Pixels,
}

/// The cities and what is known of them.
pub(super) struct CityChooser {
    base: String,
    choices: Vec<CityChoice>,
}

struct CityChoice {
    city: ListedCity,
    size_m: Option<[f64; 2]>,
    picture: Option<TextureHandle>,
}

impl CityChooser {
    /// A choice of the cities of the server at `base`.
    pub(super) fn new(base: String, cities: &[ListedCity]) -> Self {
        let choice = |city: &ListedCity| CityChoice { city: city.clone(), size_m: None, picture: None };
        Self { base, choices: cities.iter().map(choice).collect() }
    }

    /// Adds the picture of a city.
    pub(super) fn add_preview(&mut self, ctx: &Context, preview: &CityPreview) {
        if let Some(choice) = self.choices.iter_mut().find(|choice| choice.city.name == preview.name) {
            choice.size_m = Some(preview.size_m);
            let image = color_image(&preview.pixels);
            choice.picture = Some(ctx.load_texture(format!("city {}", preview.name), image, TextureOptions::LINEAR));
        }
    }

    /// Lays the choice out. Returns the name of a city that was clicked.
    pub(super) fn show(&self, ctx: &Context) -> Option<String> {
        let mut chosen = None;
        panel(ctx, "chooser", Align2::CENTER_CENTER, [0.0, 0.0], |ui| {
            ui.set_max_width(WIDTH.min(ctx.content_rect().width() - 52.0));
            ui.label(RichText::new(printable(&self.base)).strong().size(16.0).color(Color32::WHITE));
            ui.label(format!("{} cities: click one to open it", self.choices.len()));
            ui.separator();
            let height = ctx.content_rect().height() - 130.0;
            ScrollArea::vertical().max_height(height.max(80.0)).show(ui, |ui| {
                for choice in &self.choices {
                    if choice.show(ui) {
                        chosen = Some(choice.city.name.clone());
                    }
                }
            });
        });
        chosen
    }
}

impl CityChoice {
    /// Lays one city out. Returns whether it was clicked.
    fn show(&self, ui: &mut Ui) -> bool {
        let row = ui.scope_builder(egui::UiBuilder::new().sense(egui::Sense::click()), |ui| {
            ui.set_min_width(ui.available_width());
            ui.horizontal(|ui| {
                match &self.picture {
                    Some(picture) => ui.image((picture.id(), vec2(PICTURE[0], PICTURE[1]))),
                    None => ui.add_sized(PICTURE, egui::Spinner::new()),
                };
                ui.vertical(|ui| {
                    let title = if self.city.title.is_empty() { &self.city.name } else { &self.city.title };
                    ui.label(RichText::new(printable(title)).strong().color(Color32::WHITE));
                    for line in self.lines() {
                        ui.label(line);
                    }
                    ui.label(RichText::new(self.attribution()).small());
                });
            });
        });
        let response = row.response;
        if response.hovered() {
            ui.painter().rect_stroke(response.rect, 3.0, (1.0, Color32::WHITE), egui::StrokeKind::Outside);
        }
        ui.add_space(6.0);
        response.clicked()
    }

    fn lines(&self) -> Vec<String> {
        let mut lines = vec![self.city.name.clone()];
        if let Some([width, height]) = self.size_m {
            lines.push(format!("{:.1} x {:.1} km", width / 1000.0, height / 1000.0));
        }
        if self.city.bytes > 0 {
            lines.push(format!("{:.1} MiB", self.city.bytes as f64 / f64::from(1u32 << 20)));
        }
        lines
    }

    fn attribution(&self) -> String {
        let texts: Vec<&str> = self.city.attribution.iter().map(|source| source.text.as_str()).collect();
        printable(&texts.join("; ")).chars().take(200).collect()
    }
}
