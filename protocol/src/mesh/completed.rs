//! What is known around a vertex when it is its turn: the triangles that it completes.
//!
//! In: a [`Connectivity`]. Out: [`CompletedTriangles`], vertex by vertex. Next: `smooth`, `built`.
//!
//! A triangle is completed by the last of its vertices. But for joins, those that a vertex completes came with it and before
//! the next vertex, so they are read off the order of triangles, without walking around the vertex.

use super::connectivity::Connectivity;

/// Most triangles that are looked at around one vertex.
const MOST: usize = 6;

/// A triangle that a vertex completes: the other two corners, and what lies beyond the edge between them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CompletedTriangle {
    /// The corner after the vertex.
    pub(super) a: u32,
    /// The corner before the vertex.
    pub(super) b: u32,
    /// Third corner of the triangle on their other side.
    pub(super) x: u32,
    /// Of the other two corners, the one that has all its triangles now; `a` for the first wing.
    pub(super) full: u32,
}

/// All of them, the one that the vertex came with first.
#[derive(Debug, Default)]
pub(super) struct CompletedTriangles {
    wings: [CompletedTriangle; MOST],
    count: usize,
}

impl CompletedTriangles {
    /// The completed triangles, at most [`MOST`].
    #[inline]
    pub(super) fn wings(&self) -> &[CompletedTriangle] {
        &self.wings[..self.count]
    }

    /// Looks at the triangles that came with `vertex`. Only vertices below it that `is_known` are known.
    #[inline]
    pub(super) fn look(&mut self, mesh: &Connectivity, vertex: u32, is_known: impl Fn(u32) -> bool) {
        self.count = 0;
        let from = mesh.birth[vertex as usize] as usize;
        let to = mesh.birth.get(vertex as usize + 1).map_or(mesh.triangles.len(), |birth| *birth as usize);
        for t in from..to {
            let corners = mesh.triangles[t];
            let k = if corners[2] == vertex {
                2
            } else if corners[0] == vertex {
                0
            } else if corners[1] == vertex {
                1
            } else {
                continue;
            };
            let (a, b) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
            let beyond = mesh.twins[t][(k + 1) % 3] as usize;
            let x = mesh.triangles[beyond / 3][(beyond + 2) % 3];
            let known = |other: u32| other < vertex && is_known(other);
            if known(a) && known(b) && known(x) {
                let full = if k == 1 || t == from { a } else { corners[1] };
                self.wings[self.count] = CompletedTriangle { a, b, x, full };
                self.count += 1;
                if self.count == MOST {
                    return;
                }
            }
        }
    }
}
