//! The panel of stones: sliders for what landmarks are made of.
//!
//! A change is seen in the next frame, because stones are evaluated where rays meet them. "Copy as JSON" gives the parameters as a
//! landmark's `stone` takes them.

use egui::{Color32, RichText, Ui};
use glam::Vec3;
use insula_shaders::cpu::shade::encode_srgb;
use insula_shaders::stone::{MAX_OCTAVES, PRESETS, Stone, StoneParameters};
use std::ops::RangeInclusive;

/// The stones of a city, as the user has changed them.
#[derive(Debug, Default)]
pub(super) struct StonePanel {
    pub(super) is_open: bool,
    stones: Vec<StoneParameters>,
    selected: usize,
    generation: u64,
}

impl StonePanel {
    /// The stones of a manifest. One that this version does not know begins as the first preset.
    pub(super) fn new(texts: &[String]) -> Self {
        let parameters = |text: &String| {
            let known = serde_json::from_str::<StoneParameters>(text).ok().filter(|stone| stone.stone().is_ok());
            known.unwrap_or_else(|| StoneParameters { preset: PRESETS[0].0.into(), ..StoneParameters::default() })
        };
        Self { stones: texts.iter().map(parameters).collect(), ..Self::default() }
    }

    pub(super) fn generation(&self) -> u64 {
        self.generation
    }

    /// Lays the panel out. Returns a stone that the user has changed, and its number.
    pub(super) fn show(&mut self, ui: &mut Ui) -> Option<(usize, Stone)> {
        ui.label(RichText::new("Stones of landmarks").strong().color(Color32::WHITE));
        if self.stones.is_empty() {
            ui.label("no landmark of this city is of stone");
            return None;
        }
        self.selected = self.selected.min(self.stones.len() - 1);
        if self.stones.len() > 1 {
            ui.horizontal_wrapped(|ui| {
                for (number, stone) in self.stones.iter().enumerate() {
                    ui.selectable_value(&mut self.selected, number, format!("{} {}", number + 1, stone.preset));
                }
            });
        }
        let parameters = &mut self.stones[self.selected];
        let before = parameters.clone();
        show_parameters(ui, parameters);
        if ui.button("Copy as JSON").clicked() {
            ui.ctx().copy_text(serde_json::to_string_pretty(parameters).unwrap_or_default());
        }
        if *parameters == before {
            return None;
        }
        match parameters.stone() {
            Ok(stone) => {
                self.generation += 1;
                Some((self.selected, stone))
            }
            Err(_) => {
                *parameters = before;
                None
            }
        }
    }
}

fn show_parameters(ui: &mut Ui, parameters: &mut StoneParameters) {
    egui::ComboBox::from_id_salt("preset").selected_text(&parameters.preset).show_ui(ui, |ui| {
        for (name, _) in PRESETS {
            if ui.selectable_label(parameters.preset == name, name).clicked() {
                *parameters = StoneParameters { preset: name.into(), ..StoneParameters::default() };
            }
        }
    });
    let Ok(stone) = parameters.stone() else { return };
    slider(ui, "size of the pattern, m", &mut parameters.scale_m, 1.0 / stone.cells_per_m, 0.001..=10.0);
    let mut octaves = stone.octaves;
    if ui.add(egui::Slider::new(&mut octaves, 1..=MAX_OCTAVES).text("octaves")).changed() {
        parameters.octaves = Some(octaves);
    }
    slider(ui, "width of veins", &mut parameters.vein_width, stone.vein_width, 0.005..=0.2);
    slider(ui, "variation", &mut parameters.variation, stone.variation, 0.0..=1.0);
    slider(ui, "bending", &mut parameters.bend, stone.bend, 0.0..=1.0);
    for (k, text) in ["first share", "second share"].into_iter().enumerate() {
        pair_slider(ui, text, &mut parameters.blend, stone.blend, k, 0.0..=1.0);
    }
    for (k, text) in ["roughness along", "roughness across"].into_iter().enumerate() {
        pair_slider(ui, text, &mut parameters.roughness, stone.alpha, k, 0.02..=1.0);
    }
    slider(ui, "way of light in it", &mut parameters.scattering_scale, stone.scattering_scale, 0.0..=100.0);
    ui.horizontal(|ui| {
        colour(ui, "ground", &mut parameters.base, stone.base);
        colour(ui, "veins", &mut parameters.vein, stone.vein);
        colour(ui, "grains", &mut parameters.grain, stone.grain);
        colour(ui, "gloss", &mut parameters.f0, stone.f0);
    });
}

/// A slider of a value that is the preset's until it is moved. Wide ranges are logarithmic.
fn slider(ui: &mut Ui, text: &str, value: &mut Option<f32>, current: f32, range: RangeInclusive<f32>) {
    let mut moved = current;
    let is_wide = *range.end() > 1.0;
    let slider = egui::Slider::new(&mut moved, range).logarithmic(is_wide).text(text);
    if ui.add(slider).changed() {
        *value = Some(moved);
    }
}

/// The same for one of two values.
fn pair_slider(
    ui: &mut Ui,
    text: &str,
    values: &mut Option<[f32; 2]>,
    current: [f32; 2],
    place: usize,
    range: RangeInclusive<f32>,
) {
    let mut one = None;
    slider(ui, text, &mut one, current[place], range);
    if let Some(moved) = one {
        let mut both = current;
        both[place] = moved;
        *values = Some(both);
    }
}

/// A button with a colour, as `#rrggbb`.
fn colour(ui: &mut Ui, text: &str, value: &mut Option<String>, current: [f32; 3]) {
    let [r, g, b, _] = encode_srgb(Vec3::from(current)).to_le_bytes();
    let mut rgb = [r, g, b];
    ui.label(text);
    if ui.color_edit_button_srgb(&mut rgb).changed() {
        let [r, g, b] = rgb;
        *value = Some(format!("#{r:02x}{g:02x}{b:02x}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_city_without_known_stones_has_a_panel() {
        let texts = [r#"{"preset":"bronze","bend":0.1}"#, "not JSON", r#"{"preset":"cheese"}"#].map(String::from);
        let panel = StonePanel::new(&texts);
        let presets: Vec<&str> = panel.stones.iter().map(|stone| stone.preset.as_str()).collect();
        assert_eq!(presets, ["bronze", PRESETS[0].0, PRESETS[0].0]);
        assert_eq!(panel.stones[0].bend, Some(0.1));
    }

    #[test]
    fn sliders_that_are_not_moved_change_nothing() {
        let mut panel = StonePanel { is_open: true, ..StonePanel::new(&[r#"{"preset":"limestone"}"#.into()]) };
        let context = egui::Context::default();
        let mut changed = None;
        for _ in 0..2 {
            let mut output = context.run_ui(egui::RawInput::default(), |ui| changed = panel.show(ui));
            output.textures_delta.clear();
        }
        assert!(changed.is_none() && panel.generation() == 0);
        assert_eq!(serde_json::to_string(&panel.stones[0]).unwrap(), r#"{"preset":"limestone"}"#);
    }
}
