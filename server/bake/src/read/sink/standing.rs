//! Puts what has no heights of its own on the ground: buildings stand on it, areas lie on it.

use super::SceneSink;
use crate::read::scene_builder::WorldTriangle;
use insula_source::error::InputError;

/// Areas follow the ground with edges of this length at most, of this many cells, and of this share of the distance
/// between the model's heights.
const MAX_EDGE_M: f64 = 8.0;
const MAX_EDGE_CELLS: f64 = 4.0;
const MAX_EDGE_STEPS: f64 = 0.5;
/// Areas that would need more faces, such as a sea, have longer edges.
const MAX_FACES: f64 = 1e6;

impl SceneSink<'_, '_, '_> {
    /// Lowest ground under a plan; 0 without an elevation model. Fails if one cannot be read.
    pub(super) fn lowest_ground_m(&mut self, rings: &[Vec<[f64; 2]>]) -> Result<f64, InputError> {
        if self.context.elevation.is_empty() {
            return Ok(0.0);
        }
        let mut lowest = f64::INFINITY;
        for corner in rings.iter().take(1).flatten() {
            lowest = lowest.min(self.context.ground_m(*corner)?);
        }
        Ok(if lowest.is_finite() { lowest } else { 0.0 })
    }

    /// Lifts the collected faces.
    pub(super) fn lift(&mut self, by_m: f64) {
        self.faces.iter_mut().flat_map(|face| &mut face.corners).for_each(|corner| corner[2] += by_m);
    }

    /// Lifts the collected faces, which have their heights, over ground that is painted without an elevation model.
    pub(super) fn lift_over_paint(&mut self) {
        if self.context.elevation.is_empty() && self.context.is_painting() {
            self.lift(self.above_ground_m());
        }
    }

    /// So far above the terrain's triangles as these may be above the ground.
    fn above_ground_m(&self) -> f64 {
        self.context.options.terrain.error_cells * self.context.options.cell_m
    }

    /// Lays the collected faces, which are level, on the ground: divides them, and adds its height. Without an elevation model they stay
    /// level, above ground that is painted, at the height of the source if it has one. Fails as [`Self::lowest_ground_m`].
    pub(super) fn drape(&mut self, base_m: Option<f64>) -> Result<(), InputError> {
        let options = self.context.options;
        if self.context.elevation.is_empty() {
            self.lift(base_m.unwrap_or(0.0));
            self.lift_over_paint();
            return Ok(());
        }
        let above_m = self.above_ground_m();
        self.context.elevation.settle(&mut self.context.world)?;
        let of_model = self.context.elevation.step_m() * MAX_EDGE_STEPS;
        let area_m2: f64 = self.faces.iter().map(|face| area_on_map_m2(&face.corners)).sum();
        let of_area = libm::sqrt(area_m2 / MAX_FACES);
        let max_edge_m = MAX_EDGE_M.max(MAX_EDGE_CELLS * options.cell_m).max(of_model).max(of_area);
        let mut divided = Vec::with_capacity(self.faces.len());
        for face in self.faces.drain(..) {
            divide(face, max_edge_m, &mut divided);
        }
        for face in &mut divided {
            for corner in &mut face.corners {
                corner[2] += above_m + self.context.ground_m([corner[0], corner[1]])?;
            }
        }
        self.faces = divided;
        Ok(())
    }
}

fn area_on_map_m2([a, b, c]: &[[f64; 3]; 3]) -> f64 {
    ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])).abs() / 2.0
}

/// Divides a face until no edge is longer than a limit on the map. Faces with a common edge divide it alike.
fn divide(face: WorldTriangle, max_edge_m: f64, divided: &mut Vec<WorldTriangle>) {
    let mut pending = vec![face];
    while let Some(face) = pending.pop() {
        let corner = |i: usize| face.corners[i % 3];
        let length = |i: usize| {
            let (a, b) = (corner(i), corner(i + 1));
            libm::hypot(a[0] - b[0], a[1] - b[1])
        };
        let longest = (1..3).fold(0, |longest, i| if length(i) > length(longest) { i } else { longest });
        if length(longest).is_nan() || length(longest) <= max_edge_m {
            divided.push(face);
            continue;
        }
        let (a, b) = (longest, (longest + 1) % 3);
        let middle = std::array::from_fn(|axis| (face.corners[a][axis] + face.corners[b][axis]) / 2.0);
        let uv = std::array::from_fn(|axis| (face.uv[a][axis] + face.uv[b][axis]) / 2.0);
        for end in [a, b] {
            let mut half = face;
            (half.corners[end], half.uv[end]) = (middle, uv);
            pending.push(half);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_with_a_common_edge_divide_it_alike() {
        let face = |corners| WorldTriangle { corners, uv: [[0.0; 2]; 3], material: 0, is_facade: false };
        let [a, b, c, d] = [[0.0, 0.0, 1.0], [31.0, 3.0, 1.0], [2.0, 17.0, 1.0], [40.0, 60.0, 1.0]];
        let (mut first, mut second) = (Vec::new(), Vec::new());
        divide(face([a, b, c]), 8.0, &mut first);
        divide(face([c, b, d]), 8.0, &mut second);
        let on_edge = |faces: &[WorldTriangle]| {
            let is_on = |p: &[f64; 3]| {
                let cross = (c[0] - b[0]) * (p[1] - b[1]) - (c[1] - b[1]) * (p[0] - b[0]);
                cross.abs() < 1e-6
            };
            let mut points: Vec<[u64; 3]> =
                faces.iter().flat_map(|face| face.corners).filter(is_on).map(|p| p.map(f64::to_bits)).collect();
            points.sort_unstable();
            points.dedup();
            points
        };
        assert_eq!(on_edge(&first), on_edge(&second));
        assert!(on_edge(&first).len() >= 5);
        let area = |faces: &[WorldTriangle]| {
            let of = |[a, b, c]: [[f64; 3]; 3]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            faces.iter().map(|face| of(face.corners) / 2.0).sum::<f64>()
        };
        assert!((area(&first) - area(&[face([a, b, c])])).abs() < 1e-9);
    }
}
