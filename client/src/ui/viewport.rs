//! The frame loop of the viewed city: moves the camera, streams, draws, lays out the panels, and decides when to go on.

use super::bookmarks::ViewAction;
use super::city_view::CityView;
use super::furniture::{self, Furniture};
use super::overlay::{self, DisplayOptions, OverlayTexts, panel};
use super::picture_job::PictureJob;
use super::settings::UserSettings;
use super::stream_status::{loading_text, status_text};
use super::view_log::ViewLog;
use super::window::{OverlayLayout, ViewerWindow};
use super::window_surface::SceneFrame;
use super::{box_view, measure_view, minimap, proposal_panel};
use crate::error::Result;
use crate::proposal::ShownProposal;
use crate::render::Adapter;
use crate::session::PrefetchStep;
use egui::Align2;
use insula_shaders::cpu::stepped::{FrameProgress, SteppedFrame};
use insula_shaders::layout::Shading;
use insula_viewer::camera::Camera;
use insula_viewer::camera_text;
use insula_viewer::frame::{FrameData, RenderSettings};
use insula_viewer::interaction::frame_pacing::{FrameDetail, FrameTime, STEP};
use insula_viewer::streamer::StreamStatus;
use insula_viewer::sun::Daylight;
use std::time::{Duration, Instant};
use winit::event_loop::ControlFlow;

/// Shortest interval between two frames that are drawn only to check for progress.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Offset of panels above the one of [`furniture`], in points.
const ABOVE_FURNITURE: f32 = -110.0;

/// Offset of the panel of objects above the attribution, in points.
const ABOVE_ATTRIBUTION: f32 = -44.0;

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
    /// The view of the last frame, to notice changes.
    view: Option<ViewState>,
    /// Whether a final frame of this view is on the screen. It stays there while more tiles arrive, until the next one is drawn.
    shows_final_frame: bool,
    /// The final frame, while it is being drawn in steps.
    still: Option<StillFrame>,
    /// The same when it is drawn, until it is presented.
    finished: Option<FrameData>,
    log: ViewLog,
}

/// What a frame depends on besides the resident tiles.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ViewState {
    camera: Camera,
    size_px: [u32; 2],
    tau_px: f64,
    daylight: Daylight,
    shading: Shading,
    counts_rays: bool,
    /// Number of changes of the selected objects.
    selection: u64,
    /// Number of changes of the styles.
    styles: u64,
    /// Number of changes of the stones.
    stones: u64,
    /// Whether the proposal is shown, if there is one.
    proposal: Option<bool>,
}

/// A frame that is to be presented.
struct DrawnFrame {
    detail: FrameDetail,
    data: FrameData,
    /// How long the selection took.
    selection: Duration,
    /// How long the CPU ray-caster took; `None` if the GPU is still to draw it.
    time: Option<Duration>,
}

/// A frame of a resting view that the CPU ray-caster draws in steps, so that input never waits for it.
struct StillFrame {
    data: FrameData,
    frame: SteppedFrame,
    /// Whether its sketch is shown, because the whole takes long.
    shows_sketch: bool,
    /// Time of its steps.
    duration: Duration,
}

impl Viewport {
    /// The frame loop before its first frame.
    pub fn new(city: CityView) -> Self {
        let status = StreamStatus::Loading;
        Self {
            city,
            status,
            has_prefetch: true,
            has_arrivals: false,
            wake_at: None,
            view: None,
            shows_final_frame: false,
            still: None,
            finished: None,
            log: ViewLog::default(),
        }
    }

    /// One frame: move, stream, draw. While the view rests, only the overlay is redrawn. Returns when to draw the next frame, or
    /// `None` after the end of a playback. Fails if the ray-caster fails.
    pub fn frame(&mut self, window: &mut ViewerWindow, settings: &mut UserSettings) -> Result<Option<ControlFlow>> {
        let begin = Instant::now();
        if !self.advance(begin) {
            return Ok(None);
        }
        self.notice_view(begin, window);
        let mut drawn = None;
        if let Some(still) = self.still.take() {
            self.continue_still(still, window);
        } else if self.finished.is_none() && (!self.city.pacer.is_finished() || self.takes_news(window)) {
            drawn = self.draw_scene(begin, window)?;
        }
        let display = self.city.display.clone();
        let mut layout = self.lay_out(window, settings);
        let is_presented = self.present(drawn, begin, &mut layout, window)?;
        if is_presented {
            self.log.presented(&self.city, window.size().map(|side| side as f32).into());
            if let Some(data) = self.finished.take() {
                self.settled(&data, window);
            }
        }
        self.apply_options(&display, window, settings);
        Ok(Some(self.next_frame(layout.repaint_after, is_presented, window)))
    }

