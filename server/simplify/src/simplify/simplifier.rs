//! Rounds of edge collapses.
//!
//! A heap of edges would have to be updated after every collapse. Instead, each round evaluates all edges whose ends
//! changed in memory order, and collapses the cheapest share of all edges, the cheapest first. An edge whose ends
//! change within the round waits for the next one. An edge whose last known cost was above the limit of the previous
//! round is not evaluated again, because edges only become more expensive.

use super::RemovablePart;
use super::collapsible_mesh::{CollapsibleMesh, VertexConstraint, edges_of, next, prev};
use super::quadric::Quadric;
use super::wedges::WedgeValues;
use crate::model::TriangleModel;
use glam::DVec3;
use insula_protocol::mesh::half_edge::{HalfEdgeMesh, NONE};

/// Weight of the planes of borders and seams, relative to that of triangles.
const FEATURE_WEIGHT: f64 = 10.0;
/// Largest distance of a new vertex from the middle of its edge, in lengths of the edge.
const MAX_TARGET_DISTANCE: f64 = 1.5;
/// A round collapses the cheapest 1 / `ROUND_DIVISOR` of the edges ...
const ROUND_DIVISOR: usize = 2;
/// ... and the cheapest 1 / `LATE_ROUND_DIVISOR` as soon as less than 1 / `LATE_DIVISOR` of the triangles remains.
const LATE_ROUND_DIVISOR: usize = 4;
const LATE_DIVISOR: usize = 6;
/// Least number of edges of a round.
const MIN_ROUND_EDGES: usize = 64;

/// When to stop: as soon as either limit is reached.
#[derive(Debug, Clone, Copy)]
pub struct Goal {
    /// Least number of triangles.
    pub triangles: usize,
    /// Largest error, in the model's units.
    pub error: f64,
}

/// The cost of an edge when it was last evaluated; infinite if it cannot be collapsed.
#[derive(Debug, Clone, Copy)]
struct EdgeCost {
    cost: f32,
    /// Round of the evaluation; 0 if there was none.
    round: u32,
}

impl Default for EdgeCost {
    fn default() -> Self {
        Self { cost: f32::INFINITY, round: 0 }
    }
}

/// Where the ends of an edge become one vertex.
struct CollapseTarget {
    /// Of the surface: the sum of both ends.
    quadric: Quadric,
    position: DVec3,
    /// Of the surface and the texture.
    cost: f64,
}

/// The state of a simplification.
pub(super) struct Simplifier {
    pub(super) mesh: CollapsibleMesh,
    pub(super) wedges: WedgeValues,
    /// The largest error so far.
    pub(super) error: f64,
    /// For each vertex, the round in which it last changed.
    changed: Vec<u32>,
    round: u32,
    /// For each edge, stored at the lower of its two half-edges.
    costs: Vec<EdgeCost>,
}

impl Simplifier {
    pub(super) fn new(model: &TriangleModel, pieces: &HalfEdgeMesh, centre: DVec3) -> Self {
        let positions = pieces.vertex.iter().map(|vertex| DVec3::from(model.positions[*vertex as usize]) - centre);
        let (wedge_of, mut wedges) = WedgeValues::number(model, pieces);
        let mut mesh = CollapsibleMesh::new(pieces, positions, &wedge_of);
        add_quadrics(&mut mesh, &mut wedges);
        Self {
            changed: vec![0; mesh.vertices.len()],
            costs: vec![EdgeCost::default(); 4 * pieces.triangles()],
            mesh,
            wedges,
            error: 0.0,
            round: 0,
        }
    }

