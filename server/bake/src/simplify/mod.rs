//! Fewer triangles that look the same: edges are collapsed, the cheapest first (Garland and Heckbert 1997; Gasparello,
//! chapter 2), and small parts leave as a whole.
//!
//! In: a [`TriangleModel`], and how far to go. Out: a [`Simplified`]. Next: the mesh codec.
//!
//! A collapse costs area times squared distance to the planes of all triangles that went into it. Borders, and seams of
//! what corners carry, have upright planes that count much more, and only vertices of the same line are collapsed along
//! it. A part whose area times squared half diagonal costs less than the next collapse leaves: so towns of boxes get as
//! small as one asks for.

mod quadric;
mod queue;
mod shape;

use crate::model::{CornerLayer, TriangleModel};
use glam::DVec3;
use insula_protocol::mesh::{
    AttributeKind,
    half_edge::{HalfEdgeMesh, NONE, RepairReport},
};
use quadric::Quadric;
use queue::Queue;
use shape::{Hold, Shape, next, prev, sides};
use std::collections::HashMap;

/// How much a square metre of a border's or seam's fence counts against one of surface.
const FENCE: f64 = 10.0;
/// A vertex goes no further from its edge's middle than this many of its lengths.
const REACH: f64 = 1.5;
/// The cheapest edges, those that a round looks to collapse, are one of so many.
const SHARE: usize = 2;
/// The same once one of so many triangles is left.
const LATE: (usize, usize) = (6, 4);
/// No fewer edges than this.
const ROUND: usize = 64;

/// How far to go: until one of both is reached.
#[derive(Debug, Clone, Copy)]
pub struct Goal {
    /// No fewer triangles than this.
    pub triangles: usize,
    /// No error larger than this, in the model's units.
    pub error: f64,
}

/// What came out.
#[derive(Debug, Clone)]
pub struct Simplified {
    /// The triangles that are left.
    pub model: TriangleModel,
    /// The largest distance that a vertex was moved from the surfaces that it stands for, or half the diagonal of a part
    /// that left, in the model's units.
    pub error: f64,
    /// What was mended before.
    pub census: RepairReport,
    /// Parts that left.
    pub left: usize,
}

/// A piece of the surface that may leave.
struct Part {
    triangles: Vec<u32>,
    cost: f64,
    half_diagonal: f64,
}

/// What an edge cost when it was last looked at; infinity where it cannot be collapsed.
#[derive(Debug, Clone, Copy)]
struct Look {
    cost: f32,
    /// In which round that was; 0 for never.
    round: u32,
}

impl Default for Look {
    fn default() -> Self {
        Self { cost: f32::INFINITY, round: 0 }
    }
}

/// Where an edge's ends become one.
struct Aim {
    /// Of both ends.
    sum: Quadric,
    at: DVec3,
    cost: f64,
}

struct Work {
    shape: Shape,
    /// The round in which each vertex last changed.
    changed: Vec<u32>,
    round: u32,
    /// For each half-edge that stands for its edge: the lower of two.
    looks: Vec<Look>,
    /// Values of each wedge, one a layer.
    values: Vec<[f32; 4]>,
    layers: usize,
    error: f64,
}

/// Simplifies `model` towards `goal`. Vertices that `is_locked` stay where they are.
pub fn simplify(model: &TriangleModel, goal: Goal, is_locked: impl Fn(u32) -> bool) -> Simplified {
    let order = order(model);
    let sorted: Vec<[u32; 3]> = order.iter().map(|t| model.triangles[*t as usize]).collect();
    let mut pieces = HalfEdgeMesh::new(&sorted, model.positions.len() as u32);
    pieces.corner.iter_mut().for_each(|corner| *corner = 3 * order[*corner as usize / 3] + *corner % 3);
    let center = center(model);
    let mut work = Work::new(model, &pieces, center);
    let mut copies = vec![0u32; model.positions.len()];
    pieces.vertex.iter().for_each(|vertex| copies[*vertex as usize] += 1);
    let mut is_kept = vec![false; pieces.vertex.len()];
    for (vertex, &source) in pieces.vertex.iter().enumerate() {
        is_kept[vertex] = is_locked(source);
        // Where surfaces were cut apart they stay together.
        if is_kept[vertex] || copies[source as usize] > 1 {
            work.shape.vertex[vertex].hold = Hold::Fixed;
        }
    }
    let mut parts = parts(&pieces, &work.shape, &is_kept);
    let left = work.run(goal, &mut parts);
    let model = work.finish(model, center);
    Simplified { model, error: work.error, census: pieces.report, left }
}

