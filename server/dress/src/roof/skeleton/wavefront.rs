//! The moving edges of a straight skeleton, and the events in which edges disappear.

use crate::roof::RoofFault;
use crate::roof::plan::PlanPoint;
use crate::roof::simple::edges;
use glam::DVec2;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// A reflex vertex is on the line of an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Collision {
    pub(super) time: f64,
    pub(super) vertex: usize,
    pub(super) edge: usize,
}

impl Eq for Collision {}

impl Ord for Collision {
    fn cmp(&self, other: &Self) -> Ordering {
        let times = self.time.total_cmp(&other.time);
        times.then(self.vertex.cmp(&other.vertex)).then(self.edge.cmp(&other.edge))
    }
}

impl PartialOrd for Collision {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Turns to the right by more than this sine are reflex.
const REFLEX_SINE: f64 = 1e-9;
/// Vertices at the ends of an edge that has turned around by more than this many tolerances are no rounding error.
const MAX_FLIP: f64 = 1e3;
/// Slower changes of a length are none.
pub(super) const MIN_RATE: f64 = 1e-12;

/// An edge of the polygon. Time is the distance by which edges have moved.
pub(super) struct Edge {
    /// Numbers of its ends.
    pub(super) corners: (usize, usize),
    pub(super) direction: DVec2,
    /// Inwards.
    pub(super) normal: DVec2,
    /// `normal * p` of its points at time 0.
    pub(super) offset: f64,
}

/// A vertex of the wavefront, where one edge ends and the next begins.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    pub(super) in_edge: usize,
    pub(super) out_edge: usize,
    pub(super) previous: usize,
    pub(super) next: usize,
    pub(super) start: DVec2,
    pub(super) start_time: f64,
    pub(super) velocity: DVec2,
    /// Where its trace begins.
    pub(super) node: usize,
    pub(super) is_alive: bool,
}

/// What vertices leave behind.
pub(super) struct Traces {
    pub(super) nodes: Vec<PlanPoint>,
    /// Directed arcs around the face of each edge, counter-clockwise, without the edge itself.
    pub(super) arcs: Vec<Vec<(usize, usize)>>,
}

pub(super) struct Wavefront {
    pub(super) edges: Vec<Edge>,
    pub(super) vertices: Vec<Vertex>,
    /// Numbers of the vertices that are alive, and of some that were.
    pub(super) live: Vec<usize>,
    /// For each edge, the vertices at which its parts begin, and some that are not alive.
    pub(super) parts: Vec<Vec<usize>>,
    pub(super) traces: Traces,
    pub(super) collisions: BinaryHeap<Reverse<Collision>>,
    pub(super) now: f64,
    pub(super) tolerance_m: f64,
}

impl Wavefront {
    /// The edges of a simple polygon at time 0.
    pub(super) fn new(rings: &[Vec<DVec2>], tolerance_m: f64) -> Self {
        let mut wavefront = Self {
            edges: Vec::new(),
            vertices: Vec::new(),
            live: Vec::new(),
            parts: Vec::new(),
            traces: Traces { nodes: Vec::new(), arcs: Vec::new() },
            collisions: BinaryHeap::new(),
            now: 0.0,
            tolerance_m,
        };
        for ring in rings {
            let start = wavefront.edges.len();
            for (i, (from, to)) in edges(ring).enumerate() {
                let direction = (to - from).normalize_or_zero();
                let normal = direction.perp();
                let corners = (start + i, start + (i + 1) % ring.len());
                wavefront.edges.push(Edge { corners, direction, normal, offset: normal.dot(from) });
                wavefront.traces.nodes.push(PlanPoint { at: from, rise: 0.0 });
            }
        }
        let count = wavefront.edges.len();
        wavefront.traces.arcs = vec![Vec::new(); count];
        wavefront.parts = vec![Vec::new(); count];
        for ring in rings {
            let start = wavefront.vertices.len();
            for i in 0..ring.len() {
                let [previous, next] = [start + (i + ring.len() - 1) % ring.len(), start + (i + 1) % ring.len()];
                wavefront.add(previous, start + i, previous, next, start + i);
            }
        }
        wavefront
    }

