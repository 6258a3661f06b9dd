//! Actions of keys, panels and clicks on the viewed city.

use super::bookmarks::ViewAction;
use super::city_view::CityView;
use super::key_bindings::KeyAction;
use super::overlay::has_room;
use super::path_recording::PathRecorder;
use super::settings::UserSettings;
use super::view_link::format_link;
use super::window::ViewerWindow;
use crate::camera_files::write_new;
use crate::proposal::ShownProposal;
use glam::DVec3;
use insula_viewer::camera::CameraFile;
use insula_viewer::camera_text;
use serde::Serialize;
use std::time::Instant;

/// How much larger what is ahead becomes by one press.
const ZOOM_STEP: f64 = 1.25;

impl CityView {
    /// Performs the action of a key. The event loop itself performs movement, quitting and full screen.
    pub(super) fn perform(&mut self, action: KeyAction, window: &ViewerWindow, settings: &mut UserSettings) {
        let display = &mut self.display;
        match action {
            KeyAction::ToggleMode => self.control.toggle_mode(),
            KeyAction::Closer => self.control.zoom(ZOOM_STEP),
            KeyAction::Farther => self.control.zoom(1.0 / ZOOM_STEP),
            KeyAction::ClickMiddle => self.click([0.5; 2], window),
            KeyAction::GoHome => self.control.go_home(),
            KeyAction::TurnNorth => self.control.turn_north(),
            KeyAction::ToggleCollision => {
                self.control.toggle_collision();
                let state = if self.control.collides() { "on" } else { "off" };
                self.show_message(format!("collision {state}"));
            }
            KeyAction::ToggleHelp => display.shows_help = !display.shows_help,
            KeyAction::SaveImage => self.save_picture(window),
            KeyAction::SetShading(shading) => display.shading = shading,
            KeyAction::AddBookmark => self.apply(ViewAction::AddBookmark, window, settings),
            KeyAction::CopyLink => self.apply(ViewAction::CopyLink, window, settings),
            KeyAction::ToggleBookmarks => self.bookmark_panel.is_open = !self.bookmark_panel.is_open,
            KeyAction::ToggleRecording => self.toggle_recording(),
            KeyAction::ToggleMeasuring => {
                self.measure.next();
                self.report_measure();
            }
            KeyAction::UndoPoint => {
                self.measure.undo();
                self.report_measure();
            }
            KeyAction::ToggleDay => self.toggle_day(settings),
            KeyAction::ToggleSearch => self.search.is_open = !self.search.is_open,
            KeyAction::ToggleStyles => self.styles.toggle(),
            KeyAction::ToggleStones => self.stones.is_open = !self.stones.is_open,
            KeyAction::ToggleProposal => self.toggle_proposal(),
            KeyAction::ToggleMap => display.shows_map = !display.shows_map,
            KeyAction::ToggleSliders if !has_room(window.size().map(|side| side as f32).into()) => {
                self.show_message("no room for the sliders: enlarge the window".to_owned());
            }
            KeyAction::ToggleSliders => display.shows_sliders = !display.shows_sliders,
            KeyAction::ToggleCounters => display.shows_counters = !display.shows_counters,
            KeyAction::ToggleRayCounts => (self.counts_rays, self.ray_counts) = (!self.counts_rays, None),
            KeyAction::ToggleShadows => self.toggle_shadows(settings),
            KeyAction::Move(_) | KeyAction::EndInnermost | KeyAction::Quit | KeyAction::ToggleFullScreen => {}
        }
        let display = &self.display;
        (settings.overlay, settings.counters) = (display.shows_sliders, display.shows_counters);
        settings.minimap = display.shows_map;
    }

    /// Ends the innermost thing that Escape ends: help, measuring, an open panel, the selection, then a picture. Returns whether
    /// there was one.
    pub(super) fn end_innermost(&mut self) -> bool {
        if std::mem::take(&mut self.display.shows_help) {
            return true;
        }
        if self.measure.is_active {
            self.measure.toggle();
            self.report_measure();
            return true;
        }
        // The sliders and the map are there from the start: O and N hide them.
        let panels = [&mut self.search.is_open, &mut self.bookmark_panel.is_open, &mut self.stones.is_open];
        if panels.into_iter().any(std::mem::take) || self.styles.close() {
            return true;
        }
        if !self.objects.selected().is_empty() {
            self.select_object(None, false);
            return true;
        }
        let is_drawing = self.picture.take().is_some();
        if is_drawing {
            self.show_message("picture cancelled".to_owned());
        }
        is_drawing
    }

    /// Reports what is measured in the log.
    pub(super) fn report_measure(&self) {
        let text = self.measure.text();
        tracing::info!("measure: {}", text.as_deref().unwrap_or("ended"));
    }

    fn toggle_day(&mut self, settings: &mut UserSettings) {
        self.display.day.toggle(Instant::now());
        settings.time = Some(self.display.daylight.time_text());
    }

    fn toggle_proposal(&mut self) {
        match self.session.proposal().map(ShownProposal::is_shown) {
            Some(is_shown) => self.show_proposal(!is_shown),
            None => self.show_message("there is no proposal: open one by insula view --proposal".to_owned()),
        }
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
            ViewAction::SetCamera(camera) => self.control.set_camera(&camera),
            ViewAction::DeselectObjects => self.select_object(None, false),
            ViewAction::SelectObject(id) => {
                self.select_object(Some(id), false);
                self.objects.go_to_when_known(id);
            }
            ViewAction::CopyLink => self.copy_link(window),
            ViewAction::SaveCamera => {
                self.write_here("camera", "insula-camera", &CameraFile::from_camera(&self.control.camera()));
            }
            ViewAction::NorthUp => self.control.turn_north(),
            ViewAction::SavePicture => self.save_picture(window),
            ViewAction::ToggleProposal => self.toggle_proposal(),
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
        let object = self.objects.only_selected();
        let camera = self.control.camera();
        let link = format_link(&self.address, &camera, &self.display.daylight, object);
        // A city in a folder of this machine has no address.
        let copied = link.unwrap_or_else(|| format!("camera={}", camera_text::format(&camera)));
        window.egui.copy_text(copied.clone());
        self.show_message(format!("copied {copied}"));
    }

    /// Writes a camera or a path into the current folder, and says so.
    fn write_here(&mut self, what: &str, stem: &str, value: &impl Serialize) {
        self.show_message(match write_new(value, &std::env::current_dir().unwrap_or_default(), stem) {
            Ok(file) => format!("wrote {}", file.display()),
            Err(error) => format!("no {what} saved: {error}"),
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
        self.write_here("path", "insula-path", &path);
    }
}
