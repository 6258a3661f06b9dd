//! Materials of nodes and their textures.

use super::layer::{LayerJson, MaterialJson, TextureFormatJson};
use super::nodes::MaterialSource;
use super::resources::{Resource, Resources};
use crate::gltf;
use crate::tiles3d::uri;
use insula_source::object::{SourceMaterial, SourceTexture, Wrap};
use serde::Deserialize;
use serde_json::{Map, Value};

/// The cutoff of masks if the layer tells none.
const DEFAULT_ALPHA_CUTOFF: f32 = 0.25;
/// Extensions of images; some packages call all binary files alike.
const JPEG: &[&str] = &["jpg", "jpeg", "bin"];
const PNG: &[&str] = &["png", "bin"];
const KTX2: &[&str] = &["ktx2", "bin"];

/// The shared resource of a node before version 1.7.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct SharedJson {
    material_definitions: Option<Map<String, Value>>,
    texture_definitions: Option<Map<String, Value>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct SharedMaterialJson {
    params: SharedParamsJson,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct SharedParamsJson {
    diffuse: Option<Vec<f32>>,
    transparency: Option<f32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct SharedTextureJson {
    encoding: Vec<String>,
    wrap: Vec<String>,
    images: Vec<SharedImageJson>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct SharedImageJson {
    size: Option<f64>,
    href: Vec<String>,
}

/// Reads the material of a node. `None` if it has none. What cannot be read is passed to `fault`.
pub(super) fn read(
    resources: &Resources<'_, '_>,
    layer: &LayerJson,
    source: &MaterialSource,
    fault: &mut dyn FnMut(&'static str, String),
) -> Option<SourceMaterial> {
    match source {
        MaterialSource::None => None,
        MaterialSource::Defined { folder, definition } => {
            let definitions = layer.material_definitions.as_deref().unwrap_or_default();
            let Some(material) = definitions.get(*definition as usize) else {
                fault("material does not exist", format!("{folder}: material {definition}"));
                return None;
            };
            Some(defined(resources, layer, folder, material, fault))
        }
        MaterialSource::Shared { path, has_textures } => {
            let json = resources.json(&format!("{path}/sharedResource"));
            let json: Result<SharedJson, String> = json.or_else(|first| resources.json(path).map_err(|_| first));
            match json {
                Ok(json) => Some(shared(resources, path, *has_textures, &json, fault)),
                Err(what) => {
                    fault("material is not read", what);
                    None
                }
            }
        }
    }
}

fn defined(
    resources: &Resources<'_, '_>,
    layer: &LayerJson,
    folder: &str,
    json: &MaterialJson,
    fault: &mut dyn FnMut(&'static str, String),
) -> SourceMaterial {
    let pbr = json.pbr_metallic_roughness.as_ref();
    let mut material = SourceMaterial {
        roughness: pbr.and_then(|pbr| pbr.roughness_factor),
        metallic: pbr.and_then(|pbr| pbr.metallic_factor),
        ..SourceMaterial::default()
    };
    let mode = json.alpha_mode.as_deref().unwrap_or("opaque");
    if let Some(factor) = pbr.and_then(|pbr| pbr.base_color_factor.as_deref()) {
        let colour = colour(factor);
        material.rgb = colour.map(|[r, g, b, _]| [r, g, b]);
        if let Some([_, _, _, alpha]) = colour.filter(|_| mode.eq_ignore_ascii_case("blend")) {
            material.opacity = f32::from(alpha) / 255.0;
        }
    }
    if mode.eq_ignore_ascii_case("mask") {
        let cutoff = json.alpha_cutoff.unwrap_or(DEFAULT_ALPHA_CUTOFF);
        material.alpha_cutoff = Some(if cutoff > 1.0 { cutoff / 255.0 } else { cutoff });
    }
    let texture = pbr.and_then(|pbr| pbr.base_color_texture.as_ref()).or(json.emissive_texture.as_ref());
    let Some(set) = texture.and_then(|texture| texture.texture_set_definition_id) else { return material };
    let sets = layer.texture_set_definitions.as_deref().unwrap_or_default();
    let Some(set) = sets.get(set as usize) else {
        fault("texture does not exist", format!("{folder}: texture set {set}"));
        return material;
    };
    let mut images: Vec<_> =
        set.formats.iter().filter_map(|format| Some((format, extensions_of(&format.format)?))).collect();
    // The others lose less and are read faster.
    images.sort_by_key(|(_, extensions)| *extensions == KTX2);
    let image = images.first().copied();
    match image {
        Some((TextureFormatJson { name, .. }, extensions)) => {
            let path = format!("{folder}/textures/{name}");
            material.texture = texture_at(resources, &path, extensions, Wrap::Repeat, fault);
        }
        None => {
            let formats: Vec<&str> = set.formats.iter().map(|format| format.format.as_str()).collect();
            fault("texture has a format that is not read", format!("{folder}: {}", formats.join(", ")));
        }
    }
    material
}

/// Extensions of the files of a texture format; `None` if it is not read.
fn extensions_of(format: &str) -> Option<&'static [&'static str]> {
    match format.to_ascii_lowercase().as_str() {
        "jpg" | "jpeg" | "image/jpeg" => Some(JPEG),
        "png" | "image/png" => Some(PNG),
        "ktx2" | "image/ktx2" => Some(KTX2),
        _ => None,
    }
}

fn shared(
    resources: &Resources<'_, '_>,
    path: &str,
    has_textures: bool,
    json: &SharedJson,
    fault: &mut dyn FnMut(&'static str, String),
) -> SourceMaterial {
    let first = |members: &Option<Map<String, Value>>| {
        let value = members.as_ref().and_then(|members| members.values().next());
        value.cloned().unwrap_or_default()
    };
    let params =
        serde_json::from_value::<SharedMaterialJson>(first(&json.material_definitions)).unwrap_or_default().params;
    let rgb = params.diffuse.as_deref().and_then(colour).map(|[r, g, b, _]| [r, g, b]);
    let transparency = params.transparency.filter(|transparency| (0.0..=1.0).contains(transparency)).unwrap_or(0.0);
    let mut material = SourceMaterial { rgb, opacity: 1.0 - transparency, ..SourceMaterial::default() };
    if !has_textures || json.texture_definitions.as_ref().is_none_or(Map::is_empty) {
        return material;
    }
    let texture = serde_json::from_value::<SharedTextureJson>(first(&json.texture_definitions)).unwrap_or_default();
    let largest = texture.images.iter().max_by(|a, b| a.size.unwrap_or(0.0).total_cmp(&b.size.unwrap_or(0.0)));
    let image = largest.and_then(|image| {
        let encodings = texture.encoding.iter().zip(&image.href);
        encodings.into_iter().find_map(|(encoding, href)| Some((href, extensions_of(encoding)?)))
    });
    let Some((href, extensions)) = image else {
        fault("texture has a format that is not read", format!("{path}: {}", texture.encoding.join(", ")));
        return material;
    };
    let wrap = match texture.wrap.first().map(String::as_str) {
        Some("repeat") => Wrap::Repeat,
        Some("mirror") => Wrap::Mirror,
        _ => Wrap::Clamp,
    };
    match uri::join(path, href) {
        Ok(name) => material.texture = texture_at(resources, &name, extensions, wrap, fault),
        Err(reason) => fault("texture is not read", format!("{path}: {href}: {reason}")),
    }
    material
}

fn texture_at(
    resources: &Resources<'_, '_>,
    path: &str,
    extensions: &'static [&'static str],
    wrap: Wrap,
    fault: &mut dyn FnMut(&'static str, String),
) -> Option<SourceTexture> {
    let read = resources.read(path, Resource::Image(extensions)).map_err(|error| error.to_string());
    let max_bytes = resources.files.input.max_bytes;
    match read.and_then(|(name, bytes)| gltf::source_image(name, bytes, max_bytes)) {
        Ok(image) => Some(SourceTexture { image, wrap }),
        Err(error) => {
            fault("texture is not read", format!("{path}: {error}"));
            None
        }
    }
}

/// Red, green, blue and alpha of a list of numbers to 1, or to 255 as some programs write them.
fn colour(numbers: &[f32]) -> Option<[u8; 4]> {
    let at = |i: usize| numbers.get(i).copied().filter(|number| number.is_finite());
    let rgb = [at(0)?, at(1)?, at(2)?];
    let alpha = at(3);
    let is_to_255 = rgb.iter().chain(&alpha).any(|number| *number > 1.0);
    let byte = |number: f32| (if is_to_255 { number } else { number * 255.0 }).round().clamp(0.0, 255.0) as u8;
    let [r, g, b] = rgb.map(byte);
    Some([r, g, b, alpha.map_or(255, byte)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_to_one_or_to_255() {
        assert_eq!(colour(&[0.5, 0.0, 1.0, 1.0]), Some([128, 0, 255, 255]));
        assert_eq!(colour(&[255.0, 128.0, 1.0, 255.0]), Some([255, 128, 1, 255]));
        assert_eq!(colour(&[1.0, 1.0]), None);
        assert_eq!(colour(&[f32::NAN, 1.0, 1.0]), None);
    }
}
