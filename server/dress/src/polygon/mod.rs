//! Triangulates polygons with holes in space.

mod clean;
mod joined;

use super::counted_float::{CountedFloat, with_steps};
pub use clean::{Rings, area_m2, clean, crosses_itself};
use earcut::Earcut;
use glam::DVec3;
use insula_source::object::ring_ranges;
use insula_source::report::SourceReport;

/// Smaller polygons are treated as degenerate.
const MIN_AREA_M2: f64 = 1e-8;
/// Polygons with more corners are treated as damage.
pub const MAX_CORNERS: usize = 1 << 20;
/// Polygons with more corners are triangulated under a limit of steps. Below, the worst case takes no time.
const UNLIMITED_CORNERS: usize = 256;
/// Polygons with more corners are refused at once if their rings cross everywhere: they would use up all steps, each of which waits for
/// the memory, which took a minute.
const UNCHECKED_CORNERS: usize = 4096;
/// Steps that every polygon may take, a fifth of a second.
const MIN_STEPS: u64 = 200_000_000;
/// Further steps per corner: 30,000 holes of four corners in a grid need 46,000 per corner, 10,000 need 19,000.
const STEPS_PER_CORNER: u64 = 60_000;
/// No polygon may take more, about ten seconds. A star of a million corners needs nine tenths of it.
const MAX_STEPS: u64 = 10_000_000_000;

/// Kind of a polygon without area in a report.
pub const NO_AREA: &str = "polygon without area";

/// Kind of a polygon in a report whose triangles do not have the area of its rings.
pub const CROSSING: &str = "ring crosses itself or another";
/// The areas of triangles and rings may differ by this share, and by this in any case: rings with corners of whole centimetres cross a
/// little.
const CROSSING_SHARE: f64 = 1e-3;
const CROSSING_M2: f64 = 0.01;

/// Triangles of a polygon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolygonTriangles<'t> {
    /// Numbers of corners.
    pub list: &'t [[u32; 3]],
    pub areas: Areas,
}

/// Areas of a polygon.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Areas {
    pub rings_m2: f64,
    pub triangles_m2: f64,
}

impl Areas {
    /// Counts a polygon of an object in the report if its triangles do not have the area of its rings.
    pub fn note_in(self, report: &mut SourceReport, id: &str) {
        if let Some(difference) = self.difference() {
            report.problem(CROSSING, || format!("{id}: {difference}"));
        }
    }

    /// For the report: which areas differ, if they do, because the rings cross.
    pub fn difference(&self) -> Option<String> {
        let differ = (self.triangles_m2 - self.rings_m2).abs() > CROSSING_SHARE * self.rings_m2.abs() + CROSSING_M2;
        differ.then(|| format!("{:.2} m2 instead of {:.2}", self.triangles_m2, self.rings_m2))
    }

    fn error_m2(&self) -> f64 {
        (self.triangles_m2 - self.rings_m2).abs()
    }
}

/// Why a polygon has no triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PolygonFault {
    /// It has no area, or its area is not a number.
    NoArea,
    /// It has more than [`MAX_CORNERS`] corners.
    TooLarge,
    /// It crosses itself so often, or has so many holes, that its triangles would take too long to find.
    TooComplex,
}

impl PolygonFault {
    /// For the report.
    pub fn reason(self) -> &'static str {
        match self {
            Self::NoArea => NO_AREA,
            Self::TooLarge => "polygon too large",
            Self::TooComplex => "polygon too complex to triangulate",
        }
    }
}

/// Whether the triangles from the first corner cover the polygon: all are oriented as the whole.
pub fn is_fan(points: &[[f64; 3]]) -> bool {
    if points.len() == 3 {
        return true;
    }
    let Some((first, rest)) = points.split_first() else { return true };
    let first = DVec3::from_array(*first);
    let normals =
        || rest.windows(2).map(|pair| (DVec3::from_array(pair[0]) - first).cross(DVec3::from_array(pair[1]) - first));
    let whole: DVec3 = normals().sum();
    normals().all(|normal| normal.dot(whole) >= 0.0)
}

/// Triangulates polygons, with reusable buffers.
pub struct Triangulator {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    indices: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// Polygons may take the limit of steps divided by this: more than 1 in tests only.
    steps_divisor: u64,
}

impl Default for Triangulator {
    fn default() -> Self {
        Self::new()
    }
}

