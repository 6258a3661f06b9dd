//! Lines and texts with a dark outline, which are readable over bright and dark scenes.

use egui::{Align2, Color32, FontId, Painter, Pos2, Stroke, vec2};

const OUTLINE: Color32 = Color32::from_black_alpha(210);

/// A line of `width` points.
pub fn line(painter: &Painter, ends: [Pos2; 2], width: f32, colour: Color32) {
    painter.line_segment(ends, Stroke::new(width + 2.0, OUTLINE));
    painter.line_segment(ends, Stroke::new(width, colour));
}

/// A text of 14 points.
pub fn text(painter: &Painter, at: Pos2, align: Align2, text: &str, colour: Color32) {
    let font = FontId::proportional(14.0);
    for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
        painter.text(at + vec2(x, y), align, text, font.clone(), OUTLINE);
    }
    painter.text(at, align, text, font, colour);
}
