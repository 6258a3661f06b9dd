//! Clips triangles to the square of a leaf (Sutherland and Hodgman 1974).
//!
//! An intersection point is always computed from the two original points of its line, in the order of their
//! coordinates, and never from a point that an earlier clip created. So both squares beside a border, and both
//! triangles beside an edge, get exactly the same points.

use std::array;

/// A corner of a triangle or polygon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PolygonVertex {
    /// Metres from the grid's corner.
    pub(super) p: [f64; 3],
    /// Texture coordinates.
    pub(super) uv: [f32; 2],
}

/// An edge of a polygon, to the start of the next one.
#[derive(Debug, Clone, Copy)]
struct PolygonEdge {
    start: PolygonVertex,
    /// Two points of the line that the edge lies on.
    line: [PolygonVertex; 2],
}

/// A bound of one coordinate.
#[derive(Debug, Clone, Copy)]
enum ClipBound {
    Lower(f64),
    Upper(f64),
}

impl ClipBound {
    fn value(self) -> f64 {
        match self {
            Self::Lower(at) | Self::Upper(at) => at,
        }
    }

    fn contains(self, v: f64) -> bool {
        match self {
            Self::Lower(at) => v >= at,
            Self::Upper(at) => v <= at,
        }
    }
}

/// The part of `triangle` between `low` and `high` in x and y, borders included. It has fewer than three vertices if
/// the triangle lies outside.
pub(super) fn clip_to_square(triangle: [PolygonVertex; 3], low: [f64; 2], high: [f64; 2]) -> Vec<PolygonVertex> {
    let mut edges: Vec<PolygonEdge> =
        (0..3).map(|k| PolygonEdge { start: triangle[k], line: [triangle[k], triangle[(k + 1) % 3]] }).collect();
    for axis in 0..2 {
        edges = clip(&edges, axis, ClipBound::Lower(low[axis]));
        edges = clip(&edges, axis, ClipBound::Upper(high[axis]));
    }
    edges.into_iter().map(|edge| edge.start).collect()
}

/// Clips a convex polygon at one bound of a coordinate.
fn clip(edges: &[PolygonEdge], axis: usize, bound: ClipBound) -> Vec<PolygonEdge> {
    let at = bound.value();
    let is_inside = |vertex: &PolygonVertex| bound.contains(vertex.p[axis]);
    if edges.iter().all(|edge| is_inside(&edge.start)) {
        return edges.to_vec();
    }
    let mut clipped: Vec<PolygonEdge> = Vec::with_capacity(edges.len() + 1);
    // Where the polygon leaves, a new edge runs along the bound to where it enters again.
    let (mut exit_edge, mut entry) = (None, None);
    for (i, edge) in edges.iter().enumerate() {
        let end = &edges[(i + 1) % edges.len()].start;
        let (starts_inside, ends_inside) = (is_inside(&edge.start), is_inside(end));
        if starts_inside {
            clipped.push(*edge);
        }
        if starts_inside && !ends_inside {
            if edge.start.p[axis] != at {
                clipped.push(PolygonEdge { start: intersect(edge.line, axis, at), line: edge.line });
            }
            exit_edge = clipped.len().checked_sub(1);
        } else if ends_inside && !starts_inside {
            if end.p[axis] == at {
                entry = Some(*end);
            } else {
                let start = intersect(edge.line, axis, at);
                clipped.push(PolygonEdge { start, line: edge.line });
                entry = Some(start);
            }
        }
    }
    if let (Some(exit_edge), Some(entry)) = (exit_edge, entry) {
        clipped[exit_edge].line = [clipped[exit_edge].start, entry];
    }
    clipped
}

/// The point of a line where coordinate `axis` is `at`. The order of the line's points does not affect the result.
fn intersect([a, b]: [PolygonVertex; 2], axis: usize, at: f64) -> PolygonVertex {
    let (low, high) = if a.p <= b.p { (a, b) } else { (b, a) };
    let share = (at - low.p[axis]) / (high.p[axis] - low.p[axis]);
    let mut p: [f64; 3] = array::from_fn(|k| low.p[k] + (high.p[k] - low.p[k]) * share);
    p[axis] = at;
    let uv = array::from_fn(|k| low.uv[k] + (high.uv[k] - low.uv[k]) * share as f32);
    PolygonVertex { p, uv }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    fn corner(x: f64, y: f64, z: f64) -> PolygonVertex {
        PolygonVertex { p: [x, y, z], uv: [x as f32, y as f32] }
    }

    fn area(polygon: &[PolygonVertex]) -> f64 {
        let at = |i: usize| glam::DVec3::from(polygon[i % polygon.len()].p);
        (1..polygon.len().saturating_sub(1)).map(|i| (at(i) - at(0)).cross(at(i + 1) - at(0)).length() / 2.0).sum()
    }

    #[test]
    fn pieces_add_up_to_the_triangle_and_share_border_points() {
        let mut rng = Rng::new(5);
        let mut random = || f64::from(rng.range(0.0, 4.0) as f32);
        for _ in 0..500 {
            let triangle: [PolygonVertex; 3] = array::from_fn(|_| corner(random(), random(), random()));
            let mut sum = 0.0;
            let mut on_borders: Vec<Vec<[u64; 3]>> = Vec::new();
            for i in 0..16 {
                let low = [f64::from(i % 4), f64::from(i / 4)];
                let piece = clip_to_square(triangle, low, [low[0] + 1.0, low[1] + 1.0]);
                sum += area(&piece);
                for axis in 0..2 {
                    for side in 0..2 {
                        let at = low[axis] + f64::from(side);
                        let mut points: Vec<[u64; 3]> =
                            piece.iter().filter(|c| c.p[axis] == at).map(|c| c.p.map(f64::to_bits)).collect();
                        points.sort_unstable();
                        points.dedup();
                        if points.len() > 1 {
                            on_borders.push(points);
                        }
                    }
                }
            }
            assert!((sum - area(&triangle)).abs() < 1e-9 * area(&triangle).max(1.0));
            // Each border between two squares has exactly the same points on both sides.
            for points in &on_borders {
                assert_eq!(on_borders.iter().filter(|other| *other == points).count(), 2, "{points:?}");
            }
        }
    }

    #[test]
    fn triangle_that_only_touches_the_border_is_unchanged() {
        let triangle = [corner(0.0, 0.0, 0.0), corner(1.0, 0.0, 2.0), corner(1.0, 1.0, 3.0)];
        assert_eq!(clip_to_square(triangle, [0.0, 0.0], [1.0, 1.0]), triangle);
        assert!(area(&clip_to_square(triangle, [1.0, 0.0], [2.0, 1.0])) == 0.0);
        assert!(clip_to_square(triangle, [2.0, 0.0], [3.0, 1.0]).len() < 3);
    }
}
