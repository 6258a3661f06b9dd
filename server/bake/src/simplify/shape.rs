//! A half-edge mesh whose edges can be collapsed.
//!
//! In: [`Pieces`]. Out: fewer triangles. Next: `simplify`.

use super::quadric::Quadric;
use glam::DVec3;
use insula_protocol::mesh::pieces::{NONE, Pieces, next, prev};

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

/// A mesh in work.
#[derive(Debug)]
pub(super) struct Shape {
    pub(super) origin: Vec<u32>,
    pub(super) twin: Vec<u32>,
    /// For each triangle.
    pub(super) alive: Vec<bool>,
    pub(super) triangles: usize,
    pub(super) vertex: Vec<Vertex>,
    /// For each vertex a half-edge that leaves it, the border's if there is one; [`NONE`] for what is gone.
    leaving: Vec<u32>,
    /// For each half-edge, what the corner that it leaves carries: numbers that no two vertices share.
    pub(super) wedge: Vec<u32>,
    /// For each vertex the one of the input whose place it has, if it is fixed.
    pub(super) source: Vec<u32>,
    marks: Vec<u32>,
    mark: u32,
}

impl Shape {
    pub(super) fn new(pieces: &Pieces, place: impl Iterator<Item = DVec3>, wedge: Vec<u32>) -> Self {
        let quadric = Quadric::default();
        let vertex: Vec<Vertex> = place.map(|place| Vertex { quadric, place, hold: Hold::Free }).collect();
        let mut leaving = vec![NONE; vertex.len()];
        for (h, origin) in (0..).zip(&pieces.origin) {
            let known = &mut leaving[*origin as usize];
            if *known == NONE || pieces.twin[h as usize] == NONE {
                *known = h;
            }
        }
        let triangles = pieces.triangles();
        let mut shape = Self {
            origin: pieces.origin.clone(),
            twin: pieces.twin.clone(),
            alive: vec![true; triangles],
            triangles,
            marks: vec![0; vertex.len()],
            vertex,
            leaving,
            wedge,
            source: pieces.vertex.clone(),
            mark: 0,
        };
        let mut lines = vec![0u32; shape.vertex.len()];
        for h in 0..shape.origin.len() as u32 {
            if shape.is_line(h) {
                lines[shape.origin[h as usize] as usize] += 1;
                if shape.twin[h as usize] == NONE {
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
    pub(super) fn place(&self, vertex: u32) -> DVec3 {
        self.vertex[vertex as usize].place
    }

    #[inline]
    pub(super) fn target(&self, h: u32) -> u32 {
        self.origin[next(h) as usize]
    }

    /// Whether a half-edge lies on a border, or on a seam of what corners carry.
    #[inline]
    pub(super) fn is_line(&self, h: u32) -> bool {
        let twin = self.twin[h as usize];
        twin == NONE
            || self.wedge[h as usize] != self.wedge[next(twin) as usize]
            || self.wedge[next(h) as usize] != self.wedge[twin as usize]
    }

    #[inline]
    pub(super) fn is_border(&self, vertex: u32) -> bool {
        self.twin[self.leaving[vertex as usize] as usize] == NONE
    }

    /// All half-edges that leave a vertex, in turn; at a border from one side to the other.
    #[inline]
    pub(super) fn around(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.leaving[vertex as usize];
        std::iter::successors((first != NONE).then_some(first), move |h| {
            let following = self.twin[prev(*h) as usize];
            (following != NONE && following != first).then_some(following)
        })
    }

    pub(super) fn corners(&self, t: u32) -> [DVec3; 3] {
        [0, 1, 2].map(|k| self.place(self.origin[(3 * t + k) as usize]))
    }

    /// Whether the mesh stays a mesh of the same kind without this edge (the link condition, Dey et al. 1999).
    pub(super) fn may_collapse(&mut self, h: u32) -> bool {
        let (u, v) = (self.origin[h as usize], self.target(h));
        let twin = self.twin[h as usize];
        if twin != NONE && self.is_border(u) && self.is_border(v) {
            return false;
        }
        self.mark += 1;
        let mark = self.mark;
        let mut wings = 0;
        for side in [h, twin] {
            if side != NONE {
                wings += 1;
                let apex = self.origin[prev(side) as usize];
                let enough = if self.is_border(apex) { 2 } else { 4 };
                if self.around(apex).take(enough).count() < enough {
                    return false;
                }
            }
        }
        // Where surfaces were cut apart along an edge, two edges may join the same vertices: without the one, the other would
        // begin where it ends.
        let mut edges = 0;
        let mut h = self.leaving[u as usize];
        let first = h;
        while h != NONE {
            let [other, before] = [self.target(h), self.origin[prev(h) as usize]];
            self.marks[other as usize] = mark;
            self.marks[before as usize] = mark;
            edges += u32::from(other == v);
            h = self.twin[prev(h) as usize];
            if h == NONE {
                edges += u32::from(before == v);
            }
            if h == first {
                break;
            }
        }
        let mut common = 0;
        let mut last = NONE;
        let mut h = self.leaving[v as usize];
        let first = h;
        while h != NONE {
            // Each counts once, by however many edges it is joined.
            let other = self.target(h);
            common += u32::from(std::mem::replace(&mut self.marks[other as usize], 0) == mark);
            last = h;
            h = self.twin[prev(h) as usize];
            if h == first {
                break;
            }
        }
        if last != NONE && self.twin[prev(last) as usize] == NONE {
            let other = self.origin[prev(last) as usize];
            common += u32::from(std::mem::replace(&mut self.marks[other as usize], 0) == mark);
        }
        common == wings && edges == 1
    }

    /// Whether a triangle around `u` or `v` that stays would turn over if both were at `to`.
    pub(super) fn turns_over(&self, u: u32, v: u32, to: DVec3) -> bool {
        let over = |center: u32, other: u32| {
            self.around(center).any(|h| {
                let (a, b) = (self.target(h), self.origin[prev(h) as usize]);
                if a == other || b == other {
                    return false;
                }
                let (a, b, c) = (self.place(a), self.place(b), self.place(center));
                let (before, after) = ((a - c).cross(b - c), (a - to).cross(b - to));
                // Turned by more than 75 degrees, or flattened to a line.
                let (was, is) = (before.length_squared(), after.length_squared());
                let dot = before.dot(after);
                was > 0.0 && (dot <= 0.0 || dot * dot < 0.067 * was * is || is < 1e-6 * was)
            })
        };
        over(u, v) || over(v, u)
    }

    /// Collapses a half-edge: its target becomes its origin, which is put at `to`.
    pub(super) fn collapse(&mut self, h: u32, to: DVec3) {
        let (u, v) = (self.origin[h as usize], self.target(h));
        let twin = self.twin[h as usize];
        // On either side the target's wedge becomes the origin's.
        let mut renamed = [(self.wedge[next(h) as usize], self.wedge[h as usize]), (NONE, NONE)];
        if twin != NONE {
            renamed[1] = (self.wedge[twin as usize], self.wedge[next(twin) as usize]);
        }
        let first = self.leaving[v as usize];
        let mut out = first;
        while out != NONE {
            self.origin[out as usize] = u;
            let wedge = &mut self.wedge[out as usize];
            if let Some((_, new)) = renamed.iter().find(|(old, _)| old == wedge) {
                *wedge = *new;
            }
            out = self.twin[prev(out) as usize];
            if out == first {
                break;
            }
        }
        let mut mended = [(u, NONE); 3];
        for (i, side) in [h, twin].into_iter().enumerate() {
            if side == NONE {
                continue;
            }
            self.alive[side as usize / 3] = false;
            self.triangles -= 1;
            let apex = self.origin[prev(side) as usize];
            let (one, other) = (self.twin[next(side) as usize], self.twin[prev(side) as usize]);
            if one != NONE {
                self.twin[one as usize] = other;
            }
            if other != NONE {
                self.twin[other as usize] = one;
            }
            // `one` leaves the apex, `other` comes to it, and after that leaves it.
            mended[1 + i] = (apex, if one != NONE { one } else { next(other) });
            mended[0] = (u, if other != NONE { other } else { next(one) });
        }
        // The second side's edges run the other way: what leaves is known by its origin.
        for (vertex, out) in mended {
            // What left it before and is still there is still the border's, if there is one.
            let known = vertex != u && self.alive[self.leaving[vertex as usize] as usize / 3];
            if out != NONE && !known {
                self.leave_by(vertex, out);
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

    /// Remembers a half-edge that leaves `vertex`: the border's if one is met going back.
    fn leave_by(&mut self, vertex: u32, out: u32) {
        let start = if self.origin[out as usize] == vertex { out } else { next(out) };
        let mut h = start;
        loop {
            let twin = self.twin[h as usize];
            if twin == NONE {
                break;
            }
            h = next(twin);
            if h == start {
                break;
            }
        }
        self.leaving[vertex as usize] = h;
    }

    /// Takes a triangle out of a part that leaves as a whole.
    pub(super) fn remove(&mut self, t: u32) {
        if std::mem::replace(&mut self.alive[t as usize], false) {
            self.triangles -= 1;
            for h in 3 * t..3 * t + 3 {
                self.leaving[self.origin[h as usize] as usize] = NONE;
            }
        }
    }
}
