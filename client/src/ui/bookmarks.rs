//! The panel of bookmarks and coordinates.

use super::settings::Bookmark;
use egui::{Color32, Key, RichText, TextEdit, Ui};
use glam::DVec3;
use insula_protocol::Manifest;

/// Coordinates must lie within this multiple of the city's diagonal around its centre.
const MAX_DIAGONALS: f64 = 3.0;

/// Change of the view that a panel asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ViewAction {
    /// Go to the bookmark of this index.
    OpenBookmark(usize),
    /// Delete the bookmark of this index.
    DeleteBookmark(usize),
    /// Bookmark the current view.
    AddBookmark,
    /// Centre a point in the view; on the ground if `z` is `None`.
    GoTo { x: f64, y: f64, z: Option<f64> },
    /// Select an object and go to it.
    SelectObject(u32),
    /// Select no object.
    DeselectObjects,
    /// Copy a link to the current view.
    CopyLink,
    /// Turn to the north.
    NorthUp,
    /// Save a picture of the chosen size.
    SavePicture,
}

/// State of the panel.
#[derive(Debug, Clone, Default)]
pub struct BookmarkPanel {
    pub is_open: bool,
    /// Text of the coordinate field.
    coordinates: String,
    error: Option<String>,
}

impl BookmarkPanel {
    /// Lays the panel out. Returns what the user asked for.
    pub fn show(&mut self, ui: &mut Ui, bookmarks: &[Bookmark], manifest: &Manifest) -> Option<ViewAction> {
        let mut action = None;
        ui.label(RichText::new("Bookmarks").strong().color(Color32::WHITE));
        egui::ScrollArea::vertical().max_height(220.0).show(ui, |ui| {
            for (i, bookmark) in bookmarks.iter().enumerate() {
                ui.horizontal(|ui| {
                    if ui.button(&bookmark.name).clicked() {
                        action = Some(ViewAction::OpenBookmark(i));
                    }
                    if ui.small_button("x").on_hover_text("delete").clicked() {
                        action = Some(ViewAction::DeleteBookmark(i));
                    }
                });
            }
        });
        ui.horizontal(|ui| {
            if ui.button("Bookmark this view").clicked() {
                action = Some(ViewAction::AddBookmark);
            }
            if ui.button("Copy link").clicked() {
                action = Some(ViewAction::CopyLink);
            }
        });
        ui.separator();
        let crs = manifest.crs.as_deref().unwrap_or("metres in the source's coordinates");
        ui.label(format!("Go to x, y or x, y, z ({crs})"));
        let field = ui.add(TextEdit::singleline(&mut self.coordinates).hint_text("85000, 447000").desired_width(200.0));
        if field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
            match parse_coordinates(&self.coordinates, manifest) {
                Ok(go_to) => (action, self.error) = (Some(go_to), None),
                Err(error) => self.error = Some(error),
            }
        }
        if let Some(error) = &self.error {
            ui.label(RichText::new(error).color(Color32::LIGHT_RED));
        }
        action
    }
}

/// Parses two or three numbers between commas, semicolons or spaces. Fails if they are far from the city.
fn parse_coordinates(text: &str, manifest: &Manifest) -> Result<ViewAction, String> {
    let parts = text.split([',', ';', ' ', '\t']).filter(|part| !part.is_empty());
    let numbers: Vec<f64> =
        parts.map(|n| n.parse().map_err(|_| format!("{n:.40} is not a number"))).collect::<Result<_, _>>()?;
    let (x, y, z) = match numbers[..] {
        [x, y] => (x, y, None),
        [x, y, z] => (x, y, Some(z)),
        _ => return Err("expected two or three numbers".into()),
    };
    let [low, high] = manifest.bounds.map(DVec3::from);
    let point = DVec3::new(x, y, z.unwrap_or(manifest.ground_z_m));
    let is_near = point.distance((low + high) * 0.5) <= (high - low).length() * MAX_DIAGONALS;
    if is_near {
        return Ok(ViewAction::GoTo { x, y, z });
    }
    Err(format!("far from the city, which has x {:.0} to {:.0}, y {:.0} to {:.0}", low.x, high.x, low.y, high.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_may_be_separated_in_several_ways() {
        let manifest = insula_test_support::small_city::empty_manifest(0);
        let parse = |text: &str| parse_coordinates(text, &manifest);
        assert_eq!(parse("10, 20"), Ok(ViewAction::GoTo { x: 10.0, y: 20.0, z: None }));
        assert_eq!(parse(" 10.5;20  3 "), Ok(ViewAction::GoTo { x: 10.5, y: 20.0, z: Some(3.0) }));
        for invalid in ["", "1", "1,2,3,4", "a,b", "NaN,0", "inf 0", "1e9,0"] {
            assert!(parse(invalid).is_err(), "{invalid}");
        }
    }
}
