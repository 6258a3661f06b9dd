//! Actions of keys, panels and clicks on the viewed city.

use super::{
    bookmarks::ViewAction,
    city_view::CityView,
    distance_tool::ray_direction,
    key_bindings::KeyAction,
    path_recording::{PathRecorder, unused_name, write_path},
    settings::UserSettings,
    view_link::format_link,
    window::ViewerWindow,
};
use crate::image_files::{PictureNotes, write_picture};
use glam::DVec3;
use insula_viewer::{
    camera::CameraFile,
    frame::{RenderSettings, STILL_SAMPLES},
};
use std::time::Instant;

impl CityView {
    /// Performs the action of a key. The event loop itself performs movement, quitting and full screen.
    pub(super) fn perform(&mut self, action: KeyAction, window: &ViewerWindow, settings: &mut UserSettings) {
        let display = &mut self.display;
        match action {
            KeyAction::ToggleMode => self.control.toggle_mode(),
            KeyAction::GoHome => self.control.go_home(),
            KeyAction::TurnNorth => self.control.turn_north(),
            KeyAction::ToggleCollision => {
                self.control.toggle_collision();
                let state = if self.control.collides() { "on" } else { "off" };
                self.show_message(format!("collision {state}"));
            }
            KeyAction::ToggleHelp => display.shows_help = !display.shows_help,
            KeyAction::SaveImage => self.save_image(window),
            KeyAction::SetShading(shading) => display.shading = shading,
            KeyAction::AddBookmark => self.apply(ViewAction::AddBookmark, window, settings),
            KeyAction::CopyLink => self.apply(ViewAction::CopyLink, window, settings),
            KeyAction::ToggleBookmarks => self.bookmark_panel.is_open = !self.bookmark_panel.is_open,
            KeyAction::ToggleRecording => self.toggle_recording(),
            KeyAction::ToggleMeasuring => self.distance_tool.toggle(),
            KeyAction::ToggleMap => display.shows_map = !display.shows_map,
            KeyAction::ToggleCounters => display.shows_counters = !display.shows_counters,
            KeyAction::ToggleRayCounts => (self.counts_rays, self.ray_counts) = (!self.counts_rays, None),
            KeyAction::ToggleShadows => self.toggle_shadows(settings),
            KeyAction::Move(_) | KeyAction::Quit | KeyAction::ToggleFullScreen => {}
        }
        (settings.overlay, settings.minimap) = (self.display.shows_counters, self.display.shows_map);
    }

    fn toggle_shadows(&mut self, settings: &mut UserSettings) {
        let daylight = &mut self.display.daylight;
        daylight.shadows = !daylight.shadows;
        settings.shadows = daylight.shadows;
        self.render_settings = daylight.render_settings(self.render_settings.shading, self.render_settings.samples);
    }

    /// Performs what a panel asks for.
    pub(super) fn apply(&mut self, action: ViewAction, window: &ViewerWindow, settings: &mut UserSettings) {
        let city = self.name().to_owned();
        match action {
            ViewAction::AddBookmark => self.add_bookmark(&city, settings),
            ViewAction::DeleteBookmark(index) => {
                if let Some(bookmarks) = settings.bookmarks.get_mut(&city).filter(|b| index < b.len()) {
                    bookmarks.remove(index);
                    self.must_store_settings = true;
                }
            }
            ViewAction::OpenBookmark(index) => {
                let bookmark = settings.bookmarks.get(&city).and_then(|bookmarks| bookmarks.get(index));
                if let Some(camera) = bookmark.and_then(|bookmark| bookmark.camera.camera()) {
                    self.control.set_camera(&camera);
                }
            }
            ViewAction::GoTo { x, y, z } => {
                let ground_z_m = self.session.tree().manifest().ground_z_m;
                self.control.go_to(DVec3::new(x, y, z.unwrap_or(ground_z_m)));
            }
            ViewAction::CopyLink => self.copy_link(window),
        }
        window.window.request_redraw();
    }

