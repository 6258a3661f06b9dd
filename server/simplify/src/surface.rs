//! Distances between surfaces of triangles, as Metro measures them (Cignoni, Rocchini and Scopigno 1998).
//!
//! Points spread over one surface, and all its vertices, are compared with the other surface. Lengths are in the unit of the
//! triangles.

use crate::model::TriangleModel;
use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use std::collections::HashSet;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

/// Steps of a sequence of points that fill a square evenly (Roberts 2018, "The unreasonable effectiveness of quasirandom
/// sequences").
const EVEN_STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];
/// Points of which a thread finds the distances one after the other.
const POINTS_AT_ONCE: usize = 1024;
/// Most intervals between points along a triangle's side.
const MAX_INTERVALS: u32 = 6;
/// Larger coordinates are refused. Below it, all numbers stay finite, also in f32.
const MAX_COORDINATE: f64 = 1e15;

/// Triangles in a hierarchy of bounding boxes.
pub struct Surface {
    triangles: Vec<[DVec3; 3]>,
    /// Subtracted before numbers become f32.
    centre: DVec3,
    diagonal: f64,
    bvh: Bvh2,
}

/// Distances of the points of one surface from another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceDistance {
    pub mean: f64,
    pub rms: f64,
    /// The largest distance: one side of the Hausdorff distance.
    pub max: f64,
    /// The point that has it.
    pub farthest: [f64; 3],
}

impl Surface {
    /// `None` without triangles, or if a coordinate is not finite or beyond 10^15.
    pub fn new(triangles: Vec<[[f64; 3]; 3]>) -> Option<Self> {
        let triangles: Vec<[DVec3; 3]> = triangles.into_iter().map(|corners| corners.map(DVec3::from)).collect();
        let corners = || triangles.iter().flatten();
        let low = corners().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = corners().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        if triangles.is_empty() || !corners().all(|p| p.abs().max_element() <= MAX_COORDINATE && p.is_finite()) {
            return None;
        }
        let centre = (low + high) / 2.0;
        let of_bvh = |p: DVec3| Vec3A::from((p - centre).as_vec3());
        let boxed = |[a, b, c]: &[DVec3; 3]| Triangle { v0: of_bvh(*a), v1: of_bvh(*b), v2: of_bvh(*c) };
        let all: Vec<Triangle> = triangles.iter().map(boxed).collect();
        let bvh = build_bvh2_from_tris(&all, BvhBuildParams::medium_build(), &mut Duration::default());
        Some(Self { triangles, centre, diagonal: low.distance(high), bvh })
    }

    /// The surface of a model; `None` as [`Surface::new`].
    pub fn of_model(model: &TriangleModel) -> Option<Self> {
        let corners = |triangle: &[u32; 3]| triangle.map(|vertex| model.positions[vertex as usize]);
        Self::new(model.triangles.iter().map(corners).collect())
    }

    /// Diagonal of the bounding box.
    pub fn diagonal(&self) -> f64 {
        self.diagonal
    }

    /// Distance of a point from the nearest triangle.
    pub fn distance(&self, p: [f64; 3]) -> f64 {
        self.nearest(p, 0, 0.0, &mut Vec::new()).1
    }

