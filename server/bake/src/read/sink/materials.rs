//! Materials of a source, by the numbers that its reader uses.

use crate::read::context::ReadContext;
use insula_dress::alpha_mask::AlphaMask;
use insula_source::object::{SourceImage, SourceMaterial, Wrap};
use insula_source::report::SourceReport;
use insula_source::source::CitySource;
use std::collections::HashMap;
use std::rc::Rc;

/// Materials that let more light through are glass.
const GLASS_OPACITY: f32 = 0.95;
/// Materials that let more light through are not seen at all.
const INVISIBLE_OPACITY: f32 = 0.02;
/// Materials that are smoother and no metal are glass or water.
const GLASS_ROUGHNESS: f32 = 0.15;
/// Further materials are those of the first.
const MAX_MATERIALS: usize = 1 << 20;

/// Textures of one source with holes; further ones are opaque. A mask takes 65 KiB.
const MAX_MASKS: usize = 512;

/// A material whose texture is loaded.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReadMaterial {
    /// Number of its name in the table.
    pub(super) name: Option<u32>,
    pub(super) rgb: Option<[u8; 3]>,
    /// Of surfaces that do not show the texture.
    pub(super) untextured_rgb: Option<[u8; 3]>,
    /// Number of the texture in the scene, and what is outside of it.
    pub(super) texture: Option<(u32, Wrap)>,
    /// Number of the mask that cuts holes.
    pub(super) mask: Option<u32>,
    pub(super) is_reflective: bool,
    pub(super) is_invisible: bool,
    /// Whether no palette changes the colour.
    pub(super) is_exact: bool,
    /// Whether it is that of windows or doors, by its name.
    pub(super) is_opening: bool,
}

impl ReadMaterial {
    /// A material of which nothing is known.
    pub(super) const PLAIN: Self = Self {
        name: None,
        rgb: None,
        untextured_rgb: None,
        texture: None,
        mask: None,
        is_reflective: false,
        is_invisible: false,
        is_exact: false,
        is_opening: false,
    };
}

/// Whether a material is that of windows or doors, judged by its name.
fn names_an_opening(material: &str) -> bool {
    let name = material.to_lowercase();
    ["window", "glass", "door"].iter().any(|word| name.contains(word))
}

/// What distinguishes materials. Images within the source are known by their names.
#[derive(PartialEq, Eq, Hash)]
struct MaterialKey {
    name: Option<Rc<str>>,
    rgb: [Option<[u8; 3]>; 2],
    image: Option<(String, u8)>,
    numbers: [Option<u32>; 4],
    is_exact: bool,
}

impl MaterialKey {
    fn new(material: &SourceMaterial) -> Self {
        let name_of = |image: &SourceImage| match image {
            SourceImage::File(name) | SourceImage::Encoded { name, .. } | SourceImage::Texels { name, .. } => {
                name.clone()
            }
        };
        let SourceMaterial { name, rgb, untextured_rgb, texture, opacity, alpha_cutoff, roughness, metallic, is_exact } =
            material;
        Self {
            name: name.clone(),
            rgb: [*rgb, *untextured_rgb],
            image: texture.as_ref().map(|texture| (name_of(&texture.image), texture.wrap as u8)),
            numbers: [Some(*opacity), *alpha_cutoff, *roughness, *metallic].map(|number| number.map(f32::to_bits)),
            is_exact: *is_exact,
        }
    }
}

/// The materials that a reader added.
#[derive(Default)]
pub(super) struct MaterialTable {
    materials: Vec<ReadMaterial>,
    names: Vec<Rc<str>>,
    numbers: HashMap<MaterialKey, u32>,
    masks: Vec<AlphaMask>,
    /// By texture and cutoff; `None` without holes.
    mask_numbers: HashMap<(u32, u32), Option<u32>>,
}

impl MaterialTable {
    /// Number of a material; its texture is loaded with the first use.
    pub(super) fn add(
        &mut self,
        material: SourceMaterial,
        context: &mut ReadContext<'_>,
        source: &CitySource<'_>,
        report: &mut SourceReport,
    ) -> u32 {
        let key = MaterialKey::new(&material);
        if let Some(number) = self.numbers.get(&key) {
            return *number;
        }
        if self.materials.len() >= MAX_MATERIALS {
            report.problem("too many materials", || format!("more than {MAX_MATERIALS}"));
            return 0;
        }
        // Reading ends with the next object.
        let wanted = material.texture.as_ref().filter(|_| !context.holds_too_much());
        let texture = wanted.and_then(|texture| {
            let number = match &texture.image {
                SourceImage::File(name) => context.textures.load(source, name, report),
                SourceImage::Encoded { name, bytes } => context.textures.load_encoded(source, name, bytes, report),
                SourceImage::Texels { name, width, height, rgba } => {
                    context.textures.add_texels(source, name, [*width, *height], rgba, report)
                }
            };
            number.map(|number| (number, texture.wrap))
        });
        let mask = texture.zip(material.alpha_cutoff).and_then(|((texture, _), cutoff)| {
            let grid = context.textures.alpha(texture)?;
            let known = self.mask_numbers.entry((texture, cutoff.to_bits()));
            *known.or_insert_with(|| {
                let mask = AlphaMask::new(grid, cutoff)?;
                if self.masks.len() >= MAX_MASKS {
                    report.problem("too many textures with holes", || format!("more than {MAX_MASKS}"));
                    return None;
                }
                self.masks.push(mask);
                Some(self.masks.len() as u32 - 1)
            })
        });
        let is_smooth = material.roughness.is_some_and(|roughness| roughness < GLASS_ROUGHNESS)
            && material.metallic.is_some_and(|metallic| metallic < 0.5);
        let is_opening = material.name.as_deref().is_some_and(names_an_opening);
        let name = material.name.map(|name| {
            self.names.push(name);
            self.names.len() as u32 - 1
        });
        let read = ReadMaterial {
            name,
            rgb: material.rgb,
            untextured_rgb: material.untextured_rgb,
            texture,
            mask,
            is_reflective: material.opacity < GLASS_OPACITY || is_smooth && texture.is_none(),
            is_invisible: material.opacity < INVISIBLE_OPACITY,
            is_exact: material.is_exact,
            is_opening,
        };
        let number = self.materials.len() as u32;
        self.materials.push(read);
        self.numbers.insert(key, number);
        number
    }

    pub(super) fn mask(&self, number: Option<u32>) -> Option<&AlphaMask> {
        self.masks.get(number? as usize)
    }

    pub(super) fn name(&self, material: Option<ReadMaterial>) -> Option<&str> {
        self.names.get(material?.name? as usize).map(|name| &**name)
    }

    pub(super) fn get(&self, number: Option<u32>) -> Option<ReadMaterial> {
        self.materials.get(number? as usize).copied()
    }
}