    /// Moves the edges until none is left. Fails if events contradict each other.
    pub(super) fn run(mut self) -> Result<Traces, RoofFault> {
        let max_events = 20 * self.edges.len() + 100;
        self.join_coincident()?;
        for _ in 0..max_events {
            if self.live.is_empty() {
                return Ok(self.traces);
            }
            let shrunk = self.next_shrunk();
            let end_time = shrunk.map_or(f64::INFINITY, |(time, _)| time);
            if let Some(hit) = self.next_hit(end_time) {
                self.split(hit);
            } else if let Some((time, vertex)) = shrunk {
                self.now = time;
                self.join(vertex)?;
            } else {
                return Err(RoofFault::Skeleton);
            }
            self.join_coincident()?;
        }
        Err(RoofFault::Skeleton)
    }

    /// Adds a vertex that starts at a node now, and returns its number. Its neighbours must link to it.
    pub(super) fn add(&mut self, in_edge: usize, out_edge: usize, previous: usize, next: usize, node: usize) -> usize {
        let [a, b] = [&self.edges[in_edge], &self.edges[out_edge]];
        let (sine, cosine) = (a.direction.perp_dot(b.direction), a.direction.dot(b.direction));
        // Both forms move each edge by 1. The first is exact for small turns, the second for sharp ones.
        let velocity = if cosine > -0.5 {
            (a.normal + b.normal) / (1.0 + cosine)
        } else if sine.abs() > f64::MIN_POSITIVE {
            (b.direction - a.direction) / sine
        } else {
            DVec2::ZERO
        };
        let number = self.vertices.len();
        let start = self.traces.nodes[node].at;
        self.vertices.push(Vertex {
            in_edge,
            out_edge,
            previous,
            next,
            start,
            start_time: self.now,
            velocity,
            node,
            is_alive: true,
        });
        self.live.push(number);
        self.parts[out_edge].push(number);
        if sine < -REFLEX_SINE {
            self.expect_collisions(number);
        }
        number
    }

    /// Adds a vertex between two others, and links them.
    pub(super) fn insert(
        &mut self,
        in_edge: usize,
        out_edge: usize,
        previous: usize,
        next: usize,
        node: usize,
    ) -> usize {
        let number = self.add(in_edge, out_edge, previous, next, node);
        self.vertices[previous].next = number;
        self.vertices[next].previous = number;
        number
    }

    pub(super) fn position(&self, vertex: usize, time: f64) -> DVec2 {
        let vertex = &self.vertices[vertex];
        vertex.start + vertex.velocity * (time - vertex.start_time)
    }

    /// The node at a place at the present time.
    pub(super) fn node_at(&mut self, at: DVec2) -> usize {
        let nodes = &self.traces.nodes;
        let recent = nodes.iter().enumerate().rev().take_while(|(_, node)| node.rise >= self.now - self.tolerance_m);
        let known = recent.map(|(i, node)| (i, node.at)).find(|(_, known)| known.distance(at) <= self.tolerance_m);
        known.map_or_else(
            || {
                self.traces.nodes.push(PlanPoint { at, rise: self.now });
                self.traces.nodes.len() - 1
            },
            |(i, _)| i,
        )
    }

    pub(super) fn end(&mut self, vertex: usize, node: usize) {
        let Vertex { in_edge, out_edge, node: start, .. } = self.vertices[vertex];
        self.vertices[vertex].is_alive = false;
        self.add_arc(in_edge, out_edge, start, node);
    }

    /// Adds an arc with the face of one edge to the left and that of the other to the right.
    fn add_arc(&mut self, left: usize, right: usize, from: usize, to: usize) {
        if from != to {
            self.traces.arcs[left].push((from, to));
            self.traces.arcs[right].push((to, from));
        }
    }

