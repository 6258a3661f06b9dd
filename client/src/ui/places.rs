//! Views to go to: bookmarks, coordinates, the link.
//!
//! In: the city's bookmarks, what is typed. Out: [`Wish`]. Next: `city` does it.

use super::settings::Bookmark;
use egui::{Color32, Key, RichText, TextEdit, Ui};
use glam::DVec3;
use insula_protocol::Manifest;

/// Diagonals around the city that one may go to.
const AROUND: f64 = 3.0;

/// What the user wants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wish {
    /// Go to a bookmark.
    Visit(usize),
    /// Forget a bookmark.
    Forget(usize),
    /// Keep this view.
    Keep,
    /// Put a place into the middle of the picture; without a height, on the ground.
    Go([f64; 2], Option<f64>),
    /// Copy a link to this view.
    Link,
}

/// The panel's own state.
#[derive(Debug, Clone, Default)]
pub struct Places {
    /// Whether it is shown.
    pub open: bool,
    typed: String,
    wrong: Option<String>,
}

impl Places {
    /// Lays the panel out.
    pub fn show(&mut self, ui: &mut Ui, bookmarks: &[Bookmark], manifest: &Manifest) -> Option<Wish> {
        let mut wish = None;
        ui.label(RichText::new("Bookmarks").strong().color(Color32::WHITE));
        egui::ScrollArea::vertical().max_height(220.0).show(ui, |ui| {
            for (i, bookmark) in bookmarks.iter().enumerate() {
                ui.horizontal(|ui| {
                    if ui.button(&bookmark.name).clicked() {
                        wish = Some(Wish::Visit(i));
                    }
                    if ui.small_button("x").on_hover_text("forget").clicked() {
                        wish = Some(Wish::Forget(i));
                    }
                });
            }
        });
        ui.horizontal(|ui| {
            if ui.button("Keep this view").clicked() {
                wish = Some(Wish::Keep);
            }
            if ui.button("Copy link").clicked() {
                wish = Some(Wish::Link);
            }
        });
        ui.separator();
        let crs = manifest.crs.as_deref().unwrap_or("metres of the source");
        ui.label(format!("Go to x, y or x, y, z ({crs})"));
        let field = ui.add(TextEdit::singleline(&mut self.typed).hint_text("85000, 447000").desired_width(200.0));
        if field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
            match parse(&self.typed, manifest) {
                Ok(go) => (wish, self.wrong) = (Some(go), None),
                Err(why) => self.wrong = Some(why),
            }
        }
        if let Some(wrong) = &self.wrong {
            ui.label(RichText::new(wrong).color(Color32::LIGHT_RED));
        }
        wish
    }
}

/// Two or three numbers between commas, semicolons or spaces, near the city.
fn parse(text: &str, manifest: &Manifest) -> Result<Wish, String> {
    let parts = text.split([',', ';', ' ', '\t']).filter(|part| !part.is_empty());
    let numbers: Vec<f64> =
        parts.map(|n| n.parse().map_err(|_| format!("{n:.40} is no number"))).collect::<Result<_, _>>()?;
    let (x, y, z) = match numbers[..] {
        [x, y] => (x, y, None),
        [x, y, z] => (x, y, Some(z)),
        _ => return Err("write two or three numbers".into()),
    };
    let [low, high] = manifest.bounds.map(DVec3::from);
    let point = DVec3::new(x, y, z.unwrap_or(manifest.ground_z_m));
    let near = point.distance((low + high) * 0.5) <= (high - low).length() * AROUND;
    if near {
        return Ok(Wish::Go([x, y], z));
    }
    Err(format!("far from the city, x {:.0} to {:.0}, y {:.0} to {:.0}", low.x, high.x, low.y, high.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_as_people_write_them() {
        let manifest = insula_viewer::test_support::manifest(0);
        let go = |text: &str| parse(text, &manifest);
        assert_eq!(go("10, 20"), Ok(Wish::Go([10.0, 20.0], None)));
        assert_eq!(go(" 10.5;20  3 "), Ok(Wish::Go([10.5, 20.0], Some(3.0))));
        for wrong in ["", "1", "1,2,3,4", "a,b", "NaN,0", "inf 0", "1e9,0"] {
            assert!(go(wrong).is_err(), "{wrong}");
        }
    }
}
