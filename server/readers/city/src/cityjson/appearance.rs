//! Appearance of surfaces: materials and textures.

use super::nested::Nested;
use super::schema::{CityJsonAppearance, CityJsonMaterial};
use insula_source::object::{ObjectSink, SourceImage, SourceMaterial, SourceTexture, Wrap, png_cutoff};
use std::collections::HashMap;

/// Opacity of all materials that something can be seen through: writers disagree on which end of the scale is opaque, so
/// none is taken for invisible.
const GLASS_OPACITY: f32 = 0.5;

/// An appearance with the numbers of the materials that the sink has already.
pub(super) struct AppearanceReader<'a> {
    appearance: &'a CityJsonAppearance,
    /// By texture and material.
    numbers: HashMap<(Option<usize>, Option<usize>), u32>,
}

impl<'a> AppearanceReader<'a> {
    pub(super) fn new(appearance: &'a CityJsonAppearance) -> Self {
        Self { appearance, numbers: HashMap::new() }
    }

    /// The theme of textures that the file prefers.
    pub(super) fn default_theme_texture(&self) -> Option<&'a str> {
        self.appearance.default_theme_texture.as_str()
    }

    /// The theme of materials that the file prefers.
    pub(super) fn default_theme_material(&self) -> Option<&'a str> {
        self.appearance.default_theme_material.as_str()
    }

    pub(super) fn textures(&self) -> usize {
        self.appearance.textures.len()
    }

    pub(super) fn materials(&self) -> usize {
        self.appearance.materials.len()
    }

    /// The sink's number of a texture, which replaces the material, or of a material; `None` without both.
    pub(super) fn number(
        &mut self,
        texture: Option<usize>,
        material: Option<usize>,
        sink: &mut dyn ObjectSink,
    ) -> Option<u32> {
        if texture.is_none() && material.is_none() {
            return None;
        }
        let CityJsonAppearance { textures, materials, .. } = self.appearance;
        let add = || {
            let material = material.and_then(|number| materials.get(number));
            let rgb = material.and_then(CityJsonMaterial::rgb);
            let texture = texture.and_then(|number| textures.get(number));
            let alpha_cutoff = texture.and_then(|texture| png_cutoff(&texture.image));
            let texture = texture.map(|texture| SourceTexture {
                image: SourceImage::File(texture.image.replace('\\', "/")),
                wrap: texture.wrap_mode.as_str().map_or(Wrap::Repeat, Wrap::of_citygml),
            });
            if texture.is_some() {
                let untextured_rgb = rgb;
                let textured = SourceMaterial { untextured_rgb, texture, alpha_cutoff, ..SourceMaterial::default() };
                return sink.add_material(textured);
            }
            let is_transparent = material.is_some_and(CityJsonMaterial::is_transparent);
            let opacity = if is_transparent { GLASS_OPACITY } else { 1.0 };
            sink.add_material(SourceMaterial { rgb, opacity, ..SourceMaterial::default() })
        };
        Some(*self.numbers.entry((texture, material)).or_insert_with(add))
    }

    /// Appends a ring's texture coordinates; `false` if they do not fit the ring. The first entry of a ring is its
    /// texture.
    pub(super) fn append_uvs(&self, ring: &Nested, corners: usize, uvs: &mut Vec<[f32; 2]>) -> bool {
        let entries = ring.list();
        if entries.len() != corners + 1 {
            return false;
        }
        for entry in &entries[1..] {
            let index = entry.index().and_then(|index| usize::try_from(index).ok());
            let Some(uv) = index.and_then(|index| self.appearance.vertices_texture.get(index)) else { return false };
            uvs.push(uv.map(|c| c as f32));
        }
        true
    }
}
