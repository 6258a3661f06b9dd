//! The panel that is always there: compass, scale bar, coordinates, and what is being loaded.

use super::{compass, overlay::panel, scale_bar};
use egui::{Align2, Color32, Context, RichText};

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
                ui.label(RichText::new(content.coordinates.as_deref().unwrap_or_default()).size(12.5));
            });
        });
        for work in &content.works {
            ui.label(RichText::new(work).size(12.5).color(Color32::WHITE));
        }
    });
    is_clicked
}
