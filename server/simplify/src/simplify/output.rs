//! The simplified mesh as a model.

use super::collapsible_mesh::{CollapsibleMesh, VertexConstraint};
use super::wedges::WedgeValues;
use crate::model::{CornerLayer, NO_VALUE, TriangleModel};
use glam::DVec3;
use insula_protocol::mesh::AttributeKind;
use insula_protocol::mesh::half_edge::NONE;
use std::collections::HashMap;

/// The remaining triangles. Fixed vertices get the exact positions of the input, and those that were cut apart are
/// joined again. `centre` is the origin of the mesh's positions in the model.
pub(super) fn build_model(
    mesh: &CollapsibleMesh,
    wedges: &WedgeValues,
    input: &TriangleModel,
    centre: DVec3,
) -> TriangleModel {
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
