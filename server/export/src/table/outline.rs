//! The outline of triangles and cells on the map: their union, without slivers.
//!
//! The union is that of `i_overlay` on whole coordinates, so it is exact and the same on every machine.

use super::grid::{MapGrid, MapPoint};
use crate::rings::{is_sliver, tidy, twice_area};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay::{IntOverlayOptions, Overlay, ShapeType};
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::core::solver::Solver;
use i_overlay::i_shape::int::shape::IntShapes;

/// Parts are joined when there are this many, and as many as the outline has points: so that memory follows the outline and time
/// is almost linear.
const MIN_PENDING: usize = 2048;
/// Rings of a smaller area are left out.
const MIN_AREA_M2: f64 = 0.01;

/// Collects what an object covers on the map.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outline {
    /// Rings of the union so far: outer ones counter-clockwise, holes clockwise.
    rings: Vec<Vec<MapPoint>>,
    ring_points: usize,
    triangles: Vec<[MapPoint; 3]>,
    /// South-west and north-east corners.
    rectangles: Vec<[MapPoint; 2]>,
}

/// Polygons on the map, each an outer ring and its holes. Rings have at least three points and do not repeat the first one; outer
/// rings are counter-clockwise, holes clockwise.
pub(crate) type Polygons = Vec<Vec<Vec<MapPoint>>>;

impl Outline {
    /// Adds a triangle of any orientation.
    pub(crate) fn add_triangle(&mut self, mut corners: [MapPoint; 3]) {
        let area = twice_area(&corners);
        if area < 0 {
            corners.swap(1, 2);
        }
        if area != 0 {
            self.triangles.push(corners);
            self.join_if_many();
        }
    }

    /// Adds a rectangle by its south-west and north-east corner.
    pub(crate) fn add_rectangle(&mut self, min: MapPoint, max: MapPoint) {
        if min.x < max.x && min.y < max.y {
            self.rectangles.push([min, max]);
            self.join_if_many();
        }
    }

    fn join_if_many(&mut self) {
        if self.triangles.len() + self.rectangles.len() >= MIN_PENDING.max(self.ring_points / 2) {
            self.join();
        }
    }

    fn join(&mut self) {
        let mut overlay = overlay(3 * self.triangles.len() + 4 * self.rectangles.len() + self.ring_points);
        for corners in self.triangles.drain(..) {
            overlay.add_contour(&corners, ShapeType::Subject);
        }
        for [min, max] in self.rectangles.drain(..) {
            let corners = [min, MapPoint::new(max.x, min.y), max, MapPoint::new(min.x, max.y)];
            overlay.add_contour(&corners, ShapeType::Subject);
        }
        let shapes = add_rings(overlay, &self.rings);
        self.rings = shapes.into_iter().flatten().collect();
        self.ring_points = self.rings.iter().map(Vec::len).sum();
    }

    /// The outline. Points within `tolerance` units of the line between their neighbours are removed, and so are rings of at most
    /// that width or of less than 100 cm².
    pub(crate) fn finish(mut self, grid: &MapGrid, tolerance: f64) -> Polygons {
        self.join();
        let min_area = MIN_AREA_M2 / grid.unit_area_m2();
        let is_kept = |ring: &Vec<MapPoint>| !is_sliver(ring, min_area, tolerance);
        let rings: Vec<Vec<MapPoint>> =
            self.rings.iter().map(|ring| tidy(ring, tolerance)).filter(|ring| is_kept(ring)).collect();
        // Tidied rings may touch or cross, if something is narrower than the tolerance.
        let shapes = add_rings(overlay(rings.iter().map(Vec::len).sum()), &rings);
        let mut polygons = Vec::new();
        for mut shape in shapes {
            let holes = shape.split_off(shape.len().min(1));
            if let Some(outer) = shape.pop().filter(is_kept) {
                let rings = std::iter::once(outer).chain(holes.into_iter().filter(is_kept));
                polygons.push(rings.map(from_first).collect());
            }
        }
        polygons
    }
}

/// The ring from its westernmost point on, so that equal outlines have equal rings.
fn from_first(mut ring: Vec<MapPoint>) -> Vec<MapPoint> {
    let first = ring.iter().enumerate().min_by_key(|(_, point)| (point.x, point.y)).map_or(0, |(i, _)| i);
    ring.rotate_left(first);
    ring
}

/// Area in square metres.
pub(crate) fn area_m2(polygons: &Polygons, grid: &MapGrid) -> f64 {
    let twice: i128 = polygons.iter().flatten().map(|ring| i128::from(twice_area(ring))).sum();
    twice as f64 / 2.0 * grid.unit_area_m2()
}

fn overlay(points: usize) -> Overlay<i32> {
    // With `ogc`, no ring touches itself, as the Simple Features of OGC ask for.
    let options = IntOverlayOptions { ogc: true, ..IntOverlayOptions::default() };
    Overlay::new_custom(points, options, Solver::default())
}

