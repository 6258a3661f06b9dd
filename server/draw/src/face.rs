//! Convex faces in space, and cutting them by planes.

use glam::DVec3;

/// An edge without a name: made by clipping.
pub(crate) const NO_EDGE: u32 = u32::MAX;
/// Points this near to a plane are on it, in metres. Stored meshes are rounded more coarsely.
pub(crate) const ON_PLANE_M: f64 = 1e-4;
/// Estimated memory of a face with its points.
pub(crate) const FACE_BYTES: usize = 256;

/// A plane: `normal . p = offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FacePlane {
    /// Unit normal.
    pub(crate) normal: DVec3,
    pub(crate) offset: f64,
}

impl FacePlane {
    /// Height of a point above the plane in metres.
    pub(crate) fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p) - self.offset
    }

    /// The plane of a triangle; `None` if it has no area.
    pub(crate) fn of([a, b, c]: [DVec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some(Self { normal, offset: normal.dot(a) })
    }
}

/// A convex, flat polygon in space: a triangle or what is left of it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Face {
    /// Counter-clockwise as seen from outside, in metres from the scene's origin; at least three.
    pub(crate) points: Vec<DVec3>,
    /// Name of the edge from each point to the next one.
    pub(crate) edges: Vec<u32>,
    pub(crate) plane: FacePlane,
    /// Index of the scene's triangle.
    pub(crate) triangle: u32,
}

/// Where a face lies, seen from a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Front,
    Back,
    On,
    Both,
}

impl Face {
    pub(crate) fn side(&self, plane: &FacePlane) -> Side {
        let (mut is_front, mut is_back) = (false, false);
        for point in &self.points {
            let height = plane.height(*point);
            is_front |= height > ON_PLANE_M;
            is_back |= height < -ON_PLANE_M;
        }
        match (is_front, is_back) {
            (true, true) => Side::Both,
            (true, false) => Side::Front,
            (false, true) => Side::Back,
            (false, false) => Side::On,
        }
    }

    /// The ends of the line in which the face passes through a plane or touches it; `None` if it does not, or lies in it.
    pub(crate) fn meeting(&self, plane: &FacePlane) -> Option<[DVec3; 2]> {
        let heights: Vec<f64> = self.points.iter().map(|p| plane.height(*p)).collect();
        let mut ends: Vec<DVec3> = Vec::new();
        for i in 0..self.points.len() {
            let j = (i + 1) % self.points.len();
            let (a, b) = (heights[i], heights[j]);
            if a.abs() <= ON_PLANE_M {
                ends.push(self.points[i]);
            } else if b.abs() > ON_PLANE_M && (a < 0.0) != (b < 0.0) {
                ends.push(self.points[i].lerp(self.points[j], a / (a - b)));
            }
        }
        // A convex face has at most two, unless more of its corners lie in one line.
        let first = *ends.first()?;
        let far = |from: DVec3| {
            ends.iter().copied().max_by(|a, b| a.distance_squared(from).total_cmp(&b.distance_squared(from)))
        };
        let one = far(first)?;
        let other = far(one)?;
        (ends.len() < self.points.len() && one != other).then_some([one, other])
    }

    /// The parts in front of a plane and behind it. The new edges have the name `cut`. Neighbours that share an edge get the same
    /// point on it.
    pub(crate) fn split(&self, plane: &FacePlane, cut: u32) -> [Option<Self>; 2] {
        let heights: Vec<f64> = self.points.iter().map(|p| plane.height(*p)).collect();
        let mut parts = [self.emptied(), self.emptied()];
        for i in 0..self.points.len() {
            let j = (i + 1) % self.points.len();
            let (a, b, edge) = (self.points[i], self.points[j], self.edges[i]);
            for (part, sign) in parts.iter_mut().zip([1.0, -1.0]) {
                let (here, next) = (sign * heights[i], sign * heights[j]);
                if here >= -ON_PLANE_M {
                    // The edge leaves the part here if it goes along the plane to the other side.
                    let leaves = here <= ON_PLANE_M && next < -ON_PLANE_M;
                    part.points.push(a);
                    part.edges.push(if leaves { cut } else { edge });
                }
                let crosses = here.abs() > ON_PLANE_M && next.abs() > ON_PLANE_M && (here > 0.0) != (next > 0.0);
                if crosses {
                    part.points.push(crossing((a, heights[i]), (b, heights[j])));
                    part.edges.push(if here > 0.0 { cut } else { edge });
                }
            }
        }
        parts.map(|part| (part.points.len() >= 3 && part.has_area(plane)).then_some(part))
    }

    fn emptied(&self) -> Self {
        let capacity = self.points.len() + 1;
        Self { points: Vec::with_capacity(capacity), edges: Vec::with_capacity(capacity), ..*self }
    }

    /// Whether the part is more than points on the plane.
    fn has_area(&self, plane: &FacePlane) -> bool {
        self.points.iter().any(|point| plane.height(*point).abs() > ON_PLANE_M)
    }

    pub(crate) fn area_m2(&self) -> f64 {
        let first = self.points[0];
        0.5 * self.points.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum::<DVec3>().length()
    }
}

/// Lowest and highest coordinates of faces.
pub(crate) fn bounds_of<'a>(faces: impl Iterator<Item = &'a Face>) -> [DVec3; 2] {
    let points = faces.flat_map(|face| &face.points);
    points.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(*p), high.max(*p)])
}

/// Where an edge crosses a plane; the same for both directions of the edge.
fn crossing((a, height_a): (DVec3, f64), (b, height_b): (DVec3, f64)) -> DVec3 {
    let is_ordered = a.to_array() <= b.to_array();
    let ((a, height_a), (b, height_b)) =
        if is_ordered { ((a, height_a), (b, height_b)) } else { ((b, height_b), (a, height_a)) };
    a + (b - a) * (height_a / (height_a - height_b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_split_keeps_names_of_edges_and_the_area() {
        let points = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]].map(DVec3::from);
        let plane = FacePlane::of(points).unwrap();
        let face = Face { points: points.to_vec(), edges: vec![10, 11, 12], plane, triangle: 7 };
        let at = |x: f64| FacePlane { normal: DVec3::X, offset: x };
        let [front, back] = face.split(&at(1.0), 99).map(Option::unwrap);
        assert_eq!((front.points.len(), back.points.len()), (3, 4));
        assert!((front.area_m2() + back.area_m2() - face.area_m2()).abs() < 1e-12);
        for (part, names) in [(front, [10, 11, 99].as_slice()), (back, &[10, 99, 11, 12])] {
            let mut found = part.edges.clone();
            let first = found.iter().position(|edge| *edge == 10).unwrap();
            found.rotate_left(first);
            assert_eq!(found, names);
        }
        // Through a corner and along an edge.
        let [front, back] = face.split(&FacePlane { normal: DVec3::new(1.0, -1.0, 0.0).normalize(), offset: 0.0 }, 99);
        assert_eq!(front.unwrap().edges, [10, 11, 99]);
        assert_eq!(back.unwrap().edges, [99, 11, 12]);
        assert_eq!(face.side(&at(0.0)), Side::Front);
        assert_eq!(face.split(&at(0.0), 99)[1], None);
        assert_eq!(face.side(&plane), Side::On);
    }
}
