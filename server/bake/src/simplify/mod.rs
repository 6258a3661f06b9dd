//! Fewer triangles that look the same: edges are collapsed, the cheapest first (Garland and Heckbert 1997; Gasparello,
//! chapter 2), and small parts leave as a whole.
//!
//! In: a [`Model`], and how far to go. Out: a [`Simplified`]. Next: the mesh codec.
//!
//! A collapse costs area times squared distance to the planes of all triangles that went into it. Borders, and seams of
//! what corners carry, have upright planes that count much more, and only vertices of the same line are collapsed along
//! it. A part whose area times squared half diagonal costs less than the next collapse leaves: so towns of boxes get as
//! small as one asks for.

mod quadric;
mod queue;
mod shape;

use crate::model::{Layer, Model};
use glam::DVec3;
use insula_protocol::mesh::{
    Kind,
    pieces::{Census, NONE, Pieces, next, prev},
};
use quadric::Quadric;
use queue::Queue;
use shape::{Hold, Shape};
use std::collections::HashMap;

/// How much a square metre of a border's or seam's fence counts against one of surface.
const FENCE: f64 = 10.0;
/// A vertex goes no further from its edge's middle than this many of its lengths.
const REACH: f64 = 1.5;

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
    pub model: Model,
    /// The largest distance that a vertex was moved from the surfaces that it stands for, or half the diagonal of a part
    /// that left, in the model's units.
    pub error: f64,
    /// What was mended before.
    pub census: Census,
    /// Parts that left.
    pub left: usize,
}

/// A piece of the surface that may leave.
struct Part {
    triangles: Vec<u32>,
    cost: f64,
    half_diagonal: f64,
}

struct Work {
    shape: Shape,
    quadric: Vec<Quadric>,
    /// How often each vertex changed.
    changes: Vec<u32>,
    queue: Queue,
    /// Values of each wedge, one a layer.
    values: Vec<[f32; 4]>,
    layers: usize,
    error: f64,
}

/// Simplifies `model` towards `goal`. Vertices that `is_locked` stay where they are.
pub fn simplify(model: &Model, goal: Goal, is_locked: impl Fn(u32) -> bool) -> Simplified {
    let order = order(model);
    let sorted: Vec<[u32; 3]> = order.iter().map(|t| model.triangles[*t as usize]).collect();
    let mut pieces = Pieces::new(&sorted, model.positions.len() as u32);
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
            work.shape.hold[vertex] = Hold::Fixed;
        }
    }
    let mut parts = parts(&pieces, &work.shape, &is_kept);
    let left = work.run(goal, &mut parts);
    let model = work.finish(model, center);
    Simplified { model, error: work.error, census: pieces.census, left }
}

fn center(model: &Model) -> DVec3 {
    let sum: DVec3 = model.positions.iter().map(|p| DVec3::from(*p)).sum();
    sum / model.positions.len().max(1) as f64
}

/// Triangles in the order of a curve through space (Morton 1966): what lies together is then worked on together.
fn order(model: &Model) -> Vec<u32> {
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
    keys.sort_unstable();
    keys.into_iter().map(|(_, triangle)| triangle).collect()
}

