//! Colours and textures by the hashes of the identifiers of rings and surfaces.
//!
//! Appearances often come last in a file, so they are collected in a pass of their own.

use insula_source::object::{ObjectSink, SourceMaterial};
use std::collections::HashMap;

/// Further texture coordinates are left out.
const MAX_TEXTURE_COORDINATES: usize = 1 << 27;

#[derive(Debug, Clone, Copy)]
struct RingTexture {
    ring: u64,
    material: u32,
    /// Indices of [`Appearances::uv`].
    start: u32,
    count: u32,
    theme: u32,
}

#[derive(Debug, Clone, Copy)]
struct SurfaceMaterial {
    surface: u64,
    material: u32,
    theme: u32,
}

#[derive(Debug)]
struct Material {
    material: SourceMaterial,
    /// Its number in the sink, once a surface used it.
    number: Option<u32>,
}

#[derive(Debug, Default)]
pub(super) struct Appearances {
    materials: Vec<Material>,
    rings: Vec<RingTexture>,
    surfaces: Vec<SurfaceMaterial>,
    uv: Vec<[f32; 2]>,
    themes: HashMap<Box<str>, u32>,
}

impl Appearances {
    /// Number of a theme: those that come first have lower numbers.
    pub(super) fn theme(&mut self, name: &str) -> u32 {
        let next = self.themes.len() as u32;
        *self.themes.entry(name.into()).or_insert(next)
    }

    pub(super) fn add_material(&mut self, material: SourceMaterial) -> u32 {
        self.materials.push(Material { material, number: None });
        self.materials.len() as u32 - 1
    }

    /// Gives a ring a texture. Returns whether there was room for it.
    pub(super) fn add_ring(
        &mut self,
        theme: u32,
        ring: u64,
        material: u32,
        uv: impl Iterator<Item = [f32; 2]>,
    ) -> bool {
        if self.uv.len() >= MAX_TEXTURE_COORDINATES {
            return false;
        }
        let start = self.uv.len() as u32;
        self.uv.extend(uv);
        let count = self.uv.len() as u32 - start;
        self.rings.push(RingTexture { ring, material, start, count, theme });
        true
    }

    pub(super) fn add_surface(&mut self, theme: u32, surface: u64, material: u32) {
        self.surfaces.push(SurfaceMaterial { surface, material, theme });
    }

    /// Sorts the appearances for use, after all are added. Where themes give a surface different looks, that of the
    /// theme with the most textures counts; without textures, the first theme. Themes without textures do not count if
    /// others have some.
    pub(super) fn finish(&mut self) {
        let mut textures_of_theme = vec![0u32; self.themes.len()];
        for ring in &self.rings {
            if let Some(count) = textures_of_theme.get_mut(ring.theme as usize) {
                *count += 1;
            }
        }
        let textures = |theme: u32| textures_of_theme.get(theme as usize).copied().unwrap_or(0);
        let rank = |theme: u32| (std::cmp::Reverse(textures(theme)), theme);
        self.rings.sort_by_key(|entry| (entry.ring, rank(entry.theme)));
        self.rings.dedup_by_key(|entry| entry.ring);
        if !self.rings.is_empty() {
            self.surfaces.retain(|entry| textures(entry.theme) > 0);
        }
        self.surfaces.sort_by_key(|entry| (entry.surface, rank(entry.theme)));
        self.surfaces.dedup_by_key(|entry| entry.surface);
    }

    /// Whether a ring or surface has a texture or material.
    pub(super) fn has(&self, hash: u64) -> bool {
        self.texture_of_ring(hash).is_some() || self.material_of_surface(hash).is_some()
    }

    /// Material and texture coordinates of a ring.
    pub(super) fn texture_of_ring(&self, ring: u64) -> Option<(u32, &[[f32; 2]])> {
        let index = self.rings.binary_search_by_key(&ring, |entry| entry.ring).ok()?;
        let RingTexture { material, start, count, .. } = *self.rings.get(index)?;
        Some((material, self.uv.get(start as usize..(start + count) as usize)?))
    }

    pub(super) fn material_of_surface(&self, surface: u64) -> Option<u32> {
        let index = self.surfaces.binary_search_by_key(&surface, |entry| entry.surface).ok()?;
        self.surfaces.get(index).map(|entry| entry.material)
    }

    pub(super) fn number_of(&mut self, material: u32, sink: &mut dyn ObjectSink) -> Option<u32> {
        let Material { material, number } = self.materials.get_mut(material as usize)?;
        Some(*number.get_or_insert_with(|| sink.add_material(material.clone())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theme_with_the_most_textures_counts() {
        let mut appearances = Appearances::default();
        let (solar, photo) = (appearances.theme("solar"), appearances.theme("photo"));
        let [red, brick] = [0, 1].map(|_| appearances.add_material(SourceMaterial::default()));
        appearances.add_surface(solar, 7, red);
        appearances.add_surface(photo, 8, red);
        appearances.add_ring(solar, 5, red, [[0.0, 0.0]].into_iter());
        for ring in [5, 6] {
            appearances.add_ring(photo, ring, brick, [[0.5, 1.0], [1.0, 1.0]].into_iter());
        }
        appearances.finish();
        assert_eq!(appearances.texture_of_ring(5), Some((brick, &[[0.5, 1.0], [1.0, 1.0]][..])));
        assert_eq!(appearances.texture_of_ring(4), None);
        assert_eq!(appearances.material_of_surface(8), Some(red));
        assert!(appearances.has(7) && appearances.has(6) && !appearances.has(9));
    }

    #[test]
    fn themes_without_textures_do_not_count_beside_textures() {
        let mut appearances = Appearances::default();
        let (first, second) = (appearances.theme("a"), appearances.theme("b"));
        let material = appearances.add_material(SourceMaterial::default());
        appearances.add_surface(first, 1, material);
        appearances.add_surface(second, 2, material);
        appearances.add_ring(second, 3, material, std::iter::empty());
        appearances.finish();
        assert_eq!((appearances.material_of_surface(1), appearances.material_of_surface(2)), (None, Some(material)));
    }
}
