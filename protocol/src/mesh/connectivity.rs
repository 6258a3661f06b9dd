//! Connectivity by valences (Touma and Gotsman 1998; Alliez and Desbrun 2001; Gasparello, chapter 3): the conquered region
//! grows triangle by triangle, and each new vertex says only how many edges it has.
//!
//! In: [`ClosedMesh`] pieces, or coded symbols. Out: [`Connectivity`]: the same triangles in the order in which they were conquered.
//! Next: `geometry` and `attributes`, which know all of the connectivity by then.
//!
//! One walk both writes and reads. It differs from the papers in three ways. The focus is the vertex of fewest free edges of
//! all lists, not of one. A split and a merge are then one thing, a **join**: the lists are spliced at the vertex that is
//! met again, whichever list it is on. And a join says how the free edges of that vertex are shared out.

use super::{
    active_lists::{ActiveLists, ActiveNode},
    closed_mesh::ClosedMesh,
    half_edge::{NONE, next, prev},
};
use crate::{
    codec::rans::{SymbolCoder, SymbolModel},
    error::DecodeError,
};

/// SymbolCoder of a step: the vertex is on a list already, is a border's dummy, or has so many edges; the last stands for more.
const JOIN: usize = 0;
const DUMMY: usize = 1;
const MORE: usize = 15;
/// Steps along a list within which a join looks for its vertex; farther ones are named by their number.
const REACH: u32 = 1024;
/// Contexts of a degree, by each of two looks at the front.
const CONTEXTS: usize = 64;

/// Triangles in the order of conquest.
#[derive(Debug, Default)]
pub(super) struct Connectivity {
    /// Vertices of each triangle, those of dummies too; numbered as they were conquered.
    pub(super) triangles: Vec<[u32; 3]>,
    /// For each half-edge, the one beside it: the surface is closed.
    pub(super) twins: Vec<[u32; 3]>,
    /// Edges at each vertex.
    pub(super) degree: Vec<u32>,
    /// The triangle that came with each vertex.
    pub(super) birth: Vec<u32>,
    /// Vertices that stand for a border, ascending.
    pub(super) dummies: Vec<u32>,
    /// Of a writer: for each triangle, the half-edge that it begins with in the closed pieces.
    pub(super) source: Vec<u32>,
}

/// What a writer knows beyond a reader.
#[derive(Debug, Default)]
struct EncoderState {
    degree: Vec<u32>,
    /// Whether a vertex was conquered.
    met: Vec<bool>,
    /// Whether a triangle was.
    done: Vec<bool>,
    /// For each node, the half-edge beyond the edge to its next.
    beyond: Vec<u32>,
    /// For each such half-edge, its node.
    node: Vec<u32>,
}

#[derive(Debug)]
struct ConnectivityModels {
    degree: [Vec<SymbolModel<16>>; 2],
    seed: SymbolModel<16>,
    large: SymbolModel<32>,
    /// Forwards, backwards, by number.
    way: SymbolModel<4>,
    steps: SymbolModel<32>,
    part: SymbolModel<32>,
    more: SymbolModel<2>,
}

impl ConnectivityModels {
    fn new() -> Self {
        const USUAL: [u32; 16] = [30, 10, 5, 30, 120, 300, 400, 300, 100, 40, 20, 10, 6, 4, 3, 3];
        let usual = || vec![SymbolModel::new(|i| USUAL[i]); CONTEXTS];
        Self {
            degree: [usual(), usual()],
            seed: SymbolModel::new(|i| if i == JOIN { 0 } else { USUAL[i] }),
            large: SymbolModel::default(),
            way: SymbolModel::default(),
            steps: SymbolModel::default(),
            part: SymbolModel::default(),
            more: SymbolModel::new(|i| [1, 4][i]),
        }
    }
}

struct Traversal<'a> {
    active: ActiveLists,
    out: Connectivity,
    models: ConnectivityModels,
    closed: &'a ClosedMesh,
    guide: EncoderState,
    /// Nodes without free edges.
    full: Vec<u32>,
    limit: usize,
}

const DISORDER: DecodeError = DecodeError::Invalid("a mesh's connectivity contradicts itself");

/// Writes the connectivity of `closed`.
pub(super) fn write<C: SymbolCoder>(coder: &mut C, closed: &ClosedMesh) -> Result<Connectivity, DecodeError> {
    let mut walk = Traversal::new(closed, closed.triangles());
    walk.guide = EncoderState {
        degree: closed.degrees(),
        met: vec![false; closed.vertices()],
        done: vec![false; closed.triangles()],
        beyond: Vec::new(),
        node: vec![NONE; closed.origin.len()],
    };
    walk.run(coder)
}

