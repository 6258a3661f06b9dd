//! The part of space that a view shows, outside of which a tree of faces is not walked.

use crate::face::{FacePlane, ON_PLANE_M};
use glam::DVec3;

/// What a view shows if nothing hides it; all of space by default.
#[derive(Debug, Clone, Default)]
pub(crate) struct ViewVolume {
    /// Its borders, normals inwards; none of all of space.
    pub(crate) planes: Vec<FacePlane>,
    /// The corners of the part of it in which the scene is; none of all of space.
    pub(crate) corners: Vec<DVec3>,
}

impl ViewVolume {
    /// Whether some of it is in front of a plane, and whether some is behind. A half of space that has nothing of it is not shown
    /// (Moldoveanu, "Algoritmul BSP"; Giannitrapani and Fusiello, "View frustum culling").
    pub(crate) fn sides(&self, plane: &FacePlane) -> [bool; 2] {
        let heights = self.corners.iter().map(|corner| plane.height(*corner));
        let [low, high] = heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        if low > high { [true; 2] } else { [high > -ON_PLANE_M, low < ON_PLANE_M] }
    }

    /// Whether it may have a part of a box: no border has all of the box on its outer side.
    pub(crate) fn meets(&self, [low, high]: [DVec3; 2]) -> bool {
        self.planes.iter().all(|plane| {
            let innermost = DVec3::select(plane.normal.cmpgt(DVec3::ZERO), high, low);
            plane.height(innermost) >= -ON_PLANE_M
        })
    }
}
