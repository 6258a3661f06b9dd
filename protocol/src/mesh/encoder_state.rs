//! What the writer of connectivity knows beyond a reader: the whole mesh, and which parts of it were traversed.

use super::ClosedMesh;
use super::half_edge::{NONE, next, prev};

/// State of a writer. A reader's is empty and unused.
#[derive(Debug, Default)]
pub(super) struct EncoderState {
    degree: Vec<u32>,
    vertex_visited: Vec<bool>,
    triangle_visited: Vec<bool>,
    /// For each node, the untraversed half-edge on the edge to the next node.
    outside: Vec<u32>,
    /// For each such half-edge, its node.
    node: Vec<u32>,
}

impl EncoderState {
    pub(super) fn new(closed: &ClosedMesh) -> Self {
        Self {
            degree: closed.degrees(),
            vertex_visited: vec![false; closed.vertices()],
            triangle_visited: vec![false; closed.triangles()],
            outside: Vec::new(),
            node: vec![NONE; closed.origin.len()],
        }
    }

    /// The first unvisited triangle at or after `triangle`.
    pub(super) fn next_unvisited(&self, triangle: usize) -> Option<usize> {
        (triangle..self.triangle_visited.len()).find(|t| !self.triangle_visited[*t])
    }

    pub(super) fn is_vertex_visited(&self, vertex: u32) -> bool {
        self.vertex_visited[vertex as usize]
    }

    /// Marks a vertex as visited and returns its degree.
    pub(super) fn visit_vertex(&mut self, vertex: u32) -> u32 {
        self.vertex_visited[vertex as usize] = true;
        self.degree[vertex as usize]
    }

    pub(super) fn visit_triangle(&mut self, half_edge: u32) {
        self.triangle_visited[half_edge as usize / 3] = true;
    }

    /// Adds `count` nodes, whose outside half-edges are set later.
    pub(super) fn add_nodes(&mut self, count: usize) {
        self.outside.resize(self.outside.len() + count, 0);
    }

    /// The untraversed half-edge on the edge from `node` to the next node.
    #[inline]
    pub(super) fn outside(&self, node: u32) -> u32 {
        self.outside[node as usize]
    }

    #[inline]
    pub(super) fn set_outside(&mut self, node: u32, half_edge: u32) {
        self.outside[node as usize] = half_edge;
        self.node[half_edge as usize] = node;
    }

    /// Finds the node at which the third vertex of the gate's triangle is already in a list, and how many of its free
    /// edges lie between the edge to its next node and that triangle.
    pub(super) fn find_join(&self, closed: &ClosedMesh, gate: u32) -> (u32, u32) {
        let mut half_edge = prev(gate);
        let mut crossed = 0;
        loop {
            let twin = closed.twin[half_edge as usize];
            if self.triangle_visited[twin as usize / 3] {
                return (self.node[half_edge as usize], crossed - 1);
            }
            crossed += 1;
            half_edge = next(twin);
        }
    }
}
