//! Multipatches: strips, fans and lists of triangles, and polygons of rings in space.
//!
//! Seen from outside, triangles and outer rings are clockwise, so all are turned round here.

use crate::vector::geometry::{Geometry, Ring};
use insula_source::object::TriangleMesh;

/// A part of a shape, and what a multipatch says it is.
pub(super) struct Part {
    pub(super) kind: u32,
    pub(super) ring: Ring,
}

const TRIANGLE_STRIP: u32 = 0;
const TRIANGLE_FAN: u32 = 1;
const OUTER_RING: u32 = 2;
const INNER_RING: u32 = 3;
const FIRST_RING: u32 = 4;
const RING: u32 = 5;
const TRIANGLES: u32 = 6;

pub(super) fn add(parts: Vec<Part>, geometry: &mut Geometry, problems: &mut Vec<&'static str>) {
    geometry.is_surface = true;
    for Part { kind, mut ring } in parts {
        if kind == TRIANGLE_STRIP || kind == TRIANGLE_FAN || kind == TRIANGLES {
            match mesh(kind, ring) {
                Some(mesh) => geometry.meshes.push(mesh),
                None => problems.push("patch has fewer than three points"),
            }
            continue;
        }
        ring.reverse();
        let is_hole = match kind {
            INNER_RING => true,
            RING => {
                geometry.polygons.last().and_then(|polygon| polygon.first()).is_some_and(|outer| lies_in(outer, &ring))
            }
            OUTER_RING | FIRST_RING => false,
            _ => {
                problems.push("patch of unknown type");
                continue;
            }
        };
        match geometry.polygons.last_mut() {
            Some(polygon) if is_hole => polygon.push(ring),
            _ => geometry.push_polygon(vec![ring]),
        }
    }
}

/// Triangles of a strip, a fan or a list; `None` if there are none.
fn mesh(kind: u32, positions: Ring) -> Option<TriangleMesh> {
    let count = u32::try_from(positions.len()).ok()?;
    let triangles: Vec<[u32; 3]> = match kind {
        TRIANGLE_STRIP => (2..count).map(|i| if i % 2 == 0 { [i - 2, i, i - 1] } else { [i - 1, i, i - 2] }).collect(),
        TRIANGLE_FAN => (2..count).map(|i| [0, i, i - 1]).collect(),
        _ => (0..count / 3).map(|i| [3 * i, 3 * i + 2, 3 * i + 1]).collect(),
    };
    (!triangles.is_empty()).then(|| TriangleMesh { positions, triangles, ..TriangleMesh::default() })
}

/// Whether a ring's box is within that of another, and smaller: the ring may then be a hole in it.
fn lies_in(outer: &Ring, ring: &Ring) -> bool {
    let bounds = |ring: &Ring| {
        let fold = |start: f64, take: fn(f64, f64) -> f64| {
            ring.iter()
                .fold([start; 3], |bounds, p| [take(bounds[0], p[0]), take(bounds[1], p[1]), take(bounds[2], p[2])])
        };
        (fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max))
    };
    let ((low, high), (ring_low, ring_high)) = (bounds(outer), bounds(ring));
    let is_within = (0..3).all(|axis| ring_low[axis] >= low[axis] && ring_high[axis] <= high[axis]);
    is_within && (ring_low, ring_high) != (low, high)
}
