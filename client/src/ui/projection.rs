//! From points of the city to positions on the screen, and back.

use egui::{Pos2, Rect, pos2};
use glam::DVec3;
use insula_viewer::camera::View;

/// Points nearer than this in front of the camera are not projected.
const NEAR_M: f64 = 0.1;

/// Position of a point on the screen; `None` behind the camera.
pub fn project(view: &View, point: DVec3, screen: Rect) -> Option<Pos2> {
    let c = &view.camera;
    let p = point - c.position;
    let depth_m = p.dot(c.forward);
    if depth_m < NEAR_M {
        return None;
    }
    let tan_y = (c.fov_y_rad * 0.5).tan();
    let x = p.dot(c.right) / (depth_m * tan_y * view.aspect());
    let y = p.dot(c.up) / (depth_m * tan_y);
    let at = |share: f64, low: f32, high: f32| low + (high - low) * (0.5 + 0.5 * share) as f32;
    Some(pos2(at(x, screen.left(), screen.right()), at(-y, screen.top(), screen.bottom())))
}

/// Ends of a line on the screen: its part in front of the camera; `None` if there is none.
pub fn project_line(view: &View, [a, b]: [DVec3; 2], screen: Rect) -> Option<[Pos2; 2]> {
    let depth_m = |p: DVec3| (p - view.camera.position).dot(view.camera.forward);
    let (near, far) = if depth_m(a) < depth_m(b) { (a, b) } else { (b, a) };
    // A little farther than the limit, so that rounding does not put the end before it.
    let missing_m = 2.0 * NEAR_M - depth_m(near);
    let share = if missing_m > 0.0 { missing_m / (depth_m(far) - depth_m(near)) } else { 0.0 };
    if share.is_nan() || share >= 1.0 {
        return None;
    }
    let ends = [near.lerp(far, share), far].map(|p| project(view, p, screen));
    Some([ends[0]?, ends[1]?])
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
        let view = View {
            camera,
            width_px: 800,
            height_px: 400,
            tau_px: 1.0,
            switching: None,
            budget_pages: 1,
            budget_nodes: 1,
        };
        let screen = Rect::from_min_size(pos2(0.0, 0.0), egui::vec2(400.0, 200.0));
        for [x, y] in [[0.5, 0.5], [0.1, 0.9], [0.99, 0.01]] {
            let point = camera.position + ray_direction(&view, x, y) * 123.0;
            let at = project(&view, point, screen).unwrap();
            assert!((at.x - 400.0 * x as f32).abs() < 1e-3 && (at.y - 200.0 * y as f32).abs() < 1e-3, "{at}");
        }
        let behind = camera.position - camera.forward;
        assert_eq!(project(&view, behind, screen), None);
        let ahead = camera.position + camera.forward * 50.0 + camera.right;
        let line = project_line(&view, [behind, ahead], screen).unwrap();
        assert!((line[1] - project(&view, ahead, screen).unwrap()).length() < 1e-3 && !line[0].any_nan());
        assert_eq!(project_line(&view, [ahead, behind], screen), Some(line));
        assert_eq!(project_line(&view, [behind, behind - camera.right], screen), None);
    }
}
