//! How a surface looks: texture, else material, else a colour by its meaning.
//!
//! In: appearance and semantics. Out: colours, pictures, texture coordinates. Next: `geometry`.

use super::model::{CityJsonAppearance, SurfaceSemantics};
use super::nested::Nested;
use crate::read::ReadContext;
use crate::read::palette::Palette;
use crate::read::report::SourceReport;
use crate::read::source::CitySource;

/// What is said of a surface besides its texture.
pub(crate) struct SurfaceProperties<'g> {
    pub(crate) semantic: Option<&'g str>,
    pub(crate) object_type: &'g str,
    pub(crate) material: &'g Nested,
}

/// An appearance and the pictures of it that have been asked for.
pub(crate) struct AppearanceReader<'a> {
    appearance: &'a CityJsonAppearance,
    pictures: Vec<Option<Option<u32>>>,
}

/// The object and the report that a fault is noted under. A wrong index here costs the look, not the object.
type Note<'n> = (&'n str, &'n mut SourceReport);

impl<'a> AppearanceReader<'a> {
    pub(crate) fn new(appearance: &'a CityJsonAppearance) -> Self {
        Self { appearance, pictures: vec![None; appearance.textures.len()] }
    }

    /// The name of a surface's semantic.
    pub(crate) fn semantic<'g>(
        &self,
        semantics: Option<&'g SurfaceSemantics>,
        value: &Nested,
        (id, report): Note<'_>,
    ) -> Option<&'g str> {
        let surfaces = &semantics?.surfaces;
        let index = value.index()?;
        let semantic = usize::try_from(index).ok().and_then(|index| surfaces.get(index));
        if semantic.is_none() {
            let detail = || format!("{id}: semantic index {index} out of range of {}", surfaces.len());
            report.problem("semantic index out of range", detail);
        }
        semantic.map(|semantic| semantic.kind.as_str())
    }

    /// The material's colour, else one by meaning.
    pub(crate) fn colour(&self, look: &SurfaceProperties<'_>, palette: &Palette, (id, report): Note<'_>) -> [u8; 3] {
        if let Some(index) = look.material.index() {
            let materials = &self.appearance.materials;
            match usize::try_from(index).ok().and_then(|index| materials.get(index)) {
                Some(material) => {
                    if let Some(rgb) = material.diffuse_colour {
                        return rgb.map(byte);
                    }
                }
                None => {
                    let detail = || format!("{id}: material index {index} out of range of {}", materials.len());
                    report.problem("material index out of range", detail);
                }
            }
        }
        palette.colour(look.semantic, look.object_type)
    }

    /// The number of a surface's picture: its outer ring's.
    pub(crate) fn texture(
        &mut self,
        rings: &Nested,
        (reading, source): (&mut ReadContext<'_>, &CitySource<'_>),
        (id, report): Note<'_>,
    ) -> Option<u32> {
        let index = rings.child(0).list().first()?.index()?;
        let place = usize::try_from(index).ok().filter(|&index| index < self.pictures.len());
        let Some(place) = place else {
            let detail = || format!("{id}: texture index {index} out of range of {}", self.pictures.len());
            report.problem("texture index out of range", detail);
            return None;
        };
        let name = &self.appearance.textures[place].image;
        *self.pictures[place].get_or_insert_with(|| reading.textures.load(source, name, report))
    }

    /// Appends a ring's texture coordinates (its list starts with the picture); whether they fit.
    pub(crate) fn uvs(&self, ring: &Nested, corners: usize, uvs: &mut Vec<[f32; 2]>) -> bool {
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

/// A share to 8 bits.
pub(crate) fn byte(share: f64) -> u8 {
    (share.clamp(0.0, 1.0) * 255.0).round() as u8
}