/// Reads connectivity of at most `limit` triangles, those of dummies among them.
///
/// Room for `likely` of them is made at once.
pub(super) fn read<C: SymbolCoder>(coder: &mut C, limit: usize, likely: usize) -> Result<Connectivity, DecodeError> {
    let closed = ClosedMesh::default();
    let mut walk = Traversal::new(&closed, limit);
    walk.out.triangles.reserve(likely);
    walk.out.twins.reserve(likely);
    walk.out.degree.reserve(likely / 2);
    walk.out.birth.reserve(likely / 2);
    walk.active.nodes.reserve(likely / 2);
    walk.run(coder)
}

impl<'a> Traversal<'a> {
    fn new(closed: &'a ClosedMesh, limit: usize) -> Self {
        Self {
            active: ActiveLists::new(),
            out: Connectivity::default(),
            models: ConnectivityModels::new(),
            closed,
            guide: EncoderState::default(),
            full: Vec::new(),
            limit,
        }
    }

    fn run<C: SymbolCoder>(mut self, coder: &mut C) -> Result<Connectivity, DecodeError> {
        let mut seed = 0;
        loop {
            if C::WRITES {
                while self.guide.done.get(seed) == Some(&true) {
                    seed += 1;
                }
            }
            if !coder.flag(&mut self.models.more, seed < self.guide.done.len()) {
                return Ok(self.out);
            }
            self.begin(coder, 3 * seed as u32)?;
            while let Some(focus) = self.active.focus() {
                while self.active.node(focus).next != NONE {
                    self.step(coder, focus)?;
                    if coder.overrun() {
                        return Err(DecodeError::Invalid("a mesh's connectivity is cut off"));
                    }
                }
            }
        }
    }

    /// The first triangle of a piece; `seed` is its first half-edge.
    fn begin<C: SymbolCoder>(&mut self, coder: &mut C, seed: u32) -> Result<(), DecodeError> {
        let first = self.active.nodes.len() as u32;
        let edge = 3 * self.out.triangles.len() as u32;
        let mut corners = [0; 3];
        for (k, corner) in corners.iter_mut().enumerate() {
            let k = k as u32;
            let (mut symbol, mut degree) = (0, 0);
            if C::WRITES {
                (symbol, degree) = self.meet(self.closed.origin[(seed + k) as usize]);
            }
            let symbol = coder.symbol(&mut self.models.seed, symbol);
            *corner = self.vertex(coder, symbol, degree)?;
            // What is left of the edge to the node before is free: lists go the other way round than the triangle.
            let (next, prev, edge) = (first + (k + 2) % 3, first + (k + 1) % 3, edge + (k + 2) % 3);
            let free = self.out.degree[*corner as usize] - 2;
            self.active.add(ActiveNode { vertex: *corner, free, next, prev, edge });
        }
        self.triangle::<C>(corners, seed)?;
        if C::WRITES {
            self.guide.beyond.extend([0; 3]);
            for k in 0..3 {
                self.face_out(first + k, self.closed.twin[(seed + (k + 2) % 3) as usize]);
            }
        }
        self.change(&[first, first + 1, first + 2]);
        self.settle::<C>()
    }

    /// The triangle on the edge from the node before the focus to the focus.
    #[inline]
    fn step<C: SymbolCoder>(&mut self, coder: &mut C, f: u32) -> Result<(), DecodeError> {
        let focus = *self.active.node(f);
        let p = focus.prev;
        let before = *self.active.node(p);
        let (mut symbol, mut degree, mut gate) = (JOIN, 0, NONE);
        if C::WRITES {
            gate = self.guide.beyond[p as usize];
            let vertex = self.closed.origin[prev(gate) as usize];
            if !self.guide.met[vertex as usize] {
                (symbol, degree) = self.meet(vertex);
            }
        }
        let [a, b] = self.contexts(&before, &focus);
        let [by_edge, by_side] = &mut self.models.degree;
        let symbol = coder.pair(&mut by_edge[a], &mut by_side[b], symbol);
        if symbol == JOIN {
            return self.join(coder, f, gate);
        }
        let vertex = self.vertex(coder, symbol, degree)?;
        let edge = self.triangle::<C>([before.vertex, focus.vertex, vertex], gate)?;
        self.link(edge, before.edge);
        let free = self.out.degree[vertex as usize] - 2;
        let v = self.active.add(ActiveNode { vertex, free, next: f, prev: p, edge: edge + 1 });
        let node = self.active.node_mut(p);
        (node.next, node.edge, node.free) = (v, edge + 2, node.free - 1);
        let node = self.active.node_mut(f);
        (node.prev, node.free) = (v, node.free - 1);
        if C::WRITES {
            self.guide.beyond.push(0);
            self.face_out(v, self.closed.twin[next(gate) as usize]);
            self.face_out(p, self.closed.twin[prev(gate) as usize]);
        }
        if free == 0 {
            self.full.push(v);
        } else {
            self.active.wait(v);
        }
        if before.free == 1 {
            self.full.push(p);
        } else {
            self.active.wait(p);
        }
        // The focus needs not wait.
        if focus.free == 1 {
            self.full.push(f);
        }
        self.settle::<C>()
    }

