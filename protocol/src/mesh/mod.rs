//! Triangle meshes: a half-edge structure, and a codec of a few bits per triangle (`docs/formats.md`, "Meshes").
//!
//! The codec writes connectivity first and then positions and attributes in the traversal order of the triangles. Each
//! part is one function that both writes and reads, over a `SymbolCoder`.

mod active_lists;
mod architectural_positions;
mod attribute;
mod attribute_values;
mod closed_mesh;
mod completed;
mod connectivity;
mod decode;
mod difference;
mod encode;
mod encoder_state;
mod grid;
pub mod half_edge;
mod manifold;
mod points;
mod scan_models;
mod scan_positions;
mod scan_prediction;
mod scan_weights;
mod weld;

pub use attribute::{Attribute, AttributeKind};
pub use encode::EncodedMesh;
pub use grid::PositionGrid;

/// Version of the coded bytes.
pub const VERSION: u8 = 3;
/// Maximum number of triangles of a mesh, including those of dummy vertices.
pub const MAX_TRIANGLES: usize = 1 << 24;
/// Maximum number of vertices of a mesh, including dummy vertices.
pub const MAX_VERTICES: usize = 1 << 23;
/// Maximum number of attributes of a mesh.
pub const MAX_ATTRIBUTES: usize = 8;
/// Allowed bits of a coordinate.
pub const POSITION_BITS: std::ops::RangeInclusive<u8> = 8..=16;

/// Header flag: positions are coded by `architectural_positions`, otherwise by `scan_positions`.
const ARCHITECTURAL: u8 = 1;
/// Header flag: the grid's numbers are f64, otherwise f32.
const WIDE_GRID: u8 = 2;
/// Position of the two bits of the header's flags that select the classes of `scan_positions`.
const CLASSES_SHIFT: u32 = 2;

/// Triangles with vertices on a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    pub grid: PositionGrid,
    /// Grid coordinates of the vertices, each below `2^grid.bits`.
    pub positions: Vec<[u32; 3]>,
    /// Vertex indices, counter-clockwise as seen from outside.
    pub triangles: Vec<[u32; 3]>,
    pub attributes: Vec<Attribute>,
}

impl Mesh {
    /// Positions of the vertices in metres.
    pub fn positions_m(&self) -> impl Iterator<Item = [f64; 3]> {
        self.positions.iter().map(|position| self.grid.position_m(*position))
    }
}