/// Parts that may leave, the cheapest last; the one with most surface is not among them.
fn parts(pieces: &Pieces, shape: &Shape, is_kept: &[bool]) -> Vec<Part> {
    let mut seen = vec![false; pieces.triangles()];
    let mut parts = Vec::new();
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
    fn new(model: &Model, pieces: &Pieces, center: DVec3) -> Self {
        let place =
            pieces.vertex.iter().map(|vertex| DVec3::from(model.positions[*vertex as usize]) - center).collect();
        let (wedge, values) = wedges(model, pieces);
        let shape = Shape::new(pieces, place, wedge);
        let mut quadric = vec![Quadric::default(); pieces.vertex.len()];
        for t in 0..pieces.triangles() as u32 {
            let corners = shape.corners(t);
            let plane = Quadric::triangle(corners);
            for k in 0..3 {
                quadric[shape.origin[(3 * t + k) as usize] as usize] += plane;
            }
            for h in 3 * t..3 * t + 3 {
                if shape.is_line(h) {
                    let place = |h: u32| shape.place[shape.origin[h as usize] as usize];
                    let fence = Quadric::fence([place(h), place(next(h)), place(prev(h))], FENCE);
                    quadric[shape.origin[h as usize] as usize] += fence;
                    quadric[shape.target(h) as usize] += fence;
                }
            }
        }
        let changes = vec![0; pieces.vertex.len()];
        Self { shape, quadric, changes, queue: Queue::new(), values, layers: model.layers.len(), error: 0.0 }
    }

    /// Collapses and lets parts leave until the goal is reached, or nothing more can be done. How many left.
    fn run(&mut self, goal: Goal, parts: &mut Vec<Part>) -> usize {
        let parts_before = parts.len();
        let mut progress = true;
        while progress && self.shape.triangles > goal.triangles {
            progress = false;
            self.fill();
            while self.shape.triangles > goal.triangles {
                let next = self.queue.cost();
                if let Some(part) = parts.pop_if(|part| part.cost <= next && part.half_diagonal <= goal.error) {
                    self.let_go(&part);
                    continue;
                }
                let Some((h, changes)) = self.queue.pop() else { break };
                if !self.shape.alive[h as usize / 3] {
                    continue;
                }
                // Edges only get dearer: one whose ends changed is looked at again when its turn comes, not before.
                if changes == self.changes_of(h) {
                    progress |= self.try_collapse(h, goal.error);
                } else {
                    self.enqueue(h);
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

    fn let_go(&mut self, part: &Part) {
        part.triangles.iter().for_each(|t| self.shape.remove(*t));
        self.error = self.error.max(part.half_diagonal);
    }

    /// Queues all edges, the dearest first: so the cheap ones lie in the order in which they are taken out.
    fn fill(&mut self) {
        let mut entries = Vec::with_capacity(3 * self.shape.triangles / 2);
        for h in 0..self.shape.origin.len() as u32 {
            let twin = self.shape.twin[h as usize];
            if self.shape.alive[h as usize / 3] && (twin == NONE || h < twin) {
                entries.extend(self.aim(h).map(|(_, cost)| ((cost as f32).to_bits(), h)));
            }
        }
        entries.sort_unstable();
        for (cost, h) in entries.into_iter().rev() {
            self.queue.push(f32::from_bits(cost).into(), h, self.changes_of(h));
        }
    }

    fn changes_of(&self, h: u32) -> u32 {
        let (u, v) = (self.shape.origin[h as usize], self.shape.target(h));
        self.changes[u as usize].wrapping_add(self.changes[v as usize])
    }

    fn enqueue(&mut self, h: u32) {
        if let Some((_, cost)) = self.aim(h) {
            self.queue.push(cost, h, self.changes_of(h));
        }
    }

    fn sum(&self, h: u32) -> Quadric {
        let mut sum = self.quadric[self.shape.origin[h as usize] as usize];
        sum += self.quadric[self.shape.target(h) as usize];
        sum
    }

    /// Where the two ends of an edge would best become one, and what that costs.
    #[inline]
    fn aim(&self, h: u32) -> Option<(DVec3, f64)> {
        let (u, v) = (self.shape.origin[h as usize], self.shape.target(h));
        let [p, q] = [u, v].map(|vertex| self.shape.place[vertex as usize]);
        let sum = self.sum(h);
        let fixed = match (self.shape.hold[u as usize], self.shape.hold[v as usize]) {
            (Hold::Fixed, Hold::Fixed) => return None,
            (Hold::Line, Hold::Line) if !self.shape.is_line(h) => return None,
            (Hold::Fixed, Hold::Line) | (Hold::Line, Hold::Fixed) if !self.shape.is_line(h) => return None,
            (Hold::Fixed, _) | (Hold::Line, Hold::Free) => Some(p),
            (_, Hold::Fixed) | (Hold::Free, Hold::Line) => Some(q),
            _ => None,
        };
        if let Some(at) = fixed {
            return Some((at, sum.cost(at)));
        }
        let middle = (p + q) * 0.5;
        let near = |at: &DVec3| at.distance_squared(middle) <= REACH * REACH * p.distance_squared(q);
        if let Some(best) = sum.best(middle).filter(near) {
            return Some((best, sum.cost(best)));
        }
        [p, q, middle].map(|at| (at, sum.cost(at))).into_iter().min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Collapses an edge if the surface stays one, nothing turns over and the error stays small enough.
    fn try_collapse(&mut self, h: u32, most: f64) -> bool {
        let Some((aim, _)) = self.aim(h) else { return false };
        let (u, v) = (self.shape.origin[h as usize], self.shape.target(h));
        let holds = [self.shape.hold[u as usize], self.shape.hold[v as usize]];
        let sum = self.sum(h);
        let error = |at: DVec3| (sum.cost(at) / sum.area.max(f64::MIN_POSITIVE)).sqrt();
        if error(aim) > most || !self.shape.may_collapse(h) {
            return false;
        }
        let [p, q] = [u, v].map(|vertex| self.shape.place[vertex as usize]);
        // Where the best place turns something over, one of the ends may not.
        let others: &[DVec3] = if holds[0] == holds[1] { &[aim, p, q] } else { &[aim] };
        let Some(&to) = others.iter().find(|at| error(**at) <= most && !self.shape.turns_over(u, v, **at)) else {
            return false;
        };
        self.error = self.error.max(error(to));
        self.blend(h, p, q, to);
        // On either side two edges become one, and both may have been queued by the half-edge that goes.
        let twin = self.shape.twin[h as usize];
        let sides = [h, twin].map(|side| match side {
            NONE => NONE,
            side => {
                [next(side), prev(side)].map(|inner| self.shape.twin[inner as usize]).into_iter().min().unwrap_or(NONE)
            }
        });
        self.shape.collapse(h, to);
        self.quadric[u as usize] = sum;
        self.changes[u as usize] = self.changes[u as usize].max(self.changes[v as usize]) + 1;
        for side in sides {
            if side != NONE {
                self.enqueue(side);
            }
        }
        true
    }

    /// What the new vertex carries, on either side of the edge: what its ends carry there, by where it lies between them.
    fn blend(&mut self, h: u32, p: DVec3, q: DVec3, to: DVec3) {
        let edge = q - p;
        let share = ((to - p).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0) as f32;
        let twin = self.shape.twin[h as usize];
        let wedge = |h: u32| self.shape.wedge[h as usize] as usize;
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
    fn finish(&self, model: &Model, center: DVec3) -> Model {
        let mut out = Model::default();
        let mut number = vec![NONE; self.shape.place.len()];
        let mut fixed: HashMap<u32, u32> = HashMap::new();
        let mut wedges = vec![NONE; self.values.len() / self.layers.max(1)];
        out.layers = model
            .layers
            .iter()
            .map(|layer| Layer { values: Vec::new(), corners: Vec::new(), kind: layer.kind, width: layer.width })
            .collect();
        for t in (0..self.shape.alive.len()).filter(|t| self.shape.alive[*t]) {
            let corners = [0, 1, 2].map(|k| {
                let vertex = self.shape.origin[3 * t + k];
                if number[vertex as usize] == NONE {
                    let source = self.shape.source[vertex as usize];
                    let is_fixed = self.shape.hold[vertex as usize] == Hold::Fixed;
                    let own = out.positions.len() as u32;
                    let place = self.shape.place[vertex as usize] + center;
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
            for k in 0..3 {
                let wedge = self.shape.wedge[3 * t + k] as usize;
                for (i, layer) in out.layers.iter_mut().enumerate() {
                    if i == 0 && wedges[wedge] == NONE {
                        wedges[wedge] = layer.values.len() as u32;
                    }
                    if layer.values.len() as u32 == wedges[wedge] {
                        let [x, y, z, w] = self.values[wedge * self.layers + i];
                        let length = if layer.kind == Kind::Normal { (x * x + y * y + z * z).sqrt() } else { 1.0 };
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

/// For each half-edge a number for what its corner carries, and the values of each number, one a layer.
fn wedges(model: &Model, pieces: &Pieces) -> (Vec<u32>, Vec<[f32; 4]>) {
    if model.layers.is_empty() {
        return (pieces.origin.clone(), Vec::new());
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
