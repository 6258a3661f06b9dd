//! The solids of one tile: the shapes of its columns or triangles, without their appearance.

mod column_solids;

pub use column_solids::ColumnSolids;
use glam::{DVec2, DVec3, U16Vec3, Vec3Swizzles};
use insula_protocol::mesh::Mesh;
use serde::{Deserialize, Serialize};

/// A solid above and below a point: heights of bottom and top. An open bottom is minus infinity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolidInterval {
    pub bottom: f64,
    pub top: f64,
}

/// The solids of a tile, in metres from the south-west corner of its node and the city's height zero.
#[derive(Debug, Clone, Copy)]
pub(crate) enum TileSolids<'a> {
    Columns(&'a ColumnSolids),
    Mesh(&'a MeshSolids),
}

impl TileSolids<'_> {
    /// The solids above and below a place.
    pub(crate) fn intervals_at(&self, p: DVec2) -> Vec<SolidInterval> {
        match self {
            Self::Columns(columns) => columns.intervals_at(p),
            Self::Mesh(mesh) => mesh.intervals_at(p),
        }
    }

    /// Where the way from `start` along `way` first meets a solid, from `span[0]` to `span[1]` of it.
    pub(crate) fn first_hit(&self, start: DVec3, way: DVec3, span: [f64; 2]) -> Option<f64> {
        match self {
            Self::Columns(columns) => columns.first_hit(start, way, span),
            Self::Mesh(mesh) => mesh.first_hit(start, way, span),
        }
    }
}

/// Where a line crosses the borders ahead of it of a square that it is in, by axis, in shares of `way`; infinity if never.
pub(crate) fn exits_of(square: [DVec2; 2], start: DVec2, way: DVec2) -> DVec2 {
    let exit = |axis: usize| match way[axis] {
        0.0 => f64::INFINITY,
        along => (square[usize::from(along > 0.0)][axis] - start[axis]) / along,
    };
    DVec2::new(exit(0), exit(1))
}

/// Surfaces above each other that are nearer than this many metres are one.
const TIE_M: f64 = 0.02;
/// Least z of a unit normal of a surface that a vertical line crosses.
const MIN_NORMAL_Z: f64 = 1e-4;
/// Slack of barycentric coordinates, so that no line slips between two triangles.
const EDGE_SLACK: f64 = 1e-6;

/// The solids of a resident mesh: its triangles without their appearance, 18 bytes each.
///
/// Triangles are counter-clockwise as seen from outside, which tells a roof from a ceiling. A city's meshes need not be closed:
/// faces that nobody sees may be missing, such as floors. So a roof without a ceiling below it stands on the ground.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MeshSolids {
    /// Corners on the mesh's grid.
    triangles: Box<[[U16Vec3; 3]]>,
    /// Lowest corner of the grid.
    min_m: DVec3,
    step_m: f64,
}

struct SurfaceCrossing {
    z: f64,
    /// Whether it is a roof or ground, not a ceiling.
    faces_up: bool,
}

impl MeshSolids {
    /// The solids of a decoded mesh, whose decoder has checked its grid. Triangles of missing vertices are left out.
    pub fn new(mesh: &Mesh) -> Self {
        let corner = |vertex: u32| {
            let [x, y, z] = *mesh.positions.get(vertex as usize)?;
            Some(U16Vec3::new(u16::try_from(x).ok()?, u16::try_from(y).ok()?, u16::try_from(z).ok()?))
        };
        let triangles = mesh.triangles.iter().filter_map(|[a, b, c]| Some([corner(*a)?, corner(*b)?, corner(*c)?]));
        Self { triangles: triangles.collect(), min_m: mesh.grid.min.into(), step_m: mesh.grid.step }
    }

