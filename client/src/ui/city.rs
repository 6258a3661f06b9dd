//! A city in the window: its camera, its panels, its frames.
//!
//! In: window events, a session. Out: shots for `session`, drawn frames. Next: `surface`.

use super::{
    control::Control,
    measure::Measure,
    minimap,
    overlay::{self, MESSAGE_TIME, Shown, Status, panel},
    pace::{Detail, Pace},
    places::{Places, Wish},
    record::Recorder,
    settings::Settings,
    shell::Shell,
    surface::{Overlay, image},
    tour::Tour,
};
use crate::{
    error::Result,
    render::Adapter,
    session::{PrefetchStep, Session},
};
use egui::Align2;
use glam::DVec3;
use insula_shaders::{cpu::raycast::Counts, layout::Shading};
use insula_viewer::{
    camera::Camera,
    frame::{FrameData, RenderSettings},
    streamer::FrameRequest,
    sun::Daylight,
};
use std::time::{Duration, Instant};
use winit::event_loop::ControlFlow;

/// A hidden window looks for arrivals so often.
const RETRY: Duration = Duration::from_millis(100);
/// A server may be silent for so long before anybody is told.
const SILENT: Duration = Duration::from_millis(700);

/// What `window` makes a city of.
pub struct Opening {
    /// What streams and draws.
    pub session: Session,
    /// Its address for links; empty if it has none.
    pub address: String,
    /// Where it looks from; the whole city unless given.
    pub camera: Option<Camera>,
    /// The sun at first.
    pub daylight: Daylight,
    /// Tolerated error at first.
    pub tau_px: f64,
    /// A flight that flies itself.
    pub tour: Option<Tour>,
}

/// What stands in the way of a whole picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Trouble {
    None,
    Loading,
    Reconnecting,
    Broken,
}

/// A city that is looked at.
pub struct City {
    pub(super) session: Session,
    pub(super) address: String,
    pub(super) control: Control,
    pub(super) shown: Shown,
    /// Of the shown daylight.
    pub(super) look: RenderSettings,
    pub(super) places: Places,
    pub(super) measure: Measure,
    pub(super) recorder: Option<Recorder>,
    tour: Option<Tour>,
    /// Where the tour will be in a moment.
    heading: Option<Camera>,
    pub(super) pace: Pace,
    trouble: Trouble,
    /// There may be something to look at beside the picture.
    around: bool,
    /// Something arrived while the picture rested.
    pub(super) news: bool,
    /// When a frame is due although nothing happens.
    wake: Option<Instant>,
    /// Whether rays are counted, and what they did in the last picture that rested.
    pub(super) counting: bool,
    pub(super) counts: Option<Counts>,
    /// Settings were changed that should not be lost.
    pub(super) store: bool,
}

impl City {
    /// A city that was just connected to.
    pub fn new(opening: Opening, settings: &Settings, aspect: f64) -> Self {
        let Opening { session, address, camera, daylight, tau_px, tour } = opening;
        let manifest = session.tree().manifest();
        let camera = camera.unwrap_or_else(|| Camera::overview(manifest.focus_bounds(), aspect));
        let size_m = DVec3::from(manifest.bounds[1]).distance(manifest.bounds[0].into());
        let control = Control::new(&camera, size_m, manifest.ground_z_m);
        tracing::info!("open: {}", manifest.name);
        Self {
            session,
            address,
            control,
            shown: Shown {
                tau_px,
                shading: Shading::Lit,
                daylight,
                overlay: settings.overlay,
                minimap: settings.minimap,
                help: false,
                message: None,
            },
            look: daylight.render_settings(Shading::Lit, 1),
            places: Places::default(),
            measure: Measure::default(),
            recorder: None,
            tour,
            heading: None,
            pace: Pace::new(Instant::now()),
            trouble: Trouble::Loading,
            around: true,
            news: false,
            wake: None,
            counting: false,
            counts: None,
            store: false,
        }
    }

    pub(super) fn name(&self) -> &str {
        &self.session.tree().manifest().name
    }

    /// Says something for a while, on standard output too.
    pub(super) fn tell(&mut self, text: String) {
        println!("{text}");
        self.shown.message = Some((text, Instant::now() + MESSAGE_TIME));
    }

    /// The picture will differ.
    pub(super) fn changed(&mut self, shell: &Shell) {
        self.pace.changed(Instant::now());
        shell.window.request_redraw();
    }

    pub(super) fn shot(&self, shell: &Shell, divide: u32) -> FrameRequest {
        FrameRequest {
            camera: self.control.camera(),
            heading: if self.tour.is_some() { self.heading } else { self.control.heading() },
            size_px: shell.surface.size_px().map(|side| (side / divide).max(1)),
            tau_px: self.shown.tau_px,
        }
    }

