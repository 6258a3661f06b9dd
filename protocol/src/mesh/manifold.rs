//! Construction of a [`HalfEdgeMesh`] from any triangles, with the repairs that make it manifold.
//!
//! Degenerate and duplicate triangles are removed, orientations are made consistent, and surfaces are cut apart at
//! edges and vertices where more than one surface meets.

use super::half_edge::{HalfEdgeMesh, NONE, next, prev};
use std::collections::HashSet;

/// Groups of at most this many triangles are searched linearly for duplicates.
const LINEAR_SEARCH: usize = 64;

/// Half-edges grouped by their edge, in either direction.
struct EdgeTable {
    /// For each vertex, where the edges start whose lower end it is; then the total.
    starts: Vec<u32>,
    /// Upper end in the high half, half-edge in the low half; sorted within each lower end.
    keys: Vec<u64>,
}

impl EdgeTable {
    fn new(origin: &[u32], vertices: u32) -> Self {
        let corners = origin.as_chunks::<3>().0;
        let ends = |[a, b, c]: [u32; 3]| [(a.min(b), a.max(b)), (b.min(c), b.max(c)), (c.min(a), c.max(a))];
        let mut starts = vec![0u32; vertices as usize + 1];
        for corners in corners {
            ends(*corners).iter().for_each(|(lower, _)| starts[*lower as usize + 1] += 1);
        }
        accumulate(&mut starts);
        let mut free = starts.clone();
        let mut keys = vec![0; origin.len()];
        for (t, corners) in (0u32..).zip(corners) {
            for (h, (lower, upper)) in (3 * t..).zip(ends(*corners)) {
                let slot = &mut free[lower as usize];
                keys[*slot as usize] = u64::from(upper) << 32 | u64::from(h);
                *slot += 1;
            }
        }
        starts.windows(2).for_each(|range| keys[range[0] as usize..range[1] as usize].sort_unstable());
        Self { starts, keys }
    }

    /// The half-edges of each edge, in ascending order.
    fn edges(&self) -> impl Iterator<Item = &[u64]> {
        let by_vertex = self.starts.windows(2).map(|range| &self.keys[range[0] as usize..range[1] as usize]);
        by_vertex.flat_map(|keys| keys.chunk_by(|a, b| a >> 32 == b >> 32))
    }
}

/// Turns counts, shifted by one, into start indices.
fn accumulate(counts: &mut [u32]) {
    for i in 1..counts.len() {
        counts[i] += counts[i - 1];
    }
}

/// Sorts items by vertex, stably. Returns where each vertex's items start, then the total, and the sorted items.
fn sort_by_vertex(
    items: impl Iterator<Item = u32> + Clone,
    vertex: impl Fn(u32) -> u32,
    vertices: u32,
) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; vertices as usize + 1];
    items.clone().for_each(|item| starts[vertex(item) as usize + 1] += 1);
    accumulate(&mut starts);
    let mut free = starts.clone();
    let mut sorted = vec![0; starts[vertices as usize] as usize];
    for item in items {
        let slot = &mut free[vertex(item) as usize];
        sorted[*slot as usize] = item;
        *slot += 1;
    }
    (starts, sorted)
}

/// Rotates a triangle so that its lowest corner comes first.
fn lowest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

impl HalfEdgeMesh {
    /// Builds the mesh from triangles with `vertices` vertices. Triangles with other vertices count as degenerate.
    pub fn new(triangles: &[[u32; 3]], vertices: u32) -> Self {
        let mut mesh = Self::default();
        mesh.add_triangles(triangles, vertices);
        let mut edges = EdgeTable::new(&mesh.origin, vertices);
        if !mesh.pair_twins(&edges) {
            if mesh.remove_duplicates(vertices) {
                edges = EdgeTable::new(&mesh.origin, vertices);
            }
            if mesh.unify_orientation(&edges) {
                edges = EdgeTable::new(&mesh.origin, vertices);
            }
            mesh.pair_twins(&edges);
        }
        mesh.split_vertices(vertices);
        mesh.count_parts();
        mesh
    }

    /// Adds all triangles that are not degenerate.
    fn add_triangles(&mut self, triangles: &[[u32; 3]], vertices: u32) {
        self.origin.reserve(3 * triangles.len());
        self.corner.reserve(3 * triangles.len());
        for (t, &[a, b, c]) in (0u32..).zip(triangles) {
            if a == b || b == c || c == a || a.max(b).max(c) >= vertices {
                self.report.degenerate += 1;
                continue;
            }
            self.origin.extend([a, b, c]);
            self.corner.extend([3 * t, 3 * t + 1, 3 * t + 2]);
        }
    }

