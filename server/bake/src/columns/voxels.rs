//! A node's columns before they are coded: metres, linear colours.
//!
//! In: what `sample` saw, or what `lod` averaged. Out: [`VoxelNode`]. Next: `parametrise` makes a `BlockMap` of it.

use crate::columns::clip::{Clip, Plane};
use insula_protocol::{TileId, blockmap::COLUMNS};

/// Half the diagonal of a cube of side 1: the geometric error of a voxel, in cells (Vacca 2008, 3.6.2).
pub(crate) const HALF_DIAGONAL: f64 = 0.866_025_403_784_438_6;

/// Look of one voxel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Look {
    /// Linear RGB, 0 to 1.
    pub rgb: [f32; 3],
    /// Ambient occlusion: 0 closed in, 1 open.
    pub ao: f32,
    /// Coverage, 0 to 1.
    pub alpha: f32,
}

/// A run of full voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solid {
    /// Metres above the grid's height zero.
    pub bottom_m: f32,
    /// Above `bottom_m`; at the cell's centre where the column is inclined.
    pub top_m: f32,
}

/// A vertical plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelPlane {
    /// Horizontal unit vector out of the column.
    pub normal: [f32; 2],
    /// Metres from the cell's centre along `normal`.
    pub offset_m: f32,
}

/// A wall inside its cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelClip {
    /// At which the column ends.
    pub plane: VoxelPlane,
    /// The other wall of a corner, and whether it is concave.
    pub corner: Option<(VoxelPlane, bool)>,
    /// Top and look from above of what lies beyond, down to the column's bottom; `None` if nothing does.
    pub outer: Option<(f32, Look)>,
}

impl From<Clip> for VoxelClip {
    /// Without a look of what lies beyond.
    fn from(clip: Clip) -> Self {
        let plane = |plane: Plane| VoxelPlane { normal: plane.normal.to_array(), offset_m: plane.offset_m };
        Self {
            plane: plane(clip.plane),
            corner: clip.corner.map(|(second, concave)| (plane(second), concave)),
            outer: clip.outer_top_m.map(|top_m| (top_m, Look::default())),
        }
    }
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelColumn {
    /// Bottom to top, disjoint, at least one.
    pub solids: Vec<Solid>,
    /// Whether the top is the plane square to `normal`.
    pub inclined: bool,
    /// Whether the lowest solid's bottom is in the air.
    pub suspended: bool,
    /// Unit normal of the top.
    pub normal: [f32; 3],
    /// Seen from above.
    pub roof: Look,
    /// Whether a wall strip is to be kept.
    pub exposed: bool,
    /// Sum of the wall's horizontal normals, weighted by area; may be zero.
    pub wall_normal: [f32; 2],
    /// Row of the first wall look: whole cells above the grid's height zero.
    pub first_row: i32,
    /// Wall looks, a cell each, upwards; empty unless exposed.
    pub wall: Vec<Look>,
    /// Where the column ends inside its cell; only exposed ones do.
    pub clip: Option<VoxelClip>,
}

/// A node's columns, [`COLUMNS`] of them, row-major from the south-west corner.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelNode {
    /// Which node.
    pub id: TileId,
    /// `None` where nothing stands.
    pub columns: Vec<Option<VoxelColumn>>,
}

impl VoxelNode {
    /// Without columns.
    pub fn empty(id: TileId) -> Self {
        Self { id, columns: vec![None; COLUMNS] }
    }

    /// Whether nothing stands anywhere.
    pub fn is_empty(&self) -> bool {
        self.columns.iter().all(Option::is_none)
    }
}
