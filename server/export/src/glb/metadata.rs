//! The property table of a GLB: the objects that it shows, with identifiers and attributes.
//!
//! Written as `EXT_structural_metadata` (Cesium 2023) after the 3D Metadata Specification 1.0. A column that no object of the table
//! has is left out. Where only some objects have a value, the others have the column's `noData` value.

use super::ExportError;
use super::builder::GlbBuilder;
use super::columns::{Column, Packed};
use super::geometry::NO_FEATURE;
use crate::table::city::City;
use insula_objects::{AttributeInfo, ObjectRecord, Value, ValueType};
use insula_protocol::blockmap::NO_OBJECT;
use serde_json::{Map, Value as Json, json};
use std::collections::{BTreeMap, BTreeSet};

/// How much a table says of its objects. Each variant has all that the one before it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Detail {
    /// `id`.
    Number,
    /// `kind` and `identifier`.
    Name,
    /// `parent` and the attributes.
    Full,
}

/// A column with the id and the title of its property.
struct Property {
    id: String,
    name: Option<String>,
    description: Option<String>,
    semantic: Option<&'static str>,
    column: Column,
}

/// The objects of a GLB in the order of their first use, which is that of the rows of its table.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rows {
    ids: Vec<u32>,
    rows: BTreeMap<u32, u32>,
}

impl Rows {
    /// The row of an object, a new one if it has none; [`NO_FEATURE`] for no object.
    pub(crate) fn row(&mut self, object: u32) -> u32 {
        if object == NO_OBJECT {
            return NO_FEATURE;
        }
        *self.rows.entry(object).or_insert_with(|| {
            self.ids.push(object);
            self.ids.len() as u32 - 1
        })
    }

    pub(crate) fn len(&self) -> usize {
        self.ids.len()
    }
}

/// Adds the table of `rows` to a GLB with as much detail as fits `budget_bytes`, but always the numbers. Nothing without rows.
pub(crate) fn add_table(
    glb: &mut GlbBuilder,
    city: &City<'_>,
    rows: &Rows,
    budget_bytes: usize,
) -> Result<(), ExportError> {
    if rows.ids.is_empty() {
        return Ok(());
    }
    let table = Table::read(city, &rows.ids)?;
    for detail in [Detail::Full, Detail::Name, Detail::Number] {
        let packed: Vec<(Property, Packed)> = table.properties(detail).into_iter().map(pack).collect();
        let bytes: usize = packed.iter().map(|(property, packed)| property.json_bytes() + packed.bytes()).sum();
        if bytes <= budget_bytes || detail == Detail::Number {
            write(glb, rows.ids.len(), packed);
            return Ok(());
        }
    }
    Ok(())
}

fn pack(property: Property) -> (Property, Packed) {
    let packed = property.column.pack();
    (property, packed)
}

/// Adds the buffer views and the JSON of a table.
fn write(glb: &mut GlbBuilder, rows: usize, properties: Vec<(Property, Packed)>) {
    let (mut class, mut columns, mut enums) = (Map::new(), Map::new(), Map::new());
    for (property, packed) in properties {
        if let Some((id, members)) = property.column.enumeration() {
            enums.insert(id.to_owned(), members);
        }
        let mut column = json!({ "values": glb.add_bytes(&packed.values, 8) });
        if let Some((offsets, component_type)) = &packed.offsets {
            column["stringOffsets"] = json!(glb.add_bytes(offsets, 8));
            column["stringOffsetType"] = json!(component_type);
        }
        class.insert(property.id.clone(), property.class_property());
        columns.insert(property.id, column);
    }
    let mut schema = json!({ "id": "insula", "classes": { "object": { "properties": class } } });
    if !enums.is_empty() {
        schema["enums"] = Json::Object(enums);
    }
    let table = json!({ "name": "objects", "class": "object", "count": rows, "properties": columns });
    glb.set_metadata(json!({ "schema": schema, "propertyTables": [table] }));
}

impl Property {
    fn class_property(&self) -> Json {
        let mut json = self.column.class_property();
        let texts = [("name", &self.name), ("description", &self.description)];
        for (member, text) in texts {
            if let Some(text) = text {
                json[member] = json!(text);
            }
        }
        if let Some(semantic) = self.semantic {
            json["semantic"] = json!(semantic);
        }
        json
    }

    /// About the size of what the JSON of the GLB says of the property.
    fn json_bytes(&self) -> usize {
        const REFERENCES: usize = 150;
        self.class_property().to_string().len() + 2 * self.id.len() + REFERENCES
    }
}

