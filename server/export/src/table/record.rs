//! Rows of a table: one for each object, with the same columns in all formats.

use super::gather::Footprint;
use insula_objects::{FeatureKind, Schema, Value, ValueType};
use insula_protocol::text::without_sign_of_zero;
use std::borrow::Cow;
use std::collections::BTreeSet;

/// One object.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Record {
    pub(crate) object: u32,
    /// Of the source; may be empty.
    pub(crate) identifier: String,
    /// Identifier of the parent in the source.
    pub(crate) parent: Option<String>,
    pub(crate) kind: FeatureKind,
    /// `None` if no tile shows the object.
    pub(crate) footprint: Option<Footprint>,
    /// Indices of attributes in the schema, ascending, with their values.
    pub(crate) attributes: Vec<(u32, Value)>,
    /// Values that are none of the city's.
    pub(crate) added: Vec<Option<Value>>,
}

/// What a column has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Content {
    Object,
    Identifier,
    Parent,
    Kind,
    GroundZ,
    RoofZ,
    Height,
    Area,
    Attribute(u32),
    /// A value that is none of the city's: by its place.
    Added(u32),
}

/// A column of the table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Field {
    /// Unique, also without regard to case.
    pub(crate) name: String,
    pub(crate) value_type: ValueType,
    /// Unit of numbers, such as `m`.
    pub(crate) unit: Option<String>,
    content: Content,
}

/// Columns that all tables have, before those of the attributes.
const COMMON: [(&str, ValueType, Option<&str>, Content); 8] = [
    ("object", ValueType::Integer, None, Content::Object),
    ("identifier", ValueType::Text, None, Content::Identifier),
    ("parent", ValueType::Text, None, Content::Parent),
    ("kind", ValueType::Text, None, Content::Kind),
    ("ground_z_m", ValueType::Float, Some("m"), Content::GroundZ),
    ("roof_z_m", ValueType::Float, Some("m"), Content::RoofZ),
    ("height_m", ValueType::Float, Some("m"), Content::Height),
    ("area_m2", ValueType::Float, Some("m2"), Content::Area),
];
/// Names of columns that formats add.
const RESERVED: [&str; 5] = ["geometry", "bbox", "wkt", "fid", "id"];

/// The columns of a city's table: the common ones, and one for each attribute of the schema in the order in which attributes are shown.
/// An attribute whose name is taken gets a number: `height_m_2`.
///
/// Between them are those of numbers that are none of the city's, by their names.
pub(crate) fn fields(schema: &Schema, added: &[String]) -> Vec<Field> {
    let mut taken: BTreeSet<String> = RESERVED.iter().map(|name| (*name).to_owned()).collect();
    let mut fields: Vec<Field> = COMMON
        .iter()
        .map(|(name, value_type, unit, content)| {
            taken.insert((*name).to_owned());
            Field {
                name: (*name).to_owned(),
                value_type: *value_type,
                unit: unit.map(str::to_owned),
                content: *content,
            }
        })
        .collect();
    for (number, name) in (0u32..).zip(added) {
        taken.insert(name.to_lowercase());
        let (name, value_type, content) = (name.clone(), ValueType::Float, Content::Added(number));
        fields.push(Field { name, value_type, unit: None, content });
    }
    for (index, attribute) in
        schema.display_order().into_iter().filter_map(|index| Some((index, schema.attributes.get(index)?)))
    {
        let mut name = attribute.name.clone();
        let mut number = 2u32;
        while !taken.insert(name.to_lowercase()) {
            name = format!("{}_{number}", attribute.name);
            number += 1;
        }
        let (value_type, unit) = (attribute.value_type, attribute.unit.clone());
        fields.push(Field { name, value_type, unit, content: Content::Attribute(index as u32) });
    }
    fields
}

