//! The JSON of glTF 2.0 as far as exports write it (Khronos glTF 2.0, sections 3 and 5). Indices are those of the document's lists.

use serde::Serialize;
use serde_json::Value;

/// Component types (section 5.1.3).
pub(crate) const UNSIGNED_BYTE: u32 = 5121;
pub(crate) const UNSIGNED_SHORT: u32 = 5123;
pub(crate) const UNSIGNED_INT: u32 = 5125;
pub(crate) const FLOAT: u32 = 5126;

/// Targets of buffer views (section 5.11.5).
pub(crate) const ARRAY_BUFFER: u32 = 34962;
pub(crate) const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Filter and wrapping modes of samplers (section 5.26).
pub(crate) const LINEAR: u32 = 9729;
pub(crate) const LINEAR_MIPMAP_LINEAR: u32 = 9987;
pub(crate) const CLAMP_TO_EDGE: u32 = 33071;

/// The root of a document (section 5.17). Empty lists are not written, because glTF forbids them.
#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Document {
    pub(crate) asset: Asset,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) extensions_used: Vec<&'static str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) extensions_required: Vec<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extensions: Option<Value>,
    pub(crate) scene: usize,
    pub(crate) scenes: Vec<Scene>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) nodes: Vec<Node>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) cameras: Vec<Value>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) meshes: Vec<Mesh>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) materials: Vec<Material>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) textures: Vec<Value>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) images: Vec<Image>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) samplers: Vec<Sampler>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) accessors: Vec<Accessor>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) buffer_views: Vec<BufferView>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) buffers: Vec<Buffer>,
}

/// Section 5.8.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Asset {
    pub(crate) version: &'static str,
    pub(crate) generator: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) copyright: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extras: Option<Value>,
}

/// Section 5.27.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Scene {
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) nodes: Vec<usize>,
}

/// Section 5.25.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Node {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) name: Option<String>,
    /// Column by column.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) matrix: Option<[f64; 16]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mesh: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) camera: Option<usize>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) children: Vec<usize>,
}

/// Section 5.23.
#[derive(Debug, Serialize)]
pub(crate) struct Mesh {
    pub(crate) primitives: Vec<Primitive>,
}

/// Section 5.24; the mode is the default, triangles.
#[derive(Debug, Serialize)]
pub(crate) struct Primitive {
    pub(crate) attributes: Attributes,
    pub(crate) indices: usize,
    pub(crate) material: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extensions: Option<Value>,
}

/// Accessors of a primitive.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(crate) position: usize,
    #[serde(rename = "TEXCOORD_0", skip_serializing_if = "Option::is_none")]
    pub(crate) uv: Option<usize>,
    #[serde(rename = "COLOR_0", skip_serializing_if = "Option::is_none")]
    pub(crate) colour: Option<usize>,
    #[serde(rename = "_FEATURE_ID_0", skip_serializing_if = "Option::is_none")]
    pub(crate) feature: Option<usize>,
}

/// Section 5.19.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Material {
    pub(crate) pbr_metallic_roughness: PbrMetallicRoughness,
    pub(crate) double_sided: bool,
}

/// Section 5.22.
#[derive(Debug, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct PbrMetallicRoughness {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) base_color_texture: Option<TextureInfo>,
    pub(crate) metallic_factor: f32,
    /// 1 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) roughness_factor: Option<f32>,
}

/// Section 5.30.
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct TextureInfo {
    pub(crate) index: usize,
}

/// Section 5.18.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Image {
    pub(crate) buffer_view: usize,
    pub(crate) mime_type: &'static str,
}

/// Section 5.26.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Sampler {
    pub(crate) mag_filter: u32,
    pub(crate) min_filter: u32,
    pub(crate) wrap_s: u32,
    pub(crate) wrap_t: u32,
}

/// Section 5.1.
#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: usize,
    #[serde(skip_serializing_if = "is_zero")]
    pub(crate) byte_offset: usize,
    pub(crate) component_type: u32,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(crate) normalized: bool,
    pub(crate) count: usize,
    #[serde(rename = "type")]
    pub(crate) shape: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) min: Option<[u16; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) max: Option<[u16; 3]>,
}

/// Section 5.11.
#[derive(Debug, Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferView {
    pub(crate) buffer: usize,
    #[serde(skip_serializing_if = "is_zero")]
    pub(crate) byte_offset: usize,
    pub(crate) byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) byte_stride: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) target: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extensions: Option<Value>,
}

/// Section 5.10.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Buffer {
    pub(crate) byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) extensions: Option<Value>,
}

fn is_zero(value: &usize) -> bool {
    *value == 0
}