    /// The triangle nearest to a point, and its distance; or any triangle that is at most `enough` away. `guess` is any triangle: the
    /// nearer it is, the fewer others are looked at. `open` is memory of the search.
    fn nearest(&self, p: [f64; 3], guess: usize, enough: f64, open: &mut Vec<(u32, f32)>) -> (usize, f64) {
        let p = DVec3::from(p);
        let mut best = (guess, squared_distance(p, self.triangles[guess]));
        let enough = enough * enough;
        if best.1 <= enough {
            return (best.0, best.1.sqrt());
        }
        let local = p - self.centre;
        let place = Vec3A::from(local.as_vec3());
        // Boxes are in f32: they may be nearer than they seem by this.
        let slack = (local.length() + self.diagonal) as f32 * 1e-6;
        let mut reach = best.1.sqrt() as f32 + slack;
        let box_distance = |node: u32| {
            let aabb = self.bvh.nodes[node as usize].aabb();
            (place - place.clamp(aabb.min, aabb.max)).length()
        };
        open.clear();
        open.push((0, 0.0));
        while let Some((node, distance)) = open.pop() {
            // With numbers that are too large, this is never so, and all triangles are looked at.
            if distance > reach {
                continue;
            }
            let node = &self.bvh.nodes[node as usize];
            if node.prim_count == 0 {
                let (a, b) = (node.first_index, node.first_index + 1);
                let (a, b) = ((a, box_distance(a)), (b, box_distance(b)));
                // The nearer one is next.
                open.extend(if a.1 < b.1 { [b, a] } else { [a, b] });
                continue;
            }
            for at in node.first_index..node.first_index + node.prim_count {
                let triangle = self.bvh.primitive_indices[at as usize] as usize;
                let squared = squared_distance(p, self.triangles[triangle]);
                if squared < best.1 {
                    best = (triangle, squared);
                    reach = squared.sqrt() as f32 + slack;
                    if squared <= enough {
                        return (triangle, squared.sqrt());
                    }
                }
            }
        }
        (best.0, best.1.sqrt())
    }

    /// Distances of points from the nearest triangles, on all cores. It is fastest if points that follow each other are near each other.
    pub fn distances(&self, points: &[[f64; 3]]) -> Vec<f64> {
        let mut distances = vec![0.0; points.len()];
        points.par_chunks(POINTS_AT_ONCE).zip(distances.par_chunks_mut(POINTS_AT_ONCE)).for_each(
            |(points, distances)| {
                let (mut guess, mut open) = (0, Vec::new());
                for (p, distance) in points.iter().zip(distances) {
                    (guess, *distance) = self.nearest(*p, guess, 0.0, &mut open);
                }
            },
        );
        distances
    }

    /// About `count` points, evenly spread by area; none if all triangles are degenerate.
    pub fn even_points(&self, count: usize) -> Vec<[f64; 3]> {
        let area = |[a, b, c]: &[DVec3; 3]| (*b - *a).cross(*c - *a).length() / 2.0;
        let step = self.triangles.iter().map(area).sum::<f64>() / count.max(1) as f64;
        let (mut points, mut sum) = (Vec::with_capacity(count), 0.0);
        for triangle in &self.triangles {
            sum += area(triangle);
            let [a, b, c] = *triangle;
            while points.len() < count && sum > (points.len() as f64 + 0.5) * step {
                let [u, v] = EVEN_STEPS.map(|step| (0.5 + step * (points.len() + 1) as f64).fract());
                let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                points.push((a + (b - a) * u + (c - a) * v).to_array());
            }
        }
        points
    }

    /// The largest distance of about `samples` points, and of all corners, from `other`: that of [`Self::compare`], much sooner. Of a
    /// point that is nearer than the farthest one so far, the distance does not matter.
    pub fn largest_distance(&self, other: &Self, samples: usize) -> f64 {
        let mut points = self.even_points(samples);
        points.extend(self.triangles.iter().flatten().map(DVec3::to_array));
        // Distances are not negative, so that their bits have their order.
        let largest = AtomicU64::new(0);
        points.par_chunks(POINTS_AT_ONCE).for_each(|points| {
            let (mut guess, mut open) = (0, Vec::new());
            for p in points {
                let so_far = f64::from_bits(largest.load(Relaxed));
                let distance;
                (guess, distance) = other.nearest(*p, guess, so_far, &mut open);
                largest.fetch_max(distance.max(so_far).to_bits(), Relaxed);
            }
        });
        f64::from_bits(largest.into_inner())
    }