    /// A triangle whose third vertex is on a list already.
    #[cold]
    fn join<C: SymbolCoder>(&mut self, coder: &mut C, f: u32, gate: u32) -> Result<(), DecodeError> {
        let focus = *self.active.node(f);
        let p = focus.prev;
        let before = *self.active.node(p);
        let (mut target, mut part) = (0, 0);
        if C::WRITES {
            (target, part) = self.stay(gate);
        }
        let target = self.point(coder, focus.next, before.prev, target)?;
        let met = *self.active.nodes.get(target as usize).ok_or(DISORDER)?;
        if met.next == NONE || met.free < 2 || met.vertex == before.vertex || met.vertex == focus.vertex {
            return Err(DISORDER);
        }
        let part = if met.free > 2 { coder.number(&mut self.models.part, part) } else { 0 };
        let rest = (met.free - 2).checked_sub(part).ok_or(DISORDER)?;
        let edge = self.triangle::<C>([before.vertex, focus.vertex, met.vertex], gate)?;
        self.link(edge, before.edge);
        // What came after the vertex goes on from the node before the focus, what came before it leads to the focus.
        let w = self.active.add(ActiveNode { vertex: met.vertex, free: part, next: met.next, prev: p, edge: met.edge });
        self.active.node_mut(met.next).prev = w;
        let node = self.active.node_mut(target);
        (node.next, node.edge, node.free) = (f, edge + 1, rest);
        let node = self.active.node_mut(p);
        (node.next, node.edge, node.free) = (w, edge + 2, node.free - 1);
        let node = self.active.node_mut(f);
        (node.prev, node.free) = (target, node.free - 1);
        if C::WRITES {
            self.guide.beyond.push(0);
            self.face_out(w, self.guide.beyond[target as usize]);
            self.face_out(target, self.closed.twin[next(gate) as usize]);
            self.face_out(p, self.closed.twin[prev(gate) as usize]);
        }
        self.change(&[w, target, p, f]);
        self.settle::<C>()
    }

    /// Which node a join is about: so many steps after the focus or before the gate, or by its number.
    fn point<C: SymbolCoder>(&mut self, coder: &mut C, after: u32, before: u32, node: u32) -> Result<u32, DecodeError> {
        let (mut way, mut steps) = (2, node);
        if C::WRITES {
            let (mut a, mut b) = (after, before);
            for step in 0..REACH {
                if a == node || b == node {
                    (way, steps) = (usize::from(a != node), step);
                    break;
                }
                (a, b) = (self.active.node(a).next, self.active.node(b).prev);
            }
        }
        let way = coder.symbol(&mut self.models.way, way);
        let steps = coder.number(&mut self.models.steps, steps);
        match way {
            0 | 1 if steps < REACH => {
                let mut at = [after, before][way];
                for _ in 0..steps {
                    at = if way == 0 { self.active.node(at).next } else { self.active.node(at).prev };
                }
                Ok(at)
            }
            2 => Ok(steps),
            _ => Err(DISORDER),
        }
    }

    /// Of a writer: the node at which the third vertex of the gate's triangle is met, and how many of its free edges lie
    /// between the edge to its next and that triangle.
    fn stay(&self, gate: u32) -> (u32, u32) {
        let mut half_edge = prev(gate);
        let mut crossed = 0;
        loop {
            let twin = self.closed.twin[half_edge as usize];
            if self.guide.done[twin as usize / 3] {
                return (self.guide.node[half_edge as usize], crossed - 1);
            }
            crossed += 1;
            half_edge = next(twin);
        }
    }

    /// Sorts nodes whose free edges changed: those without any are full, the others wait.
    fn change(&mut self, nodes: &[u32]) {
        for &node in nodes {
            if self.active.node(node).free == 0 { self.full.push(node) } else { self.active.wait(node) }
        }
    }

