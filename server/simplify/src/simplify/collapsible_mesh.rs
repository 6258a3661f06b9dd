//! A half-edge mesh whose edges can be collapsed: its connectivity, and how its vertices may move.
//!
//! Half-edge `4 t + k` goes from corner `k` of triangle `t` to the next corner; a fourth number per triangle is unused,
//! which makes divisions cheap. Around each vertex there is one fan of triangles, closed or open at one border, as in
//! [`HalfEdgeMesh`]. Removed triangles stay in place and are marked as not alive.

use super::quadric::Quadric;
use glam::DVec3;
use insula_protocol::mesh::half_edge::{HalfEdgeMesh, NONE};
use std::ops::Range;

/// The next half-edge of the same triangle.
#[inline]
pub(super) const fn next(h: u32) -> u32 {
    if h & 3 == 2 { h - 2 } else { h + 1 }
}

/// The previous half-edge of the same triangle.
#[inline]
pub(super) const fn prev(h: u32) -> u32 {
    if h & 3 == 0 { h + 2 } else { h - 1 }
}

/// The half-edges of a triangle.
#[inline]
pub(super) fn edges_of(t: u32) -> Range<u32> {
    4 * t..4 * t + 3
}

/// How a vertex may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VertexConstraint {
    Free,
    /// Only along the border or seam that it is on.
    Feature,
    /// Not at all.
    Fixed,
}

/// What a collapse needs of a vertex, in two cache lines.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(super) struct MeshVertex {
    pub(super) quadric: Quadric,
    pub(super) position: DVec3,
    pub(super) constraint: VertexConstraint,
}

const _: () = assert!(size_of::<MeshVertex>() == 128);

/// A triangle, in half a cache line. The fourth item of each array is unused.
#[derive(Debug, Clone)]
#[repr(align(32))]
pub(super) struct HalfEdgeTriangle {
    /// The vertices from which its half-edges start.
    pub(super) origin: [u32; 4],
    /// The opposite half-edges in the neighbouring triangles, or [`NONE`] at a border.
    pub(super) twin: [u32; 4],
}

/// The neighbourhood of a vertex.
#[derive(Debug, Default)]
pub(super) struct VertexRing {
    /// The half-edges that leave the vertex, in their order around it; at a border from one side to the other.
    pub(super) spokes: Vec<u32>,
    /// The vertices they go to, followed by the last one at a border, otherwise by the first one again.
    pub(super) rim: Vec<u32>,
    /// Whether the vertex is on a border.
    pub(super) is_open: bool,
}

/// A mesh while it is simplified.
#[derive(Debug)]
pub(super) struct CollapsibleMesh {
    pub(super) faces: Vec<HalfEdgeTriangle>,
    /// For each face, whether it remains.
    pub(super) is_alive: Vec<bool>,
    /// Number of faces that remain.
    pub(super) triangles: usize,
    pub(super) vertices: Vec<MeshVertex>,
    /// For each vertex a half-edge that leaves it, at a border the border's; [`NONE`] for removed vertices.
    pub(super) outgoing: Vec<u32>,
    /// For each half-edge, the wedge of the corner that it starts from. Empty if corners carry nothing.
    pub(super) wedges: Vec<u32>,
    /// For each vertex the one of the input that it comes from. Exact for fixed vertices only.
    pub(super) source: Vec<u32>,
    /// For each vertex, the last mark that it got; scratch memory of [`Self::can_collapse`].
    pub(super) marks: Vec<u32>,
    pub(super) mark: u32,
    /// The neighbourhoods of both ends of the edge that [`Self::can_collapse`] tested last.
    pub(super) rings: [VertexRing; 2],
}

