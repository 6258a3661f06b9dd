//! Parts of a glTF that are not read, so that a warning names them.

use super::schema::{Node, Raw, Root};

/// What a document has that is not read, in words.
pub(super) fn parts_not_read(root: &Root) -> Vec<String> {
    let metadata = root.extensions.metadata.as_ref();
    let has_items = |items: Option<&Raw>| items.and_then(Option::as_ref).is_some_and(|raw| raw.get().contains('{'));
    let mut parts = Vec::new();
    if root.extensions.old_metadata.is_some() {
        parts.push("attributes in EXT_feature_metadata, which EXT_structural_metadata has replaced".to_owned());
    }
    if has_items(metadata.map(|metadata| &metadata.property_textures)) {
        parts.push("attributes in property textures".to_owned());
    }
    if has_items(metadata.map(|metadata| &metadata.property_attributes)) {
        parts.push("attributes in property attributes".to_owned());
    }
    let morphed = root.nodes.iter().filter(|node| is_morphed(root, node)).count();
    if morphed > 0 {
        parts.push(format!("morph targets, whose nodes have their basic shape: {morphed}"));
    }
    parts
}

/// Whether a node's mesh is to be shown in another shape than its basic one.
fn is_morphed(root: &Root, node: &Node) -> bool {
    let Some(mesh) = node.mesh.and_then(|mesh| root.meshes.get(mesh)) else { return false };
    let weights = node.weights.as_ref().or(mesh.weights.as_ref());
    let weights: Vec<f64> = weights.and_then(|raw| serde_json::from_str(raw.get()).ok()).unwrap_or_default();
    weights.iter().any(|weight| *weight != 0.0) && mesh.primitives.iter().any(|primitive| primitive.targets.is_some())
}