    /// Lets the session of a resting view take in what it has been told, such as the hits of the final frame. Returns whether the
    /// scene must be drawn again.
    fn takes_news(&mut self, window: &ViewerWindow) -> bool {
        self.city.take_hits();
        if !self.city.session.has_work() {
            return false;
        }
        let request = self.city.frame_request(window, 1);
        self.city.session.update(&request);
        self.update_status();
        let is_changed = !self.city.session.is_settled();
        if is_changed {
            self.city.pacer.content_changed();
        }
        is_changed
    }

    /// Draws a frame by the CPU ray-caster, or begins to. Returns a frame that is to be presented: one that the GPU is still to
    /// draw, or that was drawn at once. Fails if the ray-caster fails.
    fn draw_scene(&mut self, now: Instant, window: &mut ViewerWindow) -> Result<Option<DrawnFrame>> {
        (self.has_prefetch, self.has_arrivals) = (true, false);
        let (detail, data) = self.stream(now, window);
        let selection = now.elapsed();
        self.update_status();
        if detail.is_final && self.lift_out() {
            window.window.request_redraw();
            return Ok(None);
        }
        let CityView { session, pacer, .. } = &mut self.city;
        if self.shows_final_frame && !detail.is_final {
            // A coarse frame in place of a fine one would look like a fault. Its hits are needed nevertheless.
            let begin = Instant::now();
            session.render(&data)?;
            let time = begin.elapsed();
            pacer.end_frame(FrameTime { scene: time, all: time }, detail, false);
            return Ok(None);
        }
        if matches!(session.adapter(), Adapter::Gpu(_)) {
            window.show_scene();
        } else if detail.is_final {
            let is_long = pacer.first_still_samples(detail.samples) < detail.samples;
            let shows_sketch = is_long && !self.shows_final_frame;
            let frame = SteppedFrame::default();
            self.still = Some(StillFrame { data, frame, shows_sketch, duration: Duration::ZERO });
            return Ok(None);
        } else {
            let begin = Instant::now();
            window.set_background(&session.render(&data)?);
            return Ok(Some(DrawnFrame { detail, data, selection, time: Some(begin.elapsed()) }));
        }
        Ok(Some(DrawnFrame { detail, data, selection, time: None }))
    }

    /// Goes on with the final frame. Returns whether there is something new to present.
    fn continue_still(&mut self, mut still: StillFrame, window: &mut ViewerWindow) -> bool {
        let begin = Instant::now();
        let CityView { session, pacer, playback, .. } = &mut self.city;
        let (progress, pixels) = session.render_step(&still.data, &mut still.frame, STEP);
        still.duration += begin.elapsed();
        match progress {
            FrameProgress::Drawing => {}
            FrameProgress::Sketched => pacer.end_step(still.duration, 1.0, 1),
            FrameProgress::Drawn => {
                pacer.end_step(still.duration, 1.0, still.data.frame.samples);
                pacer.end_steps();
                session.record_frame_time(still.duration);
                if let Some(playback) = playback {
                    playback.record_frame_time(still.duration);
                }
            }
        }
        let is_drawn = progress == FrameProgress::Drawn;
        let shown = pixels.filter(|_| is_drawn || still.shows_sketch);
        if let Some(pixels) = &shown {
            window.set_background(pixels);
        }
        match is_drawn {
            true => self.finished = Some(still.data),
            false => self.still = Some(still),
        }
        shown.is_some()
    }

    /// Whether the final frame is being drawn, which goes on between events.
    pub fn is_drawing(&self) -> bool {
        self.still.is_some()
    }

