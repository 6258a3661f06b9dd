//! Mesh simplification by edge collapses (Garland and Heckbert 1997; Gasparello 2007, chapter 2).
//!
//! The cheapest edges are collapsed first. A collapse costs area times squared distance to the planes of all triangles
//! that were merged into the new vertex. Two extensions matter for cities:
//!
//! - Borders, and seams where attributes are discontinuous, get perpendicular planes with a larger weight, and their
//!   vertices are only collapsed along them (Garland and Heckbert 1997, 6).
//! - A connected part is removed as a whole when its area times its squared half diagonal is less than the cost of the
//!   next collapse. So even a town of separate boxes can be made as small as desired.
//!
//! | module | contents |
//! |---|---|
//! | `quadric` | sums of squared distances to planes |
//! | `collapsible_mesh`, `collapse` | the half-edge mesh, and collapsing one of its edges |
//! | `wedges` | attribute values of the corners |
//! | `simplifier` | the rounds of collapses |

mod collapse;
mod collapsible_mesh;
mod quadric;
mod simplifier;
mod wedges;

use crate::model::{CornerLayer, NO_VALUE, TriangleModel};
use crate::surface::Surface;
use collapsible_mesh::{CollapsibleMesh, VertexConstraint};
use glam::DVec3;
use insula_protocol::mesh::AttributeKind;
use insula_protocol::mesh::half_edge::{HalfEdgeMesh, NONE, RepairReport};
pub use simplifier::Goal;
use simplifier::Simplifier;
use std::collections::HashMap;
use wedges::WedgeValues;

/// The result of a simplification.
#[derive(Debug, Clone)]
pub struct Simplified {
    /// The remaining triangles.
    pub model: TriangleModel,
    /// For each of them the triangle of the input from which it comes.
    pub sources: Vec<u32>,
    /// In the model's units: the largest root mean square distance of a new vertex from the surfaces that it replaces,
    /// or the largest half diagonal of a removed part.
    pub error: f64,
    /// What was repaired in the input.
    pub repairs: RepairReport,
    pub removed_parts: usize,
}

/// Simplifies `model` towards `goal`. Vertices that `is_locked` keep their places.
pub fn simplify(model: &TriangleModel, goal: Goal, is_locked: impl Fn(u32) -> bool) -> Simplified {
    let order = space_filling_order(model);
    let sorted: Vec<[u32; 3]> = order.iter().map(|t| model.triangles[*t as usize]).collect();
    let mut pieces = HalfEdgeMesh::new(&sorted, model.positions.len() as u32);
    pieces.corner.iter_mut().for_each(|corner| *corner = 3 * order[*corner as usize / 3] + *corner % 3);
    let centre = centre(model);
    let mut simplifier = Simplifier::new(model, &pieces, centre);
    let mut copies = vec![0u32; model.positions.len()];
    pieces.vertex.iter().for_each(|vertex| copies[*vertex as usize] += 1);
    let mut is_kept = vec![false; pieces.vertex.len()];
    for (vertex, &source) in pieces.vertex.iter().enumerate() {
        is_kept[vertex] = is_locked(source);
        // Copies of a vertex that was cut apart stay, so that the surfaces stay together there.
        if is_kept[vertex] || copies[source as usize] > 1 {
            simplifier.mesh.vertices[vertex].constraint = VertexConstraint::Fixed;
        }
    }
    let mut parts = find_removable_parts(&pieces, &simplifier.mesh, &is_kept);
    let removed_parts = simplifier.run(goal, &mut parts);
    let model = build_model(&simplifier.mesh, &simplifier.wedges, model, centre);
    let sources = (0..simplifier.mesh.is_alive.len()).filter(|t| simplifier.mesh.is_alive[*t]);
    let sources = sources.map(|t| pieces.corner[3 * t] / 3).collect();
    Simplified { model, sources, error: simplifier.error, repairs: pieces.report, removed_parts }
}

/// Mean of the vertices. Positions relative to it keep the quadrics precise.
fn centre(model: &TriangleModel) -> DVec3 {
    let sum: DVec3 = model.positions.iter().map(|p| DVec3::from(*p)).sum();
    sum / model.positions.len().max(1) as f64
}

#[cfg(test)]
mod tests;

/// Greatest number of an axis in a Morton key, which has ten bits of each.
const MOST: f64 = 1023.0;