    /// One frame: move, stream, draw; when to draw the next, or `None` when a tour has ended.
    pub fn frame(&mut self, shell: &mut Shell, settings: &mut Settings) -> Result<Option<ControlFlow>> {
        let begin = Instant::now();
        (self.around, self.news) = (true, false);
        let secs = self.pace.begin(begin);
        if !self.advance(begin, secs) {
            return Ok(None);
        }
        let detail = self.pace.detail(begin, self.session.is_settled());
        if let Adapter::Gpu(gpu) = self.session.adapter_mut()
            && let Some((asked, pixels)) = gpu.answer()
        {
            self.session.report_hits(&asked, &pixels);
        }
        // Fewer pixels do not mean that less is fetched: what streams must not depend on how fast pixels come.
        let whole = self.shot(shell, 1);
        self.session.set_sun(RenderSettings { shading: self.shown.shading, ..self.look }.shadow_casting_sun());
        self.session.update(&whole);
        let shot = self.shot(shell, detail.divide);
        let detail = Detail { fine: detail.fine && self.session.is_settled(), ..detail };
        let look = RenderSettings { samples: detail.samples, shading: self.shown.shading, ..self.look };
        let data = self.session.frame_data(&shot, &look);
        if matches!(self.session.adapter(), Adapter::Cpu(_)) {
            shell.set_picture(image(&self.session.render(&data)?));
        }
        self.watch();
        let before = (self.shown.tau_px, self.shown.daylight);
        let (overlay, again) = self.lay_out(shell, settings);
        let shown = self.session.while_fetching(|adapter| shell.surface.present(Some((adapter, &data)), &overlay))?;
        self.session.frame_drawn(&data);
        if self.pace.end(begin, detail, shown) {
            tracing::debug!("at rest");
            self.count(&data, shell);
        }
        self.session.record_frame_time(begin.elapsed());
        if let Some(tour) = &mut self.tour {
            tour.timed(begin.elapsed());
        }
        self.moved(before, shell, settings);
        Ok(Some(self.next(again, shown, shell)))
    }

    /// Whether the picture on the screen stays, unless something came that makes it better.
    pub fn rests(&self) -> bool {
        let flies = self.control.moving() || self.tour.is_some() || self.recorder.is_some();
        let asks = self.session.adapter().is_asking();
        self.pace.is_rested() && self.trouble == Trouble::None && !flies && !asks
    }

    /// Whether there is time to take in what came, or to look at what a turn would show.
    pub fn may_look_around(&self) -> bool {
        let is_due = self.wake.is_some_and(|at| at <= Instant::now());
        (self.around || self.news) && self.rests() && !is_due
    }

    /// Takes in what came, and looks at what a turn would show; nothing on the screen changes. When to go on, or `None` if a
    /// frame is due instead.
    pub fn look_around(&mut self, shell: &Shell) -> Result<Option<ControlFlow>> {
        let shot = self.shot(shell, 1);
        self.news = false;
        self.session.update(&shot);
        self.watch();
        if !self.session.is_settled() || self.trouble != Trouble::None {
            self.pace.stir();
            return Ok(None);
        }
        let state = if self.around { self.session.prefetch(&shot)? } else { PrefetchStep::Done };
        if self.around && state == PrefetchStep::Done {
            tracing::debug!("looked around");
        }
        self.around = state != PrefetchStep::Done;
        let again = match state {
            PrefetchStep::Drawn => Some(Instant::now()),
            PrefetchStep::Waiting => Some(self.retry_at()),
            PrefetchStep::Done => None,
        };
        Ok(Some(wait_until(self.wake.into_iter().chain(again).min())))
    }

    /// When to look after what did not come. Arrivals wake the loop; retries have their time.
    fn retry_at(&self) -> Instant {
        let soon = Instant::now() + RETRY;
        self.session.retry_at().map_or(soon, |at| at.max(soon))
    }

    /// Counts what the rays of a picture do, if that was asked for: it costs as much as the picture.
    fn count(&mut self, data: &FrameData, shell: &Shell) {
        if self.counting {
            self.counts = self.session.adapter_mut().count(data).ok();
            shell.window.request_redraw();
        }
    }

    /// Time passes; `false` at the end of a tour.
    fn advance(&mut self, now: Instant, secs: f64) -> bool {
        if let Some(tour) = &mut self.tour {
            let Some((camera, heading)) = tour.cameras(now) else {
                println!("{}", tour.summary());
                return false;
            };
            self.control.set(&camera);
            self.heading = heading;
            self.pace.changed(now);
        }
        if self.control.advance(secs) {
            self.pace.changed(now);
        }
        let camera = self.control.camera();
        if self.recorder.as_mut().is_some_and(|recorder| !recorder.sample(now, &camera)) {
            self.record();
        }
        true
    }

    /// The sliders moved.
    fn moved(&mut self, before: (f64, Daylight), shell: &Shell, settings: &mut Settings) {
        if before.1 != self.shown.daylight {
            self.look = self.shown.daylight.render_settings(Shading::Lit, 1);
            settings.shadows = self.shown.daylight.shadows;
            settings.time = self.shown.daylight.fixed_bearing.is_none().then(|| self.shown.daylight.time_text());
        }
        if before.0 != self.shown.tau_px {
            settings.tau_px = self.shown.tau_px;
        }
        if before != (self.shown.tau_px, self.shown.daylight) {
            self.changed(shell);
        }
    }