    /// Goes on with it, without changing the screen: presenting takes a software driver as long as a step. Returns when to go on, or
    /// `None` if a frame is to be presented.
    pub fn draw_further(&mut self, window: &mut ViewerWindow) -> Option<ControlFlow> {
        let is_overlay_due = self.wake_at.is_some_and(|at| at <= Instant::now());
        let has_news = self.still.take().is_none_or(|still| self.continue_still(still, window));
        (!has_news && !is_overlay_due).then(|| ControlFlow::WaitUntil(Instant::now()))
    }

    /// Lifts the camera of a resting view out of a solid. Returns whether it was in one.
    fn lift_out(&mut self) -> bool {
        let CityView { session, control, playback, recorder, .. } = &mut self.city;
        let is_lifted = playback.is_none() && recorder.is_none() && control.lift_out(&session.solids());
        if is_lifted {
            self.city.show_message("the camera was inside of a building or below the ground: lifted out".to_owned());
        }
        is_lifted
    }

    /// Presents the scene and the overlay. Returns `false` if the frame must be presented again.
    fn present(
        &mut self,
        drawn: Option<DrawnFrame>,
        begin: Instant,
        layout: &mut OverlayLayout,
        window: &mut ViewerWindow,
    ) -> Result<bool> {
        let laid_out = begin.elapsed();
        let Some(DrawnFrame { detail, data, selection, time }) = drawn else {
            return window.surface.present(None, &mut layout.shapes);
        };
        let city = &mut self.city;
        let is_presented = city.session.while_fetching(|adapter| {
            let scene = match adapter {
                Adapter::Gpu(gpu) => Some(SceneFrame { gpu, data: &data }),
                Adapter::Cpu(_) => None,
            };
            window.surface.present(scene, &mut layout.shapes)
        })?;
        city.session.frame_drawn(&data);
        city.session.record_frame_time(begin.elapsed());
        if let Some(playback) = &mut city.playback {
            playback.record_frame_time(begin.elapsed());
        }
        let all = begin.elapsed();
        let camera = self.view.map_or_else(|| city.control.camera(), |view| view.camera);
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        tracing::trace!(
            divisor = detail.divisor,
            samples = detail.samples,
            selection_ms = ms(selection),
            scene_ms = ms(time.unwrap_or(all)),
            layout_ms = ms(laid_out.saturating_sub(selection + time.unwrap_or_default())),
            present_ms = ms(all.saturating_sub(laid_out)),
            all_ms = ms(all),
            full_frame_ms = ms(city.pacer.full_frame_time()),
            camera = %camera_text::format(&camera),
            "frame of a new view presented"
        );
        if city.pacer.end_frame(FrameTime { scene: time.unwrap_or(all), all }, detail, is_presented) {
            self.settled(&data, window);
        }
        Ok(is_presented)
    }

    /// The final frame of a view was drawn.
    fn settled(&mut self, data: &FrameData, window: &ViewerWindow) {
        if let Some(ViewState { camera, size_px, .. }) = &self.view {
            self.log.settled(camera, *size_px, self.city.pacer.since_change(Instant::now()));
        }
        self.shows_final_frame = true;
        if self.city.counts_rays {
            // Takes about as long as drawing the frame.
            self.city.ray_counts = self.city.session.adapter_mut().count(data).ok();
            window.window.request_redraw();
        }
    }

    /// Compares the view with that of the last frame. If it differs, the scene is redrawn.
    fn notice_view(&mut self, now: Instant, window: &ViewerWindow) {
        let CityView { session, control, display, pacer, counts_rays, objects, styles, stones, .. } = &mut self.city;
        let view = ViewState {
            camera: control.camera(),
            size_px: window.surface.size_px(),
            tau_px: display.tau_px,
            daylight: display.daylight,
            shading: display.shading,
            counts_rays: *counts_rays,
            selection: objects.generation(),
            styles: styles.generation(),
            stones: stones.generation(),
            proposal: session.proposal().map(ShownProposal::is_shown),
        };
        if self.view != Some(view) {
            pacer.view_changed(now);
            (self.view, self.shows_final_frame) = (Some(view), false);
            (self.still, self.finished) = (None, None);
        }
    }