    /// Removes triangles that repeat an earlier one. Returns whether there were any.
    fn remove_duplicates(&mut self, vertices: u32) -> bool {
        let triangles = self.origin.as_chunks::<3>().0;
        let lowest = |t: u32| lowest_first(triangles[t as usize])[0];
        let (starts, sorted) = sort_by_vertex(0..triangles.len() as u32, lowest, vertices);
        let mut is_duplicate = vec![false; triangles.len()];
        for range in starts.windows(2) {
            let group = &sorted[range[0] as usize..range[1] as usize];
            if group.len() > LINEAR_SEARCH {
                let mut seen = HashSet::new();
                for &t in group {
                    is_duplicate[t as usize] = !seen.insert(lowest_first(triangles[t as usize]));
                }
                continue;
            }
            for (i, &t) in group.iter().enumerate() {
                let corners = lowest_first(triangles[t as usize]);
                is_duplicate[t as usize] =
                    group[..i].iter().any(|other| lowest_first(triangles[*other as usize]) == corners);
            }
        }
        self.report.duplicate = is_duplicate.iter().filter(|is_duplicate| **is_duplicate).count() as u32;
        for list in [&mut self.origin, &mut self.corner] {
            let mut h = 0;
            list.retain(|_| {
                h += 1;
                !is_duplicate[(h - 1) / 3]
            });
        }
        self.report.duplicate > 0
    }

    /// Reverses triangles so that neighbours over an edge of two triangles agree. In each connected part the smaller
    /// number of triangles is reversed. Returns whether any edge disagreed.
    fn unify_orientation(&mut self, edges: &EdgeTable) -> bool {
        let mut neighbour = vec![NONE; self.origin.len()];
        let mut disagrees = false;
        for edge in edges.edges() {
            if let [h, g] = *edge {
                let [h, g] = [h as u32, g as u32];
                neighbour[h as usize] = g;
                neighbour[g as usize] = h;
                disagrees |= self.origin[h as usize] == self.origin[g as usize];
            }
        }
        if !disagrees {
            return false;
        }
        let mut reversed: Vec<Option<bool>> = vec![None; self.triangles()];
        for seed in 0..self.triangles() {
            if reversed[seed].is_none() {
                let part = self.propagate_orientation(seed, &neighbour, &mut reversed);
                self.reverse_fewer(&part, &reversed);
            }
        }
        true
    }

    /// Decides for all triangles connected to `seed` whether they are reversed relative to it. Returns these triangles.
    fn propagate_orientation(&self, seed: usize, neighbour: &[u32], reversed: &mut [Option<bool>]) -> Vec<usize> {
        reversed[seed] = Some(false);
        let mut part = vec![seed];
        let mut visited = 0;
        while let Some(&t) = part.get(visited) {
            visited += 1;
            let own = reversed[t] == Some(true);
            for h in 3 * t..3 * t + 3 {
                let g = neighbour[h];
                if g != NONE && reversed[g as usize / 3].is_none() {
                    let same_direction = self.origin[h] == self.origin[g as usize];
                    reversed[g as usize / 3] = Some(own ^ same_direction);
                    part.push(g as usize / 3);
                }
            }
        }
        part
    }

    fn reverse_fewer(&mut self, part: &[usize], reversed: &[Option<bool>]) {
        let count = part.iter().filter(|t| reversed[**t] == Some(true)).count();
        let reverse_others = count * 2 > part.len();
        for &t in part {
            if (reversed[t] == Some(true)) != reverse_others {
                self.origin.swap(3 * t + 1, 3 * t + 2);
                self.corner.swap(3 * t + 1, 3 * t + 2);
                self.report.turned += 1;
            }
        }
    }

    /// Sets all twins. On an edge of more than two triangles, it pairs opposite half-edges that are close in the input.
    /// Returns whether every edge has at most two half-edges, and two only in opposite directions.
    fn pair_twins(&mut self, edges: &EdgeTable) -> bool {
        self.twin.clear();
        self.twin.resize(self.origin.len(), NONE);
        self.report.cut_edges = 0;
        let mut waiting: Vec<u32> = Vec::new();
        for edge in edges.edges() {
            if let [h, g] = *edge {
                let [h, g] = [h as u32, g as u32];
                if self.origin[h as usize] != self.origin[g as usize] {
                    self.set_twins(h, g);
                } else {
                    self.report.cut_edges += 1;
                }
                continue;
            }
            waiting.clear();
            for h in edge.iter().map(|key| *key as u32) {
                match waiting.last() {
                    Some(&g) if self.origin[g as usize] != self.origin[h as usize] => {
                        waiting.pop();
                        self.set_twins(h, g);
                    }
                    _ => waiting.push(h),
                }
            }
            self.report.cut_edges += u32::from(edge.len() > 2);
        }
        self.report.cut_edges == 0
    }

