//! The schema of a city: which attributes its objects have, their types, ranges and most frequent values.
//!
//! A schema is stored as JSON. Blocks of objects refer to attributes by their index in it.

mod builder;
mod labels;
mod units;

use crate::value::{MAX_TEXT_BYTES, Value, ValueType};
pub use builder::SchemaBuilder;
use insula_protocol::error::{DecodeError, check_limit, invalid_if};
pub use labels::{
    AttributeLabel, Labels, MAX_LANGUAGES, MAX_TITLE_BYTES, ShownValue, UnusedLabel, is_language, title_in,
};
use serde::{Deserialize, Serialize, Serializer};
use std::collections::BTreeMap;

/// Maximum number of attributes.
pub const MAX_ATTRIBUTES: usize = 4096;
/// Maximum bytes of an attribute's name or unit.
pub const MAX_NAME_BYTES: usize = 256;
/// Names of what every object has. An attribute of the same name takes its place.
pub(crate) const FIELD_NAMES: [&str; 4] = ["id", "identifier", "kind", "height"];
/// Maximum number of distinct values that are counted.
pub const MAX_DISTINCT: usize = 1000;
/// Maximum number of most frequent values.
pub const MAX_TOP: usize = 20;
/// Maximum bytes of all names, units and texts together.
pub const MAX_TOTAL_BYTES: usize = 16 << 20;

/// What the objects of a city have.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schema {
    /// Number of objects; their ids are below it.
    pub objects: u32,
    /// At most [`MAX_ATTRIBUTES`], of different names, in the order of their first use.
    pub attributes: Vec<AttributeInfo>,
    /// Names of the attributes whose texts can be searched.
    #[serde(default)]
    pub searchable: Vec<String>,
    /// What people read, by the name of the attribute or field. Names that the city does not have are without effect.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub labels: BTreeMap<String, AttributeLabel>,
}

/// An attribute of a city's objects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttributeInfo {
    /// 1 to [`MAX_NAME_BYTES`] bytes.
    pub name: String,
    #[serde(rename = "type")]
    pub value_type: ValueType,
    /// Unit of its numbers, such as `m`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Number of objects that have it.
    pub count: u64,
    /// Smallest value. Dates as days since 1970-01-01. `None` for texts and booleans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// Number of different values; `None` above [`MAX_DISTINCT`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distinct: Option<u32>,
    /// The most frequent values with their counts, at most [`MAX_TOP`], most frequent first. Counts are lower bounds if `distinct`
    /// is `None`, because only the values that appeared first are counted then.
    #[serde(default)]
    pub top: Vec<(String, u64)>,
}

impl Schema {
    /// The index of the attribute of a name.
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.attributes.iter().position(|attribute| attribute.name == name)
    }

    /// Names by which objects can be coloured: of all attributes, and `height` and `kind`, which all cities have. Those whose labels have a
    /// number come first, as in panels; the others follow by name, so that one of hundreds is found.
    pub fn names_to_color_by(&self) -> Vec<String> {
        let mut names: Vec<String> = self.attributes.iter().map(|info| info.name.clone()).collect();
        for name in ["height", "kind"] {
            if self.index_of(name).is_none() {
                names.push(name.to_owned());
            }
        }
        let number = |name: &String| self.labels.get(name).and_then(|label| label.order).unwrap_or(u32::MAX);
        names.sort_by(|a, b| number(a).cmp(&number(b)).then_with(|| a.cmp(b)));
        names
    }

    /// The value in the type of attribute `attribute`. Numbers become floats in a column of floats, anything becomes a text in a
    /// column of texts. A value that the type cannot hold is returned as it is; it occurs only if the schema was not built from
    /// the same values.
    pub fn convert(&self, attribute: usize, value: &Value) -> Value {
        let wanted = self.attributes.get(attribute).map(|attribute| attribute.value_type);
        match (wanted, value) {
            (Some(ValueType::Float), Value::Integer(value)) => Value::Float(*value as f64),
            (Some(ValueType::Text), value) if value.type_of() != ValueType::Text => Value::Text(value.to_string()),
            _ => value.clone(),
        }
    }

    /// Fails if the schema breaks a limit of the format. Callers must check a schema that they did not build.
    pub fn check(&self) -> Result<(), DecodeError> {
        check_limit("the number of attributes", self.attributes.len(), MAX_ATTRIBUTES)?;
        check_limit("the number of searchable attributes", self.searchable.len(), MAX_ATTRIBUTES)?;
        let mut total_bytes = labels::check(&self.labels)?;
        let mut names = std::collections::BTreeSet::new();
        for attribute in &self.attributes {
            total_bytes += attribute.check()?;
            invalid_if(!names.insert(attribute.name.as_str()), "two attributes have the same name")?;
        }
        for name in &self.searchable {
            check_limit("the bytes of an attribute's name", name.len(), MAX_NAME_BYTES)?;
            total_bytes += name.len();
        }
        check_limit("the bytes of all names and texts of a schema", total_bytes, MAX_TOTAL_BYTES)
    }
}

impl AttributeInfo {
    /// Fails if the attribute breaks a limit. Returns the bytes of its texts.
    fn check(&self) -> Result<usize, DecodeError> {
        invalid_if(self.name.is_empty(), "an attribute has no name")?;
        let unit_bytes = self.unit.as_ref().map_or(0, String::len);
        check_limit("the bytes of an attribute's name", self.name.len(), MAX_NAME_BYTES)?;
        check_limit("the bytes of an attribute's unit", unit_bytes, MAX_NAME_BYTES)?;
        check_limit("the number of different values", self.distinct.unwrap_or(0) as usize, MAX_DISTINCT)?;
        check_limit("the number of most frequent values", self.top.len(), MAX_TOP)?;
        let range = [self.min, self.max];
        let is_ordered = self.min.zip(self.max).is_none_or(|(min, max)| min <= max);
        if !is_ordered || range.iter().flatten().any(|value| !value.is_finite()) {
            return Err(DecodeError::Invalid("the range of an attribute is inverted or not finite"));
        }
        let mut bytes = self.name.len() + unit_bytes;
        for (text, _) in &self.top {
            check_limit("the bytes of a text", text.len(), MAX_TEXT_BYTES)?;
            bytes += text.len();
        }
        Ok(bytes)
    }
}

/// Names and values of the attributes of an object, in the order in which they are shown: see [`Schema::display_order`]. As JSON it is an
/// object of that order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NamedValues(Vec<(String, Value)>);

impl NamedValues {
    /// The values of attributes of a schema, which are in its order: that of the source. Unknown attributes are left out.
    pub fn new(schema: &Schema, attributes: Vec<(u32, Value)>) -> Self {
        let mut order: Vec<usize> = (0..attributes.len()).collect();
        let index = |place: &usize| attributes.get(*place).map_or(usize::MAX, |(attribute, _)| *attribute as usize);
        order.sort_by_cached_key(|place| schema.rank(index(place)));
        let mut values: Vec<Option<(u32, Value)>> = attributes.into_iter().map(Some).collect();
        let named = order.into_iter().filter_map(|place| {
            let (attribute, value) = values.get_mut(place)?.take()?;
            Some((schema.attributes.get(attribute as usize)?.name.clone(), value))
        });
        Self(named.collect())
    }

    /// Names and values in their order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Value)> {
        self.0.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// The value of a name.
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.iter().find(|(known, _)| *known == name).map(|(_, value)| value)
    }
}

impl Serialize for NamedValues {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter())
    }
}

#[cfg(test)]
mod tests;