    /// Moves the camera. Returns `false` at the end of a playback.
    fn advance(&mut self, now: Instant) -> bool {
        let city = &mut self.city;
        if city.display.day.advance(&mut city.display.daylight, now) {
            city.render_settings = city.display.daylight.render_settings(Shading::Lit, 1);
        }
        if let Some(playback) = &mut city.playback {
            let Some(cameras) = playback.cameras(now) else {
                println!("{}", playback.summary());
                return false;
            };
            city.control.set_camera(&cameras.now);
            city.playback_heading = cameras.ahead;
        }
        city.control.advance_to(now);
        let (solids, plane_z_m) = (city.session.solids(), city.session.tree().manifest().ground_z_m);
        city.control.keep_outside(&solids, plane_z_m);
        let camera = city.control.camera();
        if city.recorder.as_mut().is_some_and(|recorder| !recorder.sample(now, &camera)) {
            city.toggle_recording();
        }
        true
    }

    /// Updates the session. Returns the frame to draw and its detail.
    fn stream(&mut self, now: Instant, window: &ViewerWindow) -> (FrameDetail, FrameData) {
        let city = &mut self.city;
        let was_settled = city.session.is_settled();
        city.take_hits();
        let settings = RenderSettings { shading: city.display.shading, ..city.render_settings };
        city.session.set_sun(settings.shadow_casting_sun());
        city.session.set_tau_factor(city.pacer.tau_factor(now));
        // Tiles are selected for the whole window, however few pixels are drawn.
        let whole_window = city.frame_request(window, 1);
        city.session.update(&whole_window);
        let detail = city.pacer.detail(now, was_settled && city.session.is_settled());
        let settings = RenderSettings { samples: detail.samples, ..settings };
        let request = city.frame_request(window, detail.divisor);
        let data = city.session.frame_data(&request, &settings);
        (detail, data)
    }

    /// Updates the status, and logs it if it changed.
    fn update_status(&mut self) {
        let status = self.city.session.stream_status();
        if status != self.status {
            let text = status_text(status, &self.city.session);
            tracing::info!("status: {}", text.as_deref().unwrap_or("ready"));
            self.status = status;
        }
    }

    /// Applies what the user changed in the panels.
    fn apply_options(&mut self, before: &DisplayOptions, window: &ViewerWindow, settings: &mut UserSettings) {
        let DisplayOptions { tau_px, daylight, .. } = self.city.display;
        if before.daylight != daylight {
            self.city.render_settings = daylight.render_settings(Shading::Lit, 1);
            settings.shadows = daylight.shadows;
            settings.time = daylight.fixed_bearing.is_none().then(|| daylight.time_text());
        }
        settings.tau_px = tau_px;
        if before.daylight != daylight || before.tau_px != tau_px {
            window.window.request_redraw();
        }
    }

