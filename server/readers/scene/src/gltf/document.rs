//! A parsed glTF, and the extensions that it may require.

use super::schema::Root;
use insula_source::error::InputError;
use insula_source::text::split_words;

/// Extensions that may be required. Those of materials and lights only change the look.
const KNOWN: [&str; 16] = split_words(
    "KHR_draco_mesh_compression EXT_meshopt_compression KHR_meshopt_compression KHR_mesh_quantization \
    KHR_texture_transform KHR_texture_basisu EXT_texture_webp EXT_mesh_gpu_instancing EXT_mesh_features \
    EXT_instance_features EXT_structural_metadata CESIUM_RTC CESIUM_primitive_outline KHR_node_visibility \
    KHR_techniques_webgl KHR_xmp_json_ld",
);
const KNOWN_PREFIXES: [&str; 4] = ["KHR_materials_", "KHR_lights_", "EXT_lights_", "KHR_animation_"];

/// Parsed JSON, and the binary chunk of a GLB.
pub(super) struct Document<'a> {
    pub(super) root: Root,
    pub(super) binary: Option<&'a [u8]>,
    /// What to report of a JSON that is not in UTF-8.
    pub(super) guessed: Option<String>,
}

/// Fails if an extension is required that is not known.
pub(super) fn check_required(label: &str, root: &Root) -> Result<(), InputError> {
    let is_known = |name: &str| KNOWN.contains(&name) || KNOWN_PREFIXES.iter().any(|prefix| name.starts_with(prefix));
    let unknown: Vec<&str> =
        root.extensions_required.iter().map(String::as_str).filter(|name| !is_known(name)).collect();
    if unknown.is_empty() {
        return Ok(());
    }
    let names = unknown.iter().take(5).map(|name| &name[..name.floor_char_boundary(80)]).collect::<Vec<_>>().join(", ");
    Err(InputError::unsupported(label, format!("the glTF requires extensions that are not supported: {names}")))
}
