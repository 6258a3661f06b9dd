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
mod thinned;
pub(crate) mod triangle_store;

use insula_protocol::blockmap::NO_OBJECT;
pub use insula_source::object::ObjectKind;
pub use insula_source::texture::SceneTexture;
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