fn center(model: &TriangleModel) -> DVec3 {
    let sum: DVec3 = model.positions.iter().map(|p| DVec3::from(*p)).sum();
    sum / model.positions.len().max(1) as f64
}

/// Triangles in the order of a curve through space (Morton 1966): what lies together is then worked on together.
fn order(model: &TriangleModel) -> Vec<u32> {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for position in &model.positions {
        (min, max) = (min.min(DVec3::from(*position)), max.max(DVec3::from(*position)));
    }
    let scale = 1023.0 / (max - min).max_element().max(f64::MIN_POSITIVE);
    // Ten bits, two zeros before each.
    let spread = |v: f64| {
        let mut v = v as u32;
        for (shift, mask) in [(16, 0x0300_00ff), (8, 0x0300_f00f), (4, 0x030c_30c3), (2, 0x0924_9249)] {
            v = (v | v << shift) & mask;
        }
        v
    };
    let key = |triangle: &[u32; 3]| {
        let position = model.positions.get(triangle[0] as usize).copied().unwrap_or_default();
        let at = (DVec3::from(position) - min) * scale;
        spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
    };
    let mut keys: Vec<(u32, u32)> = model.triangles.iter().map(key).zip(0..).collect();
    let mut sorted = keys.clone();
    // Ten bits of thirty after ten.
    for shift in [0, 10, 20] {
        let digit = |key: u32| (key >> shift & 1023) as usize;
        let mut places = [0u32; 1024];
        keys.iter().for_each(|(key, _)| places[digit(*key)] += 1);
        let mut before = 0;
        places.iter_mut().for_each(|place| before += std::mem::replace(place, before));
        for item in &keys {
            let place = &mut places[digit(item.0)];
            sorted[*place as usize] = *item;
            *place += 1;
        }
        std::mem::swap(&mut keys, &mut sorted);
    }
    keys.into_iter().map(|(_, triangle)| triangle).collect()
}

/// Parts that may leave, the cheapest last; the one with most surface is not among them.
fn parts(pieces: &HalfEdgeMesh, shape: &Shape, is_kept: &[bool]) -> Vec<Part> {
    let mut parts = Vec::new();
    if pieces.report.pieces < 2 {
        return parts;
    }
    let mut seen = vec![false; pieces.triangles()];
    let mut largest = (0.0, None);
    for seed in 0..pieces.triangles() as u32 {
        if std::mem::replace(&mut seen[seed as usize], true) {
            continue;
        }
        let mut triangles = vec![seed];
        let mut at = 0;
        let (mut min, mut max, mut area, mut stays) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0, false);
        while let Some(&t) = triangles.get(at) {
            at += 1;
            let corners = shape.corners(t);
            corners.iter().for_each(|p| (min, max) = (min.min(*p), max.max(*p)));
            area += (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() * 0.5;
            for h in 3 * t..3 * t + 3 {
                stays |= is_kept[pieces.origin[h as usize] as usize];
                let twin = pieces.twin[h as usize];
                if twin != NONE && !std::mem::replace(&mut seen[twin as usize / 3], true) {
                    triangles.push(twin / 3);
                }
            }
        }
        let half_diagonal = (max - min).length() * 0.5;
        if !stays {
            if area > largest.0 {
                largest = (area, Some(parts.len()));
            }
            parts.push(Part { triangles, cost: area * half_diagonal * half_diagonal, half_diagonal });
        }
    }
    if let Some(largest) = largest.1 {
        parts.swap_remove(largest);
    }
    parts.sort_by(|a, b| b.cost.total_cmp(&a.cost));
    parts
}

