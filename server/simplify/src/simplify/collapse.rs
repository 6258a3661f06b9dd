//! Collapsing an edge of a half-edge mesh.
//!
//! The caller first asks [`CollapsibleMesh::can_collapse`], which also stores the neighbourhoods of both ends. Then
//! [`CollapsibleMesh::flips_triangles`] and [`CollapsibleMesh::collapse`] use them for the same edge.

use super::collapsible_mesh::{CollapsibleMesh, VertexConstraint, VertexRing, edges_of, next, prev};
use glam::DVec3;
use insula_protocol::mesh::half_edge::NONE;

/// Squared cosine of the largest rotation of a triangle: 75 degrees.
const MIN_SQUARED_COSINE: f64 = 0.067;
/// A triangle whose squared area shrinks to less than this share counts as degenerate.
const MIN_AREA_SHARE: f64 = 1e-6;

/// A vertex that may need another outgoing half-edge after a collapse.
#[derive(Debug, Clone, Copy)]
struct OutgoingUpdate {
    vertex: u32,
    /// A half-edge that leaves the vertex or comes to it, or [`NONE`].
    half_edge: u32,
    has_border: bool,
}

impl VertexRing {
    /// The vertices that the vertex shares an edge with, once per edge.
    #[inline]
    fn neighbours(&self) -> &[u32] {
        &self.rim[..self.spokes.len() + usize::from(self.is_open)]
    }
}

impl CollapsibleMesh {
    /// Walks around a vertex.
    #[inline]
    fn collect_ring(&self, vertex: u32, ring: &mut VertexRing) {
        ring.spokes.clear();
        ring.rim.clear();
        ring.is_open = false;
        let first = self.outgoing[vertex as usize];
        let mut h = first;
        while h != NONE {
            ring.spokes.push(h);
            ring.rim.push(self.target(h));
            let incoming = prev(h);
            h = self.twin(incoming);
            if h == NONE {
                ring.rim.push(self.origin(incoming));
                ring.is_open = true;
            } else if h == first {
                ring.rim.push(ring.rim[0]);
                break;
            }
        }
    }

    /// Whether so few triangles meet at the corner opposite a half-edge that a collapse would leave none there, or two
    /// with the same corners.
    fn is_narrow(&self, h: u32) -> bool {
        let (one, other) = (self.twin(next(h)), self.twin(prev(h)));
        match (one, other) {
            (NONE, NONE) => true,
            (NONE, _) | (_, NONE) => false,
            _ => one / 4 == other / 4 || self.twin(prev(one)) == next(other),
        }
    }

    /// Whether the mesh stays manifold, with the same topology, when this edge is collapsed (the link condition, Dey et
    /// al. 1999): its ends have no common neighbours besides the apexes of its triangles.
    pub(super) fn can_collapse(&mut self, h: u32) -> bool {
        let (u, v) = (self.origin(h), self.target(h));
        let twin = self.twin(h);
        if twin != NONE && self.is_on_border(u) && self.is_on_border(v) {
            return false;
        }
        if self.is_narrow(h) || twin != NONE && self.is_narrow(twin) {
            return false;
        }
        let mut rings = std::mem::take(&mut self.rings);
        self.collect_ring(u, &mut rings[0]);
        self.collect_ring(v, &mut rings[1]);
        self.mark += 1;
        // Where surfaces were cut apart along an edge, two edges may join the same vertices. Collapsing one would turn
        // the other into a loop.
        let mut shared_edges = 0;
        for &neighbour in rings[0].neighbours() {
            self.marks[neighbour as usize] = self.mark;
            shared_edges += u32::from(neighbour == v);
        }
        // The mark is cleared, so that a vertex counts once however many edges lead to it.
        let mut common = 0;
        for &neighbour in rings[1].neighbours() {
            common += u32::from(std::mem::replace(&mut self.marks[neighbour as usize], 0) == self.mark);
        }
        self.rings = rings;
        common == 1 + u32::from(twin != NONE) && shared_edges == 1
    }

    /// Whether a triangle around the ends `u` and `v` of the tested edge would flip, or become degenerate, if both were
    /// at `to`.
    pub(super) fn flips_triangles(&self, u: u32, v: u32, to: DVec3) -> bool {
        let flips = |centre: u32, other: u32, rim: &[u32]| {
            let centre = self.position(centre);
            rim.windows(2).any(|pair| {
                // The triangles of the edge itself are removed.
                if pair.contains(&other) {
                    return false;
                }
                let (a, b) = (self.position(pair[0]), self.position(pair[1]));
                let (before, after) = ((a - centre).cross(b - centre), (a - to).cross(b - to));
                let (was, is) = (before.length_squared(), after.length_squared());
                let dot = before.dot(after);
                was > 0.0 && (dot <= 0.0 || dot * dot < MIN_SQUARED_COSINE * was * is || is < MIN_AREA_SHARE * was)
            })
        };
        flips(u, v, &self.rings[0].rim) || flips(v, u, &self.rings[1].rim)
    }

