//! Distances between two surfaces, measured at points spread over one of them.
//!
//! Lengths are in the unit of the models.

use glam::DVec3;
use insula_simplify::disjoint_sets::DisjointSets;
use insula_simplify::model::TriangleModel;
use insula_simplify::triangle_distance::squared_distance;
use std::collections::HashMap;

/// Most intervals between samples along a triangle's side.
const MAX_INTERVALS: u32 = 6;
/// Least side of a cube. Many triangles are walls of hundreds of units, which would fill too many small cubes.
const MIN_CUBE_SIDE: f64 = 128.0;
/// Half the diagonal of a cube of side 1, rounded up.
const HALF_CUBE_DIAGONAL: f64 = 0.867;

/// The triangles of a surface in a hash grid of cubes. Each cube lists all triangles within `reach` of its points.
pub(super) struct TriangleHash {
    triangles: Vec<[DVec3; 3]>,
    cubes: HashMap<[i32; 3], Vec<u32>>,
    cube_side: f64,
    reach: f64,
}

impl TriangleHash {
    /// Distances up to `reach` can be measured.
    pub(super) fn new(model: &TriangleModel, reach: f64) -> Self {
        let cube_side = (4.0 * reach).max(MIN_CUBE_SIDE);
        let triangles: Vec<[DVec3; 3]> = (0..model.triangles.len()).map(|t| corners(model, t)).collect();
        let mut cubes: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        for (number, triangle) in (0..).zip(&triangles) {
            let [a, b, c] = *triangle;
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let cube_of = |p: DVec3| (p / cube_side).floor().as_ivec3();
            let (low, high) = (cube_of(a.min(b).min(c) - reach), cube_of(a.max(b).max(c) + reach));
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    for x in low.x..=high.x {
                        let centre = (DVec3::new(x.into(), y.into(), z.into()) + 0.5) * cube_side;
                        if (centre - a).dot(normal).abs() <= HALF_CUBE_DIAGONAL * cube_side + reach {
                            cubes.entry([x, y, z]).or_default().push(number);
                        }
                    }
                }
            }
        }
        Self { triangles, cubes, cube_side, reach }
    }

    /// Distance of the nearest triangle, at most `reach`.
    fn distance(&self, p: DVec3) -> f64 {
        let cube = (p / self.cube_side).floor().as_ivec3();
        let near = self.cubes.get(&cube.to_array()).map_or(&[][..], Vec::as_slice);
        let squared = near.iter().map(|t| squared_distance(p, self.triangles[*t as usize]));
        squared.fold(self.reach * self.reach, f64::min).sqrt()
    }

    /// The largest distance of points of `model`, about `spacing` apart. Points of triangle `t` count for at most
    /// `bound(t)`.
    pub(super) fn max_distance(&self, model: &TriangleModel, spacing: f64, bound: impl Fn(usize) -> f64) -> f64 {
        let mut max = 0f64;
        for t in 0..model.triangles.len() {
            let bound = bound(t);
            let [a, b, c] = corners(model, t);
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            let intervals = ((longest / spacing).ceil() as u32).clamp(1, MAX_INTERVALS);
            for i in 0..=intervals {
                for j in 0..=intervals - i {
                    if bound <= max {
                        break;
                    }
                    let p = a + ((b - a) * f64::from(i) + (c - a) * f64::from(j)) / f64::from(intervals);
                    max = max.max(self.distance(p).min(bound));
                }
            }
        }
        max
    }
}

fn corners(model: &TriangleModel, t: usize) -> [DVec3; 3] {
    model.triangles[t].map(|vertex| DVec3::from(model.positions[vertex as usize]))
}

/// For each triangle, half the diagonal of the bounding box of its connected part: if the part is removed, no point of
/// it is further than this from where the part was.
pub(super) fn part_half_diagonals(model: &TriangleModel) -> Vec<f64> {
    let mut parts = DisjointSets::new(model.positions.len());
    for [a, b, c] in &model.triangles {
        parts.union(*a, *b);
        parts.union(*a, *c);
    }
    let mut boxes: HashMap<u32, [DVec3; 2]> = HashMap::new();
    for (v, position) in (0..).zip(&model.positions) {
        let p = DVec3::from(*position);
        let part_box = boxes.entry(parts.find(v)).or_insert([p, p]);
        *part_box = [part_box[0].min(p), part_box[1].max(p)];
    }
    let half_diagonal = |triangle: &[u32; 3]| {
        let [low, high] = boxes.get(&parts.find(triangle[0])).copied().unwrap_or_default();
        (high - low).length() / 2.0
    };
    model.triangles.iter().map(half_diagonal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(z: f64) -> TriangleModel {
        let positions = vec![[0.0, 0.0, z], [10.0, 0.0, z], [10.0, 10.0, z], [0.0, 10.0, z]];
        TriangleModel { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], layers: Vec::new() }
    }

    #[test]
    fn distance_of_parallel_squares_is_exact() {
        let near = TriangleHash::new(&square(0.0), 5.0);
        let far = |z: f64| near.max_distance(&square(z), 1.0, |_| f64::INFINITY);
        assert!(far(0.0) < 1e-9 && far(1.5) == 1.5 && far(9.0) == 5.0);
        assert_eq!(near.max_distance(&square(3.0), 1.0, |_| 0.25), 0.25);
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
    }

    #[test]
    fn half_diagonals_are_those_of_the_connected_parts() {
        let mut model = square(0.0);
        model.positions.extend([[50.0, 0.0, 0.0], [53.0, 0.0, 0.0], [53.0, 4.0, 0.0]]);
        model.triangles.push([4, 5, 6]);
        let half = part_half_diagonals(&model);
        assert!((half[0] - 50f64.sqrt()).abs() < 1e-9 && half[0] == half[1] && half[2] == 2.5);
    }
}
