//! Visible parts of polygons by subdivision of the page (Moldoveanu, "Algoritmul Warnock").
//!
//! A cell of the page has the polygons that may show in it, from the nearest to the farthest. A polygon covers the cell, is inside,
//! cuts its border, or is disjoint. The nearest one that covers the cell hides all that follow. A cell with few polygons is resolved
//! exactly: each polygon without those before it. Another cell is divided into four.

use crate::convex::{Convex, PagePoint, PageRect};
use crate::error::{DrawError, DrawProgress, DrawStep, advance};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Cells with at most so many polygons are resolved.
const MAX_RESOLVED: usize = 40;
/// Cells are not divided below this side in units.
const MIN_SIDE: i32 = 1 << 10;
/// Cells are divided at the same time to this depth.
const PARALLEL_DEPTH: u32 = 4;

/// A polygon to draw.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PagePolygon {
    pub(crate) shape: Convex,
    pub(crate) bounds: PageRect,
    /// Index of the scene's triangle.
    pub(crate) triangle: u32,
    /// Whether it hides what is behind.
    pub(crate) is_opaque: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VisiblePart {
    /// Index of the polygon.
    pub(crate) polygon: u32,
    /// Lower left corner of its cell of the page. Parts of different cells do not overlap, those of one follow each other.
    pub(crate) cell: PagePoint,
    pub(crate) shape: Convex,
}

/// The visible parts of `polygons`, which are sorted from the nearest to the farthest, inside `frame`. Fails if there are more than
/// `max_parts`.
pub(crate) fn visible_parts(
    polygons: &[PagePolygon],
    frame: PageRect,
    max_parts: usize,
    progress: DrawProgress<'_>,
) -> Result<Vec<VisiblePart>, DrawError> {
    let subdivision =
        Subdivision { polygons, max_parts, parts: AtomicUsize::new(0), done: AtomicUsize::new(0), progress };
    let all: Vec<u32> = (0..polygons.len() as u32).collect();
    subdivision.cell(&frame, &all, 0)
}

struct Subdivision<'a> {
    polygons: &'a [PagePolygon],
    max_parts: usize,
    parts: AtomicUsize,
    /// Cells of [`PARALLEL_DEPTH`].
    done: AtomicUsize,
    progress: DrawProgress<'a>,
}