    /// Collapses the tested edge: its target is removed, and its origin moves to `to`.
    pub(super) fn collapse(&mut self, h: u32, to: DVec3) {
        let (u, v) = (self.origin(h), self.target(h));
        let twin = self.twin(h);
        let has_border = self.is_on_border(u) || self.is_on_border(v);
        self.rename_wedges(h, twin);
        for i in 0..self.rings[1].spokes.len() {
            let spoke = self.rings[1].spokes[i];
            self.faces[spoke as usize / 4].origin[spoke as usize & 3] = u;
        }
        let mut updates = [OutgoingUpdate { vertex: u, half_edge: NONE, has_border }; 3];
        for (i, side) in [h, twin].into_iter().enumerate().filter(|(_, side)| *side != NONE) {
            (updates[1 + i], updates[0].half_edge) = self.remove_side(side);
        }
        for update in updates {
            let is_known = update.vertex != u && self.is_alive[self.outgoing[update.vertex as usize] as usize / 4];
            if update.half_edge != NONE && !is_known {
                self.set_outgoing(update);
            }
        }
        self.vertices[u as usize].position = to;
        self.outgoing[v as usize] = NONE;
        self.merge_constraints(u, v);
    }

    /// Removes the triangle of a half-edge that is collapsed, and joins the triangles on its other two edges. Returns
    /// the update of the triangle's apex, and a half-edge that touches the remaining vertex.
    fn remove_side(&mut self, side: u32) -> (OutgoingUpdate, u32) {
        self.is_alive[side as usize / 4] = false;
        self.triangles -= 1;
        let apex = self.origin(prev(side));
        let has_border = self.is_on_border(apex);
        let (one, other) = (self.twin(next(side)), self.twin(prev(side)));
        if one != NONE {
            self.set_twin(one, other);
        }
        if other != NONE {
            self.set_twin(other, one);
        }
        // `one` leaves the apex. `other` comes to it, and the half-edge after `other` leaves it.
        let from_apex = if one != NONE { one } else { next(other) };
        let at_origin = if other != NONE { other } else { next(one) };
        (OutgoingUpdate { vertex: apex, half_edge: from_apex, has_border }, at_origin)
    }

    /// Gives the remaining vertex the stricter of both constraints. A fixed vertex keeps its source.
    fn merge_constraints(&mut self, u: u32, v: u32) {
        use VertexConstraint::{Feature, Fixed, Free};
        let removed = self.vertices[v as usize].constraint;
        if removed == Fixed {
            self.source[u as usize] = self.source[v as usize];
        }
        let kept = &mut self.vertices[u as usize];
        kept.constraint = match (kept.constraint, removed) {
            (Fixed, _) | (_, Fixed) => Fixed,
            (Feature, _) | (_, Feature) => Feature,
            _ => Free,
        };
    }

    /// Replaces the wedges of the edge's target by those of its origin, on either side of the edge.
    fn rename_wedges(&mut self, h: u32, twin: u32) {
        if self.wedges.is_empty() {
            return;
        }
        let mut renamed = [(self.wedge(next(h)), self.wedge(h)), (NONE as usize, 0)];
        if twin != NONE {
            renamed[1] = (self.wedge(twin), self.wedge(next(twin)));
        }
        for spoke in &self.rings[1].spokes {
            let wedge = &mut self.wedges[*spoke as usize];
            if let Some((_, new)) = renamed.iter().find(|(old, _)| *old == *wedge as usize) {
                *wedge = *new as u32;
            }
        }
    }

    /// Sets the half-edge that leaves a vertex: at a border, the one found by walking back to the border.
    fn set_outgoing(&mut self, update: OutgoingUpdate) {
        let OutgoingUpdate { vertex, half_edge, has_border } = update;
        // A half-edge of the second side may come to the vertex instead of leaving it.
        let start = if self.origin(half_edge) == vertex { half_edge } else { next(half_edge) };
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
        self.outgoing[vertex as usize] = h;
    }

    /// Removes a triangle of a part that is removed as a whole.
    pub(super) fn remove(&mut self, t: u32) {
        if std::mem::replace(&mut self.is_alive[t as usize], false) {
            self.triangles -= 1;
            for h in edges_of(t) {
                let vertex = self.origin(h);
                self.outgoing[vertex as usize] = NONE;
            }
        }
    }
}
