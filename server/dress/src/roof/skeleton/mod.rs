//! The straight skeleton of a polygon with holes: the traces of its corners while all edges move inwards at equal speed
//! (Aichholzer, Aurenhammer, Alberts and Gaertner, A Novel Type of Skeleton for Polygons, 1995). Raised by the time at which
//! the edges pass, its faces are a roof with equal slopes.
//!
//! The wavefront is a set of rings of vertices that move with constant velocity. Two events change it: an edge shrinks to
//! nothing, or a reflex vertex meets another edge or vertex. Collisions of a reflex vertex with the lines of all edges are
//! known when it is made, and wait in a queue; whether the edge is there is decided at that time. At each event all
//! vertices are brought to its time, and what coincides is joined, so events at one time need no order.

mod wavefront;

use super::cut::trace_faces;
use super::plan::PlanPoint;
use super::{RoofFault, simple};
use glam::DVec2;
use std::cmp::Reverse;
use std::f64::consts::TAU;
use wavefront::{Collision, MIN_RATE, Vertex, Wavefront};

/// Polygons with more edges are refused: time grows with the square.
const MAX_EDGES: usize = 600;
/// Distances below which points coincide, in the order in which they are tried.
const TOLERANCES_M: [f64; 3] = [1e-6, 1e-8, 1e-4];

/// The faces of a skeleton.
#[derive(Debug, Clone)]
pub(super) struct Skeleton {
    /// The corners in the order of the rings, then the inner nodes. `rise` is the distance from the edges, in metres.
    pub(super) nodes: Vec<PlanPoint>,
    /// For each edge its face, rarely in several parts that touch. Edges have the number of their first corner. The first
    /// two nodes of the first part are the edge's ends.
    pub(super) faces: Vec<Vec<Vec<usize>>>,
}

/// The skeleton of a simple polygon: the outer ring counter-clockwise, then the holes clockwise. Fails if there are too many
/// edges, or if no set of faces is found that covers the polygon once.
pub(super) fn skeleton(rings: &[Vec<DVec2>]) -> Result<Skeleton, RoofFault> {
    if rings.iter().map(Vec::len).sum::<usize>() > MAX_EDGES {
        return Err(RoofFault::TooManyCorners);
    }
    let attempts = TOLERANCES_M.iter().map(|&tolerance_m| faces(Wavefront::new(rings, tolerance_m), tolerance_m));
    let mut found = attempts.skip_while(Result::is_err);
    found.next().unwrap_or(Err(RoofFault::Skeleton))
}

fn faces(wavefront: Wavefront, tolerance_m: f64) -> Result<Skeleton, RoofFault> {
    let ends: Vec<(usize, usize)> = wavefront.edges.iter().map(|edge| edge.corners).collect();
    let traces = wavefront.run()?;
    let mut faces = Vec::with_capacity(ends.len());
    for (arcs, base) in traces.arcs.into_iter().zip(ends) {
        let mut edges = without_opposites(arcs);
        edges.push(base);
        let mut parts = Vec::new();
        for face in trace_faces(&traces.nodes, &edges)? {
            let [ring] = &face[..] else { return Err(RoofFault::Skeleton) };
            parts.push(ring.clone());
        }
        // The base comes first.
        let first = parts
            .iter()
            .position(|ring| ring.windows(2).any(|pair| (pair[0], pair[1]) == base) || is_closing(ring, base));
        let first = first.ok_or(RoofFault::Skeleton)?;
        parts.swap(0, first);
        let start = parts[0].iter().position(|&node| node == base.0).ok_or(RoofFault::Skeleton)?;
        parts[0].rotate_left(start);
        faces.push(parts);
    }
    let is_valid = |ring: &Vec<usize>| {
        let corners: Vec<DVec2> = ring.iter().map(|&i| traces.nodes[i].at).collect();
        !has_spike(&corners, 2.0 * tolerance_m) && simple::is_simple(&[corners], -10.0 * tolerance_m)
    };
    let are_valid = faces.iter().flatten().all(is_valid);
    if are_valid { Ok(Skeleton { nodes: traces.nodes, faces }) } else { Err(RoofFault::Skeleton) }
}

/// Whether a ring runs out and back on one line within a distance. Vertices between nearly parallel edges are so fast that
/// a wrong order of events leads to this.
fn has_spike(ring: &[DVec2], width_m: f64) -> bool {
    let count = ring.len();
    (0..count).any(|i| {
        let [a, b, c] = [0, 1, 2].map(|k| ring[(i + k) % count]);
        let is_long = a.distance(b).min(b.distance(c)) > 10.0 * width_m;
        let does_return = (b - a).dot(c - b) < 0.0;
        is_long && does_return && simple::distance(a, b, c).min(simple::distance(b, c, a)) <= width_m
    })
}

fn is_closing(ring: &[usize], (from, to): (usize, usize)) -> bool {
    ring.first() == Some(&to) && ring.last() == Some(&from)
}

