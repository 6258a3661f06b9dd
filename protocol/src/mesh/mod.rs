//! Triangle meshes: half-edge pieces, and a codec that takes a few bits a triangle (`docs/formats.md`, "Meshes").
//!
//! In: a [`Mesh`] on a grid. Out: its bytes, and back. Next: `insula-bake` writes them, `insula-client` reads them.

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
mod grid;
pub mod half_edge;
mod points;
mod scan_positions;
mod weld;

pub use attribute::{Attribute, AttributeKind};
pub use encode::EncodedMesh;
pub use grid::PositionGrid;

/// Of the coded bytes.
pub const VERSION: u8 = 2;
/// Most triangles of a mesh, with those of dummy vertices.
pub const MAX_TRIANGLES: usize = 1 << 24;
/// Most vertices of a mesh.
pub const MAX_VERTICES: usize = 1 << 23;
/// Most attributes of a mesh.
pub const MAX_ATTRIBUTES: usize = 8;
/// Bits of a coordinate.
pub const POSITION_BITS: std::ops::RangeInclusive<u8> = 8..=16;

/// How positions are coded.
const BUILT: u8 = 1;
/// Numbers of the grid have eight bytes, not four.
const WIDE: u8 = 2;

/// Triangles on a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// What positions mean.
    pub grid: PositionGrid,
    /// Vertices, below `2^grid.bits`.
    pub positions: Vec<[u32; 3]>,
    /// Triples of vertices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// What corners carry.
    pub attributes: Vec<Attribute>,
}

impl Mesh {
    /// Positions in metres.
    pub fn positions_m(&self) -> impl Iterator<Item = [f64; 3]> {
        self.positions.iter().map(|position| self.grid.place(*position))
    }
}
