//! The frame loop of the viewed city: moves the camera, streams, draws, lays out the panels, and decides when to go on.

use super::{
    bookmarks::ViewAction,
    city_view::CityView,
    frame_pacing::FrameDetail,
    furniture::{self, Furniture},
    measure_view, minimap,
    overlay::{self, OverlayTexts, panel},
    picture_job::PictureJob,
    settings::UserSettings,
    stream_status::{StreamStatus, loading_text},
    window::{OverlayLayout, ViewerWindow},
    window_surface::{SceneFrame, color_image},
};
use crate::{error::Result, render::Adapter, session::PrefetchStep};
use egui::Align2;
use insula_shaders::layout::Shading;
use insula_viewer::{
    frame::{FrameData, RenderSettings},
    select::priority::PriorityGroup,
    sun::Daylight,
};
use std::time::{Duration, Instant};
use winit::event_loop::ControlFlow;

/// Shortest interval between two frames that are drawn only to check for progress.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Offset of panels above the one of [`furniture`], in points.
const ABOVE_FURNITURE: f32 = -110.0;

/// A [`CityView`] and its frame loop.
pub struct Viewport {
    pub(super) city: CityView,
    status: StreamStatus,
    /// Whether the idle prefetch of this view may have work left.
    has_prefetch: bool,
    /// Whether something arrived while the view rested.
    has_arrivals: bool,
    /// When a frame is due without any event.
    wake_at: Option<Instant>,
}

/// Values of the sliders, to notice changes.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SliderValues {
    tau_px: f64,
    daylight: Daylight,
}

impl Viewport {
    /// The frame loop before its first frame.
    pub fn new(city: CityView) -> Self {
        Self { city, status: StreamStatus::Loading, has_prefetch: true, has_arrivals: false, wake_at: None }
    }

    /// One frame: move, stream, draw. Returns when to draw the next frame, or `None` after the end of a playback. Fails if the
    /// ray-caster fails.
    pub fn frame(&mut self, window: &mut ViewerWindow, settings: &mut UserSettings) -> Result<Option<ControlFlow>> {
        let begin = Instant::now();
        (self.has_prefetch, self.has_arrivals) = (true, false);
        if !self.advance(begin) {
            return Ok(None);
        }
        let (detail, data) = self.stream(begin, window);
        if matches!(self.city.session.adapter(), Adapter::Cpu(_)) {
            window.set_background(color_image(&self.city.session.render(&data)?));
        }
        self.update_status();
        let sliders = self.slider_values();
        let layout = self.lay_out(window, settings);
        let is_presented = self.city.session.while_fetching(|adapter| {
            window.surface.present(Some(SceneFrame { adapter, data: &data }), &layout.shapes)
        })?;
        self.city.session.frame_drawn(&data);
        if self.city.pacer.end_frame(begin, detail, is_presented) {
            tracing::debug!("frame settled");
            self.count_rays(&data, window);
        }
        self.city.session.record_frame_time(begin.elapsed());
        if let Some(playback) = &mut self.city.playback {
            playback.record_frame_time(begin.elapsed());
        }
        self.apply_sliders(sliders, window, settings);
        Ok(Some(self.next_frame(layout.repaint_after, is_presented, window)))
    }

    /// Moves the camera. Returns `false` at the end of a playback.
    fn advance(&mut self, now: Instant) -> bool {
        let city = &mut self.city;
        let secs = city.pacer.begin_frame(now);
        if city.display.day.advance(&mut city.display.daylight, now) {
            city.render_settings = city.display.daylight.render_settings(Shading::Lit, 1);
            city.pacer.view_changed(now);
        }
        if let Some(playback) = &mut city.playback {
            let Some(cameras) = playback.cameras(now) else {
                println!("{}", playback.summary());
                return false;
            };
            city.control.set_camera(&cameras.now);
            city.playback_heading = cameras.ahead;
            city.pacer.view_changed(now);
        }
        if city.control.advance(secs) {
            city.pacer.view_changed(now);
        }
        let camera = city.control.camera();
        if city.recorder.as_mut().is_some_and(|recorder| !recorder.sample(now, &camera)) {
            city.toggle_recording();
        }
        true
    }

    /// Updates the session. Returns the frame to draw and its detail.
    fn stream(&mut self, now: Instant, window: &ViewerWindow) -> (FrameDetail, FrameData) {
        let city = &mut self.city;
        let detail = city.pacer.detail(now, city.session.is_settled());
        if let Some((query, pixels)) = city.session.adapter_mut().take_hits() {
            city.session.report_hits(&query, &pixels);
        }
        let settings =
            RenderSettings { samples: detail.samples, shading: city.display.shading, ..city.render_settings };
        city.session.set_sun(settings.shadow_casting_sun());
        // Tiles are selected for the whole window, however few pixels are drawn: the speed of the ray-caster must not
        // change what is fetched.
        let whole_window = city.frame_request(window, 1);
        city.session.update(&whole_window);
        let detail = FrameDetail { is_final: detail.is_final && city.session.is_settled(), ..detail };
        let request = city.frame_request(window, detail.divisor);
        let data = city.session.frame_data(&request, &settings);
        (detail, data)
    }

