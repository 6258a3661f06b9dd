//! Geometry of one feature, the same for all vector formats.

use insula_source::object::TriangleMesh;

/// Positions of a ring or line in source coordinates; z is 0 where the source has none.
pub(crate) type Ring = Vec<[f64; 3]>;
/// The outer ring, then the holes.
pub(crate) type Polygon = Vec<Ring>;

/// Collections nested deeper are refused.
pub(super) const MAX_DEPTH: u32 = 16;
pub(super) const TOO_DEEP: &str = "geometry nested too deep";
pub(super) const MALFORMED: &str = "malformed geometry";
pub(crate) const UNKNOWN_TYPE: &str = "geometry of unknown type";

/// Heights on land, in metres or feet; others are marks of missing ones, such as -9999.
const HEIGHTS: std::ops::RangeInclusive<f64> = -1500.0..=30_000.0;

/// Segments of a full circle that an arc is divided into.
const CIRCLE_SEGMENTS: f64 = 64.0;

/// All parts of a feature's geometry.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Geometry {
    pub(crate) polygons: Vec<Polygon>,
    pub(crate) meshes: Vec<TriangleMesh>,
    pub(crate) lines: Vec<Ring>,
    pub(crate) points: Vec<[f64; 3]>,
    /// The source says that the polygons and meshes are surfaces in space: TIN, polyhedral surface or multipatch.
    pub(crate) is_surface: bool,
    /// The positions have heights.
    pub(crate) has_z: bool,
}

impl Geometry {
    #[cfg(test)]
    pub(super) fn is_empty(&self) -> bool {
        self.positions().next().is_none()
    }

    /// All positions.
    pub(crate) fn positions(&self) -> impl Iterator<Item = &[f64; 3]> {
        let rings = self.polygons.iter().flatten().chain(&self.lines).flatten();
        rings.chain(&self.points).chain(self.meshes.iter().flat_map(|mesh| &mesh.positions))
    }

    /// West, south, east and north of all positions, ignoring those that are not numbers; `None` without any.
    pub(crate) fn bounds(&self) -> Option<[f64; 4]> {
        let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for [x, y, _] in self.positions() {
            bounds = [bounds[0].min(*x), bounds[1].min(*y), bounds[2].max(*x), bounds[3].max(*y)];
        }
        (bounds[0] <= bounds[2] && bounds[1] <= bounds[3]).then_some(bounds)
    }

    /// Settles the heights of a source where each position may have one or none (not a number): they count if all have one.
    pub(super) fn settle_heights(&mut self) {
        self.has_z = self.positions().next().is_some() && self.positions().all(|position| position[2].is_finite());
        if !self.has_z {
            self.for_each_position(|position| position[2] = 0.0);
        }
    }

    /// Gives positions whose height is missing by a mark the lowest height of the others. Returns whether there were some of both.
    pub(super) fn fill_heights(&mut self) -> bool {
        let has_marks = self.has_z && self.positions().any(|position| !HEIGHTS.contains(&position[2]));
        let known = self.positions().map(|position| position[2]).filter(|z| HEIGHTS.contains(z));
        let Some(lowest) = known.reduce(f64::min).filter(|_| has_marks) else { return false };
        self.for_each_position(|position| {
            if !HEIGHTS.contains(&position[2]) {
                position[2] = lowest;
            }
        });
        true
    }

    /// Changes all positions.
    pub(super) fn for_each_position(&mut self, change: impl FnMut(&mut [f64; 3])) {
        let rings = self.polygons.iter_mut().flatten().chain(&mut self.lines).flatten();
        let of_meshes = self.meshes.iter_mut().flat_map(|mesh| &mut mesh.positions);
        rings.chain(&mut self.points).chain(of_meshes).for_each(change);
    }

    /// Adds a polygon unless it has no ring.
    pub(crate) fn push_polygon(&mut self, mut polygon: Polygon) {
        polygon.retain(|ring| !ring.is_empty());
        if !polygon.is_empty() {
            self.polygons.push(polygon);
        }
    }

    /// Adds a line unless it has no position.
    pub(crate) fn push_line(&mut self, line: Ring) {
        if !line.is_empty() {
            self.lines.push(line);
        }
    }

    /// Adds a point unless it is empty (not a number).
    pub(crate) fn push_point(&mut self, point: [f64; 3]) {
        if !point[0].is_nan() {
            self.points.push(point);
        }
    }
}

