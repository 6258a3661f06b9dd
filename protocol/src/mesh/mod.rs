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
mod encode;
mod encoder_state;
mod grid;
pub mod half_edge;
mod manifold;
mod points;
mod scan_positions;
mod scan_prediction;
mod scan_weights;
mod weld;

use crate::codec::rans::{RAW, SymbolCoder, SymbolModel};
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

/// Number of values of [`digits`].
const DIGIT_COUNTS: usize = 18;

/// Codes a difference as its sign and number of binary digits, the second digit, and raw digits.
#[derive(Debug)]
struct DifferenceCoder {
    /// Sign and number of digits, by each of two contexts: 0 for zero, else twice the digits, less 1 if positive.
    digits: [Vec<SymbolModel<32>>; 2],
    /// The digit after the highest, by number of digits.
    second: [SymbolModel<2>; 17],
}

impl DifferenceCoder {
    /// `contexts` are the numbers of values of the two contexts.
    fn new(contexts: [usize; 2]) -> Self {
        let model = || SymbolModel::new(|symbol| if symbol < 26 { 4 } else { 1 });
        Self { digits: contexts.map(|count| vec![model(); count]), second: [(); 17].map(|()| SymbolModel::default()) }
    }

    /// Codes `value` as its difference from `expected`, all modulo 65536.
    #[inline]
    fn code<C: SymbolCoder>(&mut self, coder: &mut C, contexts: [usize; 2], value: i32, expected: i32) -> i32 {
        // From -32767 to 32768, so that 16 digits are always positive.
        let difference = (value.wrapping_sub(expected).wrapping_add(32767) & 0xffff) - 32767;
        let magnitude = difference.unsigned_abs();
        let digits = 32 - magnitude.leading_zeros();
        let symbol = (2 * digits).saturating_sub(u32::from(difference > 0));
        let [a, b] = &mut self.digits;
        let symbol = coder.pair(&mut a[contexts[0]], &mut b[contexts[1]], symbol as usize);
        if symbol == 0 {
            return expected & 0xffff;
        }
        let digits = symbol.div_ceil(2) as u32;
        let mut read = 1;
        let mut remaining = digits - 1;
        if remaining > 0 {
            remaining -= 1;
            let second = magnitude >> remaining & 1 == 1;
            read = 2 | u32::from(coder.flag(&mut self.second[digits as usize], second));
        }
        while remaining > 0 {
            let bits = remaining.min(RAW);
            remaining -= bits;
            read = read << bits | coder.raw(bits, magnitude >> remaining & ((1 << bits) - 1));
        }
        let difference = if symbol % 2 == 1 { read as i32 } else { -(read as i32) };
        expected.wrapping_add(difference) & 0xffff
    }
}

/// The number of binary digits of `|v|`, at most 17.
#[inline]
fn digits(v: i32) -> usize {
    ((32 - v.unsigned_abs().leading_zeros()) as usize).min(17)
}
