//! Triangle meshes of height fields.

use super::diamond::{Corners, Place};
use std::collections::HashMap;

/// Triangles over places of a grid. Every edge belongs to two triangles or lies on a border of the data.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TerrainMesh {
    /// Column and row of each vertex.
    pub vertices: Vec<Place>,
    /// Vertices of each triangle, counter-clockwise for rows that follow each other to the left of the columns'
    /// direction (columns to the east, rows to the north).
    pub triangles: Vec<[u32; 3]>,
}

/// Numbers the vertices of triangles by their places.
#[derive(Default)]
pub(super) struct MeshBuilder {
    mesh: TerrainMesh,
    numbers: HashMap<Place, u32>,
}

impl MeshBuilder {
    pub(super) fn add(&mut self, corners: Corners) {
        let vertices = &mut self.mesh.vertices;
        let triangle = corners.map(|place| {
            *self.numbers.entry(place).or_insert_with(|| {
                vertices.push(place);
                (vertices.len() - 1) as u32
            })
        });
        self.mesh.triangles.push(triangle);
    }

    pub(super) fn finish(self) -> TerrainMesh {
        self.mesh
    }
}
