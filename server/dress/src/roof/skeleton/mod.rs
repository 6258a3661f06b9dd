//! The straight skeleton of a polygon with holes: the traces of its corners while all edges move inwards at equal speed
//! (Aichholzer, Aurenhammer, Alberts and Gaertner, A Novel Type of Skeleton for Polygons, 1995). Raised by the time at which
//! the edges pass, its faces are a roof with equal slopes.
//!
//! The wavefront is a set of rings of vertices that move with constant velocity. Two events change it: an edge shrinks to
//! nothing, or a reflex vertex meets another edge or vertex. Collisions of a reflex vertex with the lines of all edges are
//! known when it is made, and wait in a queue; whether the edge is there is decided at that time. At each event all
//! vertices are brought to its time, and what coincides is joined, so events at one time need no order.

mod events;
mod wavefront;

use super::cut::trace_faces;
use super::plan::PlanPoint;
use super::{RoofFault, simple};
use glam::DVec2;
use wavefront::Wavefront;

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
