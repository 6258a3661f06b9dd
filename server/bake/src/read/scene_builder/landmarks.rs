//! Landmarks, and the ground that they stand on.

use super::{PendingObject, SceneBuilder};
use crate::error::BakeError;
use crate::scene::ObjectKind;

/// Objects that are farther away on the map do not tell the height of the ground.
const MAX_NEIGHBOUR_M: f64 = 200.0;
/// Objects nearer than this count as being so far away.
const MIN_NEIGHBOUR_M: f64 = 1.0;

/// A landmark while objects are read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PendingLandmark {
    pub(crate) object: u32,
    /// Number of its stone; `None` if it has its own colours.
    pub(crate) stone: Option<u8>,
    /// Whether it is moved to the ground. Until then, its lowest point is at height 0.
    pub(crate) is_on_ground: bool,
}

/// Where the ground is asked for, and what is known of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroundQuery {
    /// On the map, in world coordinates.
    pub(crate) place: [f64; 2],
    /// World height of the highest terrain there; `None` if no triangle of terrain is.
    terrain_m: Option<f64>,
}

impl SceneBuilder {
    pub(crate) fn add_landmark(&mut self, landmark: PendingLandmark) {
        self.landmarks.push(landmark);
    }

    /// The places of the landmarks that are to be moved to the ground. Fails if the objects cannot be read.
    pub(crate) fn landmarks_without_ground(&self) -> Result<Vec<[f64; 2]>, BakeError> {
        let waiting = self.landmarks.iter().filter(|landmark| landmark.is_on_ground);
        waiting.map(|landmark| Ok(self.pending.get(landmark.object as usize)?.middle())).collect()
    }

    /// Lifts the landmarks that are to be moved to the ground, in order. To be called once. Fails if the objects cannot be read.
    pub(crate) fn stand_landmarks(&mut self, heights_m: &[f64]) -> Result<(), BakeError> {
        let waiting = self.landmarks.iter().filter(|landmark| landmark.is_on_ground);
        for (landmark, height_m) in waiting.zip(heights_m) {
            self.pending.update(landmark.object as usize, |object| object.anchor[2] += height_m)?;
        }
        Ok(())
    }

    /// World heights of the ground at places, where there is no elevation model: that of the terrain's triangles, else that of the
    /// feet of the objects around, else 0. Fails if the stored triangles cannot be read.
    pub(crate) fn ground_heights(&mut self, places: &[[f64; 2]]) -> Result<Vec<f64>, BakeError> {
        let mut queries: Vec<GroundQuery> =
            places.iter().map(|place| GroundQuery { place: *place, terrain_m: None }).collect();
        let mut has_terrain = false;
        self.pending.try_for_each(|_, object| {
            has_terrain |= object.kind.is_terrain();
            Ok::<_, BakeError>(())
        })?;
        if has_terrain {
            self.triangles.flush()?;
            let mut pending = self.pending.cursor();
            self.triangles.try_for_each(|triangle| {
                let object = pending.get(triangle.object as usize)?;
                if object.kind == ObjectKind::Terrain && !object.is_dropped {
                    queries.iter_mut().for_each(|query| query.meet(object, triangle.corners));
                }
                Ok(())
            })?;
        }
        queries.iter().map(|query| query.terrain_m.map_or_else(|| self.feet_m(query.place), Ok)).collect()
    }

    /// Mean height of the lowest corners of the objects around, weighted by nearness.
    fn feet_m(&self, [x, y]: [f64; 2]) -> Result<f64, BakeError> {
        let (mut sum, mut weights) = (0.0, 0.0);
        self.pending.try_for_each(|number, object| {
            if object.is_dropped || self.landmarks.iter().any(|landmark| landmark.object as usize == number) {
                return Ok::<_, BakeError>(());
            }
            let outside = |v: f64, axis: usize| (object.low(axis) - v).max(v - object.high(axis)).max(0.0);
            let distance_m = libm::hypot(outside(x, 0), outside(y, 1));
            if distance_m <= MAX_NEIGHBOUR_M {
                let weight = distance_m.max(MIN_NEIGHBOUR_M).powi(-2);
                (sum, weights) = (sum + object.low(2) * weight, weights + weight);
            }
            Ok(())
        })?;
        Ok(if weights > 0.0 { sum / weights } else { 0.0 })
    }
}

impl PendingObject {
    /// The middle of its box on the map.
    fn middle(&self) -> [f64; 2] {
        [0, 1].map(|axis| (self.low(axis) + self.high(axis)) / 2.0)
    }
}

impl GroundQuery {
    /// Notes a triangle of terrain, in coordinates of its object.
    fn meet(&mut self, object: &PendingObject, corners: [[f32; 3]; 3]) {
        let at: [f64; 2] = std::array::from_fn(|axis| self.place[axis] - object.anchor[axis]);
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let cross = |p: [f64; 3], q: [f64; 3]| (p[0] - at[0]) * (q[1] - at[1]) - (p[1] - at[1]) * (q[0] - at[0]);
        let weights = [cross(b, c), cross(c, a), cross(a, b)];
        let whole: f64 = weights.iter().sum();
        if whole == 0.0 || weights.iter().any(|weight| weight * whole < 0.0) {
            return;
        }
        let height = (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]) / whole + object.anchor[2];
        self.terrain_m = Some(self.terrain_m.map_or(height, |known| known.max(height)));
    }
}