    /// The next edge to shrink to nothing: its time, and the vertex at which it begins.
    fn next_shrunk(&self) -> Option<(f64, usize)> {
        let times = self.live.iter().filter_map(|&i| {
            let vertex = &self.vertices[i];
            let direction = self.edges[vertex.out_edge].direction;
            let length = (self.position(vertex.next, self.now) - self.position(i, self.now)).dot(direction);
            let rate = (self.vertices[vertex.next].velocity - vertex.velocity).dot(direction);
            (rate < -MIN_RATE).then(|| (self.now + (length / -rate).max(0.0), i))
        });
        times.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
    }

    /// Joins all that coincides, and removes rings without area. Brings `live` up to date.
    fn join_coincident(&mut self) -> Result<(), RoofFault> {
        let mut is_changed = true;
        while is_changed {
            is_changed = false;
            let mut i = 0;
            while i < self.live.len() {
                let vertex = self.live[i];
                if self.vertices[vertex].is_alive && self.join_at(vertex)? {
                    is_changed = true;
                }
                i += 1;
            }
            let vertices = &self.vertices;
            self.live.retain(|&i| vertices[i].is_alive);
        }
        Ok(())
    }

    /// Joins a vertex with its neighbours if they coincide or overlap. Returns whether it did.
    fn join_at(&mut self, vertex: usize) -> Result<bool, RoofFault> {
        let Vertex { in_edge, out_edge, previous, next, .. } = self.vertices[vertex];
        if next == vertex {
            let node = self.node_at(self.position(vertex, self.now));
            self.end(vertex, node);
            return Ok(true);
        }
        let step = self.position(next, self.now) - self.position(vertex, self.now);
        let [a, b] = [&self.edges[in_edge], &self.edges[out_edge]];
        if step.length() <= self.tolerance_m || step.dot(b.direction) <= 0.0 {
            self.join(vertex)?;
            return Ok(true);
        }
        let is_spike =
            a.direction.dot(b.direction) < 0.0 && a.direction.perp_dot(b.direction).abs() <= self.spike_sine();
        if is_spike || previous == next {
            self.remove_spike(vertex);
            return Ok(true);
        }
        Ok(false)
    }

    /// Edges that turn back by less than this sine are on each other: on a length of 10 m, they are within the tolerance.
    fn spike_sine(&self) -> f64 {
        0.1 * self.tolerance_m
    }

    /// Joins a vertex with the next one: the edge between them is gone.
    fn join(&mut self, vertex: usize) -> Result<(), RoofFault> {
        let Vertex { in_edge, previous, next, .. } = self.vertices[vertex];
        let [from, to] = [self.position(vertex, self.now), self.position(next, self.now)];
        if from.distance(to) > MAX_FLIP * self.tolerance_m {
            return Err(RoofFault::Skeleton);
        }
        let node = self.node_at((from + to) / 2.0);
        let Vertex { out_edge, next: after, .. } = self.vertices[next];
        self.end(vertex, node);
        self.end(next, node);
        if previous == next {
            // The ring had two vertices: the other edge is gone too.
            return Ok(());
        }
        self.insert(in_edge, out_edge, previous, after, node);
        Ok(())
    }

    /// Removes a vertex whose edges lie on each other. They leave a ridge to the nearer end.
    fn remove_spike(&mut self, vertex: usize) {
        let Vertex { in_edge, out_edge, previous, next, .. } = self.vertices[vertex];
        let [tip, before, after] = [vertex, previous, next].map(|i| self.position(i, self.now));
        let is_next_nearer = tip.distance(after) <= tip.distance(before);
        let (near, near_at) = if is_next_nearer { (next, after) } else { (previous, before) };
        let [tip_node, near_node] = [self.node_at(tip), self.node_at(near_at)];
        self.add_arc(in_edge, out_edge, tip_node, near_node);
        self.end(vertex, tip_node);
        self.end(near, near_node);
        let Vertex { in_edge: near_in, out_edge: near_out, previous: near_previous, next: near_next, .. } =
            self.vertices[near];
        if previous == next {
            return;
        }
        if is_next_nearer {
            self.insert(in_edge, near_out, previous, near_next, near_node);
        } else {
            self.insert(near_in, out_edge, near_previous, next, near_node);
        }
    }
}
