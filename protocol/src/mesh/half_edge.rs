//! Triangles of any kind as a half-edge mesh of manifold pieces.
//!
//! In: triangles as triples of vertices. Out: [`HalfEdgeMesh`], and a [`RepairReport`] of what was mended. Next: `conquest`, or
//! simplification.
//!
//! Half-edge `3 t + k` goes from corner `k` of triangle `t` to its next corner; its twin goes the other way in the triangle
//! beside it. Around every vertex there is one fan of triangles, closed, or open at one border.

use std::collections::HashSet;

/// No half-edge, no vertex.
pub const NONE: u32 = u32::MAX;

/// The next half-edge of the same triangle.
#[inline]
pub const fn next(half_edge: u32) -> u32 {
    if half_edge % 3 == 2 { half_edge - 2 } else { half_edge + 1 }
}

/// The one before in the same triangle.
#[inline]
pub const fn prev(half_edge: u32) -> u32 {
    if half_edge.is_multiple_of(3) { half_edge + 2 } else { half_edge - 1 }
}

/// What was found and mended on the way to manifold pieces.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RepairReport {
    /// Triangles with two corners at one vertex: left out.
    pub degenerate: u32,
    /// Triangles that were there before with the same corners in the same turn: left out.
    pub duplicate: u32,
    /// Triangles that were turned around so that they agree with their neighbours.
    pub turned: u32,
    /// EdgeTable where more than two triangles meet, or two that cannot agree: cut apart, as far as no two of them fit.
    pub cut_edges: u32,
    /// Vertices added because one had several fans of triangles.
    pub cut_vertices: u32,
    /// Vertices that no triangle uses: left out.
    pub unused: u32,
    /// Connected pieces.
    pub pieces: u32,
    /// Loops of border edges.
    pub borders: u32,
}

/// Items in the order of a vertex of each: where each vertex's begin, with the end of all at last, and the items.
fn sort_by_vertex(
    items: impl Iterator<Item = u32> + Clone,
    vertex: impl Fn(u32) -> u32,
    vertices: u32,
) -> (Vec<u32>, Vec<u32>) {
    let mut from = vec![0u32; vertices as usize + 1];
    items.clone().for_each(|item| from[vertex(item) as usize + 1] += 1);
    for i in 1..from.len() {
        from[i] += from[i - 1];
    }
    let mut to = from.clone();
    let mut sorted = vec![0; from[vertices as usize] as usize];
    for item in items {
        let place = &mut to[vertex(item) as usize];
        sorted[*place as usize] = item;
        *place += 1;
    }
    (from, sorted)
}

/// Half-edges by the edge that they lie on, whichever way they go.
struct EdgeTable {
    /// Where those of each vertex begin that is the lower end, with the end of all at last.
    from: Vec<u32>,
    /// The upper end, then the half-edge; ascending for each lower end.
    keys: Vec<u64>,
}

impl EdgeTable {
    fn new(origin: &[u32], vertices: u32) -> Self {
        let mut from = vec![0u32; vertices as usize + 1];
        let corners = origin.as_chunks::<3>().0;
        let ends = |[a, b, c]: [u32; 3]| [(a.min(b), a.max(b)), (b.min(c), b.max(c)), (c.min(a), c.max(a))];
        for corners in corners {
            ends(*corners).iter().for_each(|(lower, _)| from[*lower as usize + 1] += 1);
        }
        for i in 1..from.len() {
            from[i] += from[i - 1];
        }
        let mut to = from.clone();
        let mut keys = vec![0; origin.len()];
        for (t, corners) in (0u32..).zip(corners) {
            for (h, (lower, upper)) in (3 * t..).zip(ends(*corners)) {
                let place = &mut to[lower as usize];
                keys[*place as usize] = u64::from(upper) << 32 | u64::from(h);
                *place += 1;
            }
        }
        from.windows(2).for_each(|part| keys[part[0] as usize..part[1] as usize].sort_unstable());
        Self { from, keys }
    }

