//! Triangle meshes: a half-edge structure, and a codec of a few bits per triangle (`docs/formats.md`, "Meshes").
//!
//! The codec writes connectivity first and then positions and attributes in the traversal order of the triangles. Each
//! part is one function that both writes and reads, over a `SymbolCoder`.

mod architectural_positions;
mod attribute;
mod attribute_values;
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
use half_edge::{HalfEdgeMesh, NONE};

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

/// Nodes with at least this many free edges, less one, share the last bucket.
const BUCKETS: usize = 64;

/// An occurrence of a vertex in an active list.
#[derive(Debug, Clone, Copy)]
struct ActiveNode {
    vertex: u32,
    /// Number of edges between the node's two border edges on the untraversed side.
    free: u32,
    /// The next node; [`NONE`] once the node was removed.
    next: u32,
    prev: u32,
    /// The traversed half-edge on the edge to the next node.
    edge: u32,
    /// The third vertex of that half-edge's triangle.
    opposite: u32,
}

/// The active lists: the borders of the traversed region (Touma and Gotsman 1998).
///
/// Lists are circular and ordered so that the untraversed side lies to the left of the edge from a node to the next.
/// When a list splits at a vertex, the vertex has one node in each part.
#[derive(Debug)]
struct ActiveLists {
    /// All nodes ever added. Removed nodes keep their index.
    nodes: Vec<ActiveNode>,
    /// Nodes by their number of free edges, the latest last. A node is added again whenever that number changes.
    buckets: [Vec<u32>; BUCKETS],
    lowest_bucket: usize,
}

impl ActiveLists {
    fn new() -> Self {
        Self { nodes: Vec::new(), buckets: std::array::from_fn(|_| Vec::new()), lowest_bucket: BUCKETS }
    }

    #[inline]
    fn add(&mut self, node: ActiveNode) -> u32 {
        self.nodes.push(node);
        self.nodes.len() as u32 - 1
    }

    #[inline]
    fn node(&self, node: u32) -> &ActiveNode {
        &self.nodes[node as usize]
    }

    #[inline]
    fn node_mut(&mut self, node: u32) -> &mut ActiveNode {
        &mut self.nodes[node as usize]
    }

    /// Queues a node whose number of free edges changed.
    #[inline]
    fn queue(&mut self, node: u32) {
        let bucket = (self.node(node).free as usize).min(BUCKETS - 1);
        self.buckets[bucket].push(node);
        self.lowest_bucket = self.lowest_bucket.min(bucket);
    }

    /// The node with the fewest free edges, the latest of equals. `None` once all lists are empty.
    #[inline]
    fn pop_focus(&mut self) -> Option<u32> {
        while self.lowest_bucket < BUCKETS {
            while let Some(node) = self.buckets[self.lowest_bucket].pop() {
                let ActiveNode { next, free, .. } = *self.node(node);
                if next != NONE && (free as usize).min(BUCKETS - 1) == self.lowest_bucket {
                    return Some(node);
                }
            }
            self.lowest_bucket += 1;
        }
        None
    }
}

/// A half-edge mesh with a dummy vertex for each border loop and a triangle from it to each border edge, because the connectivity coder
/// needs closed surfaces (Gasparello, 3.3.2).
#[derive(Debug, Default)]
struct ClosedMesh {
    /// As in [`HalfEdgeMesh`]. Triangles of dummy vertices come last.
    origin: Vec<u32>,
    /// As in [`HalfEdgeMesh`], but never [`NONE`].
    twin: Vec<u32>,
    first_dummy: u32,
    vertices: usize,
}

impl ClosedMesh {
    fn new(mesh: &HalfEdgeMesh) -> Self {
        let (mut origin, mut twin) = (mesh.origin.clone(), mesh.twin.clone());
        let first_dummy = mesh.vertex.len() as u32;
        let borders = mesh.borders();
        for (dummy, border) in (first_dummy..).zip(&borders) {
            let first = origin.len() as u32;
            let count = border.len() as u32;
            for (i, &h) in (0..count).zip(border) {
                // Back along the border edge, to the dummy, and from it. The last two touch the neighbouring triangles.
                let half_edge = first + 3 * i;
                origin.extend([mesh.target(h), mesh.origin[h as usize], dummy]);
                twin.extend([h, first + 3 * ((i + count - 1) % count) + 2, first + 3 * ((i + 1) % count) + 1]);
                twin[h as usize] = half_edge;
            }
        }
        debug_assert!(!twin.contains(&NONE));
        Self { origin, twin, first_dummy, vertices: mesh.vertex.len() + borders.len() }
    }

    /// Number of triangles, including those of dummy vertices.
    fn triangles(&self) -> usize {
        self.origin.len() / 3
    }

    /// Number of vertices, including dummy vertices.
    fn vertices(&self) -> usize {
        self.vertices
    }

    /// The number of edges at each vertex.
    fn degrees(&self) -> Vec<u32> {
        let mut degree = vec![0; self.vertices];
        self.origin.iter().for_each(|vertex| degree[*vertex as usize] += 1);
        degree
    }
}
