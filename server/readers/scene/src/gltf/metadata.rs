//! EXT_structural_metadata: property tables as attributes of features.

use super::GltfScene;
use super::buffers::Buffers;
use super::extras::push_value;
use super::fault::Fault;
use super::metadata_schema::{ClassProperty, EnumType, MetadataSchema, StructuralMetadata, TableColumn, TableEntry};
use super::metadata_values::{NUMBERS, Values};
use crate::bytes::NumberType;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::code_page::CodePage;
use insula_source::problems::ENCODING_GUESSED;
use serde_json::Value;

const KIND: &str = "property of a table cannot be read";
/// Semantics and names of properties that identify a feature, best first.
const ID_SEMANTIC: &str = "ID";
const ID_NAMES: [&str; 8] = ["gml:id", "gml_id", "gmlid", "id", "globalid", "guid", "uuid", "name"];

/// A table with properties of features. See [`GltfScene::attributes_of`].
#[derive(Debug, Default)]
pub(crate) struct PropertyTable {
    /// Identifier of the class, for `source_type`.
    pub(crate) class: String,
    /// Number of features.
    pub(crate) count: u32,
    columns: Vec<PropertyColumn>,
}

/// The values of a property.
#[derive(Debug)]
struct PropertyColumn {
    name: String,
    property: ClassProperty,
    enum_type: Option<EnumType>,
    /// `None` if all have the default.
    values: Option<Values>,
    offset: Option<Value>,
    scale: Option<Value>,
}

impl GltfScene {
    /// Attributes of a feature of a table: the class's property names with their values; without missing values. Empty beyond
    /// the table's end.
    pub(crate) fn attributes_of(&self, table: usize, feature: u32) -> Attributes {
        let mut attributes = Attributes::default();
        if let Some(table) = self.tables.get(table).filter(|table| feature < table.count) {
            table.columns.iter().for_each(|column| column.push(feature as usize, &mut attributes));
        }
        attributes
    }

    /// The identifier that a table gives a feature: its property with the semantic ID, or one named like an identifier.
    pub(crate) fn id_of(&self, table: usize, feature: u32) -> Option<String> {
        let table = self.tables.get(table).filter(|table| feature < table.count)?;
        let semantic = |column: &&PropertyColumn| column.property.semantic.as_deref() == Some(ID_SEMANTIC);
        let named = |name: &&str| table.columns.iter().find(|column| column.name.eq_ignore_ascii_case(name));
        let column = table.columns.iter().find(semantic).or_else(|| ID_NAMES.iter().find_map(named))?;
        let mut attributes = Attributes::default();
        column.push(feature as usize, &mut attributes);
        attributes.get(&column.name).map(AttributeValue::to_string).filter(|id| !id.is_empty())
    }
}