    /// The largest distance of points of a model from this surface, about `spacing` apart. Points of triangle `t` count for at most
    /// `bound(t)`.
    pub fn distance_of(&self, model: &TriangleModel, spacing: f64, bound: impl Fn(usize) -> f64) -> f64 {
        let (mut largest, mut guess, mut open) = (0f64, 0, Vec::new());
        for (t, triangle) in model.triangles.iter().enumerate() {
            let bound = bound(t);
            let [a, b, c] = triangle.map(|vertex| DVec3::from(model.positions[vertex as usize]));
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            let intervals = ((longest / spacing).ceil() as u32).clamp(1, MAX_INTERVALS);
            for i in 0..=intervals {
                for j in 0..=intervals - i {
                    if bound <= largest {
                        break;
                    }
                    let p = a + ((b - a) * f64::from(i) + (c - a) * f64::from(j)) / f64::from(intervals);
                    let distance;
                    (guess, distance) = self.nearest(p.to_array(), guess, largest, &mut open);
                    largest = largest.max(distance.min(bound));
                }
            }
        }
        largest
    }

    /// Distances of about `samples` points, and of all corners, from `other`.
    pub fn compare(&self, other: &Self, samples: usize) -> SurfaceDistance {
        let mut points = self.even_points(samples);
        let even = points.len();
        let mut seen = HashSet::new();
        let corners = self.triangles.iter().flatten().map(DVec3::to_array);
        points.extend(corners.filter(|p| seen.insert(p.map(f64::to_bits))));
        let distances = other.distances(&points);
        // Corners are dense where triangles are small, so they only count for the largest distance.
        let sums = distances[..even].iter().fold((0.0, 0.0), |(sum, squares), d| (sum + d, squares + d * d));
        let ((sum, squares), count) = (sums, even.max(1) as f64);
        let farthest = (0..points.len()).max_by(|a, b| distances[*a].total_cmp(&distances[*b]));
        SurfaceDistance {
            mean: sum / count,
            rms: (squares / count).sqrt(),
            max: farthest.map_or(0.0, |i| distances[i]),
            farthest: farthest.map_or([0.0; 3], |i| points[i]),
        }
    }
}

fn squared_distance(p: DVec3, triangle: [DVec3; 3]) -> f64 {
    (p - nearest_on_triangle(p, triangle)).length_squared()
}

