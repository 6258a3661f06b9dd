//! Triangulates polygons with holes in space.

use earcut::Earcut;
use glam::DVec3;

/// Smaller polygons are treated as degenerate.
const MIN_AREA_M2: f64 = 1e-8;
/// Polygons with more corners are treated as damage.
pub(crate) const MAX_CORNERS: usize = 1 << 20;

/// Triangulates polygons, with reusable buffers.
pub(crate) struct Triangulator {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    indices: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

impl Triangulator {
    pub(crate) fn new() -> Self {
        Self { earcut: Earcut::new(), flat: Vec::new(), indices: Vec::new(), triangles: Vec::new() }
    }

    /// Triangulates the polygon whose rings are consecutive in `points`: the outer ring first, then holes that start at
    /// `hole_starts` (ascending). The triples index `points` and turn as the outer ring does; `None` if the polygon has
    /// no area.
    ///
    /// The plane is that of Newell's normal, so a slightly bent polygon is triangulated in its best plane.
    pub(crate) fn triangulate(&mut self, points: &[[f64; 3]], hole_starts: &[u32]) -> Option<&[[u32; 3]]> {
        let outer_len = hole_starts.first().map_or(points.len(), |&start| start as usize);
        if outer_len < 3 || points.len() > MAX_CORNERS {
            return None;
        }
        // Relative to the first corner: products of full map coordinates would lose their digits by cancellation.
        let anchor = DVec3::from_array(points[0]);
        let normal = newell(&points[..outer_len], anchor);
        let twice_area_m2 = normal.length();
        if twice_area_m2.is_nan() || twice_area_m2 < 2.0 * MIN_AREA_M2 {
            return None;
        }
        self.triangles.clear();
        if points.len() == 3 {
            self.triangles.push([0, 1, 2]);
            return Some(&self.triangles);
        }
        let (u, v) = (normal / twice_area_m2).any_orthonormal_pair();
        self.flat.clear();
        self.flat.extend(points.iter().map(|&p| {
            let p = DVec3::from_array(p) - anchor;
            [p.dot(u), p.dot(v)]
        }));
        self.earcut.earcut_slice(&self.flat, hole_starts, &mut self.indices);
        for corners in self.indices.chunks_exact(3) {
            let [a, b, c] = [corners[0], corners[1], corners[2]];
            let twice = twice_area(&self.flat, a, b, c);
            if twice > 0.0 {
                self.triangles.push([a, b, c]);
            } else if twice < 0.0 {
                self.triangles.push([a, c, b]);
            }
        }
        (!self.triangles.is_empty()).then_some(&self.triangles)
    }
}

/// Newell's normal: its length is twice the area, and from its tip the ring turns counter-clockwise.
fn newell(ring: &[[f64; 3]], anchor: DVec3) -> DVec3 {
    let mut normal = DVec3::ZERO;
    let mut previous = DVec3::from_array(ring[ring.len() - 1]) - anchor;
    for &point in ring {
        let point = DVec3::from_array(point) - anchor;
        normal += previous.cross(point);
        previous = point;
    }
    normal
}

/// Twice the signed area of a flat triangle.
fn twice_area(flat: &[[f64; 2]], a: u32, b: u32, c: u32) -> f64 {
    let [[ax, ay], [bx, by], [cx, cy]] = [flat[a as usize], flat[b as usize], flat[c as usize]];
    (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sum of the triangles' area vectors: its direction is the orientation, its length the area.
    fn area_vector(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> DVec3 {
        let at = |i: u32| DVec3::from_array(points[i as usize]);
        triangles.iter().map(|&[a, b, c]| (at(b) - at(a)).cross(at(c) - at(a)) * 0.5).sum()
    }

    #[test]
    fn triangles_turn_as_the_outer_ring_also_far_from_the_origin() {
        let far = DVec3::new(85_088.0, 446_394.0, 45.0);
        for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(1.0, 2.0, -3.0)] {
            for sign in [1.0, -1.0] {
                let normal = (axis * sign).normalize_or(DVec3::Z);
                let (u, v) = normal.any_orthonormal_pair();
                // An L shape is not convex, so a fan of triangles would be wrong.
                let shape = [(0., 0.), (4., 0.), (4., 1.), (1., 1.), (1., 4.), (0., 4.)];
                let points: Vec<_> = shape.iter().map(|&(x, y)| (far + u * x + v * y).to_array()).collect();
                let mut triangulator = Triangulator::new();
                let triangles = triangulator.triangulate(&points, &[]).unwrap();
                assert_eq!(triangles.len(), 4);
                assert!((area_vector(&points, triangles) - normal * 7.0).length() < 1e-6);
            }
        }
    }

    #[test]
    fn holes_of_either_orientation_are_cut_out() {
        let outer = [[0., 0., 0.], [4., 0., 0.], [4., 0., 4.], [0., 0., 4.]];
        let mut hole = [[1., 0., 1.], [2., 0., 1.], [2., 0., 2.], [1., 0., 2.]];
        for _ in 0..2 {
            let points = [&outer[..], &hole[..]].concat();
            let mut triangulator = Triangulator::new();
            let triangles = triangulator.triangulate(&points, &[4]).unwrap();
            assert!((area_vector(&points, triangles) - DVec3::new(0., -15., 0.)).length() < 1e-9);
            hole.reverse();
        }
    }

    #[test]
    fn degenerate_polygons_are_refused() {
        let mut triangulator = Triangulator::new();
        assert!(triangulator.triangulate(&[], &[]).is_none());
        assert!(triangulator.triangulate(&[[0., 0., 0.], [1., 0., 0.]], &[]).is_none());
        assert!(triangulator.triangulate(&[[0., 0., 0.], [1., 0., 0.], [2., 0., 0.]], &[]).is_none());
        assert!(triangulator.triangulate(&[[1., 1., 1.]; 5], &[]).is_none());
        assert!(triangulator.triangulate(&[[f64::NAN; 3]; 4], &[]).is_none());
        let closed = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 0., 0.]];
        assert_eq!(triangulator.triangulate(&closed, &[]).unwrap().len(), 1);
    }
}
