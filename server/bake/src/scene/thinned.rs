//! Landmarks with fewer triangles, for columns.
//!
//! A column of half a metre does not show millimetres, and its occlusion is measured by drawing all triangles of the block from
//! more than a hundred directions.

use super::{Scene, SceneTriangle};
use insula_simplify::model::TriangleModel;
use insula_simplify::simplify::{Goal, Simplified, simplify};
use std::collections::HashMap;

/// A landmark with more triangles is thinned to this number. A statue has a thousand columns at most.
const MAX_TRIANGLES: usize = 20_000;

impl Scene {
    /// The scene with its dense landmarks simplified; `None` if it has none.
    pub(crate) fn with_thin_landmarks(&self) -> Option<Self> {
        let mut of_landmark: HashMap<u32, Vec<&SceneTriangle>> = HashMap::new();
        for triangle in self.triangles.iter().filter(|triangle| self.landmark(triangle.object).is_some()) {
            of_landmark.entry(triangle.object).or_default().push(triangle);
        }
        of_landmark.retain(|_, triangles| triangles.len() > MAX_TRIANGLES);
        if of_landmark.is_empty() {
            return None;
        }
        let is_kept = |triangle: &&SceneTriangle| !of_landmark.contains_key(&triangle.object);
        let mut triangles: Vec<SceneTriangle> = self.triangles.iter().filter(is_kept).copied().collect();
        let mut objects: Vec<u32> = of_landmark.keys().copied().collect();
        // The same order in every run.
        objects.sort_unstable();
        objects.iter().for_each(|object| thin(&of_landmark[object], &mut triangles));
        Some(Self {
            origin: self.origin,
            triangles,
            objects: self.objects.clone(),
            materials: self.materials.clone(),
            crs: self.crs.clone(),
            numbers: self.numbers.clone(),
            landmarks: self.landmarks.clone(),
        })
    }
}

/// Adds the simplified triangles of a landmark.
fn thin(source: &[&SceneTriangle], triangles: &mut Vec<SceneTriangle>) {
    let mut model = TriangleModel::default();
    for (first, triangle) in (0..).step_by(3).zip(source) {
        model.positions.extend(triangle.corners.map(|corner| corner.map(f64::from)));
        model.triangles.push([first, first + 1, first + 2]);
    }
    model.weld();
    let goal = Goal { triangles: MAX_TRIANGLES, error: f64::INFINITY };
    let Simplified { model, sources, .. } = simplify(&model, goal, |_| false);
    for (corners, from) in model.triangles.iter().zip(&sources) {
        let corners = corners.map(|vertex| model.positions[vertex as usize].map(|v| v as f32));
        // Texture coordinates of the source's triangle: a texel of the right part of the texture.
        triangles.push(SceneTriangle { corners, ..*source[*from as usize] });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Landmark, ObjectKind, SceneObject};

    #[test]
    fn only_dense_landmarks_become_thin() {
        const SIDE: u32 = 150;
        let mut scene = Scene::default();
        let height = |x: u32, y: u32| 0.3 * ((x as f32 * 0.2).sin() + (y as f32 * 0.17).cos());
        for object in 0..2 {
            scene.objects.push(SceneObject { id: object.to_string(), kind: ObjectKind::Building, base_z_m: 0.0 });
            for (x, y) in (0..SIDE).flat_map(|x| (0..SIDE).map(move |y| (x, y))) {
                let at = |x: u32, y: u32| [x as f32 * 0.02, y as f32 * 0.02, height(x, y) + object as f32];
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
                for corners in [[a, b, c], [a, c, d]] {
                    scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 7, object });
                }
            }
        }
        assert!(scene.with_thin_landmarks().is_none());
        scene.landmarks = vec![Landmark { object: 1, stone: None, anchor_m: [0.0; 3] }];
        let thin = scene.with_thin_landmarks().unwrap();
        let of = |scene: &Scene, object: u32| scene.triangles.iter().filter(|t| t.object == object).count();
        assert_eq!(of(&thin, 0), of(&scene, 0));
        assert!((1000..=MAX_TRIANGLES).contains(&of(&thin, 1)) && thin.triangles.iter().all(|t| t.material == 7));
    }
}
