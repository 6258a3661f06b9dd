//! The part of the map on which a building stands, and its height.

use super::map_store::{MapBounds, MapRecord, bounds};
use serde::{Deserialize, Serialize};

/// The ground beside a building meets its base, and passes into the ground around within this distance.
pub const BLEND_M: f64 = 8.0;

/// What a building stands on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BuildingBase {
    /// World height of the building's lowest corner.
    pub height_m: f64,
    /// World position to which the triangles are relative.
    pub corner: [f64; 2],
    /// Triangles on the map, each with an area.
    pub triangles: Vec<[[f32; 2]; 3]>,
}

impl BuildingBase {
    /// World positions of a triangle's corners.
    pub fn on_map(&self, triangle: &[[f32; 2]; 3]) -> [[f64; 2]; 3] {
        triangle.map(|corner| [0, 1].map(|axis| self.corner[axis] + f64::from(corner[axis])))
    }

    /// Mean of what `height_m` gives at the corners and the middle of the triangles, by their area; `None` if one of them
    /// has no height. Fails with the first error of `height_m`.
    pub fn mean_ground_m<E>(
        &self,
        mut height_m: impl FnMut([f64; 2]) -> Result<Option<f64>, E>,
    ) -> Result<Option<f64>, E> {
        let (mut sum, mut weights) = (0.0, 0.0);
        for triangle in &self.triangles {
            let [a, b, c] = self.on_map(triangle);
            let area_m2 = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs() / 2.0;
            let middle = [0, 1].map(|axis| (a[axis] + b[axis] + c[axis]) / 3.0);
            let mut mean = 0.0;
            // Exact where the ground is a plane or a paraboloid.
            for (position, share) in [(a, 1.0 / 12.0), (b, 1.0 / 12.0), (c, 1.0 / 12.0), (middle, 0.75)] {
                let Some(height) = height_m(position)? else { return Ok(None) };
                mean += share * height;
            }
            (sum, weights) = (sum + area_m2 * mean, weights + area_m2);
        }
        Ok((weights > 0.0).then(|| sum / weights))
    }
}

/// A base touches the ground of a rectangle if its bounds do.
impl MapRecord for BuildingBase {
    fn bounds(&self) -> Option<MapBounds> {
        let corners: Vec<[f64; 2]> = self.triangles.iter().flat_map(|triangle| self.on_map(triangle)).collect();
        let [low, high] = bounds(&corners)?;
        Some([low.map(|v| v - BLEND_M), high.map(|v| v + BLEND_M)])
    }

    fn size_bytes(&self) -> u64 {
        (24 + size_of_val(self.triangles.as_slice())) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bases_are_the_same_after_they_were_written() {
        let triangles = vec![[[0.0, 1.5], [4.0, -2.0], [3.0, 9.0]], [[1.0, 1.0], [2.0, 2.0], [f32::MIN_POSITIVE, 3.0]]];
        let base = BuildingBase { height_m: 431.25, corner: [25_496_117.25, 6_672_041.5], triangles };
        let bytes = base.encode().unwrap();
        assert_eq!(BuildingBase::decode(&bytes), Some(base));
        assert_eq!(BuildingBase::decode(&bytes[..bytes.len() - 1]), None);
        assert_eq!(BuildingBase::decode(&bytes[..bytes.len() - 4]), None);
        assert_eq!(BuildingBase::decode(&bytes[..9]), None);
    }

    #[test]
    fn mean_ground_follows_slopes() {
        let triangles = vec![[[0.0, 0.0], [6.0, 0.0], [6.0, 4.0]], [[0.0, 0.0], [6.0, 4.0], [0.0, 4.0]]];
        let base = BuildingBase { height_m: 0.0, corner: [100.0, 200.0], triangles };
        let plane = |[x, y]: [f64; 2]| Ok::<_, ()>(Some(0.1 * (x - 100.0) + 0.5 * (y - 200.0)));
        let mean_m = base.mean_ground_m(plane).unwrap().unwrap();
        assert!((mean_m - 1.3).abs() < 1e-6, "{mean_m}");
        let partly = |[x, _]: [f64; 2]| Ok::<_, ()>((x < 105.0).then_some(1.0));
        assert_eq!(base.mean_ground_m(partly), Ok(None));
        assert_eq!(base.mean_ground_m(|_| Err::<Option<f64>, _>("broken")), Err("broken"));
    }
}