/// The numbers of the triangles, sorted by the Morton key of their first corner.
fn space_filling_order(model: &TriangleModel) -> Vec<u32> {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for position in &model.positions {
        (min, max) = (min.min(DVec3::from(*position)), max.max(DVec3::from(*position)));
    }
    let scale = MOST / (max - min).max_element().max(f64::MIN_POSITIVE);
    let key = |triangle: &[u32; 3]| {
        let position = model.positions.get(triangle[0] as usize).copied().unwrap_or_default();
        let at = (DVec3::from(position) - min) * scale;
        spread_bits(at.x as u32) | spread_bits(at.y as u32) << 1 | spread_bits(at.z as u32) << 2
    };
    let mut keys: Vec<(u32, u32)> = model.triangles.iter().map(key).zip(0..).collect();
    keys.sort_unstable();
    keys.into_iter().map(|(_, triangle)| triangle).collect()
}

/// Ten bits with two zeros before each.
fn spread_bits(mut v: u32) -> u32 {
    for (shift, mask) in [(16, 0x0300_00ff), (8, 0x0300_f00f), (4, 0x030c_30c3), (2, 0x0924_9249)] {
        v = (v | v << shift) & mask;
    }
    v
}

/// Points on a surface that tell its distance from another one, besides the vertices.
const SAMPLES: usize = 200_000;
/// A measured distance fits if it is at most this part of the limit: points between the samples may lie further away.
const FITS: f64 = 0.95;
/// Simplifications of [`simplify_within`] until the best one is taken.
const MAX_ATTEMPTS: usize = 8;
/// The search ends once the limits that fit and that do not are this close.
const CLOSE: f64 = 1.15;

/// Simplifies `model` as far as no point of either surface lies further than `limit` from the other one: measured at 200,000
/// points of each and all vertices. The error of the result is the measured distance.
///
/// The errors of collapses are root mean squares, which a single vertex may exceed several times. So the model is simplified with
/// smaller limits until the measured distance fits. If none does, only the repairs are made. `source` is the model's surface.
pub fn simplify_within(model: &TriangleModel, source: &Surface, limit: f64) -> Simplified {
    let (mut best, mut low, mut high): (Option<Simplified>, f64, f64) = (None, 0.0, f64::INFINITY);
    let mut goal = limit;
    for _ in 0..MAX_ATTEMPTS {
        let mut out = simplify(model, Goal { triangles: 0, error: goal }, |_| false);
        out.error = largest_distance(source, &out.model);
        let ratio = out.error / limit;
        if out.error <= limit * FITS {
            low = goal;
            if best.as_ref().is_none_or(|best| out.model.triangles.len() < best.model.triangles.len()) {
                best = Some(out);
            }
        } else {
            high = goal;
        }
        if low >= limit || high <= low * CLOSE || high == 0.0 {
            break;
        }
        goal = if low == 0.0 { goal * (0.9 / ratio).min(0.7) } else { (low * high).sqrt() };
    }
    best.unwrap_or_else(|| Simplified {
        error: 0.0,
        ..simplify(model, Goal { triangles: usize::MAX, error: 0.0 }, |_| false)
    })
}

/// The larger one of the largest distances of both surfaces from each other: the Hausdorff distance. Infinite if nothing is left.
pub fn largest_distance(source: &Surface, model: &TriangleModel) -> f64 {
    let Some(result) = Surface::of_model(model) else { return f64::INFINITY };
    source.largest_distance(&result, SAMPLES).max(result.largest_distance(source, SAMPLES))
}

/// The remaining triangles. Fixed vertices get the exact positions of the input, and those that were cut apart are
/// joined again. `centre` is the origin of the mesh's positions in the model.
fn build_model(mesh: &CollapsibleMesh, wedges: &WedgeValues, input: &TriangleModel, centre: DVec3) -> TriangleModel {
    let layers = input
        .layers
        .iter()
        .map(|layer| CornerLayer { values: Vec::new(), corners: Vec::new(), kind: layer.kind, width: layer.width })
        .collect();
    let mut builder = ModelBuilder {
        mesh,
        wedges,
        input,
        centre,
        model: TriangleModel { layers, ..TriangleModel::default() },
        vertex_numbers: vec![NONE; mesh.vertices.len()],
        fixed_numbers: HashMap::new(),
        value_numbers: vec![NONE; wedges.len()],
    };
    for t in (0..mesh.is_alive.len() as u32).filter(|t| mesh.is_alive[*t as usize]) {
        let corners = [0, 1, 2].map(|k| builder.vertex(mesh.origin(4 * t + k)));
        builder.model.triangles.push(corners);
        if wedges.layers > 0 {
            (0..3).for_each(|k| builder.add_corner(mesh.wedge(4 * t + k)));
        }
    }
    builder.model
}

