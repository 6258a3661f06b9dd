//! Connectivity coded by vertex degrees (Touma and Gotsman 1998; Alliez and Desbrun 2001; Gasparello, chapter 3).
//!
//! The traversed region grows triangle by triangle, and each new vertex is coded as its number of edges. The same
//! traversal writes and reads, and it ends with [`Connectivity`]: all triangles in traversal order.
//!
//! It differs from the papers in three ways. The focus is the vertex of fewest free edges of all lists, not of one
//! list. Splits and merges are one operation, a join: the lists are spliced at the vertex that is met again, whichever
//! list it is in. A join also codes how the free edges of that vertex are divided.

use super::encoder_state::EncoderState;
use super::half_edge::{NONE, next, prev};
use super::{ActiveLists, ActiveNode, ClosedMesh};
use crate::codec::rans::{SymbolCoder, SymbolModel};
use crate::error::{DecodeError, invalid_if};

/// Symbol of a step to a vertex that is already in a list.
const JOIN: usize = 0;
/// Symbol of a step to a dummy vertex. Its degree follows as a number.
const DUMMY: usize = 1;
/// Symbol of a step to a vertex of this degree or more. The excess follows as a number. Symbols below are degrees.
const MORE: usize = 15;
/// Joins name nodes within this many steps along the list by the number of steps, and others by their index.
const MAX_JOIN_STEPS: u32 = 1024;
/// Number of contexts of each of the two models of a degree.
const CONTEXTS: usize = 64;

const CONTRADICTION: DecodeError = DecodeError::Invalid("a mesh's connectivity contradicts itself");

/// Triangles in traversal order.
#[derive(Debug, Default)]
pub(super) struct Connectivity {
    /// Vertices of each triangle, including those of dummy vertices. Vertices are numbered in traversal order.
    pub(super) triangles: Vec<[u32; 3]>,
    /// For each triangle with the vertex that was added last, the vertex beyond the opposite edge; [`NONE`] if the
    /// triangle there comes later, or if that vertex is not a corner.
    pub(super) beyond: Vec<u32>,
    /// For each half-edge, its twin; empty if no attribute needs it. The surface is closed.
    pub(super) twins: Vec<[u32; 3]>,
    /// The number of edges at each vertex.
    pub(super) degree: Vec<u32>,
    /// The triangle that added each vertex.
    pub(super) first_triangle: Vec<u32>,
    /// Dummy vertices, ascending.
    pub(super) dummies: Vec<u32>,
    /// Writer only: for each triangle, its first half-edge in the closed mesh.
    pub(super) source: Vec<u32>,
}

#[derive(Debug)]
struct ConnectivityModels {
    degree: [Vec<SymbolModel<16>>; 2],
    seed: SymbolModel<16>,
    large_degree: SymbolModel<32>,
    /// Whether a join names its node by steps forwards, by steps backwards or by index.
    join_direction: SymbolModel<4>,
    join_steps: SymbolModel<32>,
    join_free_edges: SymbolModel<32>,
    has_piece: SymbolModel<2>,
}

impl ConnectivityModels {
    fn new() -> Self {
        const TYPICAL: [u32; 16] = [30, 10, 5, 30, 120, 300, 400, 300, 100, 40, 20, 10, 6, 4, 3, 3];
        let typical = || vec![SymbolModel::new(|i| TYPICAL[i]); CONTEXTS];
        Self {
            degree: [typical(), typical()],
            seed: SymbolModel::new(|i| if i == JOIN { 0 } else { TYPICAL[i] }),
            large_degree: SymbolModel::default(),
            join_direction: SymbolModel::default(),
            join_steps: SymbolModel::default(),
            join_free_edges: SymbolModel::default(),
            has_piece: SymbolModel::new(|i| [1, 4][i]),
        }
    }
}

struct Traversal<'a> {
    active: ActiveLists,
    out: Connectivity,
    models: ConnectivityModels,
    closed: &'a ClosedMesh,
    encoder: EncoderState,
    /// Nodes without free edges.
    full: Vec<u32>,
    max_triangles: usize,
    with_twins: bool,
}

/// Writes the connectivity of `closed`. Fails only if `closed` is not a valid mesh.
pub(super) fn write<C: SymbolCoder>(
    coder: &mut C,
    closed: &ClosedMesh,
    with_twins: bool,
) -> Result<Connectivity, DecodeError> {
    let mut traversal = Traversal::new(closed, closed.triangles(), with_twins);
    traversal.encoder = EncoderState::new(closed);
    traversal.run(coder)
}