/// Replaces circular arcs, each of a start, a middle and an end (the start of the next), by short segments. Arcs in a
/// straight line stay as they are.
pub(super) fn divide_arcs(controls: &[[f64; 3]]) -> Ring {
    let mut line = Ring::with_capacity(controls.len());
    line.extend(controls.first());
    let mut at = 0;
    while let (Some(a), Some(b), Some(c)) = (controls.get(at), controls.get(at + 1), controls.get(at + 2)) {
        divide_arc(*a, *b, *c, &mut line);
        at += 2;
    }
    line.extend(controls.get(at + 1));
    line
}

/// Adds the positions of an arc after its start.
fn divide_arc(a: [f64; 3], b: [f64; 3], c: [f64; 3], line: &mut Ring) {
    let tau = std::f64::consts::TAU;
    let is_circle = a[..2] == c[..2];
    let centre = if is_circle { Some([(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0]) } else { centre_of(a, b, c) };
    let Some([x, y]) = centre else {
        line.extend([b, c]);
        return;
    };
    let angle = |p: [f64; 3]| libm::atan2(p[1] - y, p[0] - x);
    let radius = libm::hypot(a[0] - x, a[1] - y);
    let (start, middle) = (angle(a), (angle(b) - angle(a)).rem_euclid(tau));
    let mut sweep = if is_circle { tau } else { (angle(c) - start).rem_euclid(tau) };
    if middle > sweep {
        sweep -= tau;
    }
    let steps = (sweep.abs() / tau * CIRCLE_SEGMENTS).ceil().clamp(2.0, CIRCLE_SEGMENTS);
    if !(radius.is_finite() && sweep.is_finite()) {
        line.extend([b, c]);
        return;
    }
    for step in 1..steps as u32 {
        let part = f64::from(step) / steps;
        let (sin, cos) = libm::sincos(start + sweep * part);
        line.push([x + radius * cos, y + radius * sin, a[2] + (c[2] - a[2]) * part]);
    }
    line.push(c);
}

/// Centre of the circle through three positions; `None` if they are in a straight line.
fn centre_of(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> Option<[f64; 2]> {
    let (bx, by, cx, cy) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
    let cross = 2.0 * (bx * cy - by * cx);
    let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
    if cross.abs() <= 1e-9 * (b2 + c2) {
        return None;
    }
    let centre = [a[0] + (cy * b2 - by * c2) / cross, a[1] + (bx * c2 - cx * b2) / cross];
    centre.iter().all(|value| value.is_finite()).then_some(centre)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_of_missing_heights_become_the_lowest_of_the_others() {
        let of = |heights: [f64; 3]| Geometry {
            lines: vec![heights.map(|z| [1.0, 2.0, z]).to_vec()],
            has_z: true,
            ..Geometry::default()
        };
        let filled = |heights| {
            let mut geometry = of(heights);
            (geometry.fill_heights(), geometry == of([512.0, 513.0, 512.0]))
        };
        assert_eq!(filled([512.0, 513.0, -9999.0]), (true, true));
        assert_eq!(filled([512.0, 513.0, 512.0]), (false, true));
        assert_eq!(filled([-9999.0; 3]), (false, false));
    }

    #[test]
    fn arcs_keep_their_ends_side_and_radius() {
        let half = divide_arcs(&[[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 0.0, 2.0]]);
        assert_eq!((half[0], *half.last().unwrap()), ([0.0, 0.0, 0.0], [2.0, 0.0, 2.0]));
        assert_eq!(half.len(), 33);
        assert!(half.iter().all(|[x, y, _]| ((x - 1.0).hypot(*y) - 1.0).abs() < 1e-12 && *y >= 0.0), "{half:?}");
        let below = divide_arcs(&[[0.0, 0.0, 0.0], [1.0, -1.0, 0.0], [2.0, 0.0, 0.0]]);
        assert!(below.iter().all(|[_, y, _]| *y <= 0.0));
        let circle = divide_arcs(&[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]);
        assert_eq!(circle.len(), 65);
        let straight = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        assert_eq!(divide_arcs(&straight), straight);
        let broken = [[0.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0], [2.0, f64::INFINITY, 0.0], [3.0, 0.0, 0.0]];
        assert!(divide_arcs(&broken).len() < 10);
        assert!(divide_arcs(&[]).is_empty());
    }
}
