//! A half-edge mesh whose edges can be collapsed.
//!
//! In: [`HalfEdgeMesh`]. Out: fewer triangles. Next: `simplify`.

use super::quadric::Quadric;
use glam::DVec3;
use insula_protocol::mesh::half_edge::{HalfEdgeMesh, NONE};
use std::ops::Range;

/// The next half-edge of the same triangle: `4 t + k` goes from corner `k` of triangle `t`.
#[inline]
pub(super) const fn next(h: u32) -> u32 {
    if h & 3 == 2 { h - 2 } else { h + 1 }
}

/// The one before in the same triangle.
#[inline]
pub(super) const fn prev(h: u32) -> u32 {
    if h & 3 == 0 { h + 2 } else { h - 1 }
}

/// The half-edges of a triangle.
#[inline]
pub(super) fn sides(t: u32) -> Range<u32> {
    4 * t..4 * t + 3
}

/// How a vertex may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hold {
    /// Anywhere.
    Free,
    /// Along the border or seam that it is on.
    Line,
    /// Not at all.
    Fixed,
}

/// What a collapse weighs of a vertex, in two lines of a processor's cache.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct Vertex {
    pub(super) quadric: Quadric,
    pub(super) place: DVec3,
    pub(super) hold: Hold,
}

const _: () = assert!(size_of::<Vertex>() == 128);

/// A triangle, in half a line of the cache; the fourth of each is not used.
#[derive(Debug, Clone)]
#[repr(align(32))]
struct Triangle {
    /// Where its half-edges begin.
    origin: [u32; 4],
    /// What lies beside them.
    twin: [u32; 4],
}

/// A mesh in work.
#[derive(Debug)]
pub(super) struct Shape {
    triangle: Vec<Triangle>,
    /// For each triangle.
    pub(super) alive: Vec<bool>,
    /// How many are alive.
    pub(super) triangles: usize,
    pub(super) vertex: Vec<Vertex>,
    /// For each vertex a half-edge that leaves it, the border's if there is one; [`NONE`] for what is gone.
    leaving: Vec<u32>,
    /// For each half-edge, what the corner that it leaves carries: numbers that no two vertices share. Empty where corners
    /// carry nothing.
    wedge: Vec<u32>,
    /// For each vertex the one of the input whose place it has, if it is fixed.
    pub(super) source: Vec<u32>,
    marks: Vec<u32>,
    mark: u32,
    /// What lies around the two ends of the edge that was last asked about.
    rings: [Ring; 2],
}

/// What lies around a vertex.
#[derive(Debug, Default)]
struct Ring {
    /// The half-edges that leave it, in turn; at a border from one side to the other.
    spokes: Vec<u32>,
    /// Where they go to; at a border then the last vertex of all, otherwise the first again.
    rim: Vec<u32>,
    is_open: bool,
}

impl Shape {
    /// `wedge` is that of the pieces' half-edges, or empty.
    pub(super) fn new(pieces: &HalfEdgeMesh, place: impl Iterator<Item = DVec3>, wedge: &[u32]) -> Self {
        let quadric = Quadric::default();
        let vertex: Vec<Vertex> = place.map(|place| Vertex { quadric, place, hold: Hold::Free }).collect();
        let fourth = |h: u32| if h == NONE { NONE } else { h + h / 3 };
        let (origin, twin) = (pieces.origin.as_chunks::<3>().0, pieces.twin.as_chunks::<3>().0);
        let triangle: Vec<Triangle> = origin
            .iter()
            .zip(twin)
            .map(|([a, b, c], twin)| {
                let [x, y, z] = *twin;
                Triangle { origin: [*a, *b, *c, NONE], twin: [fourth(x), fourth(y), fourth(z), NONE] }
            })
            .collect();
        let mut leaving = vec![NONE; vertex.len()];
        for (t, triangle) in (0..).zip(&triangle) {
            for h in sides(t) {
                let known = &mut leaving[triangle.origin[h as usize & 3] as usize];
                if *known == NONE || triangle.twin[h as usize & 3] == NONE {
                    *known = h;
                }
            }
        }
        let mut shape = Self {
            alive: vec![true; triangle.len()],
            triangles: triangle.len(),
            triangle,
            marks: vec![0; vertex.len()],
            vertex,
            leaving,
            wedge: wedge.as_chunks::<3>().0.iter().flat_map(|[a, b, c]| [*a, *b, *c, NONE]).collect(),
            source: pieces.vertex.clone(),
            mark: 0,
            rings: Default::default(),
        };
        let mut lines = vec![0u32; shape.vertex.len()];
        for h in (0..shape.alive.len() as u32).flat_map(sides) {
            if shape.is_line(h) {
                lines[shape.origin(h) as usize] += 1;
                if shape.twin(h) == NONE {
                    lines[shape.target(h) as usize] += 1;
                }
            }
        }
        for (vertex, lines) in shape.vertex.iter_mut().zip(lines) {
            vertex.hold = match lines {
                0 => Hold::Free,
                2 => Hold::Line,
                _ => Hold::Fixed,
            };
        }
        shape
    }

