//! Vertical planes that end a column inside its cell.

use crate::columns::voxels::{VoxelAppearance, VoxelClip, VoxelPlane};
use glam::Vec2;

/// Planes of one cell whose normals' cosine is larger are the same wall.
pub(super) const SAME_COSINE: f32 = 0.978;

/// A vertical plane; what is on its inner side is `normal . p <= offset_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WallPlane {
    /// Horizontal unit vector out of the column.
    pub(crate) normal: Vec2,
    /// Metres from the cell's centre along `normal`.
    pub(crate) offset_m: f32,
}

/// Where a column ends inside its cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CellClip {
    /// The wall, or the larger one of a corner.
    pub(crate) plane: WallPlane,
    /// The other wall of a corner, and whether the corner is concave: the column then fills the inner side of either plane,
    /// else that of both.
    pub(crate) corner: Option<(WallPlane, bool)>,
    /// Top of what is beyond, whose bottom is the column's; `None` if nothing is.
    pub(crate) outer_top_m: Option<f32>,
}

impl WallPlane {
    fn beyond_m(&self, p_m: Vec2) -> f32 {
        self.normal.dot(p_m) - self.offset_m
    }
}

impl CellClip {
    /// Metres that a place, relative to the cell's centre, is beyond the column's border; negative inside.
    pub(crate) fn beyond_m(&self, p_m: Vec2) -> f32 {
        let first = self.plane.beyond_m(p_m);
        match self.corner {
            None => first,
            Some((second, true)) => first.min(second.beyond_m(p_m)),
            Some((second, false)) => first.max(second.beyond_m(p_m)),
        }
    }

    /// Whether one of the walls is `wall`, give or take `within_m`.
    pub(crate) fn ends_at(&self, wall: WallPlane, within_m: f32) -> bool {
        let planes = [Some(self.plane), self.corner.map(|(second, _)| second)];
        let same = |plane: &WallPlane| {
            plane.normal.dot(wall.normal) > SAME_COSINE && (plane.offset_m - wall.offset_m).abs() < within_m
        };
        planes.iter().flatten().any(same)
    }

    /// Whether a place is beyond the column's border.
    pub(crate) fn is_outside(&self, p_m: Vec2) -> bool {
        self.beyond_m(p_m) > 0.0
    }
}

impl From<CellClip> for VoxelClip {
    /// Without a look of what lies beyond.
    fn from(clip: CellClip) -> Self {
        let plane = |plane: WallPlane| VoxelPlane { normal: plane.normal.to_array(), offset_m: plane.offset_m };
        Self {
            plane: plane(clip.plane),
            corner: clip.corner.map(|(second, concave)| (plane(second), concave)),
            outer: clip.outer_top_m.map(|top_m| (top_m, VoxelAppearance::default())),
        }
    }
}
