//! Materials that faces use, of all libraries that a file names.

use super::mtl::{self, MtlMaterial, UvMapping};
use super::parse::{ObjFace, ObjFile};
use insula_source::input::Input;
use insula_source::object::{ALPHA_CUTOFF, ObjectSink, SourceImage, SourceMaterial, SourceTexture, Wrap, unit_to_byte};
use insula_source::problems::{LIBRARY_MISSING, PART_NOT_READ};
use insula_source::source::read_sibling;
use std::collections::HashMap;
use std::rc::Rc;

/// Larger material libraries are not read.
const MAX_LIBRARY_BYTES: u64 = 64 << 20;
/// Opacity of water and glass.
const GLASS_OPACITY: f32 = 0.5;

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FaceMaterial {
    /// The sink's number; `None` for faces without a material.
    pub(super) number: Option<u32>,
    pub(super) has_texture: bool,
    /// Of the texture.
    pub(super) mapping: UvMapping,
}

/// Passes the materials that `faces` use to the sink; by material number of the file.
pub(super) fn load_materials(
    input: &Input<'_>,
    file: &ObjFile,
    faces: &[ObjFace],
    sink: &mut dyn ObjectSink,
) -> Vec<FaceMaterial> {
    let library = read_libraries(input, file, sink);
    let mut is_used = vec![false; file.materials.len()];
    faces.iter().for_each(|face| is_used[face.material as usize] = true);
    let mut materials = vec![FaceMaterial::default(); file.materials.len()];
    for (i, name) in file.materials.iter().enumerate().filter(|(i, name)| is_used[*i] && !name.is_empty()) {
        let material = library.get(name);
        if material.is_none() {
            sink.problem("material missing", name.clone());
        }
        let is_other = |known: &&MtlMaterial| known.alpha.is_some() && known.alpha != known.texture;
        if let Some(alpha) = material.filter(is_other).and_then(|known| known.alpha.as_deref()) {
            sink.problem(PART_NOT_READ, format!("{name}: transparency in an image of its own, {alpha}"));
        }
        let own = source_material(name, material);
        let (has_texture, mapping) = (own.texture.is_some(), material.map(|known| known.mapping).unwrap_or_default());
        materials[i] = FaceMaterial { has_texture, mapping, number: Some(sink.add_material(own)) };
    }
    materials
}

fn source_material(name: &str, material: Option<&MtlMaterial>) -> SourceMaterial {
    let diffuse = material.and_then(|material| material.diffuse).map(|rgb| rgb.map(unit_to_byte));
    let image = material.and_then(|material| material.texture.as_deref());
    let wrap = if material.is_some_and(|material| material.mapping.is_clamped) { Wrap::Clamp } else { Wrap::Repeat };
    let texture = image.map(|name| SourceTexture { image: SourceImage::File(name.replace('\\', "/")), wrap });
    SourceMaterial {
        name: Some(Rc::from(name)),
        // Exporters write black for textured materials, which would hide the texture.
        rgb: diffuse.filter(|rgb| texture.is_none() || *rgb != [0; 3]),
        untextured_rgb: diffuse,
        texture,
        alpha_cutoff: material.and_then(|material| material.alpha.as_ref()).map(|_| ALPHA_CUTOFF),
        opacity: if material.is_some_and(MtlMaterial::is_glass) { GLASS_OPACITY } else { 1.0 },
        ..SourceMaterial::default()
    }
}

/// The materials of all libraries that the file names.
fn read_libraries(input: &Input<'_>, file: &ObjFile, sink: &mut dyn ObjectSink) -> HashMap<String, MtlMaterial> {
    let mut materials = HashMap::new();
    let folder = input.name.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    let read = |name: &str| {
        let path = format!("{folder}{}", name.replace('\\', "/"));
        read_sibling(input.files, &path, MAX_LIBRARY_BYTES)
    };
    for argument in &file.libraries {
        // The argument is one name with blanks, or several names: the one that exists decides.
        let error = match read(argument) {
            Ok(bytes) => {
                mtl::parse(&bytes, &mut materials);
                continue;
            }
            Err(error) => error,
        };
        let names: Vec<&str> = argument.split_ascii_whitespace().filter(|name| name.len() < argument.len()).collect();
        if names.is_empty() {
            sink.problem(LIBRARY_MISSING, format!("{argument}: {error}"));
        }
        for name in names {
            match read(name) {
                Ok(bytes) => mtl::parse(&bytes, &mut materials),
                Err(error) => sink.problem(LIBRARY_MISSING, format!("{name}: {error}")),
            }
        }
    }
    materials
}
