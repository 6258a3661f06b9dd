//! The panel that is always there: compass, scale bar, coordinates, and what is being loaded.

use super::overlay::{has_room, panel};
use super::{compass, scale_bar};
use egui::{Align2, Context, Label, RichText};

/// Width of the texts, in points: that of coordinates in metres.
const MIN_WIDTH: f32 = 250.0;

/// What the panel shows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Furniture {
    /// View direction in radians from east to north.
    pub yaw_rad: f64,
    /// Scale at the pointer or, without one, in the middle of the window; `None` for the sky.
    pub metres_per_point: Option<f64>,
    pub has_pointer: bool,
    /// Coordinates under the pointer.
    pub coordinates: Option<String>,
    /// What the window works on, such as tiles that are missing.
    pub works: Vec<String>,
}

/// Lays the panel out. Returns whether the compass was clicked.
pub fn show(ctx: &Context, content: &Furniture) -> bool {
    let mut is_clicked = false;
    panel(ctx, "furniture", Align2::LEFT_BOTTOM, [10.0, -10.0], |ui| {
        ui.horizontal(|ui| {
            is_clicked = compass::show(ui, content.yaw_rad);
            ui.vertical(|ui| {
                let place = if content.has_pointer { "at the pointer" } else { "in the middle" };
                scale_bar::show(ui, content.metres_per_point, place);
                if !has_room(ctx.content_rect().size()) {
                    return;
                }
                // Both lines are always there, so that the panel keeps its size.
                let works = content.works.join("; ");
                for text in [content.coordinates.as_deref().unwrap_or_default(), &works] {
                    ui.add(Label::new(RichText::new(text).size(12.5)).extend());
                }
                ui.set_min_width(MIN_WIDTH);
            });
        });
    });
    is_clicked
}