    /// Notices what stands in the way of a whole picture, and logs when that changes.
    fn watch(&mut self) {
        // A picture that lacks nothing needs no server.
        let failing = self.session.failing_for().filter(|_| self.session.lacks_tiles());
        let silent = failing.is_some_and(|time| time > SILENT);
        let trouble = match self.session.check(Duration::MAX) {
            Err(_) => Trouble::Broken,
            Ok(()) if silent => Trouble::Reconnecting,
            Ok(()) if self.session.selection().draw_tiles.is_empty() => Trouble::Loading,
            Ok(()) => Trouble::None,
        };
        if trouble != self.trouble {
            tracing::info!("now: {}", self.trouble_text(trouble).unwrap_or_else(|| "all is well".to_owned()));
            self.trouble = trouble;
        }
    }

    fn trouble_text(&self, trouble: Trouble) -> Option<String> {
        match trouble {
            Trouble::None => None,
            Trouble::Loading => Some(format!("loading {}", self.name())),
            Trouble::Reconnecting => {
                let secs = self.session.failing_for().map_or(0, |time| time.as_secs());
                let why = self.session.downloads().last_error();
                Some(format!("reconnecting: the server has not answered for {secs} s ({why}); trying again"))
            }
            Trouble::Broken => self.session.check(Duration::MAX).err().map(|error| error.to_string()),
        }
    }

    fn lay_out(&mut self, shell: &mut Shell, settings: &mut Settings) -> (Overlay, Duration) {
        let (control, session) = (&self.control, &self.session);
        let status =
            Status::new(session, self.pace.frame_time(), (control.mode(), control.speed_m_per_sec()), self.counts);
        let trouble = self.trouble_text(self.trouble);
        let bad = self.trouble != Trouble::Loading;
        let camera = control.camera();
        let shot = self.shot(shell, 1);
        let view = session.view(&shot, camera);
        let manifest = session.tree().manifest();
        let bookmarks = settings.bookmarks.get(&manifest.name).map_or(&[][..], Vec::as_slice);
        let recording = self.recorder.as_ref().map(|r| format!("recording, {:.0} s", r.secs(Instant::now())));
        let (shown, places, measure) = (&mut self.shown, &mut self.places, &self.measure);
        let mut wish = None;
        let laid_out = shell.lay_out(|ctx| {
            measure.paint(&ctx.layer_painter(egui::LayerId::background()), &view, ctx.content_rect());
            overlay::show(ctx, &status, shown);
            if let Some(text) = &trouble {
                overlay::notice(ctx, text, bad);
            }
            if shown.minimap {
                panel(ctx, "map", Align2::RIGHT_TOP, [-10.0, 10.0], |ui| {
                    let place = minimap::show(ui, session, &camera);
                    wish = place.map(|p| Wish::Go(p.to_array(), None)).or(wish);
                });
            }
            if places.open {
                panel(ctx, "places", Align2::LEFT_BOTTOM, [10.0, -10.0], |ui| {
                    wish = places.show(ui, bookmarks, manifest).or(wish);
                });
            }
            if let Some(text) = measure.text().or_else(|| recording.clone()) {
                panel(ctx, "tool", Align2::CENTER_BOTTOM, [0.0, -12.0], |ui| {
                    ui.label(text);
                });
            }
        });
        if let Some(wish) = wish {
            self.wish(wish, shell, settings);
        }
        laid_out
    }

    fn next(&mut self, again: Duration, shown: bool, shell: &Shell) -> ControlFlow {
        let now = Instant::now();
        self.wake = None;
        if !shown {
            return ControlFlow::WaitUntil(now + RETRY);
        }
        let flying = self.control.moving() || self.tour.is_some();
        if flying
            || self.session.has_work()
            || self.session.adapter().is_asking()
            || again.is_zero() && self.trouble == Trouble::None
        {
            shell.window.request_redraw();
            return ControlFlow::Wait;
        }
        // A spinner that turns must not cost a core.
        let again = again.max(RETRY);
        let mut wake = now.checked_add(again.min(Duration::from_secs(3600)));
        let mut sooner = |at: Option<Instant>| wake = wake.into_iter().chain(at).min();
        if !self.session.is_settled() {
            sooner(Some(self.retry_at()));
        } else {
            sooner(self.pace.rest_at().map(|at| at.max(now)));
        }
        if self.recorder.is_some() {
            sooner(Some(now + RETRY));
        }
        sooner(self.shown.message.as_ref().map(|(_, until)| *until));
        self.wake = wake;
        if self.may_look_around() { ControlFlow::WaitUntil(now) } else { wait_until(wake) }
    }
}

fn wait_until(at: Option<Instant>) -> ControlFlow {
    at.map_or(ControlFlow::Wait, ControlFlow::WaitUntil)
}
