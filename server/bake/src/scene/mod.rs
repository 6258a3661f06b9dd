//! The triangles of a city, whatever format they were read from.

pub(crate) mod block_content;
pub mod grid;
pub(crate) mod object_facts;
pub(crate) mod object_numbers;
pub(crate) mod object_records;
pub(crate) mod partition;
pub(crate) mod scratch_budget;
pub(crate) mod scratch_scene;
pub(crate) mod texture_store;
pub(crate) mod triangle_store;

use insula_protocol::blockmap::NO_OBJECT;
use insula_simplify::model::TriangleModel;
use insula_simplify::simplify::{Goal, Simplified, simplify};
pub use insula_source::object::ObjectKind;
pub use insula_source::texture::SceneTexture;
use std::collections::HashMap;
use std::sync::Arc;

/// One object of the city.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneObject {
    /// The source's own identifier, for reports.
    pub id: String,
    pub kind: ObjectKind,
    /// Height of the lowest vertex in metres above the scene's origin, or of the ground below it if the source says how far the
    /// object is above it. A shell that is open at the bottom is closed there.
    pub base_z_m: f32,
}

/// Colour of triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// 8-bit sRGB, multiplied with the texture if there is one.
    pub rgb: [u8; 3],
    /// Shared, because many materials may use one image.
    pub texture: Option<Arc<SceneTexture>>,
    /// Whether it is water or glass.
    pub is_reflective: bool,
}

/// A triangle, counter-clockwise seen from outside where the source defines an outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneTriangle {
    /// Corners in metres relative to [`Scene::origin`].
    pub corners: [[f32; 3]; 3],
    /// Texture coordinates with v up, as in OBJ; zero where the material has no texture.
    pub uv: [[f32; 2]; 3],
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Index into [`Scene::objects`].
    pub object: u32,
}

/// A whole city as triangles.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// World position, in metres of the source's coordinate system, that corners are relative to.
    pub origin: [f64; 3],
    pub triangles: Vec<SceneTriangle>,
    pub objects: Vec<SceneObject>,
    pub materials: Vec<Material>,
    /// Coordinate system such as `EPSG:7415`; `None` where no source names one.
    pub crs: Option<String>,
    /// Number in the baked city of each object, by which tiles name it; empty for tiles without objects.
    pub numbers: Vec<u32>,
    pub landmarks: Vec<Landmark>,
}

/// An object of dense triangles, with a stone of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landmark {
    /// Index into [`Scene::objects`].
    pub object: u32,
    /// Index into the manifest's stones; `None` if it has its own colours.
    pub stone: Option<u8>,
    /// Origin of the stone's pattern, in metres relative to [`Scene::origin`].
    pub anchor_m: [f32; 3],
}

impl Scene {
    /// Number of a triangle's object in the baked city; [`NO_OBJECT`] if it has none.
    pub(crate) fn object_number(&self, triangle: u32) -> u32 {
        let object = self.triangles.get(triangle as usize).map(|triangle| triangle.object as usize);
        object.and_then(|object| self.numbers.get(object)).copied().unwrap_or(NO_OBJECT)
    }

    pub(crate) fn landmark(&self, object: u32) -> Option<&Landmark> {
        self.landmarks.iter().find(|landmark| landmark.object == object)
    }

    /// Whether a triangle is water or glass; `false` for indices that do not exist.
    pub(crate) fn is_reflective(&self, triangle: u32) -> bool {
        let material = self.triangles.get(triangle as usize).and_then(|t| self.materials.get(t.material as usize));
        material.is_some_and(|material| material.is_reflective)
    }
}

/// A landmark with more triangles is thinned to this number for columns. A statue has a thousand columns at most. A column of half a metre
/// does not show millimetres, and its occlusion is measured by drawing all triangles of the block from more than a hundred directions.
const MAX_LANDMARK_TRIANGLES: usize = 20_000;

impl Scene {
    /// The scene with its dense landmarks simplified; `None` if it has none.
    pub(crate) fn with_thin_landmarks(&self) -> Option<Self> {
        let mut of_landmark: HashMap<u32, Vec<&SceneTriangle>> = HashMap::new();
        for triangle in self.triangles.iter().filter(|triangle| self.landmark(triangle.object).is_some()) {
            of_landmark.entry(triangle.object).or_default().push(triangle);
        }
        of_landmark.retain(|_, triangles| triangles.len() > MAX_LANDMARK_TRIANGLES);
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
    let goal = Goal { triangles: MAX_LANDMARK_TRIANGLES, error: f64::INFINITY };
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
        assert!(
            (1000..=MAX_LANDMARK_TRIANGLES).contains(&of(&thin, 1)) && thin.triangles.iter().all(|t| t.material == 7)
        );
    }
}
