//! A choice of the cities of a server: name, extent, size, attribution and a picture of each.

use super::overlay::panel;
use super::window_surface::color_image;
use crate::error::ListedCity;
use egui::{Align2, Color32, Context, RichText, ScrollArea, TextureHandle, TextureOptions, Ui};
use insula_protocol::text::printable;
use insula_shaders::cpu::raycast::Pixels;

/// Width of the list in points.
const WIDTH: f32 = 520.0;
/// Size of a picture in points.
const PICTURE: [f32; 2] = [160.0, 90.0];

/// A small picture of a city.
#[derive(Debug)]
pub struct CityPreview {
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
    picture: ChoicePicture,
}

enum ChoicePicture {
    Loading,
    Loaded(TextureHandle),
    /// The city cannot be drawn, or there are too many.
    None,
}

impl CityChooser {
    /// A choice of the cities of the server at `base`. Pictures are being drawn of the first `pictures` cities.
    pub(super) fn new(base: String, cities: &[ListedCity], pictures: usize) -> Self {
        let choice = |(i, city): (usize, &ListedCity)| {
            let picture = if i < pictures { ChoicePicture::Loading } else { ChoicePicture::None };
            CityChoice { city: city.clone(), size_m: None, picture }
        };
        Self { base, choices: cities.iter().enumerate().map(choice).collect() }
    }

    /// Takes in the picture of the named city; `None` if it cannot be drawn.
    pub(super) fn add_preview(&mut self, ctx: &Context, name: &str, preview: Option<&CityPreview>) {
        let Some(choice) = self.choices.iter_mut().find(|choice| choice.city.name == name) else { return };
        tracing::debug!(is_drawn = preview.is_some(), "picture of {name}");
        choice.size_m = preview.map(|preview| preview.size_m);
        choice.picture = match preview.map(|preview| color_image(&preview.pixels)) {
            Some(image) => {
                ChoicePicture::Loaded(ctx.load_texture(format!("city {name}"), image, TextureOptions::LINEAR))
            }
            None => ChoicePicture::None,
        };
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
                    ChoicePicture::Loaded(picture) => ui.image((picture.id(), PICTURE.into())),
                    ChoicePicture::Loading => ui.add_sized(PICTURE, egui::Spinner::new()),
                    ChoicePicture::None => ui.add_sized(PICTURE, egui::Label::new("no picture")),
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