impl Work {
    fn new(model: &TriangleModel, pieces: &HalfEdgeMesh, center: DVec3) -> Self {
        let place = pieces.vertex.iter().map(|vertex| DVec3::from(model.positions[*vertex as usize]) - center);
        let (wedge, values) = wedges(model, pieces);
        let mut shape = Shape::new(pieces, place, &wedge);
        for t in 0..pieces.triangles() as u32 {
            let corners = shape.corners(t);
            let plane = Quadric::triangle(corners);
            for k in 0..3 {
                let vertex = shape.origin(4 * t + k);
                shape.vertex[vertex as usize].quadric += plane;
            }
            for h in sides(t) {
                if shape.is_line(h) {
                    let fence = Quadric::fence([h, next(h), prev(h)].map(|h| shape.place(shape.origin(h))), FENCE);
                    for vertex in [shape.origin(h), shape.target(h)] {
                        shape.vertex[vertex as usize].quadric += fence;
                    }
                }
            }
        }
        let looks = vec![Look::default(); 4 * pieces.triangles()];
        let changed = vec![0; shape.vertex.len()];
        Self { shape, changed, round: 0, looks, values, layers: model.layers.len(), error: 0.0 }
    }

    /// Collapses and lets parts leave until the goal is reached, or nothing more can be done. How many left.
    ///
    /// In rounds: the edges whose ends changed are looked at again, in the order in which they lie in memory, and the
    /// cheapest of all are collapsed, the cheapest first. One whose ends changed within the round waits for the next, and
    /// one that was too dear before is not looked at: edges only get dearer.
    fn run(&mut self, goal: Goal, parts: &mut Vec<Part>) -> usize {
        let parts_before = parts.len();
        let mut triangles: Vec<u32> = (0..self.shape.alive.len() as u32).collect();
        let mut queue = Queue::new();
        // Whether some edge was given up that could do now, since something around it changed.
        let mut progress = false;
        let mut limit = f32::INFINITY;
        while self.shape.triangles > goal.triangles {
            triangles.retain(|t| self.shape.alive[*t as usize]);
            self.round += 1;
            self.look(&triangles, limit, &mut queue);
            let is_late = triangles.len() * LATE.0 < self.shape.alive.len();
            let round = (queue.len() / if is_late { LATE.1 } else { SHARE }).max(ROUND);
            let edges;
            (edges, limit) = queue.cheapest(round);
            if edges.is_empty() {
                if !std::mem::take(&mut progress) {
                    break;
                }
                self.looks.fill(Look::default());
                continue;
            }
            for &(cost, h) in edges {
                while let Some(part) =
                    parts.pop_if(|part| part.cost <= f64::from(cost) && part.half_diagonal <= goal.error)
                {
                    self.let_go(&part);
                }
                if self.shape.triangles <= goal.triangles {
                    break;
                }
                if self.last_change(h) < self.round {
                    progress |= self.try_collapse(h, goal.error, limit);
                }
            }
        }
        // What cannot be collapsed any more can still leave.
        while self.shape.triangles > goal.triangles {
            let Some(part) = parts.pop_if(|part| part.half_diagonal <= goal.error) else { break };
            self.let_go(&part);
        }
        parts_before - parts.len()
    }

    /// All edges that can be collapsed wait in the queue.
    fn look(&mut self, triangles: &[u32], limit: f32, queue: &mut Queue) {
        for h in triangles.iter().flat_map(|t| sides(*t)) {
            let twin = self.shape.twin(h);
            if twin != NONE && twin < h {
                continue;
            }
            let Look { mut cost, round } = self.looks[h as usize];
            if round <= self.last_change(h) && (round == 0 || cost <= limit || cost == f32::INFINITY) {
                cost = self.aim(h).map_or(f32::INFINITY, |aim| aim.cost as f32);
                self.looks[h as usize] = Look { cost, round: self.round };
            }
            if cost < f32::INFINITY {
                queue.push(cost, h);
            }
        }
    }

