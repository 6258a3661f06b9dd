//! Panels over the frame: sliders, counters, help, messages, attribution.

use super::bookmarks::ViewAction;
use super::key_bindings::HELP;
use super::picture_size::PictureSize;
use super::process_memory::resident_bytes;
use crate::session::Session;
use chrono::{Datelike, NaiveDate};
use egui::{Align2, Color32, Context, Frame, RichText, Ui};
use insula_protocol::text::printable;
use insula_shaders::cpu::raycast::RayCounts;
use insula_shaders::layout::Shading;
use insula_shaders::look::Look;
use insula_viewer::interaction::camera_control::{CameraControl, ControlMode};
use insula_viewer::interaction::day_animation::{DAY_SECS, DayAnimation};
use insula_viewer::interaction::frame_pacing::FramePacer;
use insula_viewer::sun::Daylight;
use insula_viewer::translucency::Translucency;
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

/// How long a message is options.
pub const MESSAGE_TIME: Duration = Duration::from_secs(5);

/// What is displayed, as far as the user can change it.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplayOptions {
    /// Tolerated screen-space error.
    pub tau_px: f64,
    pub shading: Shading,
    pub daylight: Daylight,
    /// Whether the panel of light, detail and pictures is shown.
    pub shows_sliders: bool,
    /// Whether that panel has the developer counters.
    pub shows_counters: bool,
    pub picture: PictureSize,
    pub day: DayAnimation,
    pub shows_map: bool,
    pub shows_help: bool,
    pub message: Option<TimedMessage>,
}

/// A message that is shown for [`MESSAGE_TIME`].
#[derive(Debug, Clone, PartialEq)]
pub struct TimedMessage {
    pub text: String,
    pub until: Instant,
}