/// Reads the property tables. Tables keep their numbers: one that cannot be read has no columns.
pub(super) fn tables(
    metadata: &StructuralMetadata,
    buffers: &Buffers<'_>,
    problems: &mut Vec<(&'static str, String)>,
) -> Vec<PropertyTable> {
    let mut note = |fault: Fault, place: &str| problems.push(fault.at(place));
    let schema = match (&metadata.schema, &metadata.schema_uri) {
        (Some(schema), _) => schema.clone(),
        (None, Some(uri)) => load_schema(uri, buffers).unwrap_or_else(|fault| {
            note(fault, "schema of the metadata");
            MetadataSchema::default()
        }),
        (None, None) => MetadataSchema::default(),
    };
    let mut tables = Vec::with_capacity(metadata.property_tables.len());
    for (number, entry) in metadata.property_tables.iter().enumerate() {
        let mut table = PropertyTable { class: entry.class.clone(), count: entry.count, columns: Vec::new() };
        let Some(class) = schema.classes.get(&entry.class) else {
            note(Fault::new(KIND, format!("class {} does not exist", entry.class)), &format!("table {number}"));
            tables.push(table);
            continue;
        };
        for (name, property) in &class.properties {
            match column(name, property, entry, &schema, buffers) {
                Ok(Some(mut column)) => {
                    if let Some(what) = column.values.as_mut().and_then(Values::settle_page) {
                        note(Fault::new(ENCODING_GUESSED, what), &format!("table {number}, property {name}"));
                    }
                    table.columns.push(column);
                }
                Ok(None) => {}
                Err(fault) => note(fault, &format!("table {number}, property {name}")),
            }
        }
        tables.push(table);
    }
    tables
}

fn load_schema(uri: &str, buffers: &Buffers<'_>) -> Result<MetadataSchema, Fault> {
    let bytes = buffers.uri(uri)?;
    serde_json::from_slice(&bytes).map_err(|error| Fault::new(KIND, error.to_string()))
}

fn column(
    name: &str,
    property: &ClassProperty,
    entry: &TableEntry,
    schema: &MetadataSchema,
    buffers: &Buffers<'_>,
) -> Result<Option<PropertyColumn>, Fault> {
    let enum_type = property.enum_type.as_ref().and_then(|name| schema.enums.get(name)).cloned();
    let found = entry.properties.get(name);
    if found.is_none() && property.default.is_none() {
        return Ok(None);
    }
    let values =
        found.map(|found| read_values(property, enum_type.as_ref(), found, entry.count, buffers)).transpose()?;
    Ok(Some(PropertyColumn {
        name: name.to_owned(),
        property: property.clone(),
        enum_type,
        values,
        offset: found.and_then(|found| found.offset.clone()).or_else(|| property.offset.clone()),
        scale: found.and_then(|found| found.scale.clone()).or_else(|| property.scale.clone()),
    }))
}

fn read_values(
    property: &ClassProperty,
    enum_type: Option<&EnumType>,
    found: &TableColumn,
    count: u32,
    buffers: &Buffers<'_>,
) -> Result<Values, Fault> {
    let number = |name: &Option<String>, default: NumberType| match name {
        Some(name) => {
            NumberType::by_name(NUMBERS, name).ok_or_else(|| Fault::new(KIND, format!("unknown type {name}")))
        }
        None => Ok(default),
    };
    let copy = |view: usize| -> Result<Vec<u8>, Fault> {
        let bytes = buffers.view(view)?;
        buffers.budget().take_bytes(bytes.len() as u64)?;
        Ok(bytes.to_vec())
    };
    let offsets = |view: Option<usize>, name: &Option<String>| -> Result<Option<(Vec<u8>, NumberType)>, Fault> {
        view.map(|view| Ok((copy(view)?, number(name, NumberType::U32)?))).transpose()
    };
    let width = match property.shape.as_str() {
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => 1,
    };
    let component = match property.shape.as_str() {
        "ENUM" => number(&enum_type.and_then(|e| e.value_type.clone()), NumberType::U16)?,
        "STRING" | "BOOLEAN" => NumberType::U8,
        _ => number(&property.component_type, NumberType::F32)?,
    };
    let values = Values {
        bytes: copy(found.values)?,
        component,
        width,
        is_text: property.shape == "STRING",
        is_bool: property.shape == "BOOLEAN",
        is_array: property.array,
        fixed_count: property.count.filter(|_| property.array),
        array_offsets: offsets(found.array_offsets, &found.array_offset_type)?,
        text_offsets: offsets(found.string_offsets, &found.string_offset_type)?,
        page: CodePage::UTF8,
    };
    values.check(count as usize).map_err(|what| Fault::new(KIND, what))?;
    Ok(values)
}

impl PropertyColumn {
    /// Adds the value of a feature.
    fn push(&self, feature: usize, attributes: &mut Attributes) {
        let value = self.values.as_ref().map(|values| values.value(feature));
        let is_missing = |value: &Value| self.property.no_data.as_ref().is_some_and(|none| is_equal(value, none));
        let value = match value {
            Some(value) if !is_missing(&value) => self.scaled(self.named(value)),
            _ => self.property.default.clone().unwrap_or(Value::Null),
        };
        push_value(&self.name, &value, 4, attributes);
    }

    /// Names for the numbers of an enum.
    fn named(&self, value: Value) -> Value {
        let Some(enum_type) = &self.enum_type else { return value };
        match value {
            Value::Array(items) => Value::Array(items.into_iter().map(|item| self.named(item)).collect()),
            value => {
                let entry = enum_type.values.iter().find(|entry| value.as_i64() == Some(entry.value));
                entry.map_or(value, |entry| Value::String(entry.name.clone()))
            }
        }
    }

    /// With normalisation, scale and offset.
    fn scaled(&self, value: Value) -> Value {
        let divisor =
            self.values.as_ref().filter(|_| self.property.normalized).map(|values| values.component.largest());
        if divisor.is_none() && self.offset.is_none() && self.scale.is_none() {
            return value;
        }
        scale_value(value, divisor, self.scale.as_ref(), self.offset.as_ref())
    }
}

fn scale_value(value: Value, divisor: Option<f64>, scale: Option<&Value>, offset: Option<&Value>) -> Value {
    let inner = |list: Option<&Value>, index: usize| match list {
        Some(Value::Array(items)) => items.get(index).cloned(),
        other => other.cloned(),
    };
    match value {
        Value::Array(items) => {
            let scaled = items.into_iter().enumerate().map(|(index, item)| {
                scale_value(item, divisor, inner(scale, index).as_ref(), inner(offset, index).as_ref())
            });
            Value::Array(scaled.collect())
        }
        Value::Number(number) => {
            let value = number.as_f64().unwrap_or(0.0);
            let value = divisor.map_or(value, |divisor| (value / divisor).max(-1.0));
            let value =
                value * scale.and_then(Value::as_f64).unwrap_or(1.0) + offset.and_then(Value::as_f64).unwrap_or(0.0);
            serde_json::Number::from_f64(value).map_or(Value::Null, Value::Number)
        }
        value => value,
    }
}

/// Whether values are equal, whether numbers are written as whole or not, within the precision of 32 bits.
fn is_equal(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => {
            a == b || matches!((a.as_f64(), b.as_f64()), (Some(a), Some(b)) if a == b || a as f32 == b as f32)
        }
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_equal(a, b)),
        (a, b) => a == b,
    }
}
