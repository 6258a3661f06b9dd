//! What keys and panels ask of a city.
//!
//! In: [`Order`]s, [`Wish`]es, clicks. Out: another view, a file, a copied link, a measured point. Next: `city` draws.

use super::{
    city::City,
    keys::Order,
    link::link,
    measure::direction,
    places::Wish,
    record::{self, Recorder},
    settings::Settings,
    shell::Shell,
};
use crate::picture::write_png;
use glam::DVec3;
use insula_viewer::{
    camera::CameraFile,
    frame::{RenderSettings, STILL_SAMPLES},
};
use std::time::Instant;

impl City {
    /// Does what a key asks for, unless `window` does.
    pub(super) fn order(&mut self, order: Order, shell: &Shell, settings: &mut Settings) {
        match order {
            Order::Steering => self.control.toggle(),
            Order::Help => self.shown.help = !self.shown.help,
            Order::Picture => self.screenshot(shell),
            Order::Shading(shading) => self.shown.shading = shading,
            Order::Keep => self.wish(Wish::Keep, shell, settings),
            Order::Link => self.wish(Wish::Link, shell, settings),
            Order::Places => self.places.open = !self.places.open,
            Order::Record => self.record(),
            Order::Measure => self.measure.toggle(),
            Order::Minimap => self.shown.minimap = !self.shown.minimap,
            Order::Overlay => self.shown.overlay = !self.shown.overlay,
            Order::Counts => (self.counting, self.counts) = (!self.counting, None),
            Order::Shadows => self.shadows(settings),
            Order::Move(_) | Order::Quit | Order::FullScreen => {}
        }
        (settings.overlay, settings.minimap) = (self.shown.overlay, self.shown.minimap);
    }

    fn shadows(&mut self, settings: &mut Settings) {
        let daylight = &mut self.shown.daylight;
        daylight.shadows = !daylight.shadows;
        settings.shadows = daylight.shadows;
        self.look = daylight.render_settings(self.look.shading, self.look.samples);
    }

    pub(super) fn wish(&mut self, wish: Wish, shell: &Shell, settings: &mut Settings) {
        let (name, camera) = (self.name().to_owned(), self.control.camera());
        match wish {
            Wish::Keep => {
                let n = settings.bookmarks.get(&name).map_or(0, Vec::len) + 1;
                let text = match settings.keep(&name, &format!("View {n}"), CameraFile::from_camera(&camera)) {
                    true => format!("kept as View {n}"),
                    false => "too many bookmarks: forget one first".to_owned(),
                };
                self.store = true;
                self.tell(text);
            }
            Wish::Forget(at) => {
                if let Some(bookmarks) = settings.bookmarks.get_mut(&name).filter(|b| at < b.len()) {
                    bookmarks.remove(at);
                    self.store = true;
                }
            }
            Wish::Visit(at) => {
                let bookmark = settings.bookmarks.get(&name).and_then(|bookmarks| bookmarks.get(at));
                if let Some(camera) = bookmark.and_then(|bookmark| bookmark.camera.camera()) {
                    self.control.set(&camera);
                }
            }
            Wish::Go([x, y], z) => {
                let ground_z_m = self.session.tree().manifest().ground_z_m;
                self.control.go(DVec3::new(x, y, z.unwrap_or(ground_z_m)));
            }
            Wish::Link => match link(&self.address, &camera, &self.shown.daylight) {
                Some(link) => {
                    shell.egui.copy_text(link.clone());
                    self.tell(format!("copied {link}"));
                }
                None => self.tell("no link: this city is on this machine".to_owned()),
            },
        }
        self.changed(shell);
    }

    fn screenshot(&mut self, shell: &Shell) {
        let look = RenderSettings { samples: STILL_SAMPLES, shading: self.shown.shading, ..self.look };
        let path = record::free(&std::env::current_dir().unwrap_or_default(), "insula", "png");
        let shot = self.shot(shell, 1);
        let written = self.session.draw(&shot, &look).and_then(|pixels| write_png(&path, &pixels));
        self.tell(match written {
            Ok(()) => format!("wrote {}", path.display()),
            Err(error) => format!("no picture: {error}"),
        });
    }

    pub(super) fn record(&mut self) {
        let (now, camera) = (Instant::now(), self.control.camera());
        let Some(recorder) = self.recorder.take() else {
            self.recorder = Some(Recorder::new(now, &camera));
            return self.tell("recording; R ends it".to_owned());
        };
        let written = record::write(&recorder.finish(now, &camera), &std::env::current_dir().unwrap_or_default());
        self.tell(match written {
            Ok(path) => format!("wrote {}", path.display()),
            Err(error) => format!("no path: {error}"),
        });
    }

    /// A click that was no drag, at shares of the window's width and height.
    pub(super) fn click(&mut self, x: f64, y: f64, shell: &Shell) {
        if !self.measure.on {
            return;
        }
        let point = self.pick(x, y, shell);
        match point {
            Some(point) => {
                self.measure.click(point);
                tracing::info!("measure: {}", self.measure.text().unwrap_or_default());
            }
            None => self.tell("nothing to measure there".to_owned()),
        }
        self.changed(shell);
    }

    /// What lies under a place of the window: a picture of one pixel through it.
    fn pick(&mut self, x: f64, y: f64, shell: &Shell) -> Option<DVec3> {
        let shot = self.shot(shell, 1);
        let view = self.session.view(&shot, shot.camera);
        let dir = direction(&view, x, y);
        let mut data = self.session.frame_data(&shot, &RenderSettings { samples: 1, ..self.look });
        data.frame.forward = dir.as_vec3().to_array();
        data.frame.right = data.frame.right.map(|v| v / view.width_px as f32);
        data.frame.up = data.frame.up.map(|v| v / view.height_px as f32);
        (data.frame.width_px, data.frame.height_px) = (1, 1);
        let pixels = self.session.adapter_mut().draw(&data).ok()?;
        let mut distance_m = f64::from(*pixels.distance.first()?);
        if !distance_m.is_finite() {
            // The plain ground.
            distance_m = (self.session.tree().manifest().ground_z_m - shot.camera.position.z) / dir.z;
        }
        (distance_m > 0.0 && distance_m.is_finite()).then(|| shot.camera.position + dir * distance_m)
    }
}
