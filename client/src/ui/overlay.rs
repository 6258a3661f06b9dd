//! What lies over the picture: counters, the tau slider, help, who must be named.
//!
//! In: [`Status`]. Out: egui shapes; [`Settings`] that the user changes. Next: `surface` paints them.

use super::control::Mode;
use crate::{session::Session, sun::Daylight};
use chrono::{Datelike, NaiveDate};
use egui::{Align2, Color32, Context, Frame, RichText, Ui};
use insula_shaders::layout::Shading;
use std::time::{Duration, Instant};

/// What the user can change, and what is shown.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Tolerated error.
    pub tau_px: f64,
    /// What pixels show.
    pub shading: Shading,
    /// The sun.
    pub daylight: Daylight,
    /// Whether help is shown.
    pub help: bool,
    /// A message, until then.
    pub message: Option<(String, Instant)>,
}

/// What the counters say.
#[derive(Debug, Clone, Default)]
pub struct Status {
    lines: Vec<(&'static str, String)>,
    attribution: String,
    title: String,
}

/// How long a message stays.
pub const MESSAGE_TIME: Duration = Duration::from_secs(5);

const HELP: [(&str, &str); 9] = [
    ("drag", "look around, or turn around the point ahead"),
    ("W A S D", "move; with shift, four times as fast"),
    ("Q E", "down and up"),
    ("wheel", "speed (flying), distance (orbiting)"),
    ("Tab", "fly or orbit"),
    ("1 to 6", "light, colour, ambient occlusion, normals, levels, column kinds (F2 to F7 too)"),
    ("P", "write a picture into the current folder"),
    ("F1", "this help"),
    ("Esc", "quit"),
];

impl Status {
    /// Of the last frame.
    pub fn new(session: &Session, frame_time: Duration, mode: Mode, speed_m_per_sec: f64) -> Self {
        let counters = session.selection().counters;
        let mib = |bytes: u64| format!("{:.1} MiB", bytes as f64 / f64::from(1u32 << 20));
        let steering = match mode {
            Mode::Fly => format!("fly, {speed_m_per_sec:.0} m/s"),
            Mode::Orbit => "orbit".into(),
        };
        let mut lines = vec![
            ("frame", format!("{:.1} ms", frame_time.as_secs_f64() * 1e3)),
            ("drawn", format!("{} nodes, error {:.1} px", counters.drawn, counters.worst_error_px)),
            ("resident", format!("{} nodes, {}", session.cache().len(), mib(session.cache().used_bytes()))),
            ("wanted", format!("{}, {} in flight", session.selection().wanted.len(), session.stream().in_flight())),
            ("fetched", mib(session.stream().http().bytes())),
            ("steering", steering),
            ("drawn by", session.adapter_info().name.clone()),
        ];
        if counters.tau_px > 1.001 * session.asked_tau_px() {
            lines.push(("cache full", format!("tau rose to {:.1} px", counters.tau_px)));
        }
        if session.stream().failing_since().is_some() {
            lines.push(("server", "does not answer, trying again".into()));
        }
        let manifest = session.tree().manifest();
        let sources = manifest.attribution.iter().map(|a| match &a.licence {
            Some(licence) => format!("{} ({licence})", a.text),
            None => a.text.clone(),
        });
        Self { lines, attribution: sources.collect::<Vec<_>>().join("; "), title: manifest.title.clone() }
    }
}

/// Lays everything out.
pub fn show(ctx: &Context, status: &Status, settings: &mut Settings) {
    counters(ctx, status, settings);
    attribution(ctx, &status.attribution);
    if settings.help {
        help(ctx);
    }
    settings.message = settings.message.take().filter(|(_, until)| Instant::now() < *until);
    if let Some((text, _)) = &settings.message {
        panel(ctx, "message", Align2::CENTER_TOP, [0.0, 12.0], |ui| {
            ui.label(RichText::new(text).color(Color32::WHITE));
        });
    }
}

fn panel(ctx: &Context, id: &'static str, align: Align2, offset: [f32; 2], add: impl FnOnce(&mut Ui)) {
    let frame = Frame::new().fill(Color32::from_black_alpha(165)).inner_margin(8).corner_radius(5);
    egui::Area::new(egui::Id::unique(id)).anchor(align, offset).show(ctx, |ui| {
        frame.show(ui, |ui| {
            ui.visuals_mut().override_text_color = Some(Color32::from_gray(225));
            add(ui);
        });
    });
}

fn counters(ctx: &Context, status: &Status, settings: &mut Settings) {
    panel(ctx, "counters", Align2::LEFT_TOP, [10.0, 10.0], |ui| {
        ui.label(RichText::new(&status.title).strong().color(Color32::WHITE));
        egui::Grid::new("numbers").num_columns(2).spacing([10.0, 2.0]).show(ui, |ui| {
            for (name, value) in &status.lines {
                ui.label(RichText::new(*name).color(Color32::from_gray(160)));
                ui.label(value);
                ui.end_row();
            }
        });
        let slider = egui::Slider::new(&mut settings.tau_px, 0.5..=16.0).logarithmic(true).text("tau, px");
        ui.add(slider.fixed_decimals(1));
        sun(ui, &mut settings.daylight);
        ui.label(RichText::new(format!("{}   F1: help", settings.shading.word())).color(Color32::from_gray(160)));
    });
}

/// Hour and date; touching either lets a sun that was told where to be go its way.
fn sun(ui: &mut Ui, daylight: &mut Daylight) {
    let clock = |hour: f64, _: std::ops::RangeInclusive<usize>| {
        let minutes = (hour * 60.0).round() as u32;
        format!("{:02}:{:02}", minutes / 60, minutes % 60)
    };
    let hour = egui::Slider::new(&mut daylight.hour, 0.0..=23.99).custom_formatter(clock).text("solar time");
    let mut moved = ui.add(hour).changed();
    let (year, mut day) = (daylight.date.year(), daylight.date.ordinal());
    let named = move |day: f64, _: std::ops::RangeInclusive<usize>| {
        let date = NaiveDate::from_yo_opt(year, day.round() as u32);
        date.map(|date| date.format("%-d %b").to_string()).unwrap_or_default()
    };
    if ui.add(egui::Slider::new(&mut day, 1..=365).custom_formatter(named).text("date")).changed() {
        daylight.date = NaiveDate::from_yo_opt(year, day).unwrap_or(daylight.date);
        moved = true;
    }
    if moved {
        daylight.fixed = None;
    }
    if !daylight.place.known {
        let [north, _] = daylight.place.degrees();
        ui.label(RichText::new(format!("place unknown, taken as {north:.0}\u{b0} north")).small());
    }
}

fn attribution(ctx: &Context, text: &str) {
    if !text.is_empty() {
        panel(ctx, "attribution", Align2::RIGHT_BOTTOM, [-10.0, -10.0], |ui| {
            ui.label(RichText::new(text).small());
        });
    }
}

fn help(ctx: &Context) {
    panel(ctx, "help", Align2::CENTER_CENTER, [0.0, 0.0], |ui| {
        egui::Grid::new("keys").num_columns(2).spacing([18.0, 6.0]).show(ui, |ui| {
            for (keys, what) in HELP {
                ui.label(RichText::new(keys).strong().color(Color32::WHITE));
                ui.label(what);
                ui.end_row();
            }
        });
    });
}