    /// Counts the ray steps of a frame, if that is switched on. Takes about as long as drawing it.
    fn count_rays(&mut self, data: &FrameData, window: &ViewerWindow) {
        if self.city.counts_rays {
            self.city.ray_counts = self.city.session.adapter_mut().count(data).ok();
            window.window.request_redraw();
        }
    }

    /// Updates the status, and logs it if it changed.
    fn update_status(&mut self) {
        let status = StreamStatus::of(&self.city.session);
        if status != self.status {
            let text = status.text(&self.city.session);
            tracing::info!("status: {}", text.as_deref().unwrap_or("ready"));
            self.status = status;
        }
    }

    fn slider_values(&self) -> SliderValues {
        SliderValues { tau_px: self.city.display.tau_px, daylight: self.city.display.daylight }
    }

    /// Applies what the user changed by sliders since `before`.
    fn apply_sliders(&mut self, before: SliderValues, window: &ViewerWindow, settings: &mut UserSettings) {
        let SliderValues { tau_px, daylight } = self.slider_values();
        if before.daylight != daylight {
            self.city.render_settings = daylight.render_settings(Shading::Lit, 1);
            settings.shadows = daylight.shadows;
            settings.time = daylight.fixed_bearing.is_none().then(|| daylight.time_text());
        }
        if before.tau_px != tau_px {
            settings.tau_px = tau_px;
        }
        if before != self.slider_values() {
            self.city.view_changed(window);
        }
    }

    fn lay_out(&mut self, window: &mut ViewerWindow, settings: &mut UserSettings) -> OverlayLayout {
        self.city.check_picture(window);
        self.city.sample_pointer(window);
        let request = self.city.frame_request(window, 1);
        let frame_time = self.city.pacer.frame_time();
        let furniture = self.furniture(window);
        let CityView { session, control, display, bookmark_panel, measure, recorder, ray_counts, .. } = &mut self.city;
        let texts = OverlayTexts::new(session, frame_time, control, *ray_counts);
        let status_text = self.status.text(session);
        let is_error = self.status != StreamStatus::Loading;
        let camera = control.camera();
        let view = session.view(&request, camera);
        let manifest = session.tree().manifest();
        let bookmarks = settings.bookmarks.get(&manifest.name).map_or(&[][..], Vec::as_slice);
        let recording = recorder.as_ref().map(|recorder| format!("recording, {:.0} s", recorder.secs(Instant::now())));
        let mut action = None;
        let layout = window.lay_out(|ctx| {
            measure_view::paint(measure, &ctx.layer_painter(egui::LayerId::background()), &view, ctx.content_rect());
            action = overlay::show(ctx, &texts, display).or(action);
            if furniture::show(ctx, &furniture) {
                action = Some(ViewAction::NorthUp);
            }
            if let Some(text) = &status_text {
                overlay::notice(ctx, text, is_error);
            }
            if display.shows_map {
                panel(ctx, "map", Align2::RIGHT_TOP, [-10.0, 10.0], |ui| {
                    let point = minimap::show(ui, session, &camera);
                    action = point.map(|p| ViewAction::GoTo { x: p.x, y: p.y, z: None }).or(action);
                });
            }
            if bookmark_panel.is_open {
                panel(ctx, "bookmarks", Align2::LEFT_BOTTOM, [10.0, ABOVE_FURNITURE], |ui| {
                    action = bookmark_panel.show(ui, bookmarks, manifest).or(action);
                });
            }
            if measure.is_active {
                let below_notice = if status_text.is_some() { 130.0 } else { 52.0 };
                let show_tool = |ui: &mut egui::Ui| measure_view::show(ui, measure);
                panel(ctx, "measure", Align2::CENTER_TOP, [0.0, below_notice], show_tool);
            } else if let Some(text) = &recording {
                panel(ctx, "tool", Align2::CENTER_BOTTOM, [0.0, -12.0], |ui| {
                    ui.label(text);
                });
            }
        });
        if let Some(action) = action {
            self.city.apply(action, window, settings);
        }
        layout
    }

