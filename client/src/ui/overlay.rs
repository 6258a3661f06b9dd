//! What lies over the picture: counters, sliders, help, messages, who must be named.
//!
//! In: [`Status`]. Out: egui shapes; [`Shown`] that the user changes. Next: `surface` paints them.

use super::{control::Mode, keys::HELP, tour::resident_bytes};
use crate::session::Session;
use chrono::{Datelike, NaiveDate};
use egui::{Align2, Color32, Context, Frame, RichText, Ui};
use insula_shaders::{cpu::raycast::Counts, layout::Shading};
use insula_viewer::sun::Daylight;
use std::{
    ops::RangeInclusive,
    time::{Duration, Instant},
};

/// What the user can change, and what is shown.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// Tolerated error.
    pub tau_px: f64,
    /// What pixels show.
    pub shading: Shading,
    /// The sun.
    pub daylight: Daylight,
    /// Whether the counters are shown.
    pub overlay: bool,
    /// Whether the map is shown.
    pub minimap: bool,
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

impl Status {
    /// Of the last frame.
    pub fn new(
        session: &Session,
        frame_time: Duration,
        (mode, speed_m_per_sec): (Mode, f64),
        counts: Option<Counts>,
    ) -> Self {
        let counters = session.selection().stats;
        let mib = |bytes: u64| format!("{:.1} MiB", bytes as f64 / f64::from(1u32 << 20));
        let steering = match mode {
            Mode::Fly => format!("fly, {speed_m_per_sec:.0} m/s"),
            Mode::Orbit => "orbit".into(),
        };
        let mut lines = vec![
            ("frame", format!("{:.1} ms", frame_time.as_secs_f64() * 1e3)),
            ("drawn", format!("{} nodes, error {:.1} px", counters.drawn, counters.worst_error_px)),
            ("meshes", format!("{}, {} triangles", counters.meshes, counters.triangles)),
            ("resident", format!("{} tiles, {}", session.cache().len(), mib(session.cache().used_bytes()))),
            (
                "wanted",
                format!("{}, {} in flight", session.selection().requests.len(), session.downloads().in_flight()),
            ),
            ("fetched", mib(session.downloads().fetcher().http().bytes())),
            ("steering", steering),
            ("drawn by", session.adapter_info().name.clone()),
        ];
        if let Some(bytes) = resident_bytes() {
            lines.push(("memory", mib(bytes)));
        }
        if let Some(counts) = counts {
            let each = |n: u64| n as f64 / counts.rays.max(1) as f64;
            let (nodes, steps, fetches) = (each(counts.nodes), each(counts.steps), each(counts.fetches));
            lines.push(("each ray", format!("{nodes:.2} nodes, {steps:.1} steps, {fetches:.1} fetches")));
        }
        if counters.tau_px > 1.001 * session.requested_tau_px() {
            lines.push(("cache full", format!("tau rose to {:.1} px", counters.tau_px)));
        }
        let manifest = session.tree().manifest();
        let sources = manifest.attribution.iter().map(|a| match &a.licence {
            Some(licence) => format!("{} ({licence})", a.text),
            None => a.text.clone(),
        });
        Self { lines, attribution: sources.collect::<Vec<_>>().join("; "), title: manifest.title.clone() }
    }
}

/// Lays out all but the panels of `city`.
pub fn show(ctx: &Context, status: &Status, shown: &mut Shown) {
    if shown.overlay {
        counters(ctx, status, shown);
    }
    attribution(ctx, &status.attribution);
    if shown.help {
        help(ctx);
    }
    shown.message = shown.message.take().filter(|(_, until)| Instant::now() < *until);
    if let Some((text, _)) = &shown.message {
        panel(ctx, "message", Align2::CENTER_TOP, [0.0, 12.0], |ui| {
            ui.label(RichText::new(text).color(Color32::WHITE));
        });
    }
}

/// A dark sheet at an edge of the window.
pub fn panel(ctx: &Context, id: &'static str, align: Align2, offset: [f32; 2], add: impl FnOnce(&mut Ui)) {
    let frame = Frame::new().fill(Color32::from_black_alpha(165)).inner_margin(8).corner_radius(5);
    egui::Area::new(egui::Id::unique(id)).anchor(align, offset).show(ctx, |ui| {
        frame.show(ui, |ui| {
            ui.visuals_mut().override_text_color = Some(Color32::from_gray(225));
            add(ui);
        });
    });
}

/// What is wrong or not there yet, where nobody overlooks it.
pub fn notice(ctx: &Context, text: &str, bad: bool) {
    panel(ctx, "notice", Align2::CENTER_TOP, [0.0, 56.0], |ui| {
        let colour = if bad { Color32::from_rgb(255, 190, 110) } else { Color32::WHITE };
        ui.set_max_width((ctx.content_rect().width() - 60.0).min(560.0));
        ui.spinner();
        ui.add(egui::Label::new(RichText::new(text).size(16.0).color(colour)).wrap());
    });
}

fn counters(ctx: &Context, status: &Status, shown: &mut Shown) {
    panel(ctx, "counters", Align2::LEFT_TOP, [10.0, 10.0], |ui| {
        ui.label(RichText::new(&status.title).strong().color(Color32::WHITE));
        egui::Grid::new("numbers").num_columns(2).spacing([10.0, 2.0]).show(ui, |ui| {
            for (name, value) in &status.lines {
                ui.label(RichText::new(*name).color(Color32::from_gray(160)));
                ui.label(value);
                ui.end_row();
            }
        });
        let slider = egui::Slider::new(&mut shown.tau_px, 0.5..=16.0).logarithmic(true).text("tau, px");
        ui.add(slider.fixed_decimals(1));
        sun(ui, &mut shown.daylight);
        ui.label(RichText::new(format!("{}   F1: help", shown.shading.word())).color(Color32::from_gray(160)));
    });
}

/// Hour and date; touching either lets a sun that was told where to be go its way.
fn sun(ui: &mut Ui, daylight: &mut Daylight) {
    let clock = |hour: f64, _: RangeInclusive<usize>| {
        let minutes = (hour * 60.0).round() as u32;
        format!("{:02}:{:02}", minutes / 60, minutes % 60)
    };
    let hour = egui::Slider::new(&mut daylight.hour, 0.0..=23.99).custom_formatter(clock).text("solar time");
    let mut moved = ui.add(hour).changed();
    let (year, mut day) = (daylight.date.year(), daylight.date.ordinal());
    let named = move |day: f64, _: RangeInclusive<usize>| {
        let date = NaiveDate::from_yo_opt(year, day.round() as u32);
        date.map(|date| date.format("%-d %b").to_string()).unwrap_or_default()
    };
    if ui.add(egui::Slider::new(&mut day, 1..=365).custom_formatter(named).text("date")).changed() {
        daylight.date = NaiveDate::from_yo_opt(year, day).unwrap_or(daylight.date);
        moved = true;
    }
    if moved {
        daylight.fixed_bearing = None;
    }
    ui.checkbox(&mut daylight.shadows, "sun shadows");
    if !daylight.site.is_known {
        let [north, _] = daylight.site.degrees();
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
