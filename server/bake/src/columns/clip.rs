//! Vertical planes that end a column inside its cell.
//!
//! In Vacca's thesis every wall stands on a cell border (figure 4.3). Here a column may also end at one wall plane, or
//! at the corner of two. Beyond the clip the cell is empty, or filled up to a lower top.

use crate::columns::voxels::{VoxelAppearance, VoxelClip, VoxelCorner, VoxelOuterTop, VoxelPlane};
use glam::Vec2;

/// Wall planes whose normals have a larger cosine count as parallel (about 12 degrees).
pub(super) const PARALLEL_COSINE: f32 = 0.978;

/// A vertical plane. Points with `normal . p <= offset_m` lie on its inner side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WallPlane {
    /// Horizontal unit vector that points out of the column.
    pub(crate) normal: Vec2,
    /// Metres from the cell's centre along `normal`.
    pub(crate) offset_m: f32,
}

/// The second plane of a clip at a corner of two walls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CornerPlane {
    pub(crate) plane: WallPlane,
    /// Whether the column fills the inner side of either plane; otherwise only that of both.
    pub(crate) is_concave: bool,
}

/// Where a column ends inside its cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CellClip {
    /// The wall, or the larger one of a corner.
    pub(crate) plane: WallPlane,
    pub(crate) corner: Option<CornerPlane>,
    /// Top beyond the clip, which shares the column's bottom; `None` if nothing stands there.
    pub(crate) outer_top_m: Option<f32>,
}

impl WallPlane {
    /// Metres outside of the plane; negative inside.
    fn signed_distance_m(&self, p_m: Vec2) -> f32 {
        self.normal.dot(p_m) - self.offset_m
    }
}

impl CellClip {
    /// A clip at one plane with nothing beyond it.
    pub(crate) fn at_plane(plane: WallPlane) -> Self {
        Self { plane, corner: None, outer_top_m: None }
    }

    /// Metres that a point, relative to the cell's centre, lies outside of the column; negative inside.
    pub(crate) fn signed_distance_m(&self, p_m: Vec2) -> f32 {
        let first_m = self.plane.signed_distance_m(p_m);
        match self.corner {
            None => first_m,
            Some(CornerPlane { plane, is_concave: true }) => first_m.min(plane.signed_distance_m(p_m)),
            Some(CornerPlane { plane, is_concave: false }) => first_m.max(plane.signed_distance_m(p_m)),
        }
    }

    /// Whether a point lies beyond the clip.
    pub(crate) fn is_outside(&self, p_m: Vec2) -> bool {
        self.signed_distance_m(p_m) > 0.0
    }

    /// Whether one of the clip's planes is parallel to `wall` and less than `tolerance_m` away from it.
    pub(crate) fn has_wall(&self, wall: WallPlane, tolerance_m: f32) -> bool {
        let planes = [Some(self.plane), self.corner.map(|corner| corner.plane)];
        let is_same = |plane: &WallPlane| {
            plane.normal.dot(wall.normal) > PARALLEL_COSINE && (plane.offset_m - wall.offset_m).abs() < tolerance_m
        };
        planes.iter().flatten().any(is_same)
    }
}

impl From<CellClip> for VoxelClip {
    /// The appearance beyond the clip is left unknown.
    fn from(clip: CellClip) -> Self {
        let voxel_plane = |plane: WallPlane| VoxelPlane { normal: plane.normal.to_array(), offset_m: plane.offset_m };
        Self {
            plane: voxel_plane(clip.plane),
            corner: clip
                .corner
                .map(|corner| VoxelCorner { plane: voxel_plane(corner.plane), concave: corner.is_concave }),
            outer: clip.outer_top_m.map(|top_m| VoxelOuterTop { top_m, appearance: VoxelAppearance::default() }),
        }
    }
}