fn add_rings(mut overlay: Overlay<i32>, rings: &[Vec<MapPoint>]) -> IntShapes<i32> {
    for ring in rings {
        overlay.add_contour(ring, ShapeType::Subject);
    }
    overlay.overlay(OverlayRule::Subject, FillRule::NonZero)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::test_city::manifest;

    fn point(x: i32, y: i32) -> MapPoint {
        MapPoint::new(x, y)
    }

    fn finish(outline: Outline) -> (Polygons, f64) {
        let grid = MapGrid::of(&manifest(2));
        let polygons = outline.finish(&grid, 2.0);
        let area = area_m2(&polygons, &grid);
        (polygons, area)
    }

    /// The two triangles of a rectangle, one of them clockwise.
    fn add(outline: &mut Outline, [x0, y0]: [i32; 2], [x1, y1]: [i32; 2]) {
        outline.add_triangle([point(x0, y0), point(x1, y0), point(x1, y1)]);
        outline.add_triangle([point(x0, y0), point(x0, y1), point(x1, y1)]);
    }

    #[test]
    fn triangles_of_any_orientation_become_one_ring() {
        let mut outline = Outline::default();
        add(&mut outline, [0, 0], [10_000, 5_000]);
        // A wall has no area.
        outline.add_triangle([point(0, 0), point(0, 5_000), point(0, 5_000)]);
        let (polygons, area) = finish(outline);
        assert_eq!((polygons.len(), polygons[0].len(), polygons[0][0].len(), area), (1, 1, 4, 50.0));
        assert!(twice_area(&polygons[0][0]) > 0);
    }

    #[test]
    fn courtyards_are_holes_and_slits_are_closed() {
        let mut outline = Outline::default();
        // The first two are a millimetre apart, up to the third.
        let parts = [
            [0, 0, 30_000, 9_999],
            [20_000, 10_000, 30_000, 20_000],
            [0, 0, 21_000, 10_000],
            [0, 10_000, 10_000, 20_000],
            [0, 20_000, 30_000, 30_000],
        ];
        for [x0, y0, x1, y1] in parts {
            add(&mut outline, [x0, y0], [x1, y1]);
        }
        let (polygons, area) = finish(outline);
        assert_eq!((polygons.len(), polygons[0].len(), polygons[0][0].len(), polygons[0][1].len()), (1, 2, 4, 4));
        assert!((area - 800.0).abs() < 0.1, "{area}");
        assert!(twice_area(&polygons[0][1]) < 0);
    }

    #[test]
    fn slivers_are_dropped_and_separate_parts_stay_apart() {
        let mut outline = Outline::default();
        add(&mut outline, [0, 0], [1_000, 1_000]);
        add(&mut outline, [5_000, 0], [6_000, 1_000]);
        add(&mut outline, [8_000, 0], [8_001, 900_000]);
        add(&mut outline, [9_000, 0], [9_050, 50]);
        let (polygons, area) = finish(outline);
        assert_eq!((polygons.len(), area), (2, 2.0));
    }

    #[test]
    fn many_parts_are_joined_on_the_way() {
        let mut outline = Outline::default();
        for i in 0..200 {
            for j in 0..200 {
                outline.add_rectangle(point(i * 500, j * 500), point(i * 500 + 500, j * 500 + 500));
            }
            assert!(outline.rectangles.len() < MIN_PENDING);
        }
        let (polygons, area) = finish(outline);
        assert_eq!((polygons.len(), polygons[0][0].len(), area), (1, 4, 10_000.0));
    }

    #[test]
    fn any_triangles_cover_what_their_outline_does() {
        let mut rng = insula_test_support::rng::Rng::new(7);
        for _ in 0..40 {
            let mut outline = Outline::default();
            let triangles: Vec<[MapPoint; 3]> = (0..30)
                .map(|_| {
                    let middle = [rng.below(40_000) as i32, rng.below(40_000) as i32];
                    [0; 3].map(|_| point(middle[0] + rng.below(9_000) as i32, middle[1] + rng.below(9_000) as i32))
                })
                .collect();
            triangles.iter().for_each(|corners| outline.add_triangle(*corners));
            let (polygons, _) = finish(outline);
            let (mut points, mut wrong) = (0, 0);
            for i in 0..10_000 {
                let place = point(i % 100 * 490, i / 100 * 490);
                let in_triangle = triangles.iter().any(|corners| is_in_ring(corners, place));
                let in_rings = polygons.iter().flatten().filter(|ring| is_in_ring(ring, place)).count();
                points += 1;
                wrong += usize::from(in_triangle != (in_rings % 2 == 1));
            }
            assert!(points == 10_000 && wrong <= 3, "{wrong}");
        }
    }

    fn is_in_ring(ring: &[MapPoint], place: MapPoint) -> bool {
        let crosses = |(a, b): (&MapPoint, &MapPoint)| {
            let (to_a, to_b) = (f64::from(a.y - place.y), f64::from(b.y - place.y));
            (to_a > 0.0) != (to_b > 0.0)
                && f64::from(a.x) + to_a / (to_a - to_b) * f64::from(b.x - a.x) > f64::from(place.x)
        };
        ring.iter().zip(ring.iter().cycle().skip(1)).filter(|edge| crosses(*edge)).count() % 2 == 1
    }
}