impl Triangulator {
    /// One with empty buffers, which are used again.
    pub fn new() -> Self {
        Self { earcut: Earcut::new(), flat: Vec::new(), indices: Vec::new(), triangles: Vec::new(), steps_divisor: 1 }
    }

    /// Triangulates the polygon whose rings are consecutive in `points`: the outer ring first, then holes that start at
    /// `hole_starts` (ascending). The triples index `points` and turn as the outer ring does. Fails if the polygon has no
    /// area or exceeds a limit.
    ///
    /// The plane is that of Newell's normal, so a slightly bent polygon is triangulated in its best plane.
    pub fn triangulate(
        &mut self,
        points: &[[f64; 3]],
        hole_starts: &[u32],
    ) -> Result<PolygonTriangles<'_>, PolygonFault> {
        let outer_len = hole_starts.first().map_or(points.len(), |&start| start as usize);
        if points.len() > MAX_CORNERS {
            return Err(PolygonFault::TooLarge);
        }
        if outer_len < 3 {
            return Err(PolygonFault::NoArea);
        }
        // Relative to the first corner: products of full map coordinates would lose their digits by cancellation.
        let anchor = DVec3::from_array(points[0]);
        let normal = newell(&points[..outer_len], anchor);
        let twice_area_m2 = normal.length();
        if twice_area_m2.is_nan() || twice_area_m2 < 2.0 * MIN_AREA_M2 {
            return Err(PolygonFault::NoArea);
        }
        self.triangles.clear();
        if points.len() == 3 {
            self.triangles.push([0, 1, 2]);
            let area_m2 = twice_area_m2 / 2.0;
            let areas = Areas { rings_m2: area_m2, triangles_m2: area_m2 };
            return Ok(PolygonTriangles { list: &self.triangles, areas });
        }
        let (u, v) = (normal / twice_area_m2).any_orthonormal_pair();
        self.flat.clear();
        self.flat.extend(points.iter().map(|&p| {
            let p = DVec3::from_array(p) - anchor;
            [p.dot(u), p.dot(v)]
        }));
        self.clip_ears(hole_starts)?;
        let mut areas = Areas { rings_m2: self.rings_m2(hole_starts), triangles_m2: self.turn_triangles() };
        if areas.difference().is_some()
            && !hole_starts.is_empty()
            && let Some(joined) = joined::triangles(&self.flat, hole_starts)
        {
            let indices = std::mem::replace(&mut self.indices, joined);
            let triangles = std::mem::take(&mut self.triangles);
            let again = Areas { triangles_m2: self.turn_triangles(), ..areas };
            if again.error_m2() < areas.error_m2() {
                areas = again;
            } else {
                (self.indices, self.triangles) = (indices, triangles);
            }
        }
        if self.triangles.is_empty() {
            Err(PolygonFault::NoArea)
        } else {
            Ok(PolygonTriangles { list: &self.triangles, areas })
        }
    }

    /// Area of the outer ring without that of the holes.
    fn rings_m2(&self, hole_starts: &[u32]) -> f64 {
        let rings = rings_of(&self.flat, hole_starts).map(|ring| area_m2(ring).abs()).enumerate();
        rings.map(|(number, ring_m2)| if number == 0 { ring_m2 } else { -ring_m2 }).sum()
    }

    /// Fills `triangles` from `indices`, counter-clockwise. Returns their area.
    fn turn_triangles(&mut self) -> f64 {
        self.triangles.clear();
        let mut sum = 0.0;
        for corners in self.indices.chunks_exact(3) {
            let [a, b, c] = [corners[0], corners[1], corners[2]];
            let twice = twice_area(&self.flat, a, b, c);
            if twice > 0.0 {
                self.triangles.push([a, b, c]);
            } else if twice < 0.0 {
                self.triangles.push([a, c, b]);
            }
            sum += twice.abs();
        }
        sum / 2.0
    }

    /// Fills `indices` from `flat`. Fails if that takes too many steps.
    fn clip_ears(&mut self, hole_starts: &[u32]) -> Result<(), PolygonFault> {
        if self.flat.len() <= UNLIMITED_CORNERS {
            self.earcut.earcut_slice(&self.flat, hole_starts, &mut self.indices);
            return Ok(());
        }
        if self.flat.len() > UNCHECKED_CORNERS && clean::is_tangle(rings_of(&self.flat, hole_starts)) {
            return Err(PolygonFault::TooComplex);
        }
        let counted: Vec<[CountedFloat; 2]> = self.flat.iter().map(|point| point.map(CountedFloat)).collect();
        let steps = (MIN_STEPS + STEPS_PER_CORNER * counted.len() as u64).min(MAX_STEPS) / self.steps_divisor;
        let indices = &mut self.indices;
        with_steps(steps, || Earcut::new().earcut_slice(&counted, hole_starts, indices)).ok_or(PolygonFault::TooComplex)
    }
}