    /// Content of the panel that is always there.
    fn furniture(&self, window: &ViewerWindow) -> Furniture {
        let CityView { session, control, readout, picture, .. } = &self.city;
        let pixels_per_point = f64::from(window.egui.pixels_per_point());
        let wanted = session.selection().requests.iter();
        let missing = wanted.filter(|request| request.group != PriorityGroup::Preload).count();
        Furniture {
            yaw_rad: control.camera().angles().0,
            metres_per_point: readout.metres_per_px().map(|metres| metres * pixels_per_point),
            has_pointer: readout.has_pointer(),
            coordinates: readout.text(session.tree().manifest().crs.as_deref()),
            works: loading_text(missing).into_iter().chain(picture.as_ref().map(PictureJob::text)).collect(),
        }
    }

    /// When the next frame is due.
    fn next_frame(&mut self, repaint_after: Duration, is_presented: bool, window: &ViewerWindow) -> ControlFlow {
        let now = Instant::now();
        self.wake_at = None;
        if !is_presented {
            return ControlFlow::WaitUntil(now + POLL_INTERVAL);
        }
        let CityView { session, pacer, recorder, display, control, readout, .. } = &self.city;
        let must_repaint = repaint_after.is_zero() && self.status == StreamStatus::Ready;
        if self.is_moving() || session.has_work() || session.adapter().has_pending_query() || must_repaint {
            window.window.request_redraw();
            return ControlFlow::Wait;
        }
        // The spinner of a notice must not occupy a core.
        let repaint_after = repaint_after.max(POLL_INTERVAL);
        let repaint_at = now.checked_add(repaint_after.min(Duration::from_secs(3600)));
        let progress_at = match session.is_settled() {
            false => Some(self.retry_at()),
            true => pacer.final_frame_at().map(|at| at.max(now)),
        };
        let recording_at = recorder.is_some().then(|| now + POLL_INTERVAL);
        let message_at = display.message.as_ref().map(|message| message.until);
        let readout_at = readout.due_at(&control.camera(), now);
        self.wake_at = [repaint_at, progress_at, recording_at, message_at, readout_at].into_iter().flatten().min();
        if self.may_prefetch() { ControlFlow::WaitUntil(now) } else { wait_until(self.wake_at) }
    }

    fn is_moving(&self) -> bool {
        self.city.control.is_moving() || self.city.playback.is_some() || self.city.display.day.is_running()
    }

    /// When to check for tiles that did not arrive. Arrivals wake the loop, but retries have a due time.
    fn retry_at(&self) -> Instant {
        let soon = Instant::now() + POLL_INTERVAL;
        self.city.session.retry_at().map_or(soon, |at| at.max(soon))
    }

    /// Whether the frame on the screen is final unless tiles arrive.
    fn is_resting(&self) -> bool {
        let is_waiting = self.city.recorder.is_some() || self.city.session.adapter().has_pending_query();
        self.city.pacer.is_finished() && self.status == StreamStatus::Ready && !self.is_moving() && !is_waiting
    }

    /// Takes note of an arrival. Returns whether a frame is due. Otherwise the view rests, and [`Viewport::prefetch`] will take
    /// the arrival in.
    pub fn notice_arrival(&mut self) -> bool {
        if self.is_resting() {
            self.has_arrivals = true;
            return false;
        }
        self.city.pacer.content_changed();
        true
    }

    /// Whether the view rests and there is something to take in or to prefetch.
    pub fn may_prefetch(&self) -> bool {
        let is_frame_due = self.wake_at.is_some_and(|at| at <= Instant::now());
        (self.has_prefetch || self.has_arrivals) && self.is_resting() && !is_frame_due
    }

    /// Takes in arrivals and continues the idle prefetch, without changing the screen. Returns when to go on, or `None` if a
    /// frame is due instead. Fails if the ray-caster fails.
    pub fn prefetch(&mut self, window: &ViewerWindow) -> Result<Option<ControlFlow>> {
        let request = self.city.frame_request(window, 1);
        self.has_arrivals = false;
        self.city.session.update(&request);
        self.update_status();
        if !self.city.session.is_settled() || self.status != StreamStatus::Ready {
            self.city.pacer.content_changed();
            return Ok(None);
        }
        let step = if self.has_prefetch { self.city.session.prefetch(&request)? } else { PrefetchStep::Done };
        if self.has_prefetch && step == PrefetchStep::Done {
            tracing::debug!("idle prefetch done");
        }
        self.has_prefetch = step != PrefetchStep::Done;
        let next_step_at = match step {
            PrefetchStep::Drawn => Some(Instant::now()),
            PrefetchStep::Waiting => Some(self.retry_at()),
            PrefetchStep::Done => None,
        };
        Ok(Some(wait_until(self.wake_at.into_iter().chain(next_step_at).min())))
    }
}

fn wait_until(at: Option<Instant>) -> ControlFlow {
    at.map_or(ControlFlow::Wait, ControlFlow::WaitUntil)
}
