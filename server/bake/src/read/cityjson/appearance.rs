//! Appearance of surfaces: semantics, materials and textures.

use super::nested::Nested;
use super::schema::{CityJsonAppearance, CityJsonMaterial, SurfaceSemantics};
use crate::read::context::ReadContext;
use insula_source::report::SourceReport;
use insula_source::source::CitySource;

/// The report of one object. Details begin with the object's identifier. A wrong index in an appearance costs only the
/// appearance, not the object.
pub(super) struct ObjectReport<'n> {
    pub(super) id: &'n str,
    pub(super) report: &'n mut SourceReport,
}

impl ObjectReport<'_> {
    pub(super) fn problem(&mut self, kind: &str, detail: impl FnOnce() -> String) {
        self.report.problem(kind, || format!("{}: {}", self.id, detail()));
    }
}

/// An appearance with the numbers of the textures that are loaded already.
pub(super) struct AppearanceReader<'a> {
    appearance: &'a CityJsonAppearance,
    /// By texture: `None` if not loaded yet, `Some(None)` if loading failed.
    textures: Vec<Option<Option<u32>>>,
}

impl<'a> AppearanceReader<'a> {
    pub(super) fn new(appearance: &'a CityJsonAppearance) -> Self {
        Self { appearance, textures: vec![None; appearance.textures.len()] }
    }

    /// The theme of textures that the file prefers.
    pub(super) fn default_theme_texture(&self) -> Option<&'a str> {
        self.appearance.default_theme_texture.as_str()
    }

    /// The theme of materials that the file prefers.
    pub(super) fn default_theme_material(&self) -> Option<&'a str> {
        self.appearance.default_theme_material.as_str()
    }

    /// The name of a surface's semantics.
    pub(super) fn semantic<'g>(
        &self,
        semantics: Option<&'g SurfaceSemantics>,
        value: &Nested,
        report: &mut ObjectReport<'_>,
    ) -> Option<&'g str> {
        let surfaces = &semantics?.surfaces;
        let index = value.index()?;
        let semantic = usize::try_from(index).ok().and_then(|index| surfaces.get(index));
        if semantic.is_none() {
            let detail = || format!("semantic index {index} out of range of {}", surfaces.len());
            report.problem("semantic index out of range", detail);
        }
        semantic.map(|semantic| semantic.kind.as_str())
    }

    /// The material of a surface.
    pub(super) fn material(&self, material: &Nested, report: &mut ObjectReport<'_>) -> Option<&'a CityJsonMaterial> {
        let index = material.index()?;
        let materials: &'a [CityJsonMaterial] = &self.appearance.materials;
        let material = usize::try_from(index).ok().and_then(|index| materials.get(index));
        if material.is_none() {
            let detail = || format!("material index {index} out of range of {}", materials.len());
            report.problem("material index out of range", detail);
        }
        material
    }

    /// The number of a surface's texture, which is that of its outer ring.
    pub(super) fn texture(
        &mut self,
        rings: &Nested,
        context: &mut ReadContext<'_>,
        source: &CitySource<'_>,
        report: &mut ObjectReport<'_>,
    ) -> Option<u32> {
        let index = rings.child(0).list().first()?.index()?;
        let slot = usize::try_from(index).ok().filter(|&index| index < self.textures.len());
        let Some(slot) = slot else {
            let detail = || format!("texture index {index} out of range of {}", self.textures.len());
            report.problem("texture index out of range", detail);
            return None;
        };
        let name = &self.appearance.textures[slot].image;
        *self.textures[slot].get_or_insert_with(|| context.textures.load(source, name, report.report))
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
