//! Frustum culling of boxes, given by their `centre` and the `half` of their sides.

use crate::camera::FrustumPlane;
use glam::DVec3;

/// Whether any part of a box may be in view. Conservative: never `false` for a box in view, but possibly `true` for a box
/// outside, near a corner of the frustum.
pub fn is_box_in_view(planes: &[FrustumPlane; 5], centre: DVec3, half: DVec3) -> bool {
    planes.iter().all(|p| p.normal.dot(centre) + p.offset + p.normal.abs().dot(half) >= 0.0)
}

/// Like [`is_box_in_view`], for the volume that a box sweeps when it moves by `sweep`.
pub(super) fn is_swept_box_in_view(planes: &[FrustumPlane; 5], centre: DVec3, half: DVec3, sweep: DVec3) -> bool {
    let reach =
        |p: &FrustumPlane| p.normal.dot(centre) + p.offset + p.normal.abs().dot(half) + p.normal.dot(sweep).max(0.0);
    planes.iter().all(|p| reach(p) >= 0.0)
}

/// Whether all of a box is in view.
pub(super) fn is_box_inside_view(planes: &[FrustumPlane; 5], centre: DVec3, half: DVec3) -> bool {
    planes.iter().all(|p| p.normal.dot(centre) + p.offset - p.normal.abs().dot(half) >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, View};
    use insula_test_support::rng::Rng;

    fn planes(position: [f64; 3], target: [f64; 3]) -> [FrustumPlane; 5] {
        let camera = Camera::look_at(position.into(), target.into(), DVec3::Z, 1.0).unwrap();
        View::of(camera, [320, 180]).planes()
    }

    #[test]
    fn swept_box_is_in_view_if_its_shadow_is() {
        let planes = planes([0.0, 0.0, 10.0], [0.0, 100.0, 0.0]);
        let half = DVec3::splat(2.0);
        let behind = DVec3::new(0.0, -30.0, 30.0);
        assert!(!is_box_in_view(&planes, behind, half));
        assert!(!is_swept_box_in_view(&planes, behind, half, DVec3::new(0.0, -30.0, -30.0)), "away from the view");
        assert!(is_swept_box_in_view(&planes, behind, half, DVec3::new(0.0, 60.0, -30.0)), "into the view");
        assert!(is_swept_box_in_view(&planes, DVec3::new(0.0, 50.0, 0.0), half, DVec3::ZERO), "no movement");
    }

    #[test]
    fn boxes_in_view_are_never_culled() {
        let planes = planes([10.0, -5.0, 30.0], [40.0, 60.0, 0.0]);
        let (mut in_view, mut culled) = (0, 0);
        let mut rng = Rng::new(1);
        for _ in 0..20_000 {
            let mut point = |reach: f64| DVec3::from([0; 3].map(|_: i32| rng.range(-reach, reach)));
            let (centre, half) = (point(50.0), point(5.0).abs());
            let corners = (0..9).map(|c| {
                let s = |bit: i32| if c == 8 { 0.0 } else { f64::from((c >> bit & 1) * 2 - 1) };
                centre + half * DVec3::new(s(0), s(1), s(2))
            });
            let inside = |p: DVec3| planes.iter().all(|plane| plane.normal.dot(p) + plane.offset >= 0.0);
            let any = corners.into_iter().any(inside);
            let kept = is_box_in_view(&planes, centre, half);
            assert!(kept || !any);
            assert!(
                !is_box_inside_view(&planes, centre, half) || kept && inside(centre + half) && inside(centre - half)
            );
            in_view += u32::from(any);
            culled += u32::from(!kept);
        }
        assert!(in_view > 500 && culled > 5000, "{in_view} {culled}");
    }
}
