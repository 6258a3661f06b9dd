//! Draws the measured figure over the frame, and the panel of the tool.

use super::outlined;
use super::overlay::panel;
use super::projection::{project, project_line};
use egui::{Align2, Color32, Context, Label, Painter, Pos2, Rect, Stroke, Ui, vec2};
use insula_viewer::camera::View;
use insula_viewer::interaction::measure::{MeasureKind, MeasureTool};
use insula_viewer::interaction::units::length_text;

const COLOUR: Color32 = Color32::from_rgb(255, 214, 90);
/// Lines that are shorter than this on the screen have no text.
const MIN_LABELLED_POINTS: f32 = 50.0;
/// Figures with more points have no texts at their lines.
const MAX_LABELLED: usize = 60;

/// Paints the figure over a frame that fills `screen`.
pub fn paint(tool: &MeasureTool, painter: &Painter, view: &View, screen: Rect) {
    let has_labels = tool.points().len() <= MAX_LABELLED;
    for ends in tool.lines() {
        let Some([a, b]) = project_line(view, ends, screen) else { continue };
        outlined::line(painter, [a, b], 2.0, COLOUR);
        if has_labels && a.distance(b) > MIN_LABELLED_POINTS {
            let above = a.lerp(b, 0.5) - vec2(0.0, 6.0);
            outlined::text(painter, above, Align2::CENTER_BOTTOM, &label(tool.kind(), ends), COLOUR);
        }
    }
    let positions: Vec<Pos2> = tool.points().iter().filter_map(|p| project(view, *p, screen)).collect();
    for position in positions {
        painter.circle(position, 4.0, COLOUR, Stroke::new(1.5, Color32::BLACK));
    }
}

fn label(kind: MeasureKind, [a, b]: [glam::DVec3; 2]) -> String {
    match kind {
        MeasureKind::Line => length_text(a.distance(b)),
        MeasureKind::Area => length_text(a.truncate().distance(b.truncate())),
        MeasureKind::Height => length_text((b.z - a.z).abs()),
    }
}

/// Lays out what measures or records. `below_notice` is the place of the measuring panel from the window's top, in points.
pub fn show_tool(ctx: &Context, measure: &mut MeasureTool, recording: Option<&str>, below_notice: f32) {
    if measure.is_active {
        panel(ctx, "measure", Align2::CENTER_TOP, [0.0, below_notice], |ui| show(ui, measure));
    } else if let Some(text) = recording {
        panel(ctx, "tool", Align2::CENTER_BOTTOM, [0.0, -12.0], |ui| {
            ui.label(text);
        });
    }
}

/// Lays the panel of the active tool out.
fn show(ui: &mut Ui, tool: &mut MeasureTool) {
    ui.horizontal(|ui| {
        ui.label("Measure");
        for kind in MeasureKind::ALL {
            if ui.selectable_label(tool.kind() == kind, kind.word()).clicked() {
                tool.set_kind(kind);
            }
        }
        ui.separator();
        ui.add_enabled_ui(!tool.points().is_empty(), |ui| {
            if ui.button("Undo").on_hover_text("Backspace, Ctrl+Z").clicked() {
                tool.undo();
            }
            if ui.button("Clear").clicked() {
                tool.clear();
            }
        });
        if ui.button("Close").on_hover_text("Esc, M").clicked() {
            tool.toggle();
        }
    });
    // The total and the last part have a line each.
    ui.add(Label::new(tool.text().unwrap_or_default().replace("; ", "\n")).extend());
}
