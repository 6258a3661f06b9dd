//! The JSON of EXT_structural_metadata that is read: classes, enums and property tables.

use serde::Deserialize;
use serde_json::Value;
use serde_json::value::RawValue;
use std::collections::BTreeMap;

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct StructuralMetadata {
    pub(super) schema: Option<MetadataSchema>,
    pub(super) schema_uri: Option<String>,
    pub(super) property_tables: Vec<TableEntry>,
    pub(super) property_textures: Option<Box<RawValue>>,
    pub(super) property_attributes: Option<Box<RawValue>>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub(super) struct MetadataSchema {
    pub(super) classes: BTreeMap<String, Class>,
    pub(super) enums: BTreeMap<String, EnumType>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub(super) struct Class {
    pub(super) properties: BTreeMap<String, ClassProperty>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct ClassProperty {
    #[serde(rename = "type")]
    pub(super) shape: String,
    pub(super) component_type: Option<String>,
    pub(super) enum_type: Option<String>,
    pub(super) array: bool,
    pub(super) count: Option<u32>,
    pub(super) normalized: bool,
    pub(super) offset: Option<Value>,
    pub(super) scale: Option<Value>,
    pub(super) no_data: Option<Value>,
    pub(super) default: Option<Value>,
    pub(super) semantic: Option<String>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct EnumType {
    pub(super) value_type: Option<String>,
    pub(super) values: Vec<EnumValue>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub(super) struct EnumValue {
    pub(super) name: String,
    pub(super) value: i64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct TableEntry {
    pub(super) name: Option<String>,
    pub(super) class: String,
    pub(super) count: u32,
    pub(super) properties: BTreeMap<String, TableColumn>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TableColumn {
    /// Buffer view.
    pub(super) values: usize,
    /// Buffer view with the start of each array.
    pub(super) array_offsets: Option<usize>,
    /// Buffer view with the start of each text.
    pub(super) string_offsets: Option<usize>,
    pub(super) array_offset_type: Option<String>,
    pub(super) string_offset_type: Option<String>,
    pub(super) offset: Option<Value>,
    pub(super) scale: Option<Value>,
}
