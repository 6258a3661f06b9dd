//! Measures the distance between two clicked points.

use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, pos2};
use glam::DVec3;
use insula_viewer::camera::View;

const COLOUR: Color32 = Color32::from_rgb(255, 214, 90);

/// The tool and its points, at most two.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DistanceTool {
    /// Whether clicks set points.
    pub is_active: bool,
    points: Vec<DVec3>,
}

impl DistanceTool {
    /// Activates the tool, or deactivates it and deletes its points.
    pub fn toggle(&mut self) {
        *self = Self { is_active: !self.is_active, points: Vec::new() };
    }

    /// Adds a point. A third point starts a new measurement.
    pub fn add_point(&mut self, point: DVec3) {
        if self.points.len() == 2 {
            self.points.clear();
        }
        self.points.push(point);
    }

    /// The distance, or what the user should do next; `None` if the tool is inactive.
    pub fn text(&self) -> Option<String> {
        let text = match self.points[..] {
            _ if !self.is_active => return None,
            [] => "measure: click a first point".to_owned(),
            [p] => format!("measure: from {:.1}, {:.1}, {:.1}: click a second point", p.x, p.y, p.z),
            [a, b, ..] => {
                let d = b - a;
                let horizontal_m = d.truncate().length();
                format!("{:.2} m apart ({horizontal_m:.2} m horizontally, {:+.2} m vertically)", d.length(), d.z)
            }
        };
        Some(text)
    }

    /// Paints the points and the line between them over a frame that fills `screen`.
    pub fn paint(&self, painter: &Painter, view: &View, screen: Rect) {
        let positions: Vec<Option<Pos2>> = self.points.iter().map(|p| project(view, *p, screen)).collect();
        for position in positions.iter().flatten() {
            painter.circle(*position, 4.0, COLOUR, Stroke::new(1.0, Color32::BLACK));
        }
        if let [Some(a), Some(b)] = positions[..] {
            painter.line_segment([a, b], Stroke::new(2.0, COLOUR));
            let length = format!("{:.1} m", self.points[0].distance(self.points[1]));
            let middle = a.lerp(b, 0.5) - egui::vec2(0.0, 8.0);
            let font = FontId::proportional(15.0);
            painter.text(middle + egui::vec2(1.0, 1.0), Align2::CENTER_BOTTOM, &length, font.clone(), Color32::BLACK);
            painter.text(middle, Align2::CENTER_BOTTOM, length, font, COLOUR);
        }
    }
}

/// Position of a point on the screen; `None` behind the camera.
pub fn project(view: &View, point: DVec3, screen: Rect) -> Option<Pos2> {
    let c = &view.camera;
    let p = point - c.position;
    let depth_m = p.dot(c.forward);
    if depth_m < 0.1 {
        return None;
    }
    let tan_y = (c.fov_y_rad * 0.5).tan();
    let x = p.dot(c.right) / (depth_m * tan_y * view.aspect());
    let y = p.dot(c.up) / (depth_m * tan_y);
    let at = |share: f64, low: f32, high: f32| low + (high - low) * (0.5 + 0.5 * share) as f32;
    Some(pos2(at(x, screen.left(), screen.right()), at(-y, screen.top(), screen.bottom())))
}

/// Unit vector from the camera through a point of the frame: `x`, `y` are shares of its width and height from the upper left
/// corner, 0 to 1.
pub fn ray_direction(view: &View, x: f64, y: f64) -> DVec3 {
    let c = &view.camera;
    let tan_y = (c.fov_y_rad * 0.5).tan();
    let dir = c.forward + c.right * (tan_y * view.aspect() * (2.0 * x - 1.0)) - c.up * (tan_y * (2.0 * y - 1.0));
    dir.normalize_or(c.forward)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_viewer::camera::Camera;

    #[test]
    fn projection_is_the_inverse_of_the_ray_direction() {
        let camera = Camera::look_at(DVec3::new(5.0, 6.0, 70.0), DVec3::new(50.0, 90.0, 3.0), DVec3::Z, 1.0).unwrap();
        let view = View { camera, width_px: 800, height_px: 400, tau_px: 1.0, budget_pages: 1, budget_nodes: 1 };
        let screen = Rect::from_min_size(pos2(0.0, 0.0), egui::vec2(400.0, 200.0));
        for [x, y] in [[0.5, 0.5], [0.1, 0.9], [0.99, 0.01]] {
            let point = camera.position + ray_direction(&view, x, y) * 123.0;
            let at = project(&view, point, screen).unwrap();
            assert!((at.x - 400.0 * x as f32).abs() < 1e-3 && (at.y - 200.0 * y as f32).abs() < 1e-3, "{at}");
        }
        assert_eq!(project(&view, camera.position - camera.forward, screen), None);
    }

    #[test]
    fn two_points_give_a_distance_and_a_third_starts_again() {
        let mut tool = DistanceTool::default();
        assert_eq!(tool.text(), None);
        tool.toggle();
        tool.add_point(DVec3::ZERO);
        tool.add_point(DVec3::new(3.0, 4.0, 12.0));
        assert_eq!(tool.text().unwrap(), "13.00 m apart (5.00 m horizontally, +12.00 m vertically)");
        tool.add_point(DVec3::ONE);
        assert!(tool.text().unwrap().contains("second"));
        tool.toggle();
        assert_eq!(tool, DistanceTool::default());
    }
}