    fn let_go(&mut self, part: &Part) {
        for &t in &part.triangles {
            sides(t).for_each(|h| self.changed[self.shape.origin(h) as usize] = self.round);
            self.shape.remove(t);
        }
        self.error = self.error.max(part.half_diagonal);
    }

    /// The round in which an end of an edge last changed.
    #[inline]
    fn last_change(&self, h: u32) -> u32 {
        let (u, v) = (self.shape.origin(h), self.shape.target(h));
        self.changed[u as usize].max(self.changed[v as usize])
    }

    /// Where the two ends of an edge would best become one, and what that costs.
    #[inline]
    fn aim(&self, h: u32) -> Option<Aim> {
        let ends = [self.shape.origin(h), self.shape.target(h)];
        let [u, v] = ends.map(|vertex| &self.shape.vertex[vertex as usize]);
        let (p, q) = (u.place, v.place);
        let mut sum = u.quadric;
        sum += v.quadric;
        let fixed = match (u.hold, v.hold) {
            (Hold::Free, Hold::Free) => None,
            (Hold::Fixed, Hold::Fixed) => return None,
            (Hold::Line, Hold::Line) if !self.shape.is_line(h) => return None,
            (Hold::Fixed, Hold::Line) | (Hold::Line, Hold::Fixed) if !self.shape.is_line(h) => return None,
            (Hold::Fixed, _) | (Hold::Line, Hold::Free) => Some(p),
            (_, Hold::Fixed) | (Hold::Free, Hold::Line) => Some(q),
            (Hold::Line, Hold::Line) => None,
        };
        if let Some(at) = fixed {
            return Some(Aim { sum, at, cost: sum.cost(at) });
        }
        let middle = (p + q) * 0.5;
        let near = |at: &DVec3| at.distance_squared(middle) <= REACH * REACH * p.distance_squared(q);
        if let Some(at) = sum.best(middle).filter(near) {
            return Some(Aim { sum, at, cost: sum.cost(at) });
        }
        let aims = [p, q, middle].map(|at| Aim { sum, at, cost: sum.cost(at) });
        aims.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// Collapses an edge if the surface stays one, nothing turns over and the error stays small enough.
    fn try_collapse(&mut self, h: u32, most: f64, limit: f32) -> bool {
        let (u, v) = (self.shape.origin(h), self.shape.target(h));
        let look = self.looks[h as usize];
        self.looks[h as usize] = Look { cost: f32::INFINITY, round: self.round };
        let Some(Aim { sum, at: aim, cost }) = self.aim(h) else { return false };
        if look.round <= self.last_change(h) && cost as f32 > limit {
            // It was too dear to be looked at again, and now costs even more.
            self.looks[h as usize].cost = cost as f32;
            return false;
        }
        let error = |cost: f64| (cost / sum.area.max(f64::MIN_POSITIVE)).sqrt();
        let mut found = error(cost);
        if found > most || !self.shape.may_collapse(h) {
            return false;
        }
        let [from, gone] = [u, v].map(|vertex| &self.shape.vertex[vertex as usize]);
        let (is_open, [p, q]) = (from.hold == gone.hold, [from.place, gone.place]);
        let mut to = aim;
        if self.shape.turns_over(u, v, aim) {
            // One of the ends may not.
            let fits = |at: &&DVec3| error(sum.cost(**at)) <= most && !self.shape.turns_over(u, v, **at);
            let Some(end) = [p, q].iter().find(fits).filter(|_| is_open).copied() else { return false };
            (to, found) = (end, error(sum.cost(end)));
        }
        self.error = self.error.max(found);
        self.blend(h, p, q, to);
        self.shape.collapse(h, to);
        self.shape.vertex[u as usize].quadric = sum;
        self.changed[u as usize] = self.round;
        self.changed[v as usize] = self.round;
        true
    }

    /// What the new vertex carries, on either side of the edge: what its ends carry there, by where it lies between them.
    fn blend(&mut self, h: u32, p: DVec3, q: DVec3, to: DVec3) {
        if self.layers == 0 {
            return;
        }
        let edge = q - p;
        let share = ((to - p).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0) as f32;
        let twin = self.shape.twin(h);
        let wedge = |h: u32| self.shape.wedge(h);
        let mut sides = [Some((wedge(h), wedge(next(h)))), None];
        if twin != NONE {
            sides[1] = Some((wedge(next(twin)), wedge(twin))).filter(|side| Some(*side) != sides[0]);
        }
        for (a, b) in sides.into_iter().flatten() {
            for layer in 0..self.layers {
                let other = self.values[b * self.layers + layer];
                let value = &mut self.values[a * self.layers + layer];
                *value = std::array::from_fn(|k| value[k] + (other[k] - value[k]) * share);
            }
        }
    }

    /// What is left, with vertices that were cut apart together again.
    fn finish(&self, model: &TriangleModel, center: DVec3) -> TriangleModel {
        let mut out = TriangleModel::default();
        let mut number = vec![NONE; self.shape.vertex.len()];
        let mut fixed: HashMap<u32, u32> = HashMap::new();
        let mut wedges = vec![NONE; self.values.len() / self.layers.max(1)];
        out.layers = model
            .layers
            .iter()
            .map(|layer| CornerLayer { values: Vec::new(), corners: Vec::new(), kind: layer.kind, width: layer.width })
            .collect();
        for t in (0..self.shape.alive.len() as u32).filter(|t| self.shape.alive[*t as usize]) {
            let corners = [0, 1, 2].map(|k| {
                let vertex = self.shape.origin(4 * t + k);
                if number[vertex as usize] == NONE {
                    let source = self.shape.source[vertex as usize];
                    let is_fixed = self.shape.vertex[vertex as usize].hold == Hold::Fixed;
                    let own = out.positions.len() as u32;
                    let place = self.shape.place(vertex) + center;
                    let place = if is_fixed { model.positions[source as usize] } else { place.into() };
                    let shared = if is_fixed { *fixed.entry(source).or_insert(own) } else { own };
                    if shared == own {
                        out.positions.push(place);
                    }
                    number[vertex as usize] = shared;
                }
                number[vertex as usize]
            });
            out.triangles.push(corners);
            for k in 0..if self.layers > 0 { 3 } else { 0 } {
                let wedge = self.shape.wedge(4 * t + k);
                for (i, layer) in out.layers.iter_mut().enumerate() {
                    if i == 0 && wedges[wedge] == NONE {
                        wedges[wedge] = layer.values.len() as u32;
                    }
                    if layer.values.len() as u32 == wedges[wedge] {
                        let [x, y, z, w] = self.values[wedge * self.layers + i];
                        let length =
                            if layer.kind == AttributeKind::Normal { (x * x + y * y + z * z).sqrt() } else { 1.0 };
                        let scale = if length > 0.0 { 1.0 / length } else { 1.0 };
                        layer.values.push([x, y, z, w].map(|v| v * scale));
                    }
                    layer.corners.push(wedges[wedge]);
                }
            }
        }
        out
    }
}

/// For each half-edge of the pieces a number for what its corner carries, and the values of each number, one a layer; empty
/// where corners carry nothing.
fn wedges(model: &TriangleModel, pieces: &HalfEdgeMesh) -> (Vec<u32>, Vec<[f32; 4]>) {
    if model.layers.is_empty() {
        return (Vec::new(), Vec::new());
    }
    let mut numbers: HashMap<(u32, Vec<[u32; 4]>), u32> = HashMap::new();
    let mut values = Vec::new();
    let mut wedge = Vec::with_capacity(pieces.origin.len());
    for (h, &vertex) in pieces.origin.iter().enumerate() {
        let corner = pieces.corner[h] as usize;
        let carried: Vec<[f32; 4]> =
            model.layers.iter().map(|layer| layer.values[layer.corners[corner] as usize]).collect();
        let bits = carried.iter().map(|value| value.map(f32::to_bits)).collect();
        let following = numbers.len() as u32;
        wedge.push(*numbers.entry((vertex, bits)).or_insert_with(|| {
            values.extend(carried);
            following
        }));
    }
    (wedge, values)
}

#[cfg(test)]
mod tests;
