//! A half-edge mesh of manifold pieces.
//!
//! Half-edge `3 t + k` goes from corner `k` of triangle `t` to the next corner. Its twin goes the opposite way in the
//! neighbouring triangle. The triangles around a vertex form one fan, either closed or with one gap at a border.
//!
//! [`HalfEdgeMesh::new`] makes such a mesh from any triangles and repairs what is not manifold (module `manifold`).

/// Marks a missing half-edge or vertex.
pub const NONE: u32 = u32::MAX;

/// The next half-edge of the same triangle.
#[inline]
pub const fn next(half_edge: u32) -> u32 {
    if half_edge % 3 == 2 { half_edge - 2 } else { half_edge + 1 }
}

/// The previous half-edge of the same triangle.
#[inline]
pub const fn prev(half_edge: u32) -> u32 {
    if half_edge.is_multiple_of(3) { half_edge + 2 } else { half_edge - 1 }
}

/// Counts of the repairs of [`HalfEdgeMesh::new`], and of the parts of the result.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RepairReport {
    /// Removed triangles with two equal corners, or with a corner that is not a vertex.
    pub degenerate: u32,
    /// Removed triangles with the corners of an earlier one in the same cyclic order.
    pub duplicate: u32,
    /// Triangles whose orientation was reversed to match their neighbours.
    pub turned: u32,
    /// Edges that were cut because more than two triangles meet there, or two whose orientations contradict.
    pub cut_edges: u32,
    /// Vertices that were added because one had several fans of triangles.
    pub cut_vertices: u32,
    /// Removed vertices without triangles.
    pub unused: u32,
    /// Connected pieces of the result.
    pub pieces: u32,
    /// Border loops of the result.
    pub borders: u32,
}

/// Triangles with adjacency.
#[derive(Debug, Clone, Default)]
pub struct HalfEdgeMesh {
    /// For each half-edge, the vertex that it starts from.
    pub origin: Vec<u32>,
    /// For each half-edge, its twin; [`NONE`] at a border.
    pub twin: Vec<u32>,
    /// For each vertex, the input vertex that it is or that it was copied from.
    pub vertex: Vec<u32>,
    /// For each half-edge, the input corner `3 t + k` that it starts from.
    pub corner: Vec<u32>,
    pub report: RepairReport,
}

impl HalfEdgeMesh {
    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.origin.len() / 3
    }

    /// The vertex that a half-edge goes to.
    #[inline]
    pub fn target(&self, half_edge: u32) -> u32 {
        self.origin[next(half_edge) as usize]
    }

    /// All border loops, each as its half-edges in order.
    pub fn borders(&self) -> Vec<Vec<u32>> {
        let mut border_from = vec![NONE; self.vertex.len()];
        for h in 0..self.origin.len() as u32 {
            if self.twin[h as usize] == NONE {
                border_from[self.origin[h as usize] as usize] = h;
            }
        }
        let mut seen = vec![false; self.vertex.len()];
        let mut loops = Vec::new();
        for start in 0..self.origin.len() as u32 {
            if self.twin[start as usize] != NONE || seen[self.origin[start as usize] as usize] {
                continue;
            }
            let mut border = Vec::new();
            let mut h = start;
            // A vertex has one fan, so at most one border half-edge leaves it and at most one arrives.
            while !seen[self.origin[h as usize] as usize] {
                seen[self.origin[h as usize] as usize] = true;
                border.push(h);
                match border_from[self.target(h) as usize] {
                    NONE => break,
                    following => h = following,
                }
            }
            loops.push(border);
        }
        loops
    }

    /// The Euler characteristic: vertices - edges + triangles.
    pub fn euler(&self) -> i64 {
        let open = self.twin.iter().filter(|twin| **twin == NONE).count();
        let edges = (self.twin.len() + open) / 2;
        self.vertex.len() as i64 - edges as i64 + self.triangles() as i64
    }

    /// Whether the invariants of the module documentation hold. For tests.
    pub fn is_sound(&self) -> bool {
        let mut first = vec![NONE; self.vertex.len()];
        let mut fan_size = vec![0u32; self.vertex.len()];
        for h in 0..self.origin.len() as u32 {
            let twin = self.twin[h as usize];
            if twin != NONE {
                let is_mutual = self.twin[twin as usize] == h && twin != h;
                let is_opposite =
                    self.origin[twin as usize] == self.target(h) && self.origin[h as usize] == self.target(twin);
                if !is_mutual || !is_opposite {
                    return false;
                }
            }
            let vertex = self.origin[h as usize] as usize;
            fan_size[vertex] += 1;
            // A fan at a border starts at its border half-edge.
            if first[vertex] == NONE || twin == NONE {
                first[vertex] = h;
            }
        }
        // One walk around each vertex must visit all its triangles.
        first.iter().zip(&fan_size).all(|(&start, &size)| {
            let (mut h, mut visited) = (start, 0);
            while h != NONE && visited <= size {
                visited += 1;
                h = self.twin[prev(h) as usize];
                if h == start {
                    break;
                }
            }
            visited == size && size > 0
        })
    }
}