/// Records of the rows.
struct Table<'a> {
    ids: &'a [u32],
    records: Vec<Option<ObjectRecord>>,
    parents: Vec<Option<String>>,
    attributes: &'a [AttributeInfo],
    objects: u32,
}

impl<'a> Table<'a> {
    fn read(city: &City<'a>, ids: &'a [u32]) -> Result<Self, ExportError> {
        let records = ids.iter().map(|id| city.record(*id)).collect::<Result<Vec<_>, _>>()?;
        let parent = |record: &Option<ObjectRecord>| match record.as_ref().and_then(|record| record.parent) {
            Some(parent) => city.identifier(parent).map(|name| Some(name).filter(|name| !name.is_empty())),
            None => Ok(None),
        };
        let parents = records.iter().map(parent).collect::<Result<Vec<_>, _>>()?;
        let schema = city.source.schema();
        Ok(Self { ids, records, parents, attributes: &schema.attributes, objects: schema.objects })
    }

    fn properties(&self, detail: Detail) -> Vec<Property> {
        let own = |id: &str, semantic, column| Property {
            id: id.to_owned(),
            name: None,
            description: None,
            semantic,
            column,
        };
        let mut properties = vec![own("id", None, Column::Number(self.ids.to_vec()))];
        if detail >= Detail::Name {
            let known = || self.records.iter().map(Option::as_ref);
            let kinds = known().map(|record| record.map(|record| record.kind.name().to_owned())).collect();
            properties.push(own("kind", None, Column::Text(kinds)));
            let identifier = |record: &ObjectRecord| Some(record.identifier.clone()).filter(|name| !name.is_empty());
            let identifiers = known().map(|record| record.and_then(identifier)).collect();
            properties.push(own("identifier", Some("ID"), Column::Text(identifiers)));
        }
        if detail >= Detail::Full {
            properties.push(own("parent", None, Column::Text(self.parents.clone())));
            self.push_attributes(&mut properties);
        }
        properties.retain(|property| !property.column.is_empty());
        properties
    }

    fn push_attributes(&self, properties: &mut Vec<Property>) {
        let mut ids: BTreeSet<String> = ["id", "kind", "identifier", "parent"].map(str::to_owned).into();
        for (index, info) in self.attributes.iter().enumerate() {
            let id = unique_id(&info.name, &mut ids);
            let values: Vec<Option<&Value>> =
                self.records.iter().map(|record| value_of(record.as_ref()?, index as u32)).collect();
            if values.iter().all(Option::is_none) {
                continue;
            }
            let column = match info.value_type {
                ValueType::Integer => Column::integers(&values, info),
                ValueType::Float => Column::Float(values.iter().map(|value| value.and_then(Value::as_f64)).collect()),
                ValueType::Bool => Column::bools(&values, info.count == u64::from(self.objects)),
                ValueType::Text | ValueType::Date => {
                    Column::Text(values.iter().map(|value| value.map(Value::to_string)).collect())
                }
            };
            properties.push(Property {
                name: (id != info.name).then(|| info.name.clone()),
                id,
                description: info.unit.as_ref().map(|unit| format!("in {unit}")),
                semantic: None,
                column,
            });
        }
    }
}

fn value_of(record: &ObjectRecord, attribute: u32) -> Option<&Value> {
    let at = record.attributes.binary_search_by_key(&attribute, |(attribute, _)| *attribute).ok()?;
    record.attributes.get(at).map(|(_, value)| value)
}

/// A name as the id of a property: letters, digits and underscores of ASCII, not beginning with a digit, and not in `taken`.
fn unique_id(name: &str, taken: &mut BTreeSet<String>) -> String {
    let mut id: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if !id.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
        id.insert(0, '_');
    }
    let stem = id.clone();
    let mut number = 2;
    while !taken.insert(id.clone()) {
        id = format!("{stem}_{number}");
        number += 1;
    }
    id
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_of_properties_are_valid_and_different() {
        let mut taken = BTreeSet::from(["id".to_owned()]);
        let names = ["id", "uro:lod1HeightType", "1st", "建物", "土地", "uro_lod1HeightType", ""];
        let ids = names.map(|name| unique_id(name, &mut taken));
        assert_eq!(ids, ["id_2", "uro_lod1HeightType", "_1st", "__", "___2", "uro_lod1HeightType_2", "_"]);
    }
}