/// Reads connectivity. Fails on contradictory or truncated symbols, and beyond `max_triangles` triangles (dummies
/// included). Memory for `likely_triangles` is reserved at the start.
pub(super) fn read<C: SymbolCoder>(
    coder: &mut C,
    max_triangles: usize,
    likely_triangles: usize,
    with_twins: bool,
) -> Result<Connectivity, DecodeError> {
    let closed = ClosedMesh::default();
    let mut traversal = Traversal::new(&closed, max_triangles, with_twins);
    traversal.out.triangles.reserve(likely_triangles);
    traversal.out.beyond.reserve(likely_triangles);
    if with_twins {
        traversal.out.twins.reserve(likely_triangles);
    }
    // Closed surfaces have a few more vertices than half their triangles. Each join adds a node.
    let likely_vertices = likely_triangles / 2 + likely_triangles / 32 + 64;
    traversal.out.degree.reserve(likely_vertices);
    traversal.out.first_triangle.reserve(likely_vertices);
    traversal.active.nodes.reserve(likely_vertices);
    traversal.run(coder)
}

impl<'a> Traversal<'a> {
    fn new(closed: &'a ClosedMesh, max_triangles: usize, with_twins: bool) -> Self {
        Self {
            active: ActiveLists::new(),
            out: Connectivity::default(),
            models: ConnectivityModels::new(),
            closed,
            encoder: EncoderState::default(),
            full: Vec::new(),
            max_triangles,
            with_twins,
        }
    }

    fn run<C: SymbolCoder>(mut self, coder: &mut C) -> Result<Connectivity, DecodeError> {
        let mut seed = 0;
        loop {
            let unvisited = self.encoder.next_unvisited(seed);
            if !coder.flag(&mut self.models.has_piece, unvisited.is_some()) {
                return Ok(self.out);
            }
            seed = unvisited.unwrap_or(0);
            self.start_piece(coder, 3 * seed as u32)?;
            while let Some(focus) = self.active.pop_focus() {
                while self.active.node(focus).next != NONE {
                    self.step(coder, focus)?;
                    invalid_if(coder.overrun(), "a mesh's connectivity is truncated")?;
                }
            }
        }
    }

    /// Codes the first triangle of a piece. `seed` is its first half-edge.
    fn start_piece<C: SymbolCoder>(&mut self, coder: &mut C, seed: u32) -> Result<(), DecodeError> {
        let first = self.active.nodes.len() as u32;
        let edge = 3 * self.out.triangles.len() as u32;
        let mut corners = [0; 3];
        for (k, corner) in corners.iter_mut().enumerate() {
            let k = k as u32;
            let (mut symbol, mut degree) = (0, 0);
            if C::WRITES {
                (symbol, degree) = self.visit(self.closed.origin[(seed + k) as usize]);
            }
            let symbol = coder.symbol(&mut self.models.seed, symbol);
            *corner = self.add_vertex(coder, symbol, degree)?;
            // The list runs opposite to the triangle, because the untraversed side lies to its left.
            let (next, prev, edge) = (first + (k + 2) % 3, first + (k + 1) % 3, edge + (k + 2) % 3);
            let free = self.out.degree[*corner as usize] - 2;
            self.active.add(ActiveNode { vertex: *corner, free, next, prev, edge, opposite: NONE });
        }
        for k in 0..3 {
            self.active.node_mut(first + k).opposite = corners[(k as usize + 1) % 3];
        }
        self.add_triangle::<C>(corners, NONE, seed)?;
        if C::WRITES {
            self.encoder.add_nodes(3);
            for k in 0..3 {
                self.encoder.set_outside(first + k, self.closed.twin[(seed + (k + 2) % 3) as usize]);
            }
        }
        self.queue_changed(&[first, first + 1, first + 2]);
        self.close_full_nodes::<C>()
    }

    /// Codes the triangle beyond the edge from the previous node to the focus.
    #[inline]
    fn step<C: SymbolCoder>(&mut self, coder: &mut C, f: u32) -> Result<(), DecodeError> {
        let focus = *self.active.node(f);
        let p = focus.prev;
        let before = *self.active.node(p);
        let (mut symbol, mut degree, mut gate) = (JOIN, 0, NONE);
        if C::WRITES {
            gate = self.encoder.outside(p);
            let vertex = self.closed.origin[prev(gate) as usize];
            if !self.encoder.is_vertex_visited(vertex) {
                (symbol, degree) = self.visit(vertex);
            }
        }
        let [a, b] = self.degree_contexts(&before, &focus);
        let [by_edge, by_side] = &mut self.models.degree;
        let symbol = coder.pair(&mut by_edge[a], &mut by_side[b], symbol);
        if symbol == JOIN {
            return self.join(coder, f, gate);
        }
        let vertex = self.add_vertex(coder, symbol, degree)?;
        let edge = self.add_triangle::<C>([before.vertex, focus.vertex, vertex], before.opposite, gate)?;
        self.link_twins(edge, before.edge);
        let free = self.out.degree[vertex as usize] - 2;
        let opposite = before.vertex;
        let v = self.active.add(ActiveNode { vertex, free, next: f, prev: p, edge: edge + 1, opposite });
        let node = self.active.node_mut(p);
        (node.next, node.edge, node.opposite, node.free) = (v, edge + 2, focus.vertex, node.free - 1);
        let node = self.active.node_mut(f);
        (node.prev, node.free) = (v, node.free - 1);
        if C::WRITES {
            self.encoder.add_nodes(1);
            self.encoder.set_outside(v, self.closed.twin[next(gate) as usize]);
            self.encoder.set_outside(p, self.closed.twin[prev(gate) as usize]);
        }
        self.queue_or_close(v, free);
        self.queue_or_close(p, before.free - 1);
        // The focus stays the focus while it has free edges, so it is not queued.
        if focus.free == 1 {
            self.full.push(f);
        }
        self.close_full_nodes::<C>()
    }

