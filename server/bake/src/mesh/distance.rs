//! How far two surfaces lie apart.
//!
//! In: points on one, triangles of the other. Out: distances, up to a bound. Next: `chain`.

use std::collections::HashMap;

use glam::DVec3;

use crate::model::TriangleModel;

/// Along a triangle's side, most places where it is measured.
const MOST_SAMPLES: u32 = 6;

/// Side of a cube at least: many triangles are walls of hundreds of steps.
const SMALLEST_CUBE: f64 = 128.0;

/// Triangles of a surface, in cubes.
pub(super) struct Near {
    triangles: Vec<[DVec3; 3]>,
    cubes: HashMap<[i32; 3], Vec<u32>>,
    side: f64,
    reach: f64,
}

impl Near {
    /// Distances up to `reach` can be asked for.
    pub(super) fn new(model: &TriangleModel, reach: f64) -> Self {
        let side = (4.0 * reach).max(SMALLEST_CUBE);
        let triangles: Vec<[DVec3; 3]> = (0..model.triangles.len()).map(|t| corners(model, t)).collect();
        let mut cubes: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        for (number, triangle) in (0..).zip(&triangles) {
            let [a, b, c] = *triangle;
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let cube = |p: DVec3| (p / side).floor().as_ivec3();
            let (low, high) = (cube(a.min(b).min(c) - reach), cube(a.max(b).max(c) + reach));
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    for x in low.x..=high.x {
                        let middle = (DVec3::new(x.into(), y.into(), z.into()) + 0.5) * side;
                        // Half a cube's diagonal, and what may be asked for beyond.
                        if (middle - a).dot(normal).abs() <= 0.867 * side + reach {
                            cubes.entry([x, y, z]).or_default().push(number);
                        }
                    }
                }
            }
        }
        Self { triangles, cubes, side, reach }
    }

    /// To the nearest triangle; `reach` if there is none within.
    fn distance(&self, p: DVec3) -> f64 {
        let cube = (p / self.side).floor().as_ivec3();
        let near = self.cubes.get(&cube.to_array()).map_or(&[][..], Vec::as_slice);
        let squared = near.iter().map(|t| squared_distance(p, self.triangles[*t as usize]));
        squared.fold(self.reach * self.reach, f64::min).sqrt()
    }

    /// The largest distance of points spread over `model`, about `spacing` apart; each triangle's counts for no more than
    /// its bound.
    pub(super) fn farthest(&self, model: &TriangleModel, spacing: f64, bound: impl Fn(usize) -> f64) -> f64 {
        let mut farthest = 0f64;
        for t in 0..model.triangles.len() {
            let most = bound(t);
            let [a, b, c] = corners(model, t);
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            let parts = ((longest / spacing).ceil() as u32).clamp(1, MOST_SAMPLES);
            for i in 0..=parts {
                for j in 0..=parts - i {
                    if most <= farthest {
                        break;
                    }
                    let p = a + ((b - a) * f64::from(i) + (c - a) * f64::from(j)) / f64::from(parts);
                    farthest = farthest.max(self.distance(p).min(most));
                }
            }
        }
        farthest
    }
}

fn corners(model: &TriangleModel, t: usize) -> [DVec3; 3] {
    model.triangles[t].map(|vertex| DVec3::from(model.positions[vertex as usize]))
}

/// From a point to a triangle (Ericson 2005, 5.1.5).
fn squared_distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac) = (b - a, c - a);
    let to = |q: DVec3| (p - q).length_squared();
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return to(a);
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return to(b);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return to(a + ab * (d1 / (d1 - d3)));
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return to(c);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return to(a + ac * (d2 / (d2 - d6)));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return to(b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))));
    }
    let sum = va + vb + vc;
    if sum <= 0.0 { to(a).min(to(b)).min(to(c)) } else { to(a + ab * (vb / sum) + ac * (vc / sum)) }
}

/// For each triangle, half the diagonal of the box around all that hangs together with it: when a part leaves, no more
/// than that is missing.
pub(super) fn half_diagonals(model: &TriangleModel) -> Vec<f64> {
    let mut parent: Vec<u32> = (0..model.positions.len() as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for [a, b, c] in &model.triangles {
        for other in [b, c] {
            let (one, other) = (root(&mut parent, *a), root(&mut parent, *other));
            parent[one.max(other) as usize] = one.min(other);
        }
    }
    let mut boxes: HashMap<u32, [DVec3; 2]> = HashMap::new();
    for (v, position) in (0..).zip(&model.positions) {
        let p = DVec3::from(*position);
        let around = boxes.entry(root(&mut parent, v)).or_insert([p, p]);
        *around = [around[0].min(p), around[1].max(p)];
    }
    let half = |triangle: &[u32; 3]| {
        let [low, high] = boxes.get(&root(&mut parent, triangle[0])).copied().unwrap_or_default();
        (high - low).length() / 2.0
    };
    model.triangles.iter().map(half).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(z: f64) -> TriangleModel {
        let positions = vec![[0.0, 0.0, z], [10.0, 0.0, z], [10.0, 10.0, z], [0.0, 10.0, z]];
        TriangleModel { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], layers: Vec::new() }
    }

    #[test]
    fn two_sheets_are_as_far_apart_as_they_are() {
        let near = Near::new(&sheet(0.0), 5.0);
        let far = |z: f64| near.farthest(&sheet(z), 1.0, |_| f64::INFINITY);
        assert!(far(0.0) < 1e-9 && far(1.5) == 1.5 && far(9.0) == 5.0);
        assert_eq!(near.farthest(&sheet(3.0), 1.0, |_| 0.25), 0.25);
    }

    #[test]
    fn every_region_of_a_triangle() {
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
    fn parts_are_bounded_by_their_boxes() {
        let mut model = sheet(0.0);
        model.positions.extend([[50.0, 0.0, 0.0], [53.0, 0.0, 0.0], [53.0, 4.0, 0.0]]);
        model.triangles.push([4, 5, 6]);
        let half = half_diagonals(&model);
        assert!((half[0] - 50f64.sqrt()).abs() < 1e-9 && half[0] == half[1] && half[2] == 2.5);
    }
}