    /// Those of each edge.
    fn groups(&self) -> impl Iterator<Item = &[u64]> {
        let parts = self.from.windows(2).map(|part| &self.keys[part[0] as usize..part[1] as usize]);
        parts.flat_map(|part| part.chunk_by(|a, b| a >> 32 == b >> 32))
    }
}

/// A half-edge mesh.
#[derive(Debug, Clone, Default)]
pub struct HalfEdgeMesh {
    /// Vertex that each half-edge starts from.
    pub origin: Vec<u32>,
    /// The half-edge beside each, [`NONE`] at a border.
    pub twin: Vec<u32>,
    /// For each vertex, the one of the input that it is (a copy of).
    pub vertex: Vec<u32>,
    /// For each half-edge, the corner `3 t + k` of the input that it starts from.
    pub corner: Vec<u32>,
    /// What was mended.
    pub report: RepairReport,
}

impl HalfEdgeMesh {
    /// From triangles whose corners are below `vertices`. Corners that are not count as degenerate triangles.
    pub fn new(triangles: &[[u32; 3]], vertices: u32) -> Self {
        let mut pieces = Self::default();
        pieces.gather(triangles, vertices);
        let mut edges = EdgeTable::new(&pieces.origin, vertices);
        if pieces.pair(&edges) {
            if pieces.leave_out_duplicates(vertices) {
                edges = EdgeTable::new(&pieces.origin, vertices);
            }
            if pieces.turn(&edges) {
                edges = EdgeTable::new(&pieces.origin, vertices);
            }
            pieces.pair(&edges);
        }
        pieces.split(vertices);
        pieces.count();
        pieces
    }

    /// How many triangles.
    pub fn triangles(&self) -> usize {
        self.origin.len() / 3
    }

    /// The vertex that a half-edge goes to.
    #[inline]
    pub fn target(&self, half_edge: u32) -> u32 {
        self.origin[next(half_edge) as usize]
    }