    /// Codes a triangle whose third vertex is already in a list.
    #[cold]
    fn join<C: SymbolCoder>(&mut self, coder: &mut C, f: u32, gate: u32) -> Result<(), DecodeError> {
        let focus = *self.active.node(f);
        let p = focus.prev;
        let before = *self.active.node(p);
        let (mut target, mut part) = (0, 0);
        if C::WRITES {
            (target, part) = self.encoder.find_join(self.closed, gate);
        }
        let target = self.code_join_target(coder, focus.next, before.prev, target)?;
        let met = *self.active.nodes.get(target as usize).ok_or(CONTRADICTION)?;
        if met.next == NONE || met.free < 2 || met.vertex == before.vertex || met.vertex == focus.vertex {
            return Err(CONTRADICTION);
        }
        let part = if met.free > 2 { coder.number(&mut self.models.join_free_edges, part) } else { 0 };
        let rest = (met.free - 2).checked_sub(part).ok_or(CONTRADICTION)?;
        let beyond = if self.is_latest(met.vertex) { before.opposite } else { NONE };
        let edge = self.add_triangle::<C>([before.vertex, focus.vertex, met.vertex], beyond, gate)?;
        self.link_twins(edge, before.edge);
        // The nodes after the met vertex now follow the previous node; those before it now lead to the focus.
        let w = self.active.add(ActiveNode { free: part, prev: p, ..met });
        self.active.node_mut(met.next).prev = w;
        let node = self.active.node_mut(target);
        (node.next, node.edge, node.opposite, node.free) = (f, edge + 1, before.vertex, rest);
        let node = self.active.node_mut(p);
        (node.next, node.edge, node.opposite, node.free) = (w, edge + 2, focus.vertex, node.free - 1);
        let node = self.active.node_mut(f);
        (node.prev, node.free) = (target, node.free - 1);
        if C::WRITES {
            self.encoder.add_nodes(1);
            self.encoder.set_outside(w, self.encoder.outside(target));
            self.encoder.set_outside(target, self.closed.twin[next(gate) as usize]);
            self.encoder.set_outside(p, self.closed.twin[prev(gate) as usize]);
        }
        self.queue_changed(&[w, target, p, f]);
        self.close_full_nodes::<C>()
    }