impl CollapsibleMesh {
    /// `wedges` has one item per half-edge of the pieces, or none. Vertices on one border or seam may move along it,
    /// those where several meet or one ends are fixed.
    pub(super) fn new(pieces: &HalfEdgeMesh, positions: impl Iterator<Item = DVec3>, wedges: &[u32]) -> Self {
        let quadric = Quadric::default();
        let constraint = VertexConstraint::Free;
        let vertices: Vec<MeshVertex> =
            positions.map(|position| MeshVertex { quadric, position, constraint }).collect();
        let renumbered = |h: u32| if h == NONE { NONE } else { h + h / 3 };
        let (origins, twins) = (pieces.origin.as_chunks::<3>().0, pieces.twin.as_chunks::<3>().0);
        let faces: Vec<HalfEdgeTriangle> = origins
            .iter()
            .zip(twins)
            .map(|([a, b, c], [x, y, z])| HalfEdgeTriangle {
                origin: [*a, *b, *c, NONE],
                twin: [renumbered(*x), renumbered(*y), renumbered(*z), NONE],
            })
            .collect();
        let mut outgoing = vec![NONE; vertices.len()];
        for (t, face) in (0..).zip(&faces) {
            for h in edges_of(t) {
                let known = &mut outgoing[face.origin[h as usize & 3] as usize];
                if *known == NONE || face.twin[h as usize & 3] == NONE {
                    *known = h;
                }
            }
        }
        let mut mesh = Self {
            is_alive: vec![true; faces.len()],
            triangles: faces.len(),
            faces,
            marks: vec![0; vertices.len()],
            vertices,
            outgoing,
            wedges: wedges.as_chunks::<3>().0.iter().flat_map(|[a, b, c]| [*a, *b, *c, NONE]).collect(),
            source: pieces.vertex.clone(),
            mark: 0,
            rings: Default::default(),
        };
        mesh.constrain_features();
        mesh
    }

    /// Constrains the vertices of borders and seams.
    fn constrain_features(&mut self) {
        let mut feature_edges = vec![0u32; self.vertices.len()];
        for h in (0..self.is_alive.len() as u32).flat_map(edges_of) {
            if self.is_feature(h) {
                feature_edges[self.origin(h) as usize] += 1;
                if self.twin(h) == NONE {
                    feature_edges[self.target(h) as usize] += 1;
                }
            }
        }
        for (vertex, feature_edges) in self.vertices.iter_mut().zip(feature_edges) {
            vertex.constraint = match feature_edges {
                0 => VertexConstraint::Free,
                2 => VertexConstraint::Feature,
                _ => VertexConstraint::Fixed,
            };
        }
    }

    /// The vertex from which a half-edge starts.
    #[inline]
    pub(super) fn origin(&self, h: u32) -> u32 {
        self.faces[h as usize / 4].origin[h as usize & 3]
    }

    /// The vertex to which a half-edge goes.
    #[inline]
    pub(super) fn target(&self, h: u32) -> u32 {
        self.origin(next(h))
    }

    /// The opposite half-edge, or [`NONE`] at a border.
    #[inline]
    pub(super) fn twin(&self, h: u32) -> u32 {
        self.faces[h as usize / 4].twin[h as usize & 3]
    }

    #[inline]
    pub(super) fn set_twin(&mut self, h: u32, twin: u32) {
        self.faces[h as usize / 4].twin[h as usize & 3] = twin;
    }

    #[inline]
    pub(super) fn position(&self, vertex: u32) -> DVec3 {
        self.vertices[vertex as usize].position
    }

    /// The positions of a triangle's corners.
    pub(super) fn corners(&self, t: u32) -> [DVec3; 3] {
        let [a, b, c, _] = self.faces[t as usize].origin;
        [a, b, c].map(|vertex| self.position(vertex))
    }

    /// The wedge of the corner that a half-edge starts from. Must not be called if corners carry nothing.
    #[inline]
    pub(super) fn wedge(&self, h: u32) -> usize {
        self.wedges[h as usize] as usize
    }

    /// Whether a half-edge lies on a border, or on a seam between wedges.
    #[inline]
    pub(super) fn is_feature(&self, h: u32) -> bool {
        let twin = self.twin(h);
        twin == NONE
            || !self.wedges.is_empty()
                && (self.wedge(h) != self.wedge(next(twin)) || self.wedge(next(h)) != self.wedge(twin))
    }

    #[inline]
    pub(super) fn is_on_border(&self, vertex: u32) -> bool {
        self.twin(self.outgoing[vertex as usize]) == NONE
    }
}
