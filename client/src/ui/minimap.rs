//! The city from above: which nodes are drawn, and where the camera looks.
//!
//! In: the cut, the camera. Out: egui shapes; the place that was clicked. Next: `city` goes there.

use crate::session::Session;
use egui::{Color32, Pos2, Rect, Sense, Shape, Stroke, StrokeKind, Ui, pos2, vec2};
use glam::{DVec2, DVec3};
use insula_viewer::{camera::Camera, scene::SceneTree};

/// Side in points.
const SIDE: f32 = 190.0;
/// How long the camera's wedge is.
const WEDGE: f32 = 26.0;

/// The square of the city that the map shows.
#[derive(Debug, Clone, Copy)]
struct Frame {
    centre: DVec2,
    side_m: f64,
}

impl Frame {
    fn of(tree: &SceneTree) -> Self {
        let [low, high] = tree.manifest().bounds.map(|p| DVec3::from(p).truncate());
        Self { centre: (low + high) * 0.5, side_m: (high - low).max_element().max(1.0) * 1.06 }
    }

    fn to_map(self, p: DVec2, map: Rect) -> Pos2 {
        let share = (p - self.centre) / self.side_m + 0.5;
        pos2(map.left() + map.width() * share.x as f32, map.bottom() - map.height() * share.y as f32)
    }

    fn to_city(self, p: Pos2, map: Rect) -> DVec2 {
        let share = (p - map.left_top()) / map.size();
        self.centre + (DVec2::new(f64::from(share.x), 1.0 - f64::from(share.y)) - 0.5) * self.side_m
    }
}

/// Draws the map; the place in the city that was clicked or is dragged over.
pub fn show(ui: &mut Ui, session: &Session, camera: &Camera) -> Option<DVec2> {
    let (map, response) = ui.allocate_exact_size(vec2(SIDE, SIDE), Sense::click_and_drag());
    let painter = ui.painter_at(map);
    let tree = session.tree();
    let frame = Frame::of(tree);
    painter.rect_filled(map, 2.0, Color32::from_gray(28));
    for node in session.selection().draw_tiles.iter().map(|item| tree.node(item.node)) {
        let corner = DVec3::from(tree.manifest().node_corner(node.id)).truncate();
        let side_m = tree.manifest().node_side_m(node.id.level());
        let square = Rect::from_two_pos(frame.to_map(corner, map), frame.to_map(corner + DVec2::splat(side_m), map))
            .shrink(0.25);
        let finer = f32::from(node.id.level()) / f32::from(tree.manifest().depth.max(1));
        let shade = Color32::from_rgb(60 + (60.0 * finer) as u8, 90 + (90.0 * finer) as u8, 125 + (60.0 * finer) as u8);
        painter.rect(square, 0.0, shade.gamma_multiply(0.55), Stroke::new(0.5, shade), StrokeKind::Inside);
    }
    let eye = frame.to_map(camera.position.truncate(), map);
    painter.add(wedge(eye.clamp(map.min, map.max), camera));
    painter.rect_stroke(map, 2.0, Stroke::new(1.0, Color32::from_gray(120)), StrokeKind::Inside);
    let clicked = (response.clicked() || response.dragged()).then(|| response.interact_pointer_pos()).flatten();
    clicked.filter(|at| map.contains(*at)).map(|at| frame.to_city(at, map))
}

fn wedge(eye: Pos2, camera: &Camera) -> Shape {
    let (yaw, _) = camera.angles();
    let half = camera.fov_y_rad * 0.75;
    let to = |angle: f64| eye + vec2(angle.cos() as f32, -angle.sin() as f32) * WEDGE;
    let fill = Color32::from_rgba_unmultiplied(255, 214, 90, 110);
    let stroke = Stroke::new(1.0, Color32::from_rgb(255, 214, 90));
    Shape::convex_polygon(vec![eye, to(yaw - half), to(yaw), to(yaw + half)], fill, stroke)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_click_is_the_place_that_is_drawn_there() {
        let frame = Frame { centre: DVec2::new(85_000.0, 447_000.0), side_m: 2000.0 };
        let map = Rect::from_min_size(pos2(10.0, 20.0), vec2(190.0, 190.0));
        for p in [frame.centre, frame.centre + DVec2::new(-700.0, 300.0)] {
            assert!((frame.to_city(frame.to_map(p, map), map) - p).length() < 0.1);
        }
        let north = frame.to_map(frame.centre + DVec2::Y * 500.0, map);
        assert!(north.y < map.center().y, "north is up");
    }
}
