//! A triangle cut to a square.
//!
//! In: a triangle. Out: what of it lies in the square, as a convex polygon. Next: `lattice`.
//!
//! A cut is computed from the two points that its line was made from, in the order of their coordinates, never from what an
//! earlier cut left: so both squares beside a border, and both triangles beside an edge, get the same numbers.

use std::array;

/// A corner: metres from the grid's corner, and where it lies in its picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PolygonVertex {
    pub(super) p: [f64; 3],
    pub(super) uv: [f32; 2],
}

/// A corner of a polygon, and the points that the edge from here to the next one lies on.
#[derive(Debug, Clone, Copy)]
struct PolygonEdge {
    start: PolygonVertex,
    line: [PolygonVertex; 2],
}

/// What of `triangle` lies between `low` and `high` in x and y, borders included; fewer than three corners if nothing.
pub(super) fn to_square(triangle: [PolygonVertex; 3], low: [f64; 2], high: [f64; 2]) -> Vec<PolygonVertex> {
    let mut sides: Vec<PolygonEdge> =
        (0..3).map(|k| PolygonEdge { start: triangle[k], line: [triangle[k], triangle[(k + 1) % 3]] }).collect();
    for axis in 0..2 {
        sides = clip(&sides, axis, low[axis], |v, at| v >= at);
        sides = clip(&sides, axis, high[axis], |v, at| v <= at);
    }
    sides.into_iter().map(|side| side.start).collect()
}

fn clip(sides: &[PolygonEdge], axis: usize, at: f64, keeps: impl Fn(f64, f64) -> bool) -> Vec<PolygonEdge> {
    let is_in = |corner: &PolygonVertex| keeps(corner.p[axis], at);
    if sides.iter().all(|side| is_in(&side.start)) {
        return sides.to_vec();
    }
    let mut out: Vec<PolygonEdge> = Vec::with_capacity(sides.len() + 1);
    // Where the polygon leaves, the next edge runs along the border to where it comes back.
    let (mut left, mut back) = (None, None);
    for (i, side) in sides.iter().enumerate() {
        let next = &sides[(i + 1) % sides.len()].start;
        let (here, there) = (is_in(&side.start), is_in(next));
        if here {
            out.push(*side);
        }
        if here && !there {
            if side.start.p[axis] != at {
                out.push(PolygonEdge { start: cross(side.line, axis, at), line: side.line });
            }
            left = out.len().checked_sub(1);
        } else if there && !here {
            if next.p[axis] == at {
                back = Some(*next);
            } else {
                let start = cross(side.line, axis, at);
                out.push(PolygonEdge { start, line: side.line });
                back = Some(start);
            }
        }
    }
    if let (Some(left), Some(back)) = (left, back) {
        out[left].line = [out[left].start, back];
    }
    out
}

/// Where the line between two points crosses a plane; the same whichever comes first.
fn cross([a, b]: [PolygonVertex; 2], axis: usize, at: f64) -> PolygonVertex {
    let (low, high) = if a.p <= b.p { (a, b) } else { (b, a) };
    let share = (at - low.p[axis]) / (high.p[axis] - low.p[axis]);
    let mut p: [f64; 3] = array::from_fn(|k| low.p[k] + (high.p[k] - low.p[k]) * share);
    p[axis] = at;
    let uv = array::from_fn(|k| low.uv[k] + (high.uv[k] - low.uv[k]) * share as f32);
    PolygonVertex { p, uv }
}

#[cfg(test)]
mod tests {
    use crate::mesh::square_clip::*;

    fn corner(x: f64, y: f64, z: f64) -> PolygonVertex {
        PolygonVertex { p: [x, y, z], uv: [x as f32, y as f32] }
    }

    fn area(polygon: &[PolygonVertex]) -> f64 {
        let at = |i: usize| glam::DVec3::from(polygon[i % polygon.len()].p);
        (1..polygon.len().saturating_sub(1)).map(|i| (at(i) - at(0)).cross(at(i + 1) - at(0)).length() / 2.0).sum()
    }

    #[test]
    fn pieces_make_up_the_whole_and_share_their_borders() {
        let mut seed = 5u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from((seed >> 8) as f32 / (1 << 24) as f32) * 4.0
        };
        for _ in 0..500 {
            let triangle: [PolygonVertex; 3] = array::from_fn(|_| corner(random(), random(), random()));
            let mut sum = 0.0;
            let mut on_borders: Vec<Vec<[u64; 3]>> = Vec::new();
            for i in 0..16 {
                let low = [f64::from(i % 4), f64::from(i / 4)];
                let piece = to_square(triangle, low, [low[0] + 1.0, low[1] + 1.0]);
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
            // Inside the whole square, each border is there from both sides with the very same points.
            for points in &on_borders {
                assert_eq!(on_borders.iter().filter(|other| *other == points).count(), 2, "{points:?}");
            }
        }
    }

    #[test]
    fn what_touches_the_border_stays_whole() {
        let triangle = [corner(0.0, 0.0, 0.0), corner(1.0, 0.0, 2.0), corner(1.0, 1.0, 3.0)];
        assert_eq!(to_square(triangle, [0.0, 0.0], [1.0, 1.0]), triangle);
        assert!(area(&to_square(triangle, [1.0, 0.0], [2.0, 1.0])) == 0.0);
        assert!(to_square(triangle, [2.0, 0.0], [3.0, 1.0]).len() < 3);
    }
}