    /// Fills in the triangles of vertices that have no free edge left.
    #[inline]
    fn settle<C: SymbolCoder>(&mut self) -> Result<(), DecodeError> {
        while let Some(f) = self.full.pop() {
            let node = *self.active.node(f);
            if node.next == NONE || node.free != 0 {
                continue;
            }
            let (p, n) = (node.prev, node.next);
            let (before, after) = (*self.active.node(p), *self.active.node(n));
            let gate = if C::WRITES { self.guide.beyond[p as usize] } else { 0 };
            let edge = self.triangle::<C>([before.vertex, node.vertex, after.vertex], gate)?;
            self.link(edge, before.edge);
            self.link(edge + 1, node.edge);
            self.active.node_mut(f).next = NONE;
            match (before.free, after.free) {
                (0, 0) if after.next == p => {
                    self.link(edge + 2, after.edge);
                    self.active.node_mut(p).next = NONE;
                    self.active.node_mut(n).next = NONE;
                    continue;
                }
                (0, _) | (_, 0) => return Err(DISORDER),
                _ if p == n => return Err(DISORDER),
                _ => {}
            }
            let node = self.active.node_mut(p);
            (node.next, node.edge, node.free) = (n, edge + 2, node.free - 1);
            let node = self.active.node_mut(n);
            (node.prev, node.free) = (p, node.free - 1);
            if C::WRITES {
                self.face_out(p, self.closed.twin[prev(gate) as usize]);
            }
            for (node, free) in [(p, before.free), (n, after.free)] {
                if free == 1 { self.full.push(node) } else { self.active.wait(node) }
            }
        }
        Ok(())
    }

    /// Appends a triangle and gives its first half-edge.
    #[inline]
    fn triangle<C: SymbolCoder>(&mut self, corners: [u32; 3], source: u32) -> Result<u32, DecodeError> {
        let edge = 3 * self.out.triangles.len() as u32;
        if self.out.triangles.len() >= self.limit {
            return Err(DecodeError::Invalid("a mesh has more triangles than it announces"));
        }
        self.out.triangles.push(corners);
        self.out.twins.push([NONE; 3]);
        if C::WRITES {
            self.out.source.push(source);
            self.guide.done[source as usize / 3] = true;
        }
        Ok(edge)
    }

    /// Appends a vertex.
    #[inline]
    fn vertex<C: SymbolCoder>(&mut self, coder: &mut C, symbol: usize, degree: u32) -> Result<u32, DecodeError> {
        let vertex = self.out.degree.len() as u32;
        let degree = if (2..MORE).contains(&symbol) {
            symbol as u32
        } else {
            let least = if symbol == MORE { MORE as u32 } else { 2 };
            if symbol == DUMMY {
                self.out.dummies.push(vertex);
            }
            coder.number(&mut self.models.large, degree.wrapping_sub(least)).saturating_add(least)
        };
        if symbol == JOIN || degree as usize > self.limit {
            return Err(DISORDER);
        }
        self.out.degree.push(degree);
        self.out.birth.push(self.out.triangles.len() as u32);
        Ok(vertex)
    }

    /// Two half-edges are each other's twins.
    #[inline]
    fn link(&mut self, a: u32, b: u32) {
        let twins = self.out.twins.as_flattened_mut();
        twins[a as usize] = b;
        twins[b as usize] = a;
    }

    /// What a new vertex's degree depends on: the degrees at the edge it comes to; that of the vertex after the focus, with
    /// the free edges at that edge.
    #[inline]
    fn contexts(&self, before: &ActiveNode, focus: &ActiveNode) -> [usize; 2] {
        let degree = |vertex: u32| self.out.degree[vertex as usize].clamp(3, 9) as usize - 3;
        let free = |node: &ActiveNode| node.free.min(3) as usize - 1;
        let after = self.active.node(focus.next).vertex;
        [degree(before.vertex) * 7 + degree(focus.vertex), degree(after) * 9 + free(before) * 3 + free(focus)]
    }

    /// Of a writer: a vertex's symbol and degree.
    fn meet(&mut self, vertex: u32) -> (usize, u32) {
        self.guide.met[vertex as usize] = true;
        let degree = self.guide.degree[vertex as usize];
        (if vertex >= self.closed.dummies_from { DUMMY } else { (degree as usize).min(MORE) }, degree)
    }

    /// Of a writer: what is beyond the edge from a node to its next.
    fn face_out(&mut self, node: u32, half_edge: u32) {
        self.guide.beyond[node as usize] = half_edge;
        self.guide.node[half_edge as usize] = node;
    }
}
