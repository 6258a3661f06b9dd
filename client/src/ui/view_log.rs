//! What the window reports of its frames and panels in the log. Tests and measurements wait for these lines.

use super::city_view::CityView;
use super::minimap;
use super::overlay::has_room;
use insula_viewer::camera::Camera;
use insula_viewer::camera_text;
use std::time::Duration;

/// The reports of a viewed city.
#[derive(Debug, Default)]
pub(super) struct ViewLog {
    /// Number of final frames so far.
    settled: u64,
    /// The panels that were shown last.
    panels: Vec<&'static str>,
}

impl ViewLog {
    /// The final frame of a view is on the screen.
    pub(super) fn settled(&mut self, camera: &Camera, [width_px, height_px]: [u32; 2], since_change: Duration) {
        self.settled += 1;
        let since_change_ms = since_change.as_secs_f64() * 1e3;
        let camera = camera_text::format(camera);
        tracing::debug!(since_change_ms, frame = self.settled, %camera, width_px, height_px, "frame settled");
    }

    /// Nothing is left to draw or to fetch for the view.
    pub(super) fn rests(&self) {
        tracing::debug!(frame = self.settled, "idle prefetch done");
    }

    /// A frame with the panels of `city` was presented in a window of a size, in points.
    pub(super) fn presented(&mut self, city: &CityView, size: egui::Vec2) {
        let panels = open_panels(city, size);
        if self.panels != panels {
            tracing::debug!(open = %panels.join(","), "panels shown");
            self.panels = panels;
        }
    }
}

/// Names of the panels that the user can show or hide, as far as they are shown.
fn open_panels(city: &CityView, size: egui::Vec2) -> Vec<&'static str> {
    let CityView { display, bookmark_panel, measure, objects, search, styles, stones, .. } = city;
    let panels = [
        ("sliders", display.shows_sliders && has_room(size)),
        ("map", display.shows_map && minimap::side(size).is_some()),
        ("help", display.shows_help),
        ("objects", !objects.selected().is_empty()),
        ("search", search.is_open),
        ("styles", styles.is_shown()),
        ("stones", stones.is_open),
        ("bookmarks", bookmark_panel.is_open),
        ("measure", measure.is_active),
    ];
    panels.into_iter().filter(|(_, is_open)| *is_open).map(|(name, _)| name).collect()
}
