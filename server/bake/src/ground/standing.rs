//! Landmarks that stand on generated ground.

use crate::error::BakeError;
use crate::scene::scratch_scene::{ObjectPlacement, ScratchScene};

/// Moves the standing landmarks up or down, so that their lowest points are on the triangles in the middle of their boxes. Fails if the
/// objects cannot be read.
pub(super) fn move_to(city: &mut ScratchScene, triangles: &[[[f32; 3]; 3]]) -> Result<(), BakeError> {
    for number in city.standing.clone() {
        let mut object = city.objects.get(number as usize)?;
        let [low, high] = &mut object.bounds_m;
        let middle = [0, 1].map(|axis| (low[axis] + high[axis]) / 2.0);
        let Some(ground_m) = triangles.iter().find_map(|corners| height_at(corners, middle)) else { continue };
        let rise_m = ground_m - low[2];
        (low[2], high[2], object.base_z_m) = (low[2] + rise_m, high[2] + rise_m, object.base_z_m + rise_m);
        let (low_m, high_m) = (f64::from(low[2]), f64::from(high[2]));
        city.objects.update(number as usize, |stored| *stored = object)?;
        city.placements.replace_each(|_, placement| {
            let [x, y, z] = placement.offset_m;
            let offset_m = [x, y, z + f64::from(rise_m)];
            Ok::<_, BakeError>((placement.object == Some(number)).then_some(ObjectPlacement { offset_m, ..*placement }))
        })?;
        for landmark in city.landmarks.iter_mut().filter(|landmark| landmark.object == number) {
            landmark.anchor_m[2] += rise_m;
        }
        if let Some([min, max]) = &mut city.bounds {
            (min[2], max[2]) = (min[2].min(low_m), max[2].max(high_m));
        }
    }
    Ok(())
}

/// Height of a triangle at a place on the map; `None` outside of it.
pub(super) fn height_at([a, b, c]: &[[f32; 3]; 3], at: [f32; 2]) -> Option<f32> {
    let cross = |p: &[f32; 3], q: &[f32; 3]| {
        let [px, py, qx, qy] = [p[0] - at[0], p[1] - at[1], q[0] - at[0], q[1] - at[1]].map(f64::from);
        px * qy - py * qx
    };
    let weights = [cross(b, c), cross(c, a), cross(a, b)];
    let whole: f64 = weights.iter().sum();
    if whole == 0.0 || weights.iter().any(|weight| weight * whole < 0.0) {
        return None;
    }
    let height: f64 = weights.iter().zip([a, b, c]).map(|(weight, corner)| weight * f64::from(corner[2])).sum();
    Some((height / whole) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_are_those_of_the_plane_within_a_triangle() {
        let triangle = [[0.0, 0.0, 1.0], [4.0, 0.0, 3.0], [0.0, 4.0, 1.0]];
        assert_eq!(height_at(&triangle, [2.0, 1.0]), Some(2.0));
        assert_eq!(height_at(&triangle, [4.0, 0.0]), Some(3.0));
        assert_eq!(height_at(&triangle, [3.0, 3.0]), None);
        assert_eq!(height_at(&[[0.0; 3]; 3], [0.0, 0.0]), None);
    }
}
