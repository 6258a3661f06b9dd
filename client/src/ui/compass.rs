//! The compass: a needle towards the grid's north.

use egui::{Align2, Color32, FontId, Sense, Shape, Stroke, Ui, Vec2, pos2, vec2};
use std::f64::consts::FRAC_PI_2;

/// Side of the compass, in points.
const SIDE: f32 = 54.0;
const NORTH: Color32 = Color32::from_rgb(240, 90, 70);
const SOUTH: Color32 = Color32::from_gray(215);
const WINDS: [&str; 8] = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];

/// Direction of north on the screen for a view direction (radians from east to north): the unit vector, x to the right, y down.
pub fn north_on_screen(yaw_rad: f64) -> Vec2 {
    let (sin, cos) = (FRAC_PI_2 - yaw_rad).sin_cos();
    vec2(-sin as f32, -cos as f32)
}

/// A view direction in words and degrees clockwise from north.
pub fn heading_text(yaw_rad: f64) -> String {
    let degrees = (90.0 - yaw_rad.to_degrees()).rem_euclid(360.0);
    let wind = WINDS[(degrees / 45.0).round() as usize % WINDS.len()];
    format!("looking {wind}, {:.0}\u{b0}", degrees.round() % 360.0)
}

/// Draws the compass for a view direction. Returns whether it was clicked.
pub fn show(ui: &mut Ui, yaw_rad: f64) -> bool {
    let (area, response) = ui.allocate_exact_size(Vec2::splat(SIDE), Sense::click());
    let (painter, centre) = (ui.painter_at(area), area.center());
    let ring = if response.hovered() { Color32::WHITE } else { Color32::from_gray(150) };
    painter.circle(centre, SIDE * 0.5 - 1.0, Color32::from_black_alpha(110), Stroke::new(1.5, ring));
    let north = north_on_screen(yaw_rad);
    let side = north.rot90() * 5.0;
    for (tip, colour) in [(north, NORTH), (-north, SOUTH)] {
        let points = vec![centre + tip * 15.0, centre + side, centre - side];
        painter.add(Shape::convex_polygon(points, colour, Stroke::NONE));
    }
    let letter = centre + north * 20.5;
    painter.text(pos2(letter.x, letter.y), Align2::CENTER_CENTER, "N", FontId::proportional(11.0), Color32::WHITE);
    let text = format!("{}; click to turn to the north", heading_text(yaw_rad));
    response.on_hover_text(text).clicked()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_needle_points_north_whatever_the_view_direction() {
        // Looking east, north is to the left; looking south, it is down.
        for (yaw_deg, north) in [(90.0f64, [0.0, -1.0]), (0.0, [-1.0, 0.0]), (-90.0, [0.0, 1.0]), (180.0, [1.0, 0.0])] {
            let needle = north_on_screen(yaw_deg.to_radians());
            assert!((needle - vec2(north[0], north[1])).length() < 1e-6, "{yaw_deg}: {needle}");
        }
        assert_eq!(heading_text(FRAC_PI_2), "looking north, 0\u{b0}");
        assert_eq!(heading_text(FRAC_PI_2 + 0.001), "looking north, 0\u{b0}");
        assert_eq!(heading_text(0.0), "looking east, 90\u{b0}");
        assert_eq!(heading_text(45f64.to_radians() - 4.0 * FRAC_PI_2), "looking north-east, 45\u{b0}");
    }
}
