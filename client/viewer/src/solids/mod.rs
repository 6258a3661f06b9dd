//! The solids of one tile: the shapes of its columns or triangles, without their appearance.

mod column_solids;
mod mesh_solids;

pub use column_solids::ColumnSolids;
use glam::{DVec2, DVec3};
pub use mesh_solids::MeshSolids;

/// A solid above and below a point: heights of bottom and top. An open bottom is minus infinity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolidInterval {
    pub bottom: f64,
    pub top: f64,
}

/// The solids of a tile, in metres from the south-west corner of its node and the city's height zero.
#[derive(Debug, Clone, Copy)]
pub(crate) enum TileSolids<'a> {
    Columns(&'a ColumnSolids),
    Mesh(&'a MeshSolids),
}

impl TileSolids<'_> {
    /// The solids above and below a place.
    pub(crate) fn intervals_at(&self, p: DVec2) -> Vec<SolidInterval> {
        match self {
            Self::Columns(columns) => columns.intervals_at(p),
            Self::Mesh(mesh) => mesh.intervals_at(p),
        }
    }

    /// Where the way from `start` along `way` first meets a solid, from `span[0]` to `span[1]` of it.
    pub(crate) fn first_hit(&self, start: DVec3, way: DVec3, span: [f64; 2]) -> Option<f64> {
        match self {
            Self::Columns(columns) => columns.first_hit(start, way, span),
            Self::Mesh(mesh) => mesh.first_hit(start, way, span),
        }
    }
}

/// Where a line crosses the borders ahead of it of a square that it is in, by axis, in shares of `way`; infinity if never.
pub(crate) fn exits_of(square: [DVec2; 2], start: DVec2, way: DVec2) -> DVec2 {
    let exit = |axis: usize| match way[axis] {
        0.0 => f64::INFINITY,
        along => (square[usize::from(along > 0.0)][axis] - start[axis]) / along,
    };
    DVec2::new(exit(0), exit(1))
}
