//! The triangles that every source becomes, whatever its format.
//!
//! In: what a reader of `read/` found in a file. Out: one [`Scene`]. Next: `partition`.

pub mod grid;
pub(crate) mod partition;
pub(crate) mod scratch_scene;

use std::sync::Arc;

/// What an object is: decides its colour where the source gives none, and how its columns are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum ObjectKind {
    /// A building, a bridge, furniture: anything with a volume.
    #[default]
    Building,
    /// The ground: one-sided, its underside neither blocks nor is seen (design 5, step 2).
    Terrain,
}

/// One city object: the unit that is counted, coloured and, later, updated.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneObject {
    /// The source's own identifier, for reports.
    pub id: String,
    /// What it is.
    pub kind: ObjectKind,
    /// Height of its lowest vertex in metres above the scene's origin: an open-bottomed shell is closed there.
    pub base_z_m: f32,
}

/// A picture that colours triangles. Rows from the top, 8-bit sRGB.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneTexture {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// `width * height` RGB triples.
    pub rgb: Vec<[u8; 3]>,
}

/// How a triangle is coloured.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// 8-bit sRGB, multiplied with the texture where there is one.
    pub rgb: [u8; 3],
    /// Shared, because many materials may use one picture.
    pub texture: Option<Arc<SceneTexture>>,
}

/// One triangle, counter-clockwise seen from outside where the source knows outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneTriangle {
    /// Corners in metres relative to [`Scene::origin`].
    pub corners: [[f32; 3]; 3],
    /// Texture coordinates, v up (OBJ's convention); zero where the material has no texture.
    pub uv: [[f32; 2]; 3],
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Index into [`Scene::objects`].
    pub object: u32,
}

/// A whole city as triangles.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// World position (source CRS, metres, f64) that corners are relative to.
    pub origin: [f64; 3],
    /// All triangles.
    pub triangles: Vec<SceneTriangle>,
    /// All objects.
    pub objects: Vec<SceneObject>,
    /// All materials.
    pub materials: Vec<Material>,
    /// For example `EPSG:7415`; `None` where the source does not say.
    pub crs: Option<String>,
}
