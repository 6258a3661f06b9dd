//! From points of the city to positions in the frame, and back.

use crate::camera::View;
use glam::{DVec2, DVec3};

/// Points nearer than this in front of the camera are not projected.
const NEAR_M: f64 = 0.1;

/// Position of a point in the frame, in shares of its width and height from the upper left corner; `None` behind the camera.
pub fn project(view: &View, point: DVec3) -> Option<DVec2> {
    let c = &view.camera;
    let p = point - c.position;
    let depth_m = p.dot(c.forward);
    if depth_m < NEAR_M {
        return None;
    }
    let tan_y = (c.fov_y_rad * 0.5).tan();
    let x = p.dot(c.right) / (depth_m * tan_y * view.aspect());
    let y = p.dot(c.up) / (depth_m * tan_y);
    Some(DVec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y))
}

/// Ends of a line in the frame, as [`project`] gives them: its part in front of the camera; `None` if there is none.
pub fn project_line(view: &View, [a, b]: [DVec3; 2]) -> Option<[DVec2; 2]> {
    let depth_m = |p: DVec3| (p - view.camera.position).dot(view.camera.forward);
    let (near, far) = if depth_m(a) < depth_m(b) { (a, b) } else { (b, a) };
    // A little farther than the limit, so that rounding does not put the end before it.
    let missing_m = 2.0 * NEAR_M - depth_m(near);
    let share = if missing_m > 0.0 { missing_m / (depth_m(far) - depth_m(near)) } else { 0.0 };
    if share.is_nan() || share >= 1.0 {
        return None;
    }
    let ends = [near.lerp(far, share), far].map(|p| project(view, p));
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
    use crate::camera::Camera;

    #[test]
    fn projection_is_the_inverse_of_the_ray_direction() {
        let camera = Camera::look_at(DVec3::new(5.0, 6.0, 70.0), DVec3::new(50.0, 90.0, 3.0), DVec3::Z, 1.0).unwrap();
        let view = View::of(camera, [800, 400]);
        for [x, y] in [[0.5, 0.5], [0.1, 0.9], [0.99, 0.01]] {
            let point = camera.position + ray_direction(&view, x, y) * 123.0;
            let at = project(&view, point).unwrap();
            assert!((at - DVec2::new(x, y)).length() < 1e-9, "{at}");
        }
        let behind = camera.position - camera.forward;
        assert_eq!(project(&view, behind), None);
        let ahead = camera.position + camera.forward * 50.0 + camera.right;
        let line = project_line(&view, [behind, ahead]).unwrap();
        assert!((line[1] - project(&view, ahead).unwrap()).length() < 1e-9 && !line[0].is_nan());
        assert_eq!(project_line(&view, [ahead, behind]), Some(line));
        assert_eq!(project_line(&view, [behind, behind - camera.right]), None);
    }
}