/// Texts of the counters and of the attribution.
#[derive(Debug, Clone, Default)]
pub struct OverlayTexts {
    /// Names and values.
    counters: Vec<(&'static str, String)>,
    attribution: String,
    title: String,
}

impl OverlayTexts {
    /// Texts for the last frame. `ray_counts` are shown if there are any.
    pub fn new(session: &Session, pacer: &FramePacer, control: &CameraControl, ray_counts: Option<RayCounts>) -> Self {
        let counters = session.selection().stats;
        let mib = |bytes: u64| format!("{:.1} MiB", bytes as f64 / f64::from(1u32 << 20));
        let mode = match control.mode() {
            ControlMode::Fly => format!("fly, {:.0} m/s", control.speed_m_per_sec()),
            ControlMode::Walk => format!("walk, {:.0} m/s", control.speed_m_per_sec()),
            ControlMode::Orbit => "orbit".into(),
        };
        let mut lines = vec![
            ("frame", format!("{:.1} ms", pacer.frame_time().as_secs_f64() * 1e3)),
            ("drawn", format!("{} nodes, error {:.1} px", counters.drawn, counters.worst_error_px)),
            ("meshes", format!("{}, {} triangles", counters.meshes, counters.triangles)),
            ("resident", format!("{} tiles, {}", session.cache().tile_count(), mib(session.cache().used_bytes()))),
            (
                "wanted",
                format!("{}, {} in flight", session.selection().requests.len(), session.downloads().in_flight()),
            ),
            ("fetched", mib(session.downloads().fetcher().http().bytes())),
            ("mode", mode),
            ("drawn by", session.adapter_info().name.clone()),
        ];
        let reason = &session.adapter_info().reason;
        if !reason.is_empty() {
            lines.push(("chosen because", reason.clone()));
        }
        if let Some(bytes) = resident_bytes() {
            lines.push(("memory", mib(bytes)));
        }
        if let Some(counts) = ray_counts {
            let each = |n: u64| n as f64 / counts.rays.max(1) as f64;
            let (nodes, steps, fetches) = (each(counts.nodes), each(counts.steps), each(counts.fetches));
            lines.push(("per ray", format!("{nodes:.2} nodes, {steps:.1} steps, {fetches:.1} fetches")));
        }
        if counters.tau_px > 1.001 * session.requested_tau_px() {
            let is_slow = pacer.tau_factor(Instant::now()) > 1.0;
            lines.push((
                if is_slow { "slow frames" } else { "cache full" },
                format!("tau raised to {:.1} px", counters.tau_px),
            ));
        }
        let manifest = session.tree().manifest();
        let sources = manifest.attribution.iter().map(|a| match &a.licence {
            Some(licence) => format!("{} ({licence})", a.text),
            None => a.text.clone(),
        });
        let attribution = printable(&sources.collect::<Vec<_>>().join("; ")).into_owned();
        Self { counters: lines, attribution, title: printable(&manifest.title).into_owned() }
    }
}

/// Lays out sliders, counters, attribution, help and message. The user may change `options`. Returns what else the user asked for.
pub fn show(ctx: &Context, texts: &OverlayTexts, options: &mut DisplayOptions) -> Option<ViewAction> {
    let mut action = None;
    if options.shows_sliders && has_room(ctx.content_rect().size()) {
        action = slider_panel(ctx, texts, options);
    }
    attribution_panel(ctx, &texts.attribution);
    if options.shows_help {
        help_panel(ctx);
    }
    options.message = options.message.take().filter(|message| Instant::now() < message.until);
    if let Some(message) = &options.message {
        panel(ctx, "message", Align2::CENTER_TOP, [0.0, 12.0], |ui| {
            ui.label(RichText::new(&message.text).color(Color32::WHITE));
        });
    }
    action
}

/// Whether a window of a size, in points, has room for sliders and coordinates beside the map.
pub fn has_room(size: egui::Vec2) -> bool {
    size.x >= 480.0 && size.y >= 360.0
}

/// A dark panel at an edge of the window. In a small window, it scrolls.
pub fn panel(ctx: &Context, id: &'static str, align: Align2, offset: [f32; 2], add: impl FnOnce(&mut Ui)) {
    let frame = Frame::new().fill(Color32::from_black_alpha(165)).inner_margin(8).corner_radius(5);
    let space = (ctx.content_rect().size() - egui::vec2(36.0, 36.0)).max(egui::vec2(60.0, 40.0));
    egui::Area::new(egui::Id::unique(id)).anchor(align, offset).default_size(space).show(ctx, |ui| {
        frame.show(ui, |ui| {
            let visuals = ui.visuals_mut();
            visuals.override_text_color = Some(Color32::from_gray(225));
            // Rails of sliders must be visible over dark scenes.
            visuals.widgets.inactive.bg_fill = Color32::from_gray(105);
            // Areas offer no more than the size of the last frame.
            ui.set_max_size(space);
            let area = egui::ScrollArea::both().id_salt(id).max_width(space.x).max_height(space.y);
            area.auto_shrink(true).show(ui, add);
        });
    });
}

/// What is to be said while there is no city.
pub(super) enum StartNotice {
    /// Something is being done.
    Busy(String),
    /// An attempt failed, another one follows.
    Retrying(String),
    /// Another attempt is up to the user.
    Failed(String),
}

/// Shows a [`StartNotice`]. Returns whether the user asks for another attempt.
pub(super) fn start_notice(ctx: &Context, shown: &StartNotice) -> bool {
    let mut is_clicked = false;
    match shown {
        StartNotice::Busy(text) => notice(ctx, text, false),
        StartNotice::Retrying(text) => notice(ctx, text, true),
        StartNotice::Failed(text) => panel(ctx, "failed", Align2::CENTER_TOP, [0.0, 56.0], |ui| {
            ui.set_max_width((ctx.content_rect().width() - 60.0).min(560.0));
            let text = RichText::new(printable(text)).size(16.0).color(Color32::from_rgb(255, 190, 110));
            ui.add(egui::Label::new(text).wrap());
            is_clicked = ui.button("try again").clicked();
        }),
    }
    is_clicked
}

/// A prominent notice that something is missing or, if `is_error`, has failed.
pub fn notice(ctx: &Context, text: &str, is_error: bool) {
    panel(ctx, "notice", Align2::CENTER_TOP, [0.0, 56.0], |ui| {
        let colour = if is_error { Color32::from_rgb(255, 190, 110) } else { Color32::WHITE };
        ui.set_max_width((ctx.content_rect().width() - 60.0).min(560.0));
        ui.spinner();
        ui.add(egui::Label::new(RichText::new(text).size(16.0).color(colour)).wrap());
    });
}

fn slider_panel(ctx: &Context, texts: &OverlayTexts, options: &mut DisplayOptions) -> Option<ViewAction> {
    let mut action = None;
    panel(ctx, "counters", Align2::LEFT_TOP, [10.0, 10.0], |ui| {
        ui.label(RichText::new(&texts.title).strong().color(Color32::WHITE));
        if options.shows_counters {
            counter_grid(ui, &texts.counters);
        }
        // Its number, an error in pixels, says nothing to most people.
        let slider =
            egui::Slider::new(&mut options.tau_px, 0.5..=16.0).logarithmic(true).text("detail: fine to coarse");
        ui.add(slider.fixed_decimals(1).show_value(options.shows_counters));
        sun_sliders(ui, &mut options.daylight);
        day_row(ui, &mut options.day);
        action = options.picture.show(ui).then_some(ViewAction::SavePicture);
        let shading = match options.shading {
            Shading::Lit => String::new(),
            other => format!("{}   ", other.word()),
        };
        ui.label(RichText::new(format!("{shading}F1: help")).color(Color32::from_gray(160)));
    });
    action
}

fn counter_grid(ui: &mut Ui, counters: &[(&'static str, String)]) {
    egui::Grid::new("numbers").num_columns(2).spacing([10.0, 2.0]).show(ui, |ui| {
        for (name, value) in counters {
            ui.label(RichText::new(*name).color(Color32::from_gray(160)));
            ui.label(value);
            ui.end_row();
        }
    });
}

/// Runs or pauses the day, and sets how long it takes.
fn day_row(ui: &mut Ui, day: &mut DayAnimation) {
    ui.horizontal(|ui| {
        if ui.button(if day.is_running() { "Pause" } else { "Run the day" }).on_hover_text("T").clicked() {
            day.toggle(Instant::now());
        }
        ui.add(egui::DragValue::new(&mut day.day_secs).range(DAY_SECS).speed(0.5).fixed_decimals(0).suffix(" s"));
    });
}

/// Sliders for time and date. Moving one ends a fixed position of the sun.
fn sun_sliders(ui: &mut Ui, daylight: &mut Daylight) {
    let clock_text = |hour: f64, _: RangeInclusive<usize>| {
        let minutes = (hour * 60.0).round() as u32;
        format!("{:02}:{:02}", minutes / 60, minutes % 60)
    };
    let hour = egui::Slider::new(&mut daylight.hour, 0.0..=23.99).custom_formatter(clock_text).text("solar time");
    let mut is_moved = ui.add(hour).changed();
    let (year, mut day) = (daylight.date.year(), daylight.date.ordinal());
    let date_text = move |day: f64, _: RangeInclusive<usize>| {
        let date = NaiveDate::from_yo_opt(year, day.round() as u32);
        date.map(|date| date.format("%-d %b").to_string()).unwrap_or_default()
    };
    if ui.add(egui::Slider::new(&mut day, 1..=365).custom_formatter(date_text).text("date")).changed() {
        daylight.date = NaiveDate::from_yo_opt(year, day).unwrap_or(daylight.date);
        is_moved = true;
    }
    if is_moved {
        daylight.fixed_bearing = None;
    }
    ui.horizontal(|ui| {
        ui.label("look");
        for look in Look::ALL {
            ui.radio_value(&mut daylight.look, look, look.word());
        }
    });
    ui.checkbox(&mut daylight.shadows, "sun shadows");
    ui.checkbox(&mut daylight.lit_windows, "lit windows at night");
    ui.horizontal(|ui| {
        ui.label("light through stone");
        for (word, quality) in Translucency::ALL {
            ui.radio_value(&mut daylight.translucency, quality, word);
        }
    });
    if !daylight.site.is_known {
        let [north, _] = daylight.site.degrees();
        ui.label(RichText::new(format!("unknown location, using {north:.0}\u{b0} north")).small());
    }
}

fn attribution_panel(ctx: &Context, text: &str) {
    if !text.is_empty() {
        panel(ctx, "attribution", Align2::RIGHT_BOTTOM, [-10.0, -10.0], |ui| {
            ui.label(RichText::new(text).small());
        });
    }
}

fn help_panel(ctx: &Context) {
    panel(ctx, "help", Align2::CENTER_CENTER, [0.0, 0.0], |ui| {
        egui::Grid::new("keys").num_columns(2).spacing([18.0, 6.0]).show(ui, |ui| {
            for (keys, action) in HELP {
                ui.label(RichText::new(keys).strong().color(Color32::WHITE));
                ui.label(action);
                ui.end_row();
            }
        });
    });
}
