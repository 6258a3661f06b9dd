//! Which boxes a view can see.
//!
//! In: planes, a box. Out: yes or no. Next: `select` visits what is in view.

use crate::camera::FrustumPlane;
use glam::DVec3;

/// Whether any of the box (`centre`, `half` sides) may lie inside all planes. Conservative: may say yes to a box near a
/// corner of the frustum, never no to one that is seen.
pub fn in_view(planes: &[FrustumPlane; 5], centre: DVec3, half: DVec3) -> bool {
    planes.iter().all(|p| p.normal.dot(centre) + p.offset + p.normal.abs().dot(half) >= 0.0)
}

/// The same for all places that the box passes on its way by `way`.
pub fn hull_in_view(planes: &[FrustumPlane; 5], centre: DVec3, half: DVec3, way: DVec3) -> bool {
    let reach =
        |p: &FrustumPlane| p.normal.dot(centre) + p.offset + p.normal.abs().dot(half) + p.normal.dot(way).max(0.0);
    planes.iter().all(|p| reach(p) >= 0.0)
}

/// Whether all of the box lies inside all planes.
pub fn wholly_in_view(planes: &[FrustumPlane; 5], centre: DVec3, half: DVec3) -> bool {
    planes.iter().all(|p| p.normal.dot(centre) + p.offset - p.normal.abs().dot(half) >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, View};

    #[test]
    fn a_box_is_kept_if_its_shadow_is_seen() {
        let camera = Camera::look_at(DVec3::new(0.0, 0.0, 10.0), DVec3::new(0.0, 100.0, 0.0), DVec3::Z, 1.0).unwrap();
        let view = View { camera, width_px: 320, height_px: 180, tau_px: 1.0, budget_pages: 1, budget_nodes: 1 };
        let planes = view.planes();
        let half = DVec3::splat(2.0);
        let behind = DVec3::new(0.0, -30.0, 30.0);
        assert!(!in_view(&planes, behind, half));
        assert!(!hull_in_view(&planes, behind, half, DVec3::new(0.0, -30.0, -30.0)), "away from the picture");
        assert!(hull_in_view(&planes, behind, half, DVec3::new(0.0, 60.0, -30.0)), "into the picture");
        assert!(hull_in_view(&planes, DVec3::new(0.0, 50.0, 0.0), half, DVec3::ZERO), "itself");
    }

    #[test]
    fn a_seen_point_is_never_culled() {
        let camera = Camera::look_at(DVec3::new(10.0, -5.0, 30.0), DVec3::new(40.0, 60.0, 0.0), DVec3::Z, 1.0).unwrap();
        let view = View { camera, width_px: 320, height_px: 180, tau_px: 1.0, budget_pages: 1, budget_nodes: 1 };
        let planes = view.planes();
        let (mut seen, mut culled) = (0, 0);
        for i in 0..20_000u32 {
            let r = |k: u32| f64::from(i.wrapping_mul(2_654_435_761).rotate_left(k * 7) % 1000) / 10.0 - 50.0;
            let (centre, half) = (DVec3::new(r(1), r(2), r(3)), DVec3::new(r(4), r(5), r(1)).abs() * 0.1);
            let corners = (0..9).map(|c| {
                let s = |bit: i32| if c == 8 { 0.0 } else { f64::from((c >> bit & 1) * 2 - 1) };
                centre + half * DVec3::new(s(0), s(1), s(2))
            });
            let inside = |p: DVec3| planes.iter().all(|plane| plane.normal.dot(p) + plane.offset >= 0.0);
            let any = corners.into_iter().any(inside);
            let kept = in_view(&planes, centre, half);
            assert!(kept || !any);
            assert!(!wholly_in_view(&planes, centre, half) || kept && inside(centre + half) && inside(centre - half));
            seen += u32::from(any);
            culled += u32::from(!kept);
        }
        assert!(seen > 500 && culled > 5000, "{seen} {culled}");
    }
}