    /// Collapses edges and removes parts until the goal is reached or nothing more can be done. Returns the number of
    /// removed parts.
    pub(super) fn run(&mut self, goal: Goal, parts: &mut Vec<RemovablePart>) -> usize {
        let parts_before = parts.len();
        let mut triangles: Vec<u32> = (0..self.mesh.is_alive.len() as u32).collect();
        let mut queue = EdgeQueue::new();
        // Whether there were collapses since all edges were last evaluated. An edge that could not be collapsed may be
        // possible after them.
        let mut has_progress = false;
        let mut limit = f32::INFINITY;
        while self.mesh.triangles > goal.triangles {
            triangles.retain(|t| self.mesh.is_alive[*t as usize]);
            self.round += 1;
            self.queue_edges(&triangles, limit, &mut queue);
            let is_late = triangles.len() * LATE_DIVISOR < self.mesh.is_alive.len();
            let divisor = if is_late { LATE_ROUND_DIVISOR } else { ROUND_DIVISOR };
            let edges;
            (edges, limit) = queue.take_cheapest((queue.len() / divisor).max(MIN_ROUND_EDGES));
            if edges.is_empty() {
                if !std::mem::take(&mut has_progress) {
                    break;
                }
                self.costs.fill(EdgeCost::default());
                continue;
            }
            has_progress |= self.collapse_edges(edges, limit, goal, parts);
        }
        // Parts may still be removed when no edge can be collapsed any more.
        while self.mesh.triangles > goal.triangles {
            let Some(part) = parts.pop_if(|part| part.half_diagonal <= goal.error) else { break };
            self.remove_part(&part);
        }
        parts_before - parts.len()
    }

    /// Evaluates the edges that need it, and queues all that can be collapsed.
    fn queue_edges(&mut self, triangles: &[u32], limit: f32, queue: &mut EdgeQueue) {
        for h in triangles.iter().flat_map(|t| edges_of(*t)) {
            let twin = self.mesh.twin(h);
            if twin != NONE && twin < h {
                continue;
            }
            let EdgeCost { mut cost, round } = self.costs[h as usize];
            if round <= self.last_change(h) && (round == 0 || cost <= limit || cost == f32::INFINITY) {
                cost = self.target(h).map_or(f32::INFINITY, |target| target.cost as f32);
                self.costs[h as usize] = EdgeCost { cost, round: self.round };
            }
            if cost < f32::INFINITY {
                queue.push(cost, h);
            }
        }
    }

    /// Collapses the edges of a round, and removes parts that are cheaper. Returns whether an edge was collapsed.
    fn collapse_edges(&mut self, edges: &[(f32, u32)], limit: f32, goal: Goal, parts: &mut Vec<RemovablePart>) -> bool {
        let mut has_progress = false;
        for &(cost, h) in edges {
            let is_cheaper =
                |part: &mut RemovablePart| part.cost <= f64::from(cost) && part.half_diagonal <= goal.error;
            while let Some(part) = parts.pop_if(is_cheaper) {
                self.remove_part(&part);
            }
            if self.mesh.triangles <= goal.triangles {
                break;
            }
            if self.last_change(h) < self.round {
                has_progress |= self.try_collapse(h, goal.error, limit);
            }
        }
        has_progress
    }

    fn remove_part(&mut self, part: &RemovablePart) {
        for &t in &part.triangles {
            edges_of(t).for_each(|h| self.changed[self.mesh.origin(h) as usize] = self.round);
            self.mesh.remove(t);
        }
        self.error = self.error.max(part.half_diagonal);
    }

    /// The round in which an end of an edge last changed.
    #[inline]
    fn last_change(&self, h: u32) -> u32 {
        let (u, v) = (self.mesh.origin(h), self.mesh.target(h));
        self.changed[u as usize].max(self.changed[v as usize])
    }

