//! Events in which a reflex vertex meets another part of the wavefront.

use super::wavefront::{Collision, MIN_RATE, Vertex, Wavefront};
use glam::DVec2;
use std::cmp::Reverse;
use std::f64::consts::TAU;

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
pub(super) struct Hit {
    time: f64,
    vertex: usize,
    met: Met,
}

impl Wavefront {
    /// Queues the times at which a new vertex will be on the lines of edges.
    pub(super) fn expect_collisions(&mut self, number: usize) {
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

    pub(super) fn next_hit(&mut self, before: f64) -> Option<Hit> {
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
    pub(super) fn split(&mut self, hit: Hit) {
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