    fn add_bookmark(&mut self, city: &str, settings: &mut UserSettings) {
        let name = format!("View {}", settings.bookmarks.get(city).map_or(0, Vec::len) + 1);
        let is_added = settings.add_bookmark(city, &name, CameraFile::from_camera(&self.control.camera()));
        self.must_store_settings = true;
        self.show_message(match is_added {
            true => format!("bookmark saved as {name}"),
            false => "this city has too many bookmarks: delete one first".to_owned(),
        });
    }

    fn copy_link(&mut self, window: &ViewerWindow) {
        match format_link(&self.address, &self.control.camera(), &self.display.daylight) {
            Some(link) => {
                window.egui.copy_text(link.clone());
                self.show_message(format!("copied {link}"));
            }
            None => self.show_message("no link: this city is a local folder".to_owned()),
        }
    }

    fn save_image(&mut self, window: &ViewerWindow) {
        let settings = RenderSettings { samples: STILL_SAMPLES, shading: self.display.shading, ..self.render_settings };
        let path = unused_name(&std::env::current_dir().unwrap_or_default(), "insula", "png");
        let request = self.frame_request(window, 1);
        let link = format_link(&self.address, &request.camera, &self.display.daylight);
        let notes = PictureNotes::new(self.session.tree().manifest(), link, self.has_captions);
        let written = self.session.draw(&request, &settings).and_then(|pixels| write_picture(&path, &pixels, &notes));
        self.show_message(match written {
            Ok(()) => format!("wrote {}", path.display()),
            Err(error) => format!("no image saved: {error}"),
        });
    }

    /// Starts recording the camera's path, or ends the recording and writes it.
    pub(super) fn toggle_recording(&mut self) {
        let (now, camera) = (Instant::now(), self.control.camera());
        let Some(recorder) = self.recorder.take() else {
            self.recorder = Some(PathRecorder::new(now, &camera));
            return self.show_message("recording: press R to stop".to_owned());
        };
        let path = recorder.finish(now, &camera);
        self.show_message(match write_path(&path, &std::env::current_dir().unwrap_or_default()) {
            Ok(file) => format!("wrote {}", file.display()),
            Err(error) => format!("no path saved: {error}"),
        });
    }

    /// Handles a click at shares of the window's width and height, 0 to 1.
    pub(super) fn click(&mut self, [x, y]: [f64; 2], window: &ViewerWindow) {
        if !self.distance_tool.is_active {
            return;
        }
        match self.pick(x, y, window) {
            Some(point) => {
                self.distance_tool.add_point(point);
                tracing::info!("measure: {}", self.distance_tool.text().unwrap_or_default());
            }
            None => self.show_message("nothing to measure at this point".to_owned()),
        }
        window.window.request_redraw();
    }

    /// Handles a double click: goes to what is below it.
    pub(super) fn double_click(&mut self, at: [f64; 2], window: &ViewerWindow) {
        if self.distance_tool.is_active {
            return self.click(at, window);
        }
        match self.pick(at[0], at[1], window) {
            Some(point) => self.control.approach(point),
            None => self.show_message("nothing to go to at this point".to_owned()),
        }
        window.window.request_redraw();
    }

    /// The point of the city below a position of the window. Draws a frame of one pixel there.
    fn pick(&mut self, x: f64, y: f64, window: &ViewerWindow) -> Option<DVec3> {
        let request = self.frame_request(window, 1);
        let view = self.session.view(&request, request.camera);
        let direction = ray_direction(&view, x, y);
        let mut data = self.session.frame_data(&request, &RenderSettings { samples: 1, ..self.render_settings });
        data.frame.forward = direction.as_vec3().to_array();
        data.frame.right = data.frame.right.map(|v| v / view.width_px as f32);
        data.frame.up = data.frame.up.map(|v| v / view.height_px as f32);
        (data.frame.width_px, data.frame.height_px) = (1, 1);
        let pixels = self.session.adapter_mut().draw(&data).ok()?;
        let mut distance_m = f64::from(*pixels.distance.first()?);
        if !distance_m.is_finite() {
            // Outside of the city, the ground is a plane.
            distance_m = (self.session.tree().manifest().ground_z_m - request.camera.position.z) / direction.z;
        }
        (distance_m > 0.0 && distance_m.is_finite()).then(|| request.camera.position + direction * distance_m)
    }
}