    fn set_twins(&mut self, h: u32, g: u32) {
        self.twin[h as usize] = g;
        self.twin[g as usize] = h;
    }

    /// Gives each fan of triangles its own vertex. Vertices are numbered in the order of their first triangle.
    fn split_vertices(&mut self, vertices: u32) {
        let mut fans = vec![0u32; vertices as usize];
        let mut new_origin = vec![NONE; self.origin.len()];
        for start in 0..self.origin.len() as u32 {
            if new_origin[start as usize] != NONE {
                continue;
            }
            let id = self.vertex.len() as u32;
            let vertex = self.origin[start as usize];
            self.vertex.push(vertex);
            self.report.cut_vertices += u32::from(fans[vertex as usize] > 0);
            fans[vertex as usize] += 1;
            // Go around to one side until the border or the start, then from the start to the other side.
            let mut h = start;
            loop {
                new_origin[h as usize] = id;
                h = self.twin[prev(h) as usize];
                if h == NONE || h == start {
                    break;
                }
            }
            let mut beyond = self.twin[start as usize];
            while h == NONE && beyond != NONE {
                new_origin[next(beyond) as usize] = id;
                beyond = self.twin[next(beyond) as usize];
            }
        }
        self.report.unused = fans.iter().filter(|fans| **fans == 0).count() as u32;
        self.origin = new_origin;
    }

    /// Counts borders and connected pieces.
    fn count_parts(&mut self) {
        self.report.borders = self.borders().len() as u32;
        let mut seen = vec![false; self.triangles()];
        let mut stack = Vec::new();
        for seed in 0..self.triangles() {
            if seen[seed] {
                continue;
            }
            self.report.pieces += 1;
            seen[seed] = true;
            stack.push(seed);
            while let Some(t) = stack.pop() {
                for h in 3 * t..3 * t + 3 {
                    let neighbour = self.twin[h] as usize / 3;
                    if self.twin[h] != NONE && !seen[neighbour] {
                        seen[neighbour] = true;
                        stack.push(neighbour);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::half_edge::RepairReport;

    fn repair(triangles: &[[u32; 3]], vertices: u32) -> RepairReport {
        let mesh = HalfEdgeMesh::new(triangles, vertices);
        assert!(mesh.is_sound());
        mesh.report
    }

    #[test]
    fn a_tetrahedron_needs_no_repair() {
        let mesh = HalfEdgeMesh::new(&[[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], 4);
        assert!(mesh.is_sound());
        assert_eq!(mesh.report, RepairReport { pieces: 1, ..RepairReport::default() });
        assert_eq!(mesh.euler(), 2);
    }

    #[test]
    fn removed_triangles_and_vertices_are_counted() {
        let found = repair(&[[0, 1, 2], [1, 2, 0], [2, 2, 3], [0, 9, 1]], 5);
        let removed = RepairReport { duplicate: 1, degenerate: 2, unused: 2, ..RepairReport::default() };
        assert_eq!(found, RepairReport { pieces: 1, borders: 1, ..removed });
    }

    #[test]
    fn an_edge_of_three_triangles_is_cut() {
        let found = repair(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]], 5);
        assert_eq!((found.cut_edges, found.pieces, found.cut_vertices), (1, 2, 2));
    }

    #[test]
    fn a_vertex_of_two_fans_is_cut() {
        let found = repair(&[[0, 1, 2], [0, 3, 4]], 5);
        assert_eq!((found.cut_vertices, found.pieces, found.borders), (1, 2, 2));
    }

    #[test]
    fn a_reversed_triangle_is_turned_back() {
        let found = repair(&[[0, 1, 2], [1, 3, 2], [1, 4, 3], [5, 3, 4], [6, 5, 4], [2, 7, 3]], 8);
        assert_eq!((found.turned, found.pieces, found.borders), (1, 1, 1));
    }

    #[test]
    fn a_moebius_band_is_cut_at_one_edge() {
        let band: Vec<[u32; 3]> = (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect();
        let found = repair(&band, 5);
        assert_eq!(found.pieces, 1);
        assert_eq!(found.cut_edges, 1);
    }
}
