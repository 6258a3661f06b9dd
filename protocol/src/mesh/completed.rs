//! The triangles that a vertex completes, from which its position is predicted.
//!
//! A triangle is completed by its last vertex in the traversal order. Apart from joins, the triangles that a vertex
//! completes were added with it and before the next vertex, so they are found in the order of triangles, without a walk
//! around the vertex.

use super::connectivity::Connectivity;

/// Maximum number of completed triangles that are used per vertex.
const MAX_TRIANGLES: usize = 6;

/// A triangle that a vertex completes, with the triangle on the other side of the opposite edge.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CompletedTriangle {
    /// The corner after the vertex.
    pub(super) a: u32,
    /// The corner before the vertex.
    pub(super) b: u32,
    /// The third corner of the triangle beyond the edge from `a` to `b`.
    pub(super) beyond: u32,
    /// The one of `a` and `b` whose triangles are all complete; `a` in the first triangle.
    pub(super) full: u32,
}

impl CompletedTriangle {
    /// The one of `a` and `b` that is not `full`.
    #[inline]
    pub(super) fn not_full(&self) -> u32 {
        if self.full == self.a { self.b } else { self.a }
    }
}

/// The triangles that one vertex completes, the one that added the vertex first.
#[derive(Debug, Default)]
pub(super) struct CompletedTriangles {
    triangles: [CompletedTriangle; MAX_TRIANGLES],
    count: usize,
}

impl CompletedTriangles {
    #[inline]
    pub(super) fn triangles(&self) -> &[CompletedTriangle] {
        &self.triangles[..self.count]
    }

    /// Finds the triangles that `vertex` completes. Only those count whose other vertices precede it and are
    /// `is_known`.
    #[inline]
    pub(super) fn find(&mut self, mesh: &Connectivity, vertex: u32, is_known: impl Fn(u32) -> bool) {
        self.count = 0;
        let start = mesh.first_triangle[vertex as usize] as usize;
        let end = mesh.first_triangle.get(vertex as usize + 1).map_or(mesh.triangles.len(), |first| *first as usize);
        // The range is in order, because triangles are only ever added.
        let (Some(triangles), Some(beyond)) = (mesh.triangles.get(start..end), mesh.beyond.get(start..end)) else {
            return;
        };
        for (i, (corners, &beyond)) in triangles.iter().zip(beyond).enumerate() {
            let [first, second, third] = *corners;
            let (a, b) = if third == vertex { (first, second) } else { (second, third) };
            // Missing vertices have the highest number.
            if beyond < vertex && is_known(a) && is_known(b) && is_known(beyond) {
                let full = if i == 0 { a } else { second };
                self.triangles[self.count] = CompletedTriangle { a, b, beyond, full };
                self.count += 1;
                if self.count == MAX_TRIANGLES {
                    return;
                }
            }
        }
    }
}
