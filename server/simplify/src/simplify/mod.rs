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
//! | `order` | triangles sorted along a space-filling curve, so that memory accesses are local |
//! | `quadric` | sums of squared distances to planes |
//! | `collapsible_mesh`, `collapse` | the half-edge mesh, and collapsing one of its edges |
//! | `edge_queue` | the cheapest edges of a round |
//! | `parts` | connected parts that may be removed |
//! | `wedges` | attribute values of the corners |
//! | `texture_quadric` | sums of squared differences of texture coordinates |
//! | `simplifier` | the rounds of collapses |
//! | `output` | the result as a model |
//! | `within` | simplification within a measured distance |

mod collapse;
mod collapsible_mesh;
mod edge_queue;
mod order;
mod output;
mod parts;
mod quadric;
mod simplifier;
mod texture_quadric;
mod wedges;
mod within;

use crate::model::TriangleModel;
use collapsible_mesh::VertexConstraint;
use glam::DVec3;
use insula_protocol::mesh::half_edge::{HalfEdgeMesh, RepairReport};
pub use simplifier::Goal;
use simplifier::Simplifier;
pub use within::{largest_distance, simplify_within};

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
    let order = order::space_filling_order(model);
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
    let mut parts = parts::find_removable_parts(&pieces, &simplifier.mesh, &is_kept);
    let removed_parts = simplifier.run(goal, &mut parts);
    let model = output::build_model(&simplifier.mesh, &simplifier.wedges, model, centre);
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