    /// Codes the node of a join: by steps forwards from `after`, by steps backwards from `before`, or by its index.
    fn code_join_target<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        after: u32,
        before: u32,
        node: u32,
    ) -> Result<u32, DecodeError> {
        let (mut direction, mut steps) = (2, node);
        if C::WRITES {
            let (mut a, mut b) = (after, before);
            for step in 0..MAX_JOIN_STEPS {
                if a == node || b == node {
                    (direction, steps) = (usize::from(a != node), step);
                    break;
                }
                (a, b) = (self.active.node(a).next, self.active.node(b).prev);
            }
        }
        let direction = coder.symbol(&mut self.models.join_direction, direction);
        let steps = coder.number(&mut self.models.join_steps, steps);
        match direction {
            0 | 1 if steps < MAX_JOIN_STEPS => {
                let mut at = [after, before][direction];
                for _ in 0..steps {
                    at = if direction == 0 { self.active.node(at).next } else { self.active.node(at).prev };
                }
                Ok(at)
            }
            2 => Ok(steps),
            _ => Err(CONTRADICTION),
        }
    }

    fn queue_changed(&mut self, nodes: &[u32]) {
        for &node in nodes {
            self.queue_or_close(node, self.active.node(node).free);
        }
    }

    #[inline]
    fn queue_or_close(&mut self, node: u32, free: u32) {
        if free == 0 {
            self.full.push(node);
        } else {
            self.active.queue(node);
        }
    }

    /// Adds the last triangle of each vertex without free edges and removes its node.
    #[inline]
    fn close_full_nodes<C: SymbolCoder>(&mut self) -> Result<(), DecodeError> {
        while let Some(f) = self.full.pop() {
            let node = *self.active.node(f);
            if node.next == NONE || node.free != 0 {
                continue;
            }
            let (p, n) = (node.prev, node.next);
            let (before, after) = (*self.active.node(p), *self.active.node(n));
            let gate = if C::WRITES { self.encoder.outside(p) } else { 0 };
            let beyond = if self.is_latest(after.vertex) {
                before.opposite
            } else if self.is_latest(before.vertex) {
                node.opposite
            } else {
                NONE
            };
            let closed = node.vertex;
            let edge = self.add_triangle::<C>([before.vertex, closed, after.vertex], beyond, gate)?;
            self.link_twins(edge, before.edge);
            self.link_twins(edge + 1, node.edge);
            self.active.node_mut(f).next = NONE;
            match (before.free, after.free) {
                (0, 0) if after.next == p => {
                    self.link_twins(edge + 2, after.edge);
                    self.active.node_mut(p).next = NONE;
                    self.active.node_mut(n).next = NONE;
                    continue;
                }
                (0, _) | (_, 0) => return Err(CONTRADICTION),
                _ if p == n => return Err(CONTRADICTION),
                _ => {}
            }
            let node = self.active.node_mut(p);
            (node.next, node.edge, node.opposite, node.free) = (n, edge + 2, closed, node.free - 1);
            let node = self.active.node_mut(n);
            (node.prev, node.free) = (p, node.free - 1);
            if C::WRITES {
                self.encoder.set_outside(p, self.closed.twin[prev(gate) as usize]);
            }
            self.queue_or_close(p, before.free - 1);
            self.queue_or_close(n, after.free - 1);
        }
        Ok(())
    }

    /// Whether no vertex was added after this one.
    #[inline]
    fn is_latest(&self, vertex: u32) -> bool {
        vertex as usize + 1 == self.out.degree.len()
    }

    /// Adds a triangle and returns its first half-edge.
    #[inline]
    fn add_triangle<C: SymbolCoder>(
        &mut self,
        corners: [u32; 3],
        beyond: u32,
        source: u32,
    ) -> Result<u32, DecodeError> {
        let edge = 3 * self.out.triangles.len() as u32;
        invalid_if(self.out.triangles.len() >= self.max_triangles, "a mesh has more triangles than its header says")?;
        self.out.triangles.push(corners);
        self.out.beyond.push(beyond);
        if self.with_twins {
            self.out.twins.push([NONE; 3]);
        }
        if C::WRITES {
            self.out.source.push(source);
            self.encoder.visit_triangle(source);
        }
        Ok(edge)
    }

    /// Adds the vertex of a symbol and returns its number. Codes the degree where the symbol does not hold it.
    #[inline]
    fn add_vertex<C: SymbolCoder>(&mut self, coder: &mut C, symbol: usize, degree: u32) -> Result<u32, DecodeError> {
        let vertex = self.out.degree.len() as u32;
        let degree = if (2..MORE).contains(&symbol) {
            symbol as u32
        } else {
            let least = if symbol == MORE { MORE as u32 } else { 2 };
            if symbol == DUMMY {
                self.out.dummies.push(vertex);
            }
            coder.number(&mut self.models.large_degree, degree.wrapping_sub(least)).saturating_add(least)
        };
        if symbol == JOIN || degree as usize > self.max_triangles {
            return Err(CONTRADICTION);
        }
        self.out.degree.push(degree);
        self.out.first_triangle.push(self.out.triangles.len() as u32);
        Ok(vertex)
    }

    #[inline]
    fn link_twins(&mut self, a: u32, b: u32) {
        if self.with_twins {
            let twins = self.out.twins.as_flattened_mut();
            twins[a as usize] = b;
            twins[b as usize] = a;
        }
    }

    /// Contexts of a new vertex's degree: the degrees at the edge it is attached to; and the degree of the vertex after
    /// the focus with the free edges at that edge.
    #[inline]
    fn degree_contexts(&self, before: &ActiveNode, focus: &ActiveNode) -> [usize; 2] {
        let degree = |vertex: u32| self.out.degree[vertex as usize].clamp(3, 9) as usize - 3;
        let free = |node: &ActiveNode| node.free.min(3) as usize - 1;
        let after = self.active.node(focus.next).vertex;
        [degree(before.vertex) * 7 + degree(focus.vertex), degree(after) * 9 + free(before) * 3 + free(focus)]
    }

    /// Writer only: marks a vertex of the closed mesh as visited and returns its symbol and degree.
    fn visit(&mut self, vertex: u32) -> (usize, u32) {
        let degree = self.encoder.visit_vertex(vertex);
        (if vertex >= self.closed.first_dummy { DUMMY } else { (degree as usize).min(MORE) }, degree)
    }
}