/// The rings of a polygon: the outer one, then the holes.
fn rings_of<'f>(flat: &'f [[f64; 2]], hole_starts: &'f [u32]) -> impl Iterator<Item = &'f [[f64; 2]]> {
    ring_ranges(flat.len(), hole_starts).map(move |ring| flat.get(ring).unwrap_or_default())
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
    use insula_test_support::rng::Rng;

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
                let triangles = triangulator.triangulate(&points, &[]).unwrap().list;
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
            let triangles = triangulator.triangulate(&points, &[4]).unwrap().list;
            assert!((area_vector(&points, triangles) - DVec3::new(0., -15., 0.)).length() < 1e-9);
            hole.reverse();
        }
    }

    #[test]
    fn degenerate_polygons_are_refused() {
        let mut triangulator = Triangulator::new();
        assert!(triangulator.triangulate(&[], &[]).is_err());
        assert!(triangulator.triangulate(&[[0., 0., 0.], [1., 0., 0.]], &[]).is_err());
        assert!(triangulator.triangulate(&[[0., 0., 0.], [1., 0., 0.], [2., 0., 0.]], &[]).is_err());
        assert!(triangulator.triangulate(&[[1., 1., 1.]; 5], &[]).is_err());
        assert!(triangulator.triangulate(&[[f64::NAN; 3]; 4], &[]).is_err());
        let closed = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 0., 0.]];
        assert_eq!(triangulator.triangulate(&closed, &[]).unwrap().list.len(), 1);
    }

    #[test]
    fn polygons_that_would_take_minutes_are_refused() {
        let mut rng = Rng::new(1);
        let tangle: Vec<[f64; 3]> = (0..10_000).map(|_| [rng.range(0.0, 100.0), rng.range(0.0, 100.0), 0.0]).collect();
        // They use up any number of steps; a part of the limit takes less than a second.
        let impatient = || Triangulator { steps_divisor: 64, ..Triangulator::new() };
        assert_eq!(impatient().triangulate(&tangle, &[]), Err(PolygonFault::TooComplex));
        assert_eq!(Triangulator::new().triangulate(&tangle, &[]), Err(PolygonFault::TooComplex), "without a step");
        // Holes at random places cross each other.
        let mut points = vec![[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0], [1000.0, 1000.0, 0.0], [0.0, 1000.0, 0.0]];
        let mut starts = Vec::new();
        for _ in 0..6000 {
            let [x, y] = [rng.range(0.0, 990.0), rng.range(0.0, 990.0)];
            starts.push(points.len() as u32);
            points.extend([[x, y, 0.0], [x, y + 9.0, 0.0], [x + 9.0, y + 9.0, 0.0], [x + 9.0, y, 0.0]]);
        }
        assert_eq!(impatient().triangulate(&points, &starts), Err(PolygonFault::TooComplex));
        assert!(Triangulator::new().triangulate(&vec![[0.0; 3]; MAX_CORNERS + 1], &[]) == Err(PolygonFault::TooLarge));
    }

    /// A square of `side` times `side` square holes, turned by `angle`: turned, its triangles are found slowest.
    fn holes_in_a_grid(side: u32, angle: f64) -> (Vec<[f64; 3]>, Vec<u32>) {
        let (sin, cos) = angle.sin_cos();
        let turned = |x: f64, y: f64| [x * cos - y * sin, x * sin + y * cos, 0.0];
        let end = f64::from(2 * side + 1);
        let mut points = vec![turned(0.0, 0.0), turned(end, 0.0), turned(end, end), turned(0.0, end)];
        let mut starts = Vec::new();
        for hole in 0..side * side {
            let [x, y] = [hole % side, hole / side].map(|place| f64::from(2 * place + 1));
            starts.push(points.len() as u32);
            points.extend([turned(x, y), turned(x, y + 1.0), turned(x + 1.0, y + 1.0), turned(x + 1.0, y)]);
        }
        (points, starts)
    }

    #[test]
    fn thousands_of_holes_in_a_grid_are_cut_out() {
        for (side, angle) in [(100, 0.0), (120, 0.3)] {
            let (points, starts) = holes_in_a_grid(side, angle);
            let mut triangulator = Triangulator::new();
            let triangles = triangulator.triangulate(&points, &starts).unwrap().list;
            let area_m2 = f64::from((2 * side + 1) * (2 * side + 1) - side * side);
            let found = area_vector(&points, triangles);
            assert!((found.z / area_m2 - 1.0).abs() < 1e-9, "{side} {angle}: {found} instead of {area_m2}");
        }
    }

    #[test]
    fn large_honest_polygons_have_the_triangles_of_the_unlimited_algorithm() {
        let mut rng = Rng::new(1);
        let star: Vec<[f64; 3]> = (0..20_000)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 20_000.0).sin_cos();
                let radius = 100.0 + rng.unit();
                [radius * cos, radius * sin, 0.0]
            })
            .collect();
        let mut points = star.clone();
        let mut starts = Vec::new();
        for i in 0..2000 {
            let [x, y] = [f64::from(i % 50) - 25.0, f64::from(i / 50) - 20.0];
            starts.push(points.len() as u32);
            points.extend([[x, y, 0.0], [x, y + 0.5, 0.0], [x + 0.5, y + 0.5, 0.0], [x + 0.5, y, 0.0]]);
        }
        for (points, starts) in [(star, vec![]), (points, starts)] {
            let mut triangulator = Triangulator::new();
            triangulator.triangulate(&points, &starts).unwrap();
            let mut expected = Vec::new();
            Earcut::new().earcut_slice(&triangulator.flat, &starts, &mut expected);
            assert_eq!(triangulator.indices, expected);
        }
    }

    #[test]
    fn holes_that_touch_the_outer_ring_are_cut_out_in_space() {
        let outer = [[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]];
        for (hole, expected_m2) in [
            (&[[0.0, 10.0], [10.0, 5.0], [10.0, 15.0]][..], 850.0),
            (&[[-0.001, 10.0], [10.0, 5.0], [10.0, 15.0]], 850.0),
            (&[[0.0, 5.0], [0.0, 15.0], [10.0, 15.0], [10.0, 5.0]], 800.0),
            (&[[0.0, 15.0], [15.0, 20.0], [30.0, 15.0], [15.0, 10.0]], 750.0),
        ] {
            // On a wall, and on a roof.
            for axes in [[0, 2], [0, 1], [1, 2]] {
                let point = |[x, y]: &[f64; 2]| {
                    let mut point = [85_000.25, 446_000.5, 12.125];
                    (point[axes[0]], point[axes[1]]) = (point[axes[0]] + x, point[axes[1]] + y);
                    point
                };
                let points: Vec<[f64; 3]> = outer.iter().chain(hole).map(point).collect();
                let mut triangulator = Triangulator::new();
                let triangles = triangulator.triangulate(&points, &[4]).unwrap();
                let found = area_vector(&points, triangles.list).length();
                assert!((found - expected_m2).abs() < 0.2, "{hole:?}: {found} m2");
                assert_eq!(triangles.areas.difference(), None);
            }
        }
    }

    #[test]
    fn holes_that_touch_each_other_in_a_corner_are_cut_out() {
        let rings = [
            &[[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]][..],
            &[[10.0, 10.0], [20.0, 10.0], [20.0, 20.0]],
            &[[20.0, 20.0], [25.0, 20.0], [25.0, 25.0]],
        ];
        let points: Vec<[f64; 3]> = rings.concat().into_iter().map(|[x, y]| [x, y, 1.0]).collect();
        let areas = Triangulator::new().triangulate(&points, &[4, 7]).unwrap().areas;
        assert!((areas.triangles_m2 - 837.5).abs() < 1e-6, "{areas:?}");
    }

    #[test]
    fn areas_that_differ_are_told() {
        let bow = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0], [4.0, -5.0, 0.0], [0.0, 10.0, 0.0]];
        let mut triangulator = Triangulator::new();
        let areas = triangulator.triangulate(&bow, &[]).unwrap().areas;
        assert!(areas.difference().unwrap().ends_with("m2 instead of 25.00"), "{areas:?}");
    }
}