    /// The best place for the ends of an edge to become one; `None` if their constraints forbid it.
    #[inline]
    fn target(&self, h: u32) -> Option<CollapseTarget> {
        use VertexConstraint::{Feature, Fixed, Free};
        let ends = [self.mesh.origin(h), self.mesh.target(h)];
        let [u, v] = ends.map(|vertex| &self.mesh.vertices[vertex as usize]);
        let (p, q) = (u.position, v.position);
        let mut quadric = u.quadric;
        quadric += v.quadric;
        let mut total = quadric;
        for (kept, removed) in self.merged_wedges(h).into_iter().flatten() {
            total += self.wedges.texture_cost(kept, removed);
        }
        let at = |position: DVec3| CollapseTarget { quadric, position, cost: total.cost(position) };
        // The end that must stay, if one must.
        let end = match (u.constraint, v.constraint) {
            (Free, Free) => None,
            (Fixed, Fixed) => return None,
            (Feature, Feature) | (Fixed, Feature) | (Feature, Fixed) if !self.mesh.is_feature(h) => return None,
            (Fixed, _) | (Feature, Free) => Some(p),
            (_, Fixed) | (Free, Feature) => Some(q),
            (Feature, Feature) => None,
        };
        if let Some(end) = end {
            return Some(at(end));
        }
        let middle = (p + q) * 0.5;
        let is_near = |at: &DVec3| {
            at.distance_squared(middle) <= MAX_TARGET_DISTANCE * MAX_TARGET_DISTANCE * p.distance_squared(q)
        };
        if let Some(best) = total.best_point(middle).filter(is_near) {
            return Some(at(best));
        }
        [p, q, middle].map(at).into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// Collapses an edge if the mesh stays manifold, no triangle flips and the error is at most `max_error`.
    fn try_collapse(&mut self, h: u32, max_error: f64, limit: f32) -> bool {
        let (u, v) = (self.mesh.origin(h), self.mesh.target(h));
        let known = self.costs[h as usize];
        // If the collapse fails, the edge is not queued again until it is evaluated again.
        self.costs[h as usize] = EdgeCost { cost: f32::INFINITY, round: self.round };
        let Some(CollapseTarget { quadric, mut position, cost }) = self.target(h) else { return false };
        if known.round <= self.last_change(h) && cost as f32 > limit {
            // The queued cost was outdated, and the edge is too expensive for this round.
            self.costs[h as usize].cost = cost as f32;
            return false;
        }
        let error_at = |at: DVec3| (quadric.cost(at) / quadric.area.max(f64::MIN_POSITIVE)).sqrt();
        let mut error = error_at(position);
        if error > max_error || !self.mesh.can_collapse(h) {
            return false;
        }
        let [kept, removed] = [u, v].map(|vertex| &self.mesh.vertices[vertex as usize]);
        let (is_movable, ends) = (kept.constraint == removed.constraint, [kept.position, removed.position]);
        if self.mesh.flips_triangles(u, v, position) {
            // One of the ends may do instead.
            let is_possible = |at: &&DVec3| error_at(**at) <= max_error && !self.mesh.flips_triangles(u, v, **at);
            let Some(end) = ends.iter().find(is_possible).filter(|_| is_movable).copied() else { return false };
            (position, error) = (end, error_at(end));
        }
        self.error = self.error.max(error);
        self.merge_wedges(h, ends, position);
        self.mesh.collapse(h, position);
        self.mesh.vertices[u as usize].quadric = quadric;
        self.changed[u as usize] = self.round;
        self.changed[v as usize] = self.round;
        true
    }

    /// The wedges that collapsing an edge merges, on either side of it: the kept and the removed one.
    fn merged_wedges(&self, h: u32) -> [Option<(usize, usize)>; 2] {
        if self.wedges.layers == 0 {
            return [None; 2];
        }
        let twin = self.mesh.twin(h);
        let wedge = |h: u32| self.mesh.wedge(h);
        let mut sides = [Some((wedge(h), wedge(next(h)))), None];
        if twin != NONE {
            sides[1] = Some((wedge(next(twin)), wedge(twin))).filter(|side| Some(*side) != sides[0]);
        }
        sides
    }

    /// Sets the attributes of the new vertex, on either side of the edge, to those between the edge's ends. Texture coordinates
    /// get their best value if neither end stays.
    fn merge_wedges(&mut self, h: u32, [p, q]: [DVec3; 2], position: DVec3) {
        let edge = q - p;
        let share = ((position - p).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0) as f32;
        let moved = Some(position).filter(|to| *to != p && *to != q);
        for (kept, removed) in self.merged_wedges(h).into_iter().flatten() {
            self.wedges.blend(kept, removed, share);
            self.wedges.merge_texture(kept, removed, moved);
        }
    }
}

/// Adds the planes and texture coordinates of all triangles to their corners, and the planes of borders and seams to the ends of
/// their edges.
fn add_quadrics(mesh: &mut CollapsibleMesh, wedges: &mut WedgeValues) {
    for t in 0..mesh.is_alive.len() as u32 {
        let plane = Quadric::triangle(mesh.corners(t));
        for k in 0..3 {
            let vertex = mesh.origin(4 * t + k);
            mesh.vertices[vertex as usize].quadric += plane;
        }
        if wedges.layers > 0 {
            wedges.add_triangle(mesh.corners(t), [0, 1, 2].map(|k| mesh.wedge(4 * t + k)));
        }
        for h in edges_of(t) {
            if mesh.is_feature(h) {
                let corners = [h, next(h), prev(h)].map(|h| mesh.position(mesh.origin(h)));
                let plane = Quadric::perpendicular(corners, FEATURE_WEIGHT);
                for vertex in [mesh.origin(h), mesh.target(h)] {
                    mesh.vertices[vertex as usize].quadric += plane;
                }
            }
        }
    }
}

/// Low bits of a cost that do not decide its class. Above them are the 8 bits of the exponent and 3 of the mantissa.
const IGNORED_BITS: u32 = 20;
const CLASSES: usize = 1 << (31 - IGNORED_BITS);

/// The cheapest edges, sorted into classes of similar cost.
///
/// Costs of a class differ by at most an eighth. Within a class, edges keep the order in which they were pushed, so
/// that edges that are collapsed one after the other are near each other in memory. A full sort would be slower and no
/// better.
#[derive(Debug)]
pub(super) struct EdgeQueue {
    /// Cost and half-edge.
    waiting: Vec<(f32, u32)>,
    /// Number of waiting edges of each class.
    counts: Vec<u32>,
    sorted: Vec<(f32, u32)>,
}

impl EdgeQueue {
    pub(super) fn new() -> Self {
        Self { waiting: Vec::new(), counts: vec![0; CLASSES], sorted: Vec::new() }
    }

    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Adds an edge. Its cost must be at least 0 and finite.
    #[inline]
    pub(super) fn push(&mut self, cost: f32, h: u32) {
        self.counts[class(cost)] += 1;
        self.waiting.push((cost, h));
    }

    /// The cheapest classes with together at least `least` edges, or all edges, and an upper bound of their
    /// costs. Empties the queue.
    pub(super) fn take_cheapest(&mut self, least: usize) -> (&[(f32, u32)], f32) {
        // Counts become the place of each class's next edge in the sorted list.
        let mut before = 0;
        let mut end = 0;
        for (class, count) in self.counts.iter_mut().enumerate() {
            if (before as usize) < least {
                end = class + 1;
            }
            let own = *count;
            *count = before;
            before += own;
        }
        let chosen = self.counts.get(end).copied().unwrap_or(before);
        self.sorted.clear();
        self.sorted.resize(chosen as usize, (0.0, 0));
        for &(cost, h) in &self.waiting {
            let class = class(cost);
            if class < end {
                let place = &mut self.counts[class];
                self.sorted[*place as usize] = (cost, h);
                *place += 1;
            }
        }
        self.counts.fill(0);
        self.waiting.clear();
        (&self.sorted, f32::from_bits((end as u32) << IGNORED_BITS))
    }
}

#[inline]
fn class(cost: f32) -> usize {
    (cost.to_bits() >> IGNORED_BITS) as usize & (CLASSES - 1)
}
