//! Borders closed with dummy vertices, so that the conquest meets closed surfaces only (Gasparello, 3.3.2).
//!
//! In: [`HalfEdgeMesh`]. Out: [`ClosedMesh`]. Next: `conquest`.

use super::half_edge::{HalfEdgeMesh, NONE};

/// HalfEdgeMesh with a dummy vertex for each loop of border edges, and a triangle from it to each edge.
#[derive(Debug, Default)]
pub(super) struct ClosedMesh {
    /// As of [`HalfEdgeMesh`]; triangles of dummies come last.
    pub(super) origin: Vec<u32>,
    /// As of [`HalfEdgeMesh`], without borders.
    pub(super) twin: Vec<u32>,
    /// The first dummy vertex.
    pub(super) dummies_from: u32,
    vertices: usize,
}

impl ClosedMesh {
    /// Closes all borders.
    pub(super) fn new(pieces: &HalfEdgeMesh) -> Self {
        let (mut origin, mut twin) = (pieces.origin.clone(), pieces.twin.clone());
        let dummies_from = pieces.vertex.len() as u32;
        let borders = pieces.borders();
        for (dummy, border) in (dummies_from..).zip(&borders) {
            let first = origin.len() as u32;
            let count = border.len() as u32;
            for (i, &h) in (0..count).zip(border) {
                // Back along the border edge, to the dummy, and from it: beside those of the edges before and after.
                let here = first + 3 * i;
                origin.extend([pieces.target(h), pieces.origin[h as usize], dummy]);
                twin.extend([h, first + 3 * ((i + count - 1) % count) + 2, first + 3 * ((i + 1) % count) + 1]);
                twin[h as usize] = here;
            }
        }
        debug_assert!(!twin.contains(&NONE));
        Self { origin, twin, dummies_from, vertices: pieces.vertex.len() + borders.len() }
    }

    /// With those of dummies.
    pub(super) fn triangles(&self) -> usize {
        self.origin.len() / 3
    }

    /// With dummies.
    pub(super) fn vertices(&self) -> usize {
        self.vertices
    }

    /// Edges at each vertex: as many as triangles.
    pub(super) fn degrees(&self) -> Vec<u32> {
        let mut degree = vec![0; self.vertices];
        self.origin.iter().for_each(|vertex| degree[*vertex as usize] += 1);
        degree
    }
}
