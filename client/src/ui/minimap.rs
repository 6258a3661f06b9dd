//! The map: where the city is, from above, and the camera.

use crate::session::Session;
use egui::{Color32, Pos2, Rect, Sense, Shape, Stroke, StrokeKind, Ui, pos2, vec2};
use glam::{DVec2, DVec3};
use insula_viewer::camera::Camera;
use insula_viewer::scene::SceneTree;

/// Largest side of the map, in points, and as a share of the window's smaller side.
const MAX_SIDE: f32 = 190.0;
const SIDE_SHARE: f32 = 0.35;
/// No map is drawn with a smaller side.
const MIN_SIDE: f32 = 70.0;
/// Length of the camera's wedge, in points.
const WEDGE_LENGTH: f32 = 26.0;

const LAND: Color32 = Color32::from_rgb(96, 110, 124);

/// The part of the world that the map shows: a square around the city.
#[derive(Debug, Clone, Copy)]
struct MapExtent {
    centre: DVec2,
    side_m: f64,
}

impl MapExtent {
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

/// Side of the map in a window of a size, in points; `None` if it would cover too much.
pub fn side(window: egui::Vec2) -> Option<f32> {
    Some((window.min_elem() * SIDE_SHARE).min(MAX_SIDE)).filter(|side| *side >= MIN_SIDE)
}

/// Draws the map with the given side: land where there is any city, to developers each node that is drawn. Returns the position in the city that was clicked or dragged to.
pub fn show(ui: &mut Ui, side: f32, session: &Session, camera: &Camera, is_developer: bool) -> Option<DVec2> {
    let (map, response) = ui.allocate_exact_size(vec2(side, side), Sense::click_and_drag());
    let painter = ui.painter_at(map);
    let tree = session.tree();
    let extent = MapExtent::of(tree);
    painter.rect_filled(map, 2.0, Color32::from_gray(28));
    for node in session.selection().draw_tiles.iter().map(|item| tree.node(item.node)) {
        let corner = DVec3::from(tree.manifest().node_corner(node.id)).truncate();
        let side_m = tree.manifest().node_side_m(node.id.level());
        let area = Rect::from_two_pos(extent.to_map(corner, map), extent.to_map(corner + DVec2::splat(side_m), map))
            .shrink(0.25);
        if !is_developer {
            painter.rect_filled(area.expand(0.5), 0.0, LAND);
            continue;
        }
        let depth_share = f32::from(node.id.level()) / f32::from(tree.manifest().depth.max(1));
        let shade = Color32::from_rgb(
            60 + (60.0 * depth_share) as u8,
            90 + (90.0 * depth_share) as u8,
            125 + (60.0 * depth_share) as u8,
        );
        painter.rect(area, 0.0, shade.gamma_multiply(0.55), Stroke::new(0.5, shade), StrokeKind::Inside);
    }
    let eye = extent.to_map(camera.position.truncate(), map);
    painter.add(wedge(eye.clamp(map.min, map.max), camera));
    painter.rect_stroke(map, 2.0, Stroke::new(1.0, Color32::from_gray(120)), StrokeKind::Inside);
    let pointer = (response.clicked() || response.dragged()).then(|| response.interact_pointer_pos()).flatten();
    pointer.filter(|at| map.contains(*at)).map(|at| extent.to_city(at, map))
}

fn wedge(eye: Pos2, camera: &Camera) -> Shape {
    let (yaw, _) = camera.angles();
    let half = camera.fov_y_rad * 0.75;
    let edge = |angle: f64| eye + vec2(angle.cos() as f32, -angle.sin() as f32) * WEDGE_LENGTH;
    let fill = Color32::from_rgba_unmultiplied(255, 214, 90, 110);
    let stroke = Stroke::new(1.0, Color32::from_rgb(255, 214, 90));
    Shape::convex_polygon(vec![eye, edge(yaw - half), edge(yaw), edge(yaw + half)], fill, stroke)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_windows_have_a_small_map_or_none() {
        assert_eq!(side(vec2(1280.0, 720.0)), Some(MAX_SIDE));
        assert_eq!(side(vec2(390.0, 844.0)), Some(136.5));
        assert_eq!(side(vec2(240.0, 180.0)), None);
    }

    #[test]
    fn map_positions_convert_back_to_city_positions() {
        let extent = MapExtent { centre: DVec2::new(85_000.0, 447_000.0), side_m: 2000.0 };
        let map = Rect::from_min_size(pos2(10.0, 20.0), vec2(190.0, 190.0));
        for p in [extent.centre, extent.centre + DVec2::new(-700.0, 300.0)] {
            assert!((extent.to_city(extent.to_map(p, map), map) - p).length() < 0.1);
        }
        let north = extent.to_map(extent.centre + DVec2::Y * 500.0, map);
        assert!(north.y < map.center().y, "north is up");
    }
}