    #[inline]
    pub(super) fn origin(&self, h: u32) -> u32 {
        self.triangle[h as usize / 4].origin[h as usize & 3]
    }

    #[inline]
    pub(super) fn twin(&self, h: u32) -> u32 {
        self.triangle[h as usize / 4].twin[h as usize & 3]
    }

    #[inline]
    fn set_twin(&mut self, h: u32, twin: u32) {
        self.triangle[h as usize / 4].twin[h as usize & 3] = twin;
    }

    #[inline]
    pub(super) fn place(&self, vertex: u32) -> DVec3 {
        self.vertex[vertex as usize].place
    }

    #[inline]
    pub(super) fn target(&self, h: u32) -> u32 {
        self.origin(next(h))
    }

    /// What the corner that a half-edge leaves carries; only where corners carry something.
    #[inline]
    pub(super) fn wedge(&self, h: u32) -> usize {
        self.wedge[h as usize] as usize
    }

    /// Whether a half-edge lies on a border, or on a seam of what corners carry.
    #[inline]
    pub(super) fn is_line(&self, h: u32) -> bool {
        let twin = self.twin(h);
        twin == NONE
            || !self.wedge.is_empty()
                && (self.wedge(h) != self.wedge(next(twin)) || self.wedge(next(h)) != self.wedge(twin))
    }

    #[inline]
    fn is_border(&self, vertex: u32) -> bool {
        self.twin(self.leaving[vertex as usize]) == NONE
    }

    pub(super) fn corners(&self, t: u32) -> [DVec3; 3] {
        let [a, b, c, _] = self.triangle[t as usize].origin;
        [a, b, c].map(|vertex| self.place(vertex))
    }

    /// Walks around a vertex.
    #[inline]
    fn gather(&self, vertex: u32, ring: &mut Ring) {
        ring.spokes.clear();
        ring.rim.clear();
        ring.is_open = false;
        let first = self.leaving[vertex as usize];
        let mut h = first;
        while h != NONE {
            ring.spokes.push(h);
            ring.rim.push(self.target(h));
            let before = prev(h);
            h = self.twin(before);
            if h == NONE {
                ring.rim.push(self.origin(before));
                ring.is_open = true;
            } else if h == first {
                ring.rim.push(ring.rim[0]);
                break;
            }
        }
    }

    /// Whether the corner across a half-edge has so few triangles that none were left without the edge, or two on each other.
    fn is_narrow(&self, h: u32) -> bool {
        let (one, other) = (self.twin(next(h)), self.twin(prev(h)));
        match (one, other) {
            (NONE, NONE) => true,
            (NONE, _) | (_, NONE) => false,
            _ => one / 4 == other / 4 || self.twin(prev(one)) == next(other),
        }
    }

    /// Whether the mesh stays a mesh of the same kind without this edge (the link condition, Dey et al. 1999).
    pub(super) fn may_collapse(&mut self, h: u32) -> bool {
        let (u, v) = (self.origin(h), self.target(h));
        let twin = self.twin(h);
        if twin != NONE && self.is_border(u) && self.is_border(v) {
            return false;
        }
        if self.is_narrow(h) || twin != NONE && self.is_narrow(twin) {
            return false;
        }
        let mut rings = std::mem::take(&mut self.rings);
        self.gather(u, &mut rings[0]);
        self.gather(v, &mut rings[1]);
        self.mark += 1;
        // Where surfaces were cut apart along an edge, two edges may join the same vertices: without the one, the other would
        // begin where it ends.
        let mut edges = 0;
        for &other in rings[0].others() {
            self.marks[other as usize] = self.mark;
            edges += u32::from(other == v);
        }
        // Each counts once, by however many edges it is joined.
        let mut common = 0;
        for &other in rings[1].others() {
            common += u32::from(std::mem::replace(&mut self.marks[other as usize], 0) == self.mark);
        }
        self.rings = rings;
        common == 1 + u32::from(twin != NONE) && edges == 1
    }