/// The point of a triangle that is nearest to a point (Ericson 2005, "Real-Time Collision Detection", 5.1.5).
pub fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    // `a` and `b` may be one point.
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    if sum > 0.0 {
        return a + ab * (vb / sum) + ac * (vc / sum);
    }
    let nearer = |q: DVec3, r: DVec3| if q.distance_squared(p) <= r.distance_squared(p) { q } else { r };
    nearer(nearer(a, b), c)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of two triangles at height `z`.
    fn square(side: f64, z: f64) -> Surface {
        let p = |x: f64, y: f64| [x * side, y * side, z];
        let (a, b, c, d) = (p(0.0, 0.0), p(1.0, 0.0), p(1.0, 1.0), p(0.0, 1.0));
        Surface::new(vec![[a, b, c], [a, c, d]]).unwrap()
    }

    #[test]
    fn distances_of_squares_are_known() {
        let (small, large) = (square(1.0, 0.0), square(2.0, 0.5));
        let there = small.compare(&large, 1000);
        assert!((there.mean - 0.5).abs() < 1e-12 && (there.rms - 0.5).abs() < 1e-12 && (there.max - 0.5).abs() < 1e-12);
        let back = large.compare(&small, 20_000);
        assert!((back.max - 2.25f64.sqrt()).abs() < 1e-12 && back.farthest == [2.0, 2.0, 0.5], "{back:?}");
        // The integral of squares: a quarter lies above the small square.
        let rms = (0.25 + (1.0 / 3.0 + 1.0 / 3.0 + 2.0 / 3.0) / 4.0f64).sqrt();
        assert!((back.rms - rms).abs() < 0.01, "{} {rms}", back.rms);
        assert!((small.distance([100.0, 0.5, 0.0]) - 99.0).abs() < 1e-9);
        for bad in [f64::NAN, f64::INFINITY, 1e16, -1e300] {
            assert!(Surface::new(vec![[[0.0; 3], [1.0, bad, 0.0], [0.0, 1.0, 0.0]]]).is_none());
        }
        assert!(Surface::new(Vec::new()).is_none());
        let point = Surface::new(vec![[[3.0, 0.0, 0.0]; 3]]).unwrap();
        assert_eq!(point.compare(&small, 10).max, 2.0);
        assert_eq!(small.distance([1e300, 0.0, 0.0]), f64::INFINITY);
    }

    #[test]
    fn points_of_a_model_count_for_their_bound_at_most() {
        let at = |z: f64| TriangleModel {
            positions: vec![[0.0, 0.0, z], [10.0, 0.0, z], [10.0, 10.0, z], [0.0, 10.0, z]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            layers: Vec::new(),
        };
        let far = |z: f64| square(10.0, 0.0).distance_of(&at(z), 1.0, |_| f64::INFINITY);
        assert!(far(0.0) < 1e-9 && far(1.5) == 1.5 && far(9.0) == 9.0);
        assert_eq!(square(10.0, 0.0).distance_of(&at(3.0), 1.0, |_| 0.25), 0.25);
    }

    #[test]
    fn the_nearest_triangle_is_found_from_any_guess() {
        // A bent sheet of 800 triangles, and points in and around it.
        let at = |x: usize, y: usize| [x as f64, y as f64, ((x * y) as f64 / 9.0).sin() * 3.0];
        let squares = (0..20).flat_map(|y| (0..20).map(move |x| [x, y]));
        let sheet = squares.flat_map(|[x, y]| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        });
        let sheet = Surface::new(sheet.collect()).unwrap();
        let part = |i: usize, step: f64| (i as f64 * step).fract() * 30.0 - 5.0;
        let points: Vec<[f64; 3]> = (0..3000).map(|i| [part(i, 0.618), part(i, 0.755), part(i, 0.57)]).collect();
        let all = |p: &[f64; 3]| {
            let squared = |corners: &[DVec3; 3]| squared_distance(DVec3::from(*p), *corners);
            sheet.triangles.iter().map(squared).fold(f64::INFINITY, f64::min).sqrt()
        };
        let found = sheet.distances(&points);
        assert!(points.iter().zip(&found).all(|(p, distance)| all(p) == *distance && sheet.distance(*p) == *distance));
        let cloud = Surface::new(points.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()).unwrap();
        for (a, b) in [(&cloud, &sheet), (&sheet, &cloud), (&sheet, &sheet)] {
            assert_eq!(a.largest_distance(b, 5000), a.compare(b, 5000).max);
        }
    }

    #[test]
    fn precision_does_not_depend_on_the_place() {
        let at = |z: f64| {
            let p = |x: f64, y: f64| [4_500_000.0 + x, 5_400_000.0 + y, z];
            Surface::new(vec![[p(0.0, 0.0), p(30.0, 0.0), p(0.0, 30.0)]]).unwrap()
        };
        let found = at(0.0).compare(&at(0.001), 500);
        assert!((found.max - 0.001).abs() < 1e-8, "{found:?}");
    }

    #[test]
    fn distance_is_right_in_every_region_of_a_triangle() {
        let triangle = [DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];
        for (p, squared) in [
            ([1.0, 1.0, 3.0], 9.0),
            ([-3.0, -4.0, 0.0], 25.0),
            ([7.0, -4.0, 0.0], 25.0),
            ([-4.0, 7.0, 0.0], 25.0),
            ([2.0, -2.0, 0.0], 4.0),
            ([-2.0, 2.0, 0.0], 4.0),
            ([4.0, 4.0, 0.0], 8.0),
        ] {
            assert!((squared_distance(p.into(), triangle) - squared).abs() < 1e-12, "{p:?}");
        }
        let [a, b, _] = triangle;
        for triangle in [[a, a, b], [a, b, a], [b, a, a]] {
            assert_eq!(squared_distance(DVec3::new(1.0, 2.0, 0.0), triangle), 4.0, "{triangle:?}");
        }
    }
}
