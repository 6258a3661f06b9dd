//! Closes the borders of a half-edge mesh with dummy vertices, because the connectivity coder needs closed surfaces
//! (Gasparello, 3.3.2).

use super::half_edge::{HalfEdgeMesh, NONE};

/// A half-edge mesh with a dummy vertex for each border loop and a triangle from it to each border edge.
#[derive(Debug, Default)]
pub(super) struct ClosedMesh {
    /// As in [`HalfEdgeMesh`]. Triangles of dummy vertices come last.
    pub(super) origin: Vec<u32>,
    /// As in [`HalfEdgeMesh`], but never [`NONE`].
    pub(super) twin: Vec<u32>,
    pub(super) first_dummy: u32,
    vertices: usize,
}

impl ClosedMesh {
    pub(super) fn new(mesh: &HalfEdgeMesh) -> Self {
        let (mut origin, mut twin) = (mesh.origin.clone(), mesh.twin.clone());
        let first_dummy = mesh.vertex.len() as u32;
        let borders = mesh.borders();
        for (dummy, border) in (first_dummy..).zip(&borders) {
            let first = origin.len() as u32;
            let count = border.len() as u32;
            for (i, &h) in (0..count).zip(border) {
                // Back along the border edge, to the dummy, and from it. The last two touch the neighbouring triangles.
                let half_edge = first + 3 * i;
                origin.extend([mesh.target(h), mesh.origin[h as usize], dummy]);
                twin.extend([h, first + 3 * ((i + count - 1) % count) + 2, first + 3 * ((i + 1) % count) + 1]);
                twin[h as usize] = half_edge;
            }
        }
        debug_assert!(!twin.contains(&NONE));
        Self { origin, twin, first_dummy, vertices: mesh.vertex.len() + borders.len() }
    }

    /// Number of triangles, including those of dummy vertices.
    pub(super) fn triangles(&self) -> usize {
        self.origin.len() / 3
    }

    /// Number of vertices, including dummy vertices.
    pub(super) fn vertices(&self) -> usize {
        self.vertices
    }

    /// The number of edges at each vertex.
    pub(super) fn degrees(&self) -> Vec<u32> {
        let mut degree = vec![0; self.vertices];
        self.origin.iter().for_each(|vertex| degree[*vertex as usize] += 1);
        degree
    }
}
