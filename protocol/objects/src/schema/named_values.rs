//! The attributes of an object with their names, as they are shown.

use super::Schema;
use crate::value::Value;
use serde::{Serialize, Serializer};

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
mod tests {
    use super::*;
    use crate::SchemaBuilder;

    #[test]
    fn values_are_in_the_order_of_the_source_with_the_telling_ones_first() {
        let mut builder = SchemaBuilder::default();
        for (name, value) in [
            ("zone", Value::Integer(3)),
            ("height", Value::Float(8.63)),
            ("area", Value::Float(-0.0)),
            ("name", Value::Text("Kerk".into())),
        ] {
            builder.add(name, &value);
        }
        let schema = builder.finish(1);
        let values = vec![
            (0, Value::Integer(3)),
            (1, Value::Float(8.63)),
            (2, Value::Float(-0.0)),
            (3, Value::Text("Kerk".into())),
            (9, Value::Bool(true)),
        ];
        let named = NamedValues::new(&schema, values);
        let json = serde_json::to_string(&named).unwrap();
        assert_eq!(json, r#"{"name":"Kerk","height":8.63,"zone":3,"area":0.0}"#);
        let texts: Vec<String> = named.iter().map(|(_, value)| value.to_string()).collect();
        assert_eq!((texts.join(" "), named.get("zone")), ("Kerk 8.63 3 0".into(), Some(&Value::Integer(3))));
    }
}