    /// Whether a triangle around the ends of the edge that was last asked about would turn over if both were at `to`.
    pub(super) fn turns_over(&self, u: u32, v: u32, to: DVec3) -> bool {
        let over = |center: u32, other: u32, rim: &[u32]| {
            let center = self.place(center);
            rim.windows(2).any(|pair| {
                if pair.contains(&other) {
                    return false;
                }
                let (a, b) = (self.place(pair[0]), self.place(pair[1]));
                let (before, after) = ((a - center).cross(b - center), (a - to).cross(b - to));
                // Turned by more than 75 degrees, or flattened to a line.
                let (was, is) = (before.length_squared(), after.length_squared());
                let dot = before.dot(after);
                was > 0.0 && (dot <= 0.0 || dot * dot < 0.067 * was * is || is < 1e-6 * was)
            })
        };
        over(u, v, &self.rings[0].rim) || over(v, u, &self.rings[1].rim)
    }

    /// Collapses the half-edge that was last asked about: its target becomes its origin, which is put at `to`.
    pub(super) fn collapse(&mut self, h: u32, to: DVec3) {
        let (u, v) = (self.origin(h), self.target(h));
        let twin = self.twin(h);
        let has_border = self.is_border(u) || self.is_border(v);
        self.rename(h, twin);
        for i in 0..self.rings[1].spokes.len() {
            let spoke = self.rings[1].spokes[i];
            self.triangle[spoke as usize / 4].origin[spoke as usize & 3] = u;
        }
        let mut mended = [(u, NONE, has_border); 3];
        for (i, side) in [h, twin].into_iter().enumerate() {
            if side == NONE {
                continue;
            }
            self.alive[side as usize / 4] = false;
            self.triangles -= 1;
            let apex = self.origin(prev(side));
            let is_border = self.is_border(apex);
            let (one, other) = (self.twin(next(side)), self.twin(prev(side)));
            if one != NONE {
                self.set_twin(one, other);
            }
            if other != NONE {
                self.set_twin(other, one);
            }
            // `one` leaves the apex, `other` comes to it, and after that leaves it.
            mended[1 + i] = (apex, if one != NONE { one } else { next(other) }, is_border);
            mended[0].1 = if other != NONE { other } else { next(one) };
        }
        // The second side's edges run the other way: what leaves is known by its origin.
        for (vertex, out, has_border) in mended {
            // What left it before and is still there is still the border's, if there is one.
            let known = vertex != u && self.alive[self.leaving[vertex as usize] as usize / 4];
            if out != NONE && !known {
                self.leave_by(vertex, out, has_border);
            }
        }
        self.vertex[u as usize].place = to;
        self.leaving[v as usize] = NONE;
        let hold = self.vertex[v as usize].hold;
        if hold == Hold::Fixed {
            self.source[u as usize] = self.source[v as usize];
        }
        let kept = &mut self.vertex[u as usize];
        // A line's end on a free vertex makes that one part of the line; a fixed vertex stays one.
        kept.hold = match (kept.hold, hold) {
            (Hold::Fixed, _) | (_, Hold::Fixed) => Hold::Fixed,
            (Hold::Line, _) | (_, Hold::Line) => Hold::Line,
            _ => Hold::Free,
        };
    }

    /// On either side of an edge, what its target carries becomes what its origin carries.
    fn rename(&mut self, h: u32, twin: u32) {
        if self.wedge.is_empty() {
            return;
        }
        let mut renamed = [(self.wedge(next(h)), self.wedge(h)), (NONE as usize, 0)];
        if twin != NONE {
            renamed[1] = (self.wedge(twin), self.wedge(next(twin)));
        }
        for spoke in &self.rings[1].spokes {
            let wedge = &mut self.wedge[*spoke as usize];
            if let Some((_, new)) = renamed.iter().find(|(old, _)| *old == *wedge as usize) {
                *wedge = *new as u32;
            }
        }
    }

    /// Remembers a half-edge that leaves `vertex`: the border's if it may have one and it is met going back.
    fn leave_by(&mut self, vertex: u32, out: u32, has_border: bool) {
        let start = if self.origin(out) == vertex { out } else { next(out) };
        let mut h = start;
        if has_border {
            loop {
                let twin = self.twin(h);
                if twin == NONE {
                    break;
                }
                h = next(twin);
                if h == start {
                    break;
                }
            }
        }
        self.leaving[vertex as usize] = h;
    }

    /// Takes a triangle out of a part that leaves as a whole.
    pub(super) fn remove(&mut self, t: u32) {
        if std::mem::replace(&mut self.alive[t as usize], false) {
            self.triangles -= 1;
            for h in sides(t) {
                let vertex = self.origin(h);
                self.leaving[vertex as usize] = NONE;
            }
        }
    }
}

impl Ring {
    /// Where each edge goes.
    #[inline]
    fn others(&self) -> &[u32] {
        &self.rim[..self.spokes.len() + usize::from(self.is_open)]
    }
}