    fn lay_out(&mut self, window: &mut ViewerWindow, settings: &mut UserSettings) -> OverlayLayout {
        self.city.check_picture(window);
        self.city.sample_pointer(window);
        self.city.poll_objects();
        let request = self.city.frame_request(window, 1);
        let furniture = self.furniture(window);
        let CityView {
            session,
            control,
            display,
            bookmark_panel,
            measure,
            objects,
            search,
            styles,
            stones,
            recorder,
            ray_counts,
            pacer,
            ..
        } = &mut self.city;
        let texts = OverlayTexts::new(session, pacer, control, *ray_counts);
        let status_text = status_text(self.status, session);
        let is_error = self.status != StreamStatus::Loading;
        let camera = control.camera();
        let view = session.view(&request, camera);
        let manifest = session.tree().manifest();
        let bookmarks = settings.bookmarks.get(&manifest.name).map_or(&[][..], Vec::as_slice);
        let recording = recorder.as_ref().map(|recorder| format!("recording, {:.0} s", recorder.secs(Instant::now())));
        let (mut action, mut changed_stone) = (None, None);
        let layout = window.lay_out(|ctx| {
            box_view::paint(session, &request, display.shading, ctx);
            measure_view::paint(measure, &ctx.layer_painter(egui::LayerId::background()), &view, ctx.content_rect());
            action = overlay::show(ctx, &texts, display).or(proposal_panel::show(ctx, session)).or(action);
            if furniture::show(ctx, &furniture) {
                action = Some(ViewAction::NorthUp);
            }
            if let Some(text) = &status_text {
                overlay::notice(ctx, text, is_error);
            }
            if let Some(side) = minimap::side(ctx.content_rect().size()).filter(|_| display.shows_map) {
                panel(ctx, "map", Align2::RIGHT_TOP, [-10.0, 10.0], |ui| {
                    let point = minimap::show(ui, side, session, &camera, display.shows_counters);
                    action = point.map(|p| ViewAction::GoTo { x: p.x, y: p.y, z: None }).or(action);
                });
            }
            if !objects.selected().is_empty() {
                panel(ctx, "objects", Align2::RIGHT_BOTTOM, [-10.0, ABOVE_ATTRIBUTION], |ui| {
                    action = objects.show(ui).or(action.take());
                });
            }
            if search.is_open {
                panel(ctx, "search", Align2::CENTER_TOP, [0.0, 10.0], |ui| {
                    action = search.show(ui).map(ViewAction::SelectObject).or(action.take());
                });
            } else {
                search.hide();
            }
            if styles.is_shown() {
                panel(ctx, "styles", Align2::LEFT_CENTER, [10.0, 0.0], |ui| styles.show(ui));
            }
            if stones.is_open {
                panel(ctx, "stones", Align2::RIGHT_CENTER, [-10.0, 40.0], |ui| changed_stone = stones.show(ui));
            }
            if bookmark_panel.is_open {
                panel(ctx, "bookmarks", Align2::LEFT_BOTTOM, [10.0, ABOVE_FURNITURE], |ui| {
                    action = bookmark_panel.show(ui, bookmarks, manifest).or(action);
                });
            }
            let below_notice = if status_text.is_some() { 130.0 } else { 52.0 };
            measure_view::show_tool(ctx, measure, recording.as_deref(), below_notice);
        });
        if let Some((number, stone)) = changed_stone {
            session.set_stone(number, stone);
        }
        if let Some(action) = action {
            self.city.apply(action, window, settings);
        }
        layout
    }

    /// Content of the panel that is always there.
    fn furniture(&self, window: &ViewerWindow) -> Furniture {
        let CityView { session, control, readout, picture, .. } = &self.city;
        let pixels_per_point = f64::from(window.egui.pixels_per_point());
        Furniture {
            yaw_rad: control.camera().angles().0,
            metres_per_point: readout.metres_per_px().map(|metres| metres * pixels_per_point),
            has_pointer: readout.has_pointer(),
            coordinates: readout.text(session.tree().manifest().crs.as_deref()),
            works: loading_text(session.missing_tiles(), self.city.display.shows_counters)
                .into_iter()
                .chain(picture.as_ref().map(PictureJob::text))
                .collect(),
        }
    }

    /// When the next frame is due.
    fn next_frame(&mut self, repaint_after: Duration, is_presented: bool, window: &ViewerWindow) -> ControlFlow {
        let now = Instant::now();
        self.wake_at = None;
        if !is_presented {
            self.wake_at = Some(now + POLL_INTERVAL);
            return wait_until(self.wake_at);
        }
        if self.still.is_some() {
            self.wake_at = now.checked_add(repaint_after.max(POLL_INTERVAL));
            return ControlFlow::WaitUntil(now);
        }
        let CityView { session, pacer, recorder, display, control, readout, objects, search, styles, .. } = &self.city;
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
        let is_waiting = objects.is_waiting() || search.is_waiting() || styles.is_waiting();
        let recording_at = (recorder.is_some() || is_waiting).then(|| now + POLL_INTERVAL);
        let message_at = display.message.as_ref().map(|message| message.until);
        let readout_at = readout.due_at(&control.camera(), now);
        let recheck_at = session.recheck_at().map(|at| at.max(now + POLL_INTERVAL));
        let due = [repaint_at, progress_at, recording_at, message_at, readout_at, recheck_at];
        self.wake_at = due.into_iter().flatten().min();
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
        self.still = None;
        true
    }

    /// Whether the view rests and there is something to take in or to prefetch.
    pub fn may_prefetch(&self) -> bool {
        let is_frame_due = self.finished.is_some() || self.wake_at.is_some_and(|at| at <= Instant::now());
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
            self.log.rests();
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