/// Arcs without those that have an opposite.
fn without_opposites(arcs: Vec<(usize, usize)>) -> Vec<(usize, usize)> {
    let mut kept: Vec<(usize, usize)> = Vec::with_capacity(arcs.len() + 1);
    for (from, to) in arcs {
        match kept.iter().position(|&known| known == (to, from)) {
            Some(i) => drop(kept.swap_remove(i)),
            None => kept.push((from, to)),
        }
    }
    kept
}

/// Directions that differ by less than this angle, in radians, are equal.
const EQUAL_RAD: f64 = 1e-6;

/// What a reflex vertex meets.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Met {
    Vertex(usize),
    /// The inside of an edge, by the vertex at which this part of it begins.
    Edge(usize),
}

/// A reflex vertex meets something.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Hit {
    time: f64,
    vertex: usize,
    met: Met,
}

impl Wavefront {
    /// Queues the times at which a new vertex will be on the lines of edges.
    fn expect_collisions(&mut self, number: usize) {
        let Vertex { in_edge, out_edge, start, velocity, .. } = self.vertices[number];
        for (i, edge) in self.edges.iter().enumerate().filter(|&(i, _)| i != in_edge && i != out_edge) {
            let distance = edge.normal.dot(start) - edge.offset - self.now;
            let rate = edge.normal.dot(velocity) - 1.0;
            if distance >= -self.tolerance_m && rate < -MIN_RATE {
                let time = self.now + (distance / -rate).max(0.0);
                self.collisions.push(Reverse(Collision { time, vertex: number, edge: i }));
            }
        }
    }

    fn next_hit(&mut self, before: f64) -> Option<Hit> {
        while let Some(Reverse(collision)) = self.collisions.peek().copied().filter(|next| next.0.time < before) {
            self.collisions.pop();
            if let Some(met) = self.met(&collision) {
                return Some(Hit { time: collision.time.max(self.now), vertex: collision.vertex, met });
            }
        }
        None
    }

    /// What a vertex meets on the line of an edge.
    fn met(&mut self, collision: &Collision) -> Option<Met> {
        let &Collision { time, vertex, edge } = collision;
        let Vertex { previous, next, is_alive, .. } = self.vertices[vertex];
        if !is_alive {
            return None;
        }
        let at = self.position(vertex, time);
        let vertices = &self.vertices;
        self.parts[edge].retain(|&start| vertices[start].is_alive);
        let mut is_at_end = false;
        for &start in &self.parts[edge] {
            let end = self.vertices[start].next;
            let [from, to] = [self.position(start, time), self.position(end, time)];
            let direction = self.edges[edge].direction;
            let [along, length] = [(at - from).dot(direction), (to - from).dot(direction)];
            if along < -self.tolerance_m || along > length + self.tolerance_m {
                continue;
            }
            if along > self.tolerance_m && along < length - self.tolerance_m {
                return Some(Met::Edge(start));
            }
            is_at_end = true;
        }
        let is_near = |&i: &usize| self.position(i, time).distance(at) <= 2.0 * self.tolerance_m;
        let others = self.live.iter().copied().filter(|&i| i != vertex && i != previous && i != next);
        let mut near = others.filter(|&i| self.vertices[i].is_alive).filter(is_near);
        is_at_end.then(|| near.find(|&i| self.is_facing(i, vertex)).map(Met::Vertex)).flatten()
    }

    /// Whether the edges of `inner` are between those of `outer`, on the interior's side.
    fn is_facing(&self, outer: usize, inner: usize) -> bool {
        let rays = |i: usize| {
            let vertex = &self.vertices[i];
            (self.edges[vertex.out_edge].direction, -self.edges[vertex.in_edge].direction)
        };
        let ((outer_out, outer_in), (inner_out, inner_in)) = (rays(outer), rays(inner));
        let angle = |ray: DVec2| {
            let angle = outer_out.angle_to(ray).rem_euclid(TAU);
            if angle > TAU - EQUAL_RAD { 0.0 } else { angle }
        };
        let width = if angle(outer_in) == 0.0 { TAU } else { angle(outer_in) } + EQUAL_RAD;
        let (first, last) = (angle(inner_in), angle(inner_out));
        first <= last + EQUAL_RAD && last <= width
    }

    /// Splits the wavefront where a reflex vertex meets something. Each edge that ends there goes on with the other's next.
    fn split(&mut self, hit: Hit) {
        self.now = hit.time;
        let node = self.node_at(self.position(hit.vertex, self.now));
        let Vertex { in_edge, out_edge, previous, next, .. } = self.vertices[hit.vertex];
        let (other_in, other_out, other_previous, other_next) = match hit.met {
            Met::Vertex(other) => {
                self.end(other, node);
                let other = &self.vertices[other];
                (other.in_edge, other.out_edge, other.previous, other.next)
            }
            Met::Edge(start) => {
                let Vertex { out_edge, next, .. } = self.vertices[start];
                (out_edge, out_edge, start, next)
            }
        };
        self.end(hit.vertex, node);
        self.insert(in_edge, other_out, previous, other_next, node);
        self.insert(other_in, out_edge, other_previous, next, node);
    }
}