    /// The solids at `p`, metres from the south-west corner, as heights above the city's height zero, from top to bottom.
    pub fn intervals_at(&self, p: DVec2) -> Vec<SolidInterval> {
        let place = (p - self.min_m.xy()) / self.step_m;
        let mut crossings: Vec<SurfaceCrossing> =
            self.triangles.iter().filter_map(|t| self.crossing(t, place)).collect();
        crossings.sort_by(|a, b| b.z.total_cmp(&a.z));
        let mut intervals = Vec::new();
        let mut top = None;
        for surface in crossings.chunk_by(|a, b| a.z - b.z <= TIE_M) {
            let (z, has_roof) = (surface[0].z, surface.iter().any(|crossing| crossing.faces_up));
            let has_ceiling = surface.iter().any(|crossing| !crossing.faces_up);
            // Both at once: below a roof, a part that stands on another; else a thin sheet.
            let stands_on_another = top.is_some() && has_ceiling && has_roof;
            if has_roof && top.is_none() {
                top = Some(z);
            }
            // A roof in a solid is hidden: that of a part that touches another.
            if has_ceiling && let Some(top) = top.take() {
                intervals.push(SolidInterval { bottom: z, top });
            }
            if stands_on_another {
                top = Some(z);
            }
        }
        intervals.extend(top.map(|top| SolidInterval { bottom: f64::NEG_INFINITY, top }));
        intervals
    }

    /// Where a vertical line through a place of the grid crosses a triangle.
    fn crossing(&self, triangle: &[U16Vec3; 3], place: DVec2) -> Option<SurfaceCrossing> {
        let [low, high] = [U16Vec3::min, U16Vec3::max].map(|pick| pick(pick(triangle[0], triangle[1]), triangle[2]));
        let is_beside = place.x < f64::from(low.x)
            || place.y < f64::from(low.y)
            || place.x > f64::from(high.x)
            || place.y > f64::from(high.y);
        if is_beside {
            return None;
        }
        let [a, b, c] = triangle.map(|corner| corner.as_dvec3());
        let (e1, e2, d) = (b - a, c - a, place - a.xy());
        let normal = e1.cross(e2);
        if normal.z.abs() <= MIN_NORMAL_Z * normal.length() {
            return None;
        }
        let u = d.perp_dot(e2.xy()) / normal.z;
        let v = e1.xy().perp_dot(d) / normal.z;
        let is_within = u >= -EDGE_SLACK && v >= -EDGE_SLACK && u + v <= 1.0 + EDGE_SLACK;
        let z = self.min_m.z + (a.z + e1.z * u + e2.z * v) * self.step_m;
        is_within.then_some(SurfaceCrossing { z, faces_up: normal.z > 0.0 })
    }

    /// Where the way from `start` along `way` first meets a triangle from either side, from `span[0]` to `span[1]` of it (Möller
    /// and Trumbore 1997).
    pub(crate) fn first_hit(&self, start: DVec3, way: DVec3, span: [f64; 2]) -> Option<f64> {
        let (o, d) = ((start - self.min_m) / self.step_m, way / self.step_m);
        let [from, to] = span.map(|t| o + d * t);
        let (low, high) = (from.min(to), from.max(to));
        let hit = |triangle: &[U16Vec3; 3]| {
            let [a, b, c] = triangle.map(|corner| corner.as_dvec3());
            if a.max(b).max(c).cmplt(low).any() || a.min(b).min(c).cmpgt(high).any() {
                return None;
            }
            let (e1, e2, start) = (b - a, c - a, o - a);
            let p = d.cross(e2);
            let scale = 1.0 / e1.dot(p);
            let q = start.cross(e1);
            let (u, v, t) = (start.dot(p) * scale, d.dot(q) * scale, e2.dot(q) * scale);
            let is_within = u >= -EDGE_SLACK && v >= -EDGE_SLACK && u + v <= 1.0 + EDGE_SLACK;
            (is_within && span[0] <= t && t <= span[1]).then_some(t)
        };
        self.triangles.iter().filter_map(hit).min_by(f64::total_cmp)
    }
}