struct ModelBuilder<'a> {
    mesh: &'a CollapsibleMesh,
    wedges: &'a WedgeValues,
    input: &'a TriangleModel,
    centre: DVec3,
    model: TriangleModel,
    /// Number in the model of each vertex of the mesh, or [`NONE`].
    vertex_numbers: Vec<u32>,
    /// Number in the model of each fixed vertex of the input.
    fixed_numbers: HashMap<u32, u32>,
    /// Number in the model of each wedge, or [`NONE`].
    value_numbers: Vec<u32>,
}

impl ModelBuilder<'_> {
    /// The number of a vertex in the model, which gets its position when it is first used.
    fn vertex(&mut self, vertex: u32) -> u32 {
        let known = self.vertex_numbers[vertex as usize];
        if known != NONE {
            return known;
        }
        let source = self.mesh.source[vertex as usize];
        let is_fixed = self.mesh.vertices[vertex as usize].constraint == VertexConstraint::Fixed;
        let next = self.model.positions.len() as u32;
        let number = if is_fixed { *self.fixed_numbers.entry(source).or_insert(next) } else { next };
        if number == next {
            let moved = self.mesh.position(vertex) + self.centre;
            self.model.positions.push(if is_fixed { self.input.positions[source as usize] } else { moved.into() });
        }
        self.vertex_numbers[vertex as usize] = number;
        number
    }

    /// Adds a corner with the values of a wedge to all layers.
    fn add_corner(&mut self, wedge: usize) {
        let is_new = self.value_numbers[wedge] == NONE;
        if is_new {
            self.value_numbers[wedge] = self.model.layers[0].values.len() as u32;
        }
        for (i, layer) in self.model.layers.iter_mut().enumerate() {
            if is_new {
                let [x, y, z, w] = self.wedges.value(wedge, i).map(|v| if v.is_nan() { 0.0 } else { v });
                let length = if layer.kind == AttributeKind::Normal { (x * x + y * y + z * z).sqrt() } else { 1.0 };
                let scale = if length > 0.0 { 1.0 / length } else { 1.0 };
                layer.values.push([x, y, z, w].map(|v| v * scale));
            }
            let is_missing = self.wedges.value(wedge, i)[0].is_nan();
            layer.corners.push(if is_missing { NO_VALUE } else { self.value_numbers[wedge] });
        }
    }
}

/// A connected part that may be removed.
struct RemovablePart {
    triangles: Vec<u32>,
    /// Area times squared half diagonal, comparable with the cost of a collapse.
    cost: f64,
    /// Half the diagonal of the bounding box: the error of removing the part.
    half_diagonal: f64,
}

/// The connected parts that may be removed, the cheapest last. Parts with a vertex of `is_kept` stay, and so does the
/// one with the largest area.
fn find_removable_parts(pieces: &HalfEdgeMesh, mesh: &CollapsibleMesh, is_kept: &[bool]) -> Vec<RemovablePart> {
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
        let triangles = connected_triangles(pieces, seed, &mut seen);
        let mut corners = triangles.iter().flat_map(|t| 3 * t..3 * t + 3);
        if corners.any(|h| is_kept[pieces.origin[h as usize] as usize]) {
            continue;
        }
        let (mut min, mut max, mut area) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0);
        for &t in &triangles {
            let corners = mesh.corners(t);
            corners.iter().for_each(|p| (min, max) = (min.min(*p), max.max(*p)));
            area += (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() * 0.5;
        }
        if area > largest.0 {
            largest = (area, Some(parts.len()));
        }
        let half_diagonal = (max - min).length() * 0.5;
        parts.push(RemovablePart { triangles, cost: area * half_diagonal * half_diagonal, half_diagonal });
    }
    if let Some(largest) = largest.1 {
        parts.swap_remove(largest);
    }
    parts.sort_by(|a, b| b.cost.total_cmp(&a.cost));
    parts
}

/// All triangles connected to `seed`, which is marked as `seen` already.
fn connected_triangles(pieces: &HalfEdgeMesh, seed: u32, seen: &mut [bool]) -> Vec<u32> {
    let mut triangles = vec![seed];
    let mut at = 0;
    while let Some(&t) = triangles.get(at) {
        at += 1;
        for h in 3 * t..3 * t + 3 {
            let twin = pieces.twin[h as usize];
            if twin != NONE && !std::mem::replace(&mut seen[twin as usize / 3], true) {
                triangles.push(twin / 3);
            }
        }
    }
    triangles
}