    /// Leaves out what is no triangle.
    fn gather(&mut self, triangles: &[[u32; 3]], vertices: u32) {
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

    /// Leaves out triangles that were there before. Whether there are any.
    fn leave_out_duplicates(&mut self, vertices: u32) -> bool {
        // By their lowest corner, turned so that it is the first.
        let lowest_first = |[a, b, c]: [u32; 3]| {
            if a < b && a < c {
                [a, b, c]
            } else if b < c {
                [b, c, a]
            } else {
                [c, a, b]
            }
        };
        let triangles = self.origin.as_chunks::<3>().0;
        let lowest = |t: u32| lowest_first(triangles[t as usize])[0];
        let (from, sorted) = sort_by_vertex(0..triangles.len() as u32, lowest, vertices);
        let mut again = vec![false; triangles.len()];
        for group in from.windows(2) {
            let group = &sorted[group[0] as usize..group[1] as usize];
            if group.len() > 64 {
                let mut seen = HashSet::new();
                group.iter().for_each(|&t| again[t as usize] = !seen.insert(lowest_first(triangles[t as usize])));
                continue;
            }
            for (i, &t) in group.iter().enumerate() {
                let turned = lowest_first(triangles[t as usize]);
                again[t as usize] = group[..i].iter().any(|other| lowest_first(triangles[*other as usize]) == turned);
            }
        }
        self.report.duplicate = again.iter().filter(|again| **again).count() as u32;
        for list in [&mut self.origin, &mut self.corner] {
            let mut h = 0;
            list.retain(|_| {
                h += 1;
                !again[(h - 1) / 3]
            });
        }
        self.report.duplicate > 0
    }

    /// Turns triangles around where an edge of two goes the same way in both; the fewer of a connected part are turned.
    /// Whether any was.
    fn turn(&mut self, edges: &EdgeTable) -> bool {
        let mut beside = vec![NONE; self.origin.len()];
        let mut against = false;
        for group in edges.groups() {
            if let [h, g] = *group {
                let [h, g] = [h as u32, g as u32];
                beside[h as usize] = g;
                beside[g as usize] = h;
                against |= self.origin[h as usize] == self.origin[g as usize];
            }
        }
        if !against {
            return false;
        }
        let mut turned: Vec<Option<bool>> = vec![None; self.triangles()];
        let mut part = Vec::new();
        for seed in 0..self.triangles() {
            if turned[seed].is_some() {
                continue;
            }
            turned[seed] = Some(false);
            part.clear();
            part.push(seed);
            let (mut done, mut turns) = (0, 0);
            while let Some(&t) = part.get(done) {
                done += 1;
                let here = turned[t] == Some(true);
                turns += usize::from(here);
                for h in 3 * t..3 * t + 3 {
                    let g = beside[h];
                    if g != NONE && turned[g as usize / 3].is_none() {
                        let same_way = self.origin[h] == self.origin[g as usize];
                        turned[g as usize / 3] = Some(here ^ same_way);
                        part.push(g as usize / 3);
                    }
                }
            }
            let all_but = turns * 2 > part.len();
            for &t in &part {
                if (turned[t] == Some(true)) != all_but {
                    self.origin.swap(3 * t + 1, 3 * t + 2);
                    self.corner.swap(3 * t + 1, 3 * t + 2);
                    self.report.turned += 1;
                }
            }
        }
        true
    }

    /// Twins: on an edge of several triangles those that go opposite ways and stand nearest in the input. Whether some edge has
    /// two that go the same way.
    fn pair(&mut self, edges: &EdgeTable) -> bool {
        self.twin.clear();
        self.twin.resize(self.origin.len(), NONE);
        self.report.cut_edges = 0;
        let mut same_way = false;
        let mut waiting: Vec<u32> = Vec::new();
        for group in edges.groups() {
            if let [h, g] = *group {
                let [h, g] = [h as u32, g as u32];
                if self.origin[h as usize] != self.origin[g as usize] {
                    self.twin[h as usize] = g;
                    self.twin[g as usize] = h;
                } else {
                    same_way = true;
                    self.report.cut_edges += 1;
                }
                continue;
            }
            waiting.clear();
            for h in group.iter().map(|key| *key as u32) {
                match waiting.last() {
                    Some(&g) if self.origin[g as usize] != self.origin[h as usize] => {
                        waiting.pop();
                        self.twin[h as usize] = g;
                        self.twin[g as usize] = h;
                    }
                    _ => waiting.push(h),
                }
            }
            self.report.cut_edges += u32::from(group.len() > 2);
            same_way |= group.len() > 2;
        }
        same_way
    }

    /// Gives each fan its own vertex; vertices are numbered as triangles first use them.
    fn split(&mut self, vertices: u32) {
        let mut fans = vec![0u32; vertices as usize];
        let mut own = vec![NONE; self.origin.len()];
        for start in 0..self.origin.len() as u32 {
            if own[start as usize] != NONE {
                continue;
            }
            let id = self.vertex.len() as u32;
            let vertex = self.origin[start as usize];
            self.vertex.push(vertex);
            self.report.cut_vertices += u32::from(fans[vertex as usize] > 0);
            fans[vertex as usize] += 1;
            // To one side until the border or back at the start, then to the other.
            let mut h = start;
            loop {
                own[h as usize] = id;
                h = self.twin[prev(h) as usize];
                if h == NONE || h == start {
                    break;
                }
            }
            let mut beyond = self.twin[start as usize];
            while h == NONE && beyond != NONE {
                own[next(beyond) as usize] = id;
                beyond = self.twin[next(beyond) as usize];
            }
        }
        self.report.unused = fans.iter().filter(|fans| **fans == 0).count() as u32;
        self.origin = own;
    }

    /// Loops of border half-edges, each in the order of its half-edges.
    pub fn borders(&self) -> Vec<Vec<u32>> {
        let mut from = vec![NONE; self.vertex.len()];
        for h in 0..self.origin.len() as u32 {
            if self.twin[h as usize] == NONE {
                from[self.origin[h as usize] as usize] = h;
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
            // Each vertex has one fan, so at most one border leaves it and one comes in.
            while !seen[self.origin[h as usize] as usize] {
                seen[self.origin[h as usize] as usize] = true;
                border.push(h);
                match from[self.target(h) as usize] {
                    NONE => break,
                    following => h = following,
                }
            }
            loops.push(border);
        }
        loops
    }

    fn count(&mut self) {
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
                    let beside = self.twin[h] as usize / 3;
                    if self.twin[h] != NONE && !seen[beside] {
                        seen[beside] = true;
                        stack.push(beside);
                    }
                }
            }
        }
    }

    /// Vertices - edges + triangles.
    pub fn euler(&self) -> i64 {
        let open = self.twin.iter().filter(|twin| **twin == NONE).count();
        let edges = (self.twin.len() + open) / 2;
        self.vertex.len() as i64 - edges as i64 + self.triangles() as i64
    }

    /// Whether all that is said of a half-edge mesh holds.
    pub fn is_sound(&self) -> bool {
        let mut first = vec![NONE; self.vertex.len()];
        let mut fan = vec![0u32; self.vertex.len()];
        for h in 0..self.origin.len() as u32 {
            let twin = self.twin[h as usize];
            if twin != NONE {
                let back = self.twin[twin as usize] == h && twin != h;
                if !back || self.origin[twin as usize] != self.target(h) || self.origin[h as usize] != self.target(twin)
                {
                    return false;
                }
            }
            let vertex = self.origin[h as usize] as usize;
            fan[vertex] += 1;
            // At a border, begin where the fan begins.
            if first[vertex] == NONE || twin == NONE {
                first[vertex] = h;
            }
        }
        // Around each vertex all its triangles are met.
        first.iter().zip(&fan).all(|(&start, &size)| {
            let (mut h, mut met) = (start, 0);
            while h != NONE && met <= size {
                met += 1;
                h = self.twin[prev(h) as usize];
                if h == start {
                    break;
                }
            }
            met == size && size > 0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(triangles: &[[u32; 3]], vertices: u32) -> RepairReport {
        let pieces = HalfEdgeMesh::new(triangles, vertices);
        assert!(pieces.is_sound());
        pieces.report
    }

    #[test]
    fn a_tetrahedron_is_closed() {
        let pieces = HalfEdgeMesh::new(&[[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], 4);
        assert!(pieces.is_sound());
        assert_eq!(pieces.report, RepairReport { pieces: 1, ..RepairReport::default() });
        assert_eq!(pieces.euler(), 2);
    }

    #[test]
    fn what_is_wrong_is_counted() {
        let found = report(&[[0, 1, 2], [1, 2, 0], [2, 2, 3], [0, 9, 1]], 5);
        let wanted =
            RepairReport { duplicate: 1, degenerate: 2, unused: 2, pieces: 1, borders: 1, ..RepairReport::default() };
        assert_eq!(found, wanted);
    }

    #[test]
    fn three_triangles_on_an_edge_are_cut() {
        let found = report(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]], 5);
        assert_eq!((found.cut_edges, found.pieces, found.cut_vertices), (1, 2, 2));
    }

    #[test]
    fn an_hourglass_is_cut_at_its_waist() {
        let found = report(&[[0, 1, 2], [0, 3, 4]], 5);
        assert_eq!((found.cut_vertices, found.pieces, found.borders), (1, 2, 2));
    }

    #[test]
    fn one_that_is_turned_around_is_turned_back() {
        let found = report(&[[0, 1, 2], [1, 3, 2], [1, 4, 3], [5, 3, 4], [6, 5, 4], [2, 7, 3]], 8);
        assert_eq!((found.turned, found.pieces, found.borders), (1, 1, 1));
    }

    #[test]
    fn a_moebius_band_is_cut_once() {
        let band: Vec<[u32; 3]> = (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect();
        let found = report(&band, 5);
        assert_eq!(found.pieces, 1);
        assert_eq!(found.cut_edges, 1);
    }
}