impl Subdivision<'_> {
    fn cell(&self, cell: &PageRect, above: &[u32], depth: u32) -> Result<Vec<VisiblePart>, DrawError> {
        if depth == PARALLEL_DEPTH {
            let done = self.done.fetch_add(1, Ordering::Relaxed) as f64;
            advance(self.progress, DrawStep::Subdivide, done / f64::from(1u32 << (2 * PARALLEL_DEPTH)))?;
        }
        let shown = self.shown(cell, above);
        if shown.len() <= MAX_RESOLVED || cell.side() < MIN_SIDE {
            let parts = self.resolve(cell, &shown);
            let all = self.parts.fetch_add(parts.len(), Ordering::Relaxed) + parts.len();
            return if all > self.max_parts {
                Err(DrawError::TooManyParts { limit: self.max_parts })
            } else {
                Ok(parts)
            };
        }
        let quarters = cell.quarters();
        let parts: Result<Vec<Vec<VisiblePart>>, DrawError> = if depth < PARALLEL_DEPTH {
            quarters.par_iter().map(|quarter| self.cell(quarter, &shown, depth + 1)).collect()
        } else {
            quarters.iter().map(|quarter| self.cell(quarter, &shown, depth + 1)).collect()
        };
        Ok(parts?.into_iter().flatten().collect())
    }

    /// The polygons in a cell up to the first one that covers it.
    fn shown(&self, cell: &PageRect, above: &[u32]) -> Vec<u32> {
        let mut shown = Vec::new();
        for &index in above {
            let polygon = &self.polygons[index as usize];
            if !polygon.bounds.overlaps(cell) || polygon.shape.misses(cell) {
                continue;
            }
            shown.push(index);
            if polygon.is_opaque && polygon.shape.covers(cell) {
                break;
            }
        }
        shown
    }

    fn resolve(&self, cell: &PageRect, shown: &[u32]) -> Vec<VisiblePart> {
        let mut parts = Vec::new();
        let mut nearer: Vec<(Convex, PageRect)> = Vec::with_capacity(shown.len());
        for &index in shown {
            let polygon = &self.polygons[index as usize];
            let Some(shape) = polygon.shape.clipped(cell) else { continue };
            let bounds = PageRect::of(&shape.points);
            let mut rest = vec![shape.clone()];
            for (other, other_bounds) in nearer.iter().filter(|(_, other)| other.overlaps(&bounds)) {
                let mut left = Vec::new();
                for part in rest {
                    if PageRect::of(&part.points).overlaps(other_bounds) {
                        part.subtract(other, &mut left);
                    } else {
                        left.push(part);
                    }
                }
                rest = left;
            }
            parts.extend(rest.into_iter().map(|shape| VisiblePart { polygon: index, cell: cell.min, shape }));
            if polygon.is_opaque {
                nearer.push((shape, bounds));
            }
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsp::{BspTree, Eye, TreeWalk};
    use crate::convex::cross;
    use crate::face::{Face, FacePlane, bounds_of};
    use crate::scene::clip;
    use crate::view::{DrawView, PaperRect, Projection, ViewAxes};
    use crate::volume::ViewVolume;
    use glam::DVec3;
    use insula_export::camera::ExportCamera;

    const UNITS: f64 = 1_000_000.0;

    /// Numbers of a linear congruential generator, 0 to 1.
    struct RandomNumbers(u64);

    impl RandomNumbers {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    /// Triangles through each other, facing up, inside of a square of 100 m.
    fn triangles(count: usize, random: &mut RandomNumbers) -> Vec<Face> {
        let mut faces = Vec::new();
        while faces.len() < count {
            let at = DVec3::new(random.next(), random.next(), random.next()) * 80.0;
            let corner =
                |random: &mut RandomNumbers| at + DVec3::new(random.next(), random.next(), random.next()) * 20.0;
            let mut points = [corner(random), corner(random), corner(random)];
            if FacePlane::of(points).is_some_and(|plane| plane.normal.z < 0.0) {
                points.swap(1, 2);
            }
            let Some(plane) = FacePlane::of(points).filter(|plane| plane.normal.z > 0.05) else { continue };
            faces.push(Face { points: points.to_vec(), edges: vec![0; 3], plane, triangle: faces.len() as u32 });
        }
        faces
    }

    /// Numbers of the faces that a view shows, from the nearest to the farthest.
    fn sorted(tree: &mut BspTree, faces: &[Face], eye: Eye, volume: &ViewVolume) -> Vec<u32> {
        let walk = TreeWalk { eye, volume, is_asked: &|_: &Face| true, max_faces: 1 << 20 };
        tree.front_to_back(faces, &walk, &|_, _| true).unwrap()
    }

    fn page(face: &Face) -> PagePolygon {
        let at = |p: &DVec3| PagePoint::new((p.x * UNITS) as i32, (p.y * UNITS) as i32);
        let shape = Convex { points: face.points.iter().map(at).collect(), edges: face.edges.clone() };
        PagePolygon { bounds: PageRect::of(&shape.points), shape, triangle: face.triangle, is_opaque: true }
    }

    fn contains(shape: &Convex, p: PagePoint, margin: f64) -> bool {
        (0..shape.points.len()).all(|i| {
            let (a, b) = (shape.points[i], shape.points[(i + 1) % shape.points.len()]);
            let length = f64::from(b.x - a.x).hypot(f64::from(b.y - a.y));
            cross(a, b, p) as f64 >= margin * length
        })
    }

    #[test]
    fn each_point_shows_the_nearest_of_triangles_that_pass_through_each_other() {
        let mut random = RandomNumbers(7);
        let faces = triangles(600, &mut random);
        let mut tree = BspTree::new(&faces, 1000);
        let order = sorted(&mut tree, &faces, Eye::Direction(DVec3::Z), &ViewVolume::default());
        let splits = order.len() as f64 / faces.len() as f64;
        assert!(splits < 4.0, "{splits} faces for each triangle");
        let polygons: Vec<PagePolygon> = order.iter().map(|number| page(tree.face(&faces, *number))).collect();
        let frame = PageRect { min: PagePoint::new(0, 0), max: PagePoint::new(100_000_000, 100_000_000) };
        let parts = visible_parts(&polygons, frame, 1 << 20, &|_, _| true).unwrap();
        let mut judged = 0;
        for _ in 0..4000 {
            let p = PagePoint::new((random.next() * 1e8) as i32, (random.next() * 1e8) as i32);
            let (x, y) = (f64::from(p.x) / UNITS, f64::from(p.y) / UNITS);
            let height = |face: &Face| {
                let n = face.plane.normal;
                (face.plane.offset - n.x * x - n.y * y) / n.z
            };
            let shapes: Vec<Convex> = faces.iter().map(|face| page(face).shape).collect();
            // Points near an edge, or near the line where two triangles meet, may show either.
            let is_near = |shape: &Convex| contains(shape, p, -1000.0) != contains(shape, p, 1000.0);
            let mut seen: Vec<&Face> =
                faces.iter().zip(&shapes).filter(|(_, shape)| contains(shape, p, 0.0)).map(|(face, _)| face).collect();
            seen.sort_by(|a, b| height(b).total_cmp(&height(a)));
            let is_tie = seen.len() > 1 && height(seen[0]) - height(seen[1]) < 0.01;
            let shown: Vec<u32> = parts
                .iter()
                .filter(|part| contains(&part.shape, p, 0.0))
                .map(|part| polygons[part.polygon as usize].triangle)
                .collect();
            if is_tie || shapes.iter().any(is_near) || parts.iter().any(|part| is_near(&part.shape)) {
                continue;
            }
            judged += 1;
            assert_eq!(shown, seen.first().map(|face| face.triangle).into_iter().collect::<Vec<_>>());
        }
        assert!(judged > 1000, "only {judged} points were judged");
        let area: i64 = parts.iter().map(|part| part.shape.twice_area()).sum();
        assert!(area > 0 && area as f64 <= 2e16 * (1.0 + 1e-9), "no part overlaps another one");
    }

    #[test]
    fn the_order_holds_from_any_eye() {
        let mut random = RandomNumbers(3);
        let faces = triangles(60, &mut random);
        let mut tree = BspTree::new(&faces, 1000);
        let mut divisions = Vec::new();
        for eye in [DVec3::new(500.0, 20.0, 30.0), DVec3::new(-90.0, -300.0, 200.0), DVec3::new(40.0, 40.0, 40.0)] {
            let numbers = sorted(&mut tree, &faces, Eye::Point(eye), &ViewVolume::default());
            divisions.push(tree.divisions());
            let order: Vec<&Face> = numbers.iter().map(|number| tree.face(&faces, *number)).collect();
            for (i, near) in order.iter().enumerate() {
                for far in &order[i + 1..] {
                    // A ray to the middle of the nearer face must not pass the farther one before.
                    let middle = near.points.iter().sum::<DVec3>() / near.points.len() as f64;
                    let ray = middle - eye;
                    let share = (far.plane.offset - far.plane.normal.dot(eye)) / far.plane.normal.dot(ray);
                    let hit = eye + ray * share;
                    let is_inside = (0..far.points.len()).all(|k| {
                        let (a, b) = (far.points[k], far.points[(k + 1) % far.points.len()]);
                        (b - a).cross(hit - a).dot(far.plane.normal) > 1e-6
                    });
                    assert!(!(share > 0.0 && share < 1.0 - 1e-6 && is_inside));
                }
            }
        }
        assert!(divisions[0] > 0 && divisions.iter().all(|count| *count == divisions[0]), "{divisions:?}");
    }

    #[test]
    fn a_view_neither_divides_nor_walks_what_is_outside_of_it() {
        let faces = triangles(600, &mut RandomNumbers(5));
        let (position, target) = ([-20.0, -20.0, 40.0], [50.0, 30.0, 40.0]);
        let camera = ExportCamera { position, target, up: [0.0, 0.0, 1.0], fov_y_deg: 10.0 };
        let axes = ViewAxes::new(&DrawView::Perspective(camera), [0.0; 3]).unwrap();
        let frame = PaperRect { min: [0.0; 2], max: [200.0, 100.0] };
        let volume = Projection::new(axes, frame, None, std::iter::empty()).volume(bounds_of(faces.iter()));
        let mut tree = BspTree::new(&faces, 1000);
        let of_view = sorted(&mut tree, &faces, axes.eye(), &volume);
        let divided = tree.divisions();
        let of_all = sorted(&mut tree, &faces, axes.eye(), &ViewVolume::default());
        assert!(divided > 0 && 3 * divided < 2 * tree.divisions(), "{divided} of {}", tree.divisions());
        assert!(of_view.len() < of_all.len(), "{} of {}", of_view.len(), of_all.len());
        let inside = |order: &[u32]| -> Vec<u32> {
            let is_inside = |number: &u32| clip(tree.face(&faces, *number).clone(), &volume.planes).is_some();
            order.iter().copied().filter(is_inside).collect()
        };
        assert!(!inside(&of_all).is_empty());
        assert_eq!(inside(&of_view), inside(&of_all), "what is left out is outside, and the order is the same");
        let divided = tree.divisions();
        assert_eq!(sorted(&mut tree, &faces, axes.eye(), &volume), of_view);
        assert_eq!(tree.divisions(), divided);
    }

    #[test]
    fn a_face_beside_its_own_plane_ends_the_division() {
        let mut faces = triangles(1, &mut RandomNumbers(7));
        faces[0].plane.offset += 100.0;
        let mut tree = BspTree::new(&faces, 1000);
        assert_eq!(sorted(&mut tree, &faces, Eye::Direction(DVec3::Z), &ViewVolume::default()), [0]);
        assert_eq!(tree.divisions(), 1);
    }

    #[test]
    fn a_progress_that_says_so_stops_the_work() {
        let faces = triangles(600, &mut RandomNumbers(7));
        let polygons: Vec<PagePolygon> = faces.iter().map(page).collect();
        let frame = PageRect { min: PagePoint::new(0, 0), max: PagePoint::new(100_000_000, 100_000_000) };
        let stopped = visible_parts(&polygons, frame, 1 << 20, &|_, _| false);
        assert!(matches!(stopped, Err(DrawError::Cancelled)));
        let limited = visible_parts(&polygons, frame, 100, &|_, _| true);
        assert!(matches!(limited, Err(DrawError::TooManyParts { limit: 100 })));
        let (eye, volume) = (Eye::Direction(DVec3::Z), ViewVolume::default());
        let walk = TreeWalk { eye, volume: &volume, is_asked: &|_: &Face| true, max_faces: 100 };
        let limited = BspTree::new(&faces, 1000).front_to_back(&faces, &walk, &|_, _| true);
        assert!(matches!(limited, Err(DrawError::TooManyParts { limit: 100 })));
    }
}
