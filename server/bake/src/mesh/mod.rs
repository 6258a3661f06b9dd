//! The triangles of a leaf as levels of detail (LODs) for near views.
//!
//! In: a block's scene and one of its leaves. Out: [`EncodedLod`]s, which are mesh tiles with what a client must know
//! to select them. Next: `write`.
//!
//! | step | module |
//! |---|---|
//! | clip triangles to the leaf's square | `square_clip` |
//! | put them on the grid of points that all leaves share | `leaf_surface` |
//! | simplify them, level by level, within measured errors | `lod_chain`, `dense_chain`, `lod_encoder` |
//! | compute occlusion at the vertices of landmarks | `leaf_occlusion` |
//! | cut textured surfaces into charts, and pack these | `charts`, `atlas` |
//! | resample the source's textures into one per level | `texture_bake`, `texture_canvas`, `texture_fill` |
//! | encode the texture as WebP | `texture_encode` |
//!
//! Neighbouring leaves meet at any two levels of detail: both clip a triangle at their border in the same way, both
//! have the same grid points there, and vertices on the border never move.

mod atlas;
mod charts;
mod dense_chain;
mod leaf_occlusion;
mod leaf_surface;
mod lod_chain;
mod lod_encoder;
mod square_clip;
mod texture_bake;
mod texture_canvas;
mod texture_encode;
mod texture_fill;

use crate::error::BakeError;
use crate::scene::grid::CityGrid;
use crate::scene::{Scene, SceneTexture};
use insula_protocol::TileId;
use insula_protocol::blockmap::Quality;
pub(crate) use lod_encoder::EncodedLod;

/// Version of the algorithm. Raised whenever the same scene and settings would give other meshes than before.
pub const ALGORITHM: u32 = 6;

/// The leaf's levels of detail, the finest first. Empty if the leaf has no surface, or only one too small for its grid.
///
/// Fails if a level cannot be encoded.
pub(crate) fn leaf_lods(
    scene: &Scene,
    grid: &CityGrid,
    id: TileId,
    quality: Quality,
) -> Result<Vec<EncodedLod>, BakeError> {
    match leaf_surface::LeafSurface::gather(scene, grid, id) {
        Some(surface) => lod_chain::encode_lods(scene, grid, id, &surface, quality),
        None => Ok(Vec::new()),
    }
}

#[cfg(test)]
mod tests;

fn texture_of(scene: &Scene, material: u32) -> Option<&SceneTexture> {
    scene.materials.get(material as usize)?.texture.as_deref()
}

fn has_pattern(scene: &Scene, material: u32) -> bool {
    texture_of(scene, material).is_some_and(|texture| texture.is_pattern)
}

/// The 8-bit sRGB colour of a material; grey if the scene has no such material.
fn base_colour(scene: &Scene, material: u32) -> [u8; 3] {
    scene.materials.get(material as usize).map_or([128; 3], |material| material.rgb)
}
