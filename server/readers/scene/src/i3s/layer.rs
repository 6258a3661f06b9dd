//! The JSON of a scene layer.

use serde::Deserialize;

/// A layer document, or the document of a service with `layers`. Members that are not read are left out.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct LayerJson {
    pub(super) layer_type: Option<String>,
    pub(super) name: Option<String>,
    pub(super) model_name: Option<String>,
    pub(super) copyright_text: Option<String>,
    pub(super) spatial_reference: Option<SpatialReferenceJson>,
    pub(super) height_model_info: Option<HeightModelJson>,
    pub(super) elevation_info: Option<ElevationJson>,
    pub(super) store: Option<StoreJson>,
    pub(super) node_pages: Option<NodePagesJson>,
    pub(super) material_definitions: Option<Vec<MaterialJson>>,
    pub(super) texture_set_definitions: Option<Vec<TextureSetJson>>,
    pub(super) geometry_definitions: Option<Vec<GeometryDefinitionJson>>,
    pub(super) attribute_storage_info: Option<Vec<AttributeJson>>,
    pub(super) fields: Option<Vec<FieldJson>>,
    pub(super) sublayers: Option<Vec<SublayerJson>>,
    /// Layers of a service.
    pub(super) layers: Option<Vec<SublayerJson>>,
}

impl LayerJson {
    /// The layer with the coordinate system of the one around it, if it names none of its own.
    pub(super) fn within(self, around: &Self) -> Self {
        let has_own =
            self.spatial_reference.is_some() || self.store.as_ref().is_some_and(|store| store.vertex_crs.is_some());
        if has_own {
            return self;
        }
        let height_model_info = self.height_model_info.or_else(|| around.height_model_info.clone());
        Self { spatial_reference: around.spatial_reference.clone(), height_model_info, ..self }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct SublayerJson {
    pub(super) id: Option<i64>,
    pub(super) layer_type: Option<String>,
    pub(super) model_name: Option<String>,
    pub(super) name: Option<String>,
    pub(super) sublayers: Option<Vec<SublayerJson>>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct SpatialReferenceJson {
    pub(super) wkid: Option<i64>,
    pub(super) latest_wkid: Option<i64>,
    pub(super) vcs_wkid: Option<i64>,
    pub(super) latest_vcs_wkid: Option<i64>,
    pub(super) wkt: Option<String>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct HeightModelJson {
    pub(super) height_model: Option<String>,
    pub(super) height_unit: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct ElevationJson {
    pub(super) mode: Option<String>,
    pub(super) offset: Option<f64>,
    pub(super) unit: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct StoreJson {
    pub(super) root_node: Option<String>,
    #[serde(rename = "vertexCRS")]
    pub(super) vertex_crs: Option<String>,
    pub(super) default_geometry_schema: Option<SchemaJson>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct NodePagesJson {
    pub(super) nodes_per_page: Option<u32>,
    pub(super) root_index: Option<u32>,
}

/// Layout of geometry before version 1.7.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct SchemaJson {
    pub(super) topology: Option<String>,
    pub(super) header: Option<Vec<HeaderJson>>,
    pub(super) ordering: Option<Vec<String>>,
    pub(super) vertex_attributes: Option<serde_json::Map<String, serde_json::Value>>,
    pub(super) feature_attribute_order: Option<Vec<String>>,
    pub(super) feature_attributes: Option<serde_json::Map<String, serde_json::Value>>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct HeaderJson {
    pub(super) property: Option<String>,
    #[serde(alias = "valueType")]
    pub(super) r#type: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct GeometryDefinitionJson {
    pub(super) geometry_buffers: Vec<BufferJson>,
}

/// Layout of one geometry buffer since version 1.7. The order of the attributes is fixed.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct BufferJson {
    pub(super) offset: u64,
    pub(super) position: Option<FormatJson>,
    pub(super) normal: Option<FormatJson>,
    pub(super) uv0: Option<FormatJson>,
    pub(super) uv1: Option<FormatJson>,
    pub(super) color: Option<FormatJson>,
    pub(super) uv_region: Option<FormatJson>,
    pub(super) feature_id: Option<FormatJson>,
    pub(super) face_range: Option<FormatJson>,
    pub(super) compressed_attributes: Option<CompressedJson>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct FormatJson {
    pub(super) r#type: Option<String>,
    pub(super) component: Option<u32>,
    pub(super) binding: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct CompressedJson {
    pub(super) encoding: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct MaterialJson {
    pub(super) pbr_metallic_roughness: Option<PbrJson>,
    pub(super) emissive_texture: Option<TextureJson>,
    pub(super) alpha_mode: Option<String>,
    pub(super) alpha_cutoff: Option<f32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct PbrJson {
    pub(super) base_color_factor: Option<Vec<f32>>,
    pub(super) base_color_texture: Option<TextureJson>,
    pub(super) metallic_factor: Option<f32>,
    pub(super) roughness_factor: Option<f32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct TextureJson {
    pub(super) texture_set_definition_id: Option<u32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct TextureSetJson {
    pub(super) formats: Vec<TextureFormatJson>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct TextureFormatJson {
    pub(super) name: String,
    pub(super) format: String,
}

/// How the values of an attribute are stored.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct AttributeJson {
    pub(super) key: String,
    pub(super) name: String,
    pub(super) header: Vec<HeaderJson>,
    pub(super) ordering: Vec<String>,
    pub(super) attribute_values: Option<ValueJson>,
    pub(super) attribute_byte_counts: Option<ValueJson>,
    pub(super) object_ids: Option<ValueJson>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct ValueJson {
    pub(super) value_type: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct FieldJson {
    pub(super) name: String,
    pub(super) r#type: String,
}