/// The columns of a table that has none of a city's, by name, type and unit.
pub(crate) fn own_fields(columns: &[(&str, ValueType, Option<&str>)]) -> Vec<Field> {
    let numbered = (0u32..).zip(columns);
    let field = |(number, (name, value_type, unit)): (u32, &(&str, ValueType, Option<&str>))| Field {
        name: (*name).to_owned(),
        value_type: *value_type,
        unit: unit.map(str::to_owned),
        content: Content::Added(number),
    };
    numbered.map(field).collect()
}

impl Record {
    /// The values of the columns, `None` where the object has none. Values have the types of their columns.
    pub(crate) fn values<'a>(&'a self, fields: &[Field]) -> Vec<Option<Cow<'a, Value>>> {
        let value = |field: &Field| match field.content {
            Content::Attribute(index) => {
                let at = self.attributes.binary_search_by_key(&index, |(known, _)| *known).ok()?;
                self.attributes.get(at).map(|(_, value)| Cow::Borrowed(value))
            }
            content => self.common(content).map(Cow::Owned),
        };
        let of_type = |field: &Field| value(field).filter(|value| value.type_of() == field.value_type);
        fields.iter().map(of_type).collect()
    }

    fn common(&self, content: Content) -> Option<Value> {
        let text = |text: &str| Some(Value::Text(text.to_owned())).filter(|_| !text.is_empty());
        let metres = |of: &dyn Fn(&Footprint) -> f64| {
            let millimetres = self.footprint.as_ref().map(|footprint| (of(footprint) * 1000.0).round());
            millimetres.map(|millimetres| Value::Float(without_sign_of_zero(millimetres / 1000.0)))
        };
        match content {
            Content::Object => Some(Value::Integer(i64::from(self.object))),
            Content::Identifier => text(&self.identifier),
            Content::Parent => text(self.parent.as_deref().unwrap_or_default()),
            Content::Kind => text(self.kind.name()),
            Content::GroundZ => metres(&|footprint| footprint.z_m[0]),
            Content::RoofZ => metres(&|footprint| footprint.z_m[1]),
            Content::Height => metres(&|footprint| footprint.z_m[1] - footprint.z_m[0]),
            Content::Area => metres(&|footprint| footprint.area_m2),
            Content::Added(at) => self.added.get(at as usize).cloned().flatten(),
            Content::Attribute(_) => None,
        }
    }

    /// The polygons of the footprint; empty if the object covers no area.
    pub(crate) fn polygons(&self) -> &[Vec<Vec<[f64; 2]>>] {
        self.footprint.as_ref().map_or(&[], |footprint| &footprint.polygons)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::SchemaBuilder;

    #[test]
    fn names_are_unique_without_regard_to_case() {
        let mut builder = SchemaBuilder::default();
        for name in ["Kind", "kind_2", "ID", "year"] {
            builder.add(name, &Value::Integer(1));
        }
        let fields = fields(&builder.finish(1), &[]);
        let names: Vec<&str> = fields.iter().skip(8).map(|field| field.name.as_str()).collect();
        // The year is told first.
        assert_eq!(names, ["year", "Kind_2", "kind_2_2", "ID_2"]);
    }

    #[test]
    fn values_follow_the_columns() {
        let mut builder = SchemaBuilder::default();
        builder.add("a", &Value::Integer(1));
        builder.add("b", &Value::Bool(true));
        builder.add("c", &Value::Float(2.5));
        let fields = fields(&builder.finish(1), &["Sun_hours".to_owned(), "A".to_owned()]);
        let record = Record {
            object: 7,
            identifier: "x".into(),
            parent: None,
            kind: FeatureKind::Bridge,
            footprint: None,
            attributes: vec![(0, Value::Integer(4)), (2, Value::Float(0.5))],
            added: vec![Some(Value::Float(1.5)), None],
        };
        let values: Vec<String> = record
            .values(&fields)
            .into_iter()
            .map(|value| value.map(|value| value.to_string()).unwrap_or_default())
            .collect();
        assert_eq!(fields[10].name, "a_2", "the name of an attribute was taken");
        assert_eq!(values, ["7", "x", "", "bridge", "", "", "", "", "1.5", "", "4", "", "0.5"]);
    }
}
