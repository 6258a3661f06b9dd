//! What the mesh modules need of a scene's materials.

use crate::scene::{Scene, SceneTexture};

pub(super) fn texture_of(scene: &Scene, material: u32) -> Option<&SceneTexture> {
    scene.materials.get(material as usize)?.texture.as_deref()
}

pub(super) fn has_pattern(scene: &Scene, material: u32) -> bool {
    texture_of(scene, material).is_some_and(|texture| texture.is_pattern)
}

/// The 8-bit sRGB colour of a material; grey if the scene has no such material.
pub(super) fn base_colour(scene: &Scene, material: u32) -> [u8; 3] {
    scene.materials.get(material as usize).map_or([128; 3], |material| material.rgb)
}
