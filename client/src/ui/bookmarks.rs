//! The panel of bookmarks and coordinates.

use super::settings::Bookmark;
use egui::{Color32, Key, RichText, TextEdit, Ui};
use glam::DVec3;
use insula_command_line::camera::{EarthCamera, of_link};
use insula_protocol::Manifest;
use insula_protocol::earth::grid_position;
use insula_viewer::camera::Camera;
use insula_viewer::camera_text;

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
    /// Look from a camera.
    SetCamera(Camera),
    /// Select an object and go to it.
    SelectObject(u32),
    /// Select no object.
    DeselectObjects,
    /// Copy a link to the current view.
    CopyLink,
    /// Write a camera file into the current folder.
    SaveCamera,
    /// Turn to the north.
    NorthUp,
    /// Save a picture of the chosen size.
    SavePicture,
    /// Show the city with the proposal, or as it is.
    ToggleProposal,
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
            if ui.button("Save camera").on_hover_text("a file for --camera of other commands").clicked() {
                action = Some(ViewAction::SaveCamera);
            }
        });
        ui.separator();
        let crs = manifest.crs.as_deref().unwrap_or("metres in the source's coordinates");
        ui.label(format!("Go to x, y or x, y, z ({crs}), degrees, or a copied link or camera"));
        let [low, high] = manifest.bounds;
        let hint = [0, 1].map(|axis| format!("{:.0}", 0.5 * (low[axis] + high[axis]))).join(", ");
        let field = ui.add(TextEdit::singleline(&mut self.coordinates).hint_text(hint).desired_width(200.0));
        if field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
            match parse_place(&self.coordinates, manifest) {
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

/// Parses two or three numbers between commas, semicolons or spaces, in metres or, in either order, degrees; the five or six of a camera in
/// degrees or the six of one in metres; or a copied link. Fails if they are far from the city.
fn parse_place(text: &str, manifest: &Manifest) -> Result<ViewAction, String> {
    if let Some(camera) = of_link(text).and_then(camera_text::of_numbers) {
        return Ok(ViewAction::SetCamera(camera));
    }
    let parts = text.split([',', ';', ' ', '\t']).filter(|part| !part.is_empty());
    let numbers: Vec<f64> =
        parts.map(|n| n.parse().map_err(|_| format!("{n:.40} is not a number"))).collect::<Result<_, _>>()?;
    let (x, y, z) = match numbers[..] {
        [x, y] => (x, y, None),
        [x, y, z] => (x, y, Some(z)),
        [_, _, _, _, _] | [_, _, _, _, _, _] => {
            let on_earth = EarthCamera::of_numbers(&numbers).and_then(|typed| typed.in_city(manifest).ok());
            let camera = on_earth.or_else(|| numbers.as_slice().try_into().ok()).and_then(camera_text::of_numbers);
            return camera.map(ViewAction::SetCamera).ok_or_else(|| {
                "not a camera: longitude, latitude, height, heading, pitch, field of view, or those of a link".into()
            });
        }
        _ => return Err("expected two or three numbers, or those of a camera".into()),
    };
    let [low, high] = manifest.bounds.map(DVec3::from);
    let is_near = |[x, y]: &[f64; 2]| {
        let point = DVec3::new(*x, *y, z.unwrap_or(manifest.ground_z_m));
        point.distance((low + high) * 0.5) <= (high - low).length() * MAX_DIAGONALS
    };
    let on_earth = |[lon, lat]: [f64; 2]| {
        let is_on_earth = lon.abs() <= 180.0 && lat.abs() <= 90.0;
        is_on_earth.then(|| grid_position(manifest, [lon, lat])).flatten()
    };
    let meant = [Some([x, y]), on_earth([x, y]), on_earth([y, x])].into_iter().flatten().find(is_near);
    meant.map(|[x, y]| ViewAction::GoTo { x, y, z }).ok_or_else(|| {
        format!("far from the city, which has x {:.0} to {:.0}, y {:.0} to {:.0}", low.x, high.x, low.y, high.y)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::manifest::GeoLocation;

    #[test]
    fn coordinates_may_be_separated_in_several_ways() {
        let manifest = insula_test_support::small_city::empty_manifest(0);
        let parse = |text: &str| parse_place(text, &manifest);
        assert_eq!(parse("10, 20"), Ok(ViewAction::GoTo { x: 10.0, y: 20.0, z: None }));
        assert_eq!(parse(" 10.5;20  3 "), Ok(ViewAction::GoTo { x: 10.5, y: 20.0, z: Some(3.0) }));
        for invalid in ["", "1", "1,2,3,4", "a,b", "NaN,0", "inf 0", "1e9,0"] {
            assert!(parse(invalid).is_err(), "{invalid}");
        }
    }

    #[test]
    fn degrees_and_cameras_are_places() {
        let location = GeoLocation { longitude_deg: 4.3571, latitude_deg: 52.0116, north_deg: 0.0 };
        let bounds = [[84_000.0, 446_000.0, 0.0], [86_000.0, 448_000.0, 90.0]];
        let focus = bounds.map(|[x, y, _]| [x, y]);
        let empty = insula_test_support::small_city::empty_manifest(0);
        let manifest = Manifest { location: Some(location), focus, bounds, ..empty };
        for text in ["4.3571, 52.0116", "52.0116 4.3571"] {
            let place = parse_place(text, &manifest);
            assert_eq!(place, Ok(ViewAction::GoTo { x: 85_000.0, y: 447_000.0, z: None }), "{text}");
        }
        let camera = |text: &str| -> Result<_, String> { Ok(ViewAction::SetCamera(camera_text::parse(text).unwrap())) };
        let text = "84500,446500,80,45,-10,60";
        assert_eq!(parse_place(text, &manifest), camera(text));
        assert_eq!(parse_place(&format!("insula://h/v1/cities/a?camera={text}"), &manifest), camera(text));
        for typed in ["4.3571,52.0116,80,45,-10", "4.3571 52.0116 80 45 -10 60"] {
            assert_eq!(parse_place(typed, &manifest), camera("85000,447000,80,45,-10,60"), "{typed}");
        }
        assert!(parse_place("84500,446500,80,45,-100,60", &manifest).is_err());
        assert!(parse_place("84500,446500,80,45,-10", &manifest).is_err());
    }
}
