//! What lies under a position of the window: for the measuring tool and for the readout of coordinates.

use super::city_view::CityView;
use super::window::ViewerWindow;
use crate::render::Adapter;
use glam::DVec3;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_viewer::frame::RenderSettings;
use insula_viewer::objects::ObjectStyles;
use insula_viewer::projection::ray_direction;
use insula_viewer::streamer::FrameRequest;
use std::time::Instant;

/// An object that was searched for is approached if it is farther away than this.
const FAR_M: f64 = 400.0;

impl CityView {
    /// Handles a click at shares of the window's width and height, 0 to 1.
    pub(super) fn click(&mut self, [x, y]: [f64; 2], window: &ViewerWindow) {
        if !self.measure.is_active {
            let object = self.pick_object(x, y, window);
            self.select_object(object, self.is_shift_down);
            return window.window.request_redraw();
        }
        match self.pick(x, y, window) {
            Some(point) if self.measure.add_point(point) => self.report_measure(),
            Some(_) => self.show_message("this figure has too many points: clear it first".to_owned()),
            None => self.show_message("nothing to measure at this point".to_owned()),
        }
        window.window.request_redraw();
    }

    /// Handles a double click: goes to what is below it.
    pub(super) fn double_click(&mut self, [x, y]: [f64; 2], window: &ViewerWindow) {
        if self.measure.is_active {
            return self.click([x, y], window);
        }
        match self.pick(x, y, window) {
            Some(point) => self.control.approach(point),
            None => self.show_message("nothing to go to at this point".to_owned()),
        }
        window.window.request_redraw();
    }

    /// Samples the surface under the pointer if that is due. Nothing is sampled while the view moves by itself.
    pub(super) fn sample_pointer(&mut self, window: &ViewerWindow) {
        let (now, camera) = (Instant::now(), self.control.camera());
        if self.control.is_moving() || self.playback.is_some() || self.display.day.is_running() {
            return;
        }
        if let Some([x, y]) = self.readout.due(&camera, now) {
            let surface = self.pick(x, y, window);
            let view = self.session.view(&self.frame_request(window, 1), camera);
            self.readout.sample(&view, surface, now);
            self.outline_hovered(x, y, window);
        }
    }

    /// Outlines the object under the pointer. Only on a GPU: a still picture of the CPU takes too long to be drawn for each.
    fn outline_hovered(&mut self, x: f64, y: f64, window: &ViewerWindow) {
        let is_gpu = matches!(self.session.adapter(), Adapter::Gpu(_));
        let has_pointer = self.readout.has_pointer() && !self.measure.is_active;
        let object = if is_gpu && has_pointer { self.pick_object(x, y, window) } else { None };
        if self.objects.hover(object) {
            self.set_styles(self.session.cache().styles().clone());
            window.window.request_redraw();
        }
    }

    /// Selects an object or none, as a click on it does, and outlines what is selected.
    pub(super) fn select_object(&mut self, object: Option<u32>, adds: bool) {
        self.objects.click(object, adds);
        self.set_styles(self.session.cache().styles().clone());
    }

    /// Shows the city with or without the proposal, and deselects objects that are no longer shown.
    pub(super) fn show_proposal(&mut self, is_shown: bool) {
        self.session.show_proposal(is_shown);
        let proposal = self.session.proposal();
        self.objects.retain(|object| proposal.is_none_or(|proposal| proposal.shows(object)));
        self.set_styles(self.session.cache().styles().clone());
    }

    /// Takes in attributes and styles that have arrived.
    pub(super) fn poll_objects(&mut self) {
        if self.session.is_settled()
            && let Some(objects) = self.unopened_objects.take()
        {
            objects.open_early();
        }
        let before = self.objects.generation();
        if let Some(place) = self.objects.poll() {
            let place = DVec3::from(place);
            self.control.go_to(place);
            if self.control.camera().position.distance(place) > FAR_M {
                self.control.approach(place);
            }
        }
        if self.objects.generation() != before {
            self.set_styles(self.session.cache().styles().clone());
        }
        self.search.poll();
        if let Some(styles) = self.styles.poll() {
            self.set_styles(styles);
        }
    }

    /// Draws objects in these styles, with outlines of those that are selected.
    fn set_styles(&mut self, mut styles: ObjectStyles) {
        styles.outline(self.objects.outlined());
        self.session.set_styles(styles);
    }

    /// The object below a position of the window, if there is one.
    fn pick_object(&mut self, x: f64, y: f64, window: &ViewerWindow) -> Option<u32> {
        let request = self.frame_request(window, 1);
        let pixels = self.draw_pixel([x, y], &request, Shading::Objects)?;
        self.session.object_at(*pixels.colour.first()?)
    }

    /// The point of the city below a position of the window.
    fn pick(&mut self, x: f64, y: f64, window: &ViewerWindow) -> Option<DVec3> {
        let request = self.frame_request(window, 1);
        let direction = ray_direction(&self.session.view(&request, request.camera), x, y);
        let pixels = self.draw_pixel([x, y], &request, self.render_settings.shading)?;
        let mut distance_m = f64::from(*pixels.distance.first()?);
        if !distance_m.is_finite() {
            // Outside of the city, the ground is a plane.
            distance_m = (self.session.tree().manifest().ground_z_m - request.camera.position.z) / direction.z;
        }
        (distance_m > 0.0 && distance_m.is_finite()).then(|| request.camera.position + direction * distance_m)
    }

    /// Draws a frame of one pixel at shares of the window's width and height.
    fn draw_pixel(&mut self, [x, y]: [f64; 2], request: &FrameRequest, shading: Shading) -> Option<Pixels> {
        let view = self.session.view(request, request.camera);
        let settings = RenderSettings { samples: 1, shadow_m: 0.0, shading, ..self.render_settings };
        let mut data = self.session.frame_data(request, &settings);
        data.narrow_to_ray(&view, [x, y]);
        self.session.adapter_mut().draw(&data).ok()
    }
}
