//! The city that is read, as far as generated facades need it.

use super::scene_builder::SceneBuilder;
use super::texture::TextureLoader;
use crate::scene::SceneTexture;
use crate::scene::scratch_scene::StoredMaterial;
use insula_dress::facade::{FacadeMaterials, SIDE_TEXELS};
use insula_place::placement::World;
use insula_read_ground::elevation::Elevation;
use std::sync::Arc;

/// Materials, textures and ground of the city that is read.
pub(super) struct FacadeCity<'a> {
    pub(super) builder: &'a mut SceneBuilder,
    pub(super) textures: &'a mut TextureLoader,
    /// Of objects that stand on elevation models.
    pub(super) ground: Option<(&'a mut Elevation, &'a mut World)>,
}

impl FacadeMaterials for FacadeCity<'_> {
    fn colour(&self, material: u32) -> [u8; 3] {
        self.builder.colour(material)
    }

    fn add_pattern(&mut self, texels: Vec<[u8; 3]>) -> u32 {
        let texture = SceneTexture { width: SIDE_TEXELS, height: SIDE_TEXELS, rgb: texels, is_pattern: true };
        let texture = self.textures.add_generated(Arc::new(texture));
        self.builder.material(StoredMaterial::matt([255; 3], Some(texture)))
    }

    fn ground_m(&mut self, position: [f64; 2]) -> Option<f64> {
        let (elevation, world) = self.ground.as_mut()?;
        // The terrain fails if a model cannot be read.
        elevation.settle(world).ok()?;
        elevation.extended_height_m(position).ok()?
    }
}
