//! Units of attributes that the source tells beside them, or that follow from their names.

use super::Schema;
use crate::attribute_names::unit_of_name;

/// After the name of an attribute, in the name of the one that has its unit: CityGML writes units as attributes of values.
const UNIT_SUFFIX: &str = ".uom";
/// What sources write for units, and what people read.
const SPELLINGS: [(&str, &str); 8] = [
    ("metre", "m"),
    ("meter", "m"),
    ("meters", "m"),
    ("[ft_i]", "ft"),
    ("m2", "m²"),
    ("sqm", "m²"),
    ("m3", "m³"),
    ("9001", "m"),
];

impl Schema {
    /// Gives numbers without a unit the one that the source tells or that follows from their names. Heights are in `heights`, as the bake
    /// reads them.
    pub fn set_known_units(&mut self, heights: &str) {
        let told: Vec<Option<String>> = self.attributes.iter().map(|info| self.told_unit(&info.name)).collect();
        for (info, told) in self.attributes.iter_mut().zip(told) {
            if info.unit.is_some() || !info.value_type.is_number() {
                continue;
            }
            info.unit = match told {
                // The source has other units for some objects, or one of its own.
                Some(told) => Some(told).filter(|unit| !unit.is_empty()),
                None => unit_of_name(&info.name, heights).map(str::to_owned),
            };
        }
    }

    /// The unit of an attribute in the source. Empty if the source has several units, or one that is not readable. `None` without any.
    fn told_unit(&self, name: &str) -> Option<String> {
        let unit = self.index_of(&format!("{name}{UNIT_SUFFIX}")).and_then(|index| self.attributes.get(index))?;
        let [(text, _)] = &unit.top[..] else { return Some(String::new()) };
        let is_only = unit.distinct == Some(1);
        Some(if is_only { readable(text) } else { String::new() })
    }
}

/// The unit of a text such as `m`, `#m`, `urn:adv:uom:m` or `urn:ogc:def:uom:UCUM::[ft_i]`.
fn readable(text: &str) -> String {
    let last = text.trim().rsplit([':', '/', '#']).next().unwrap_or_default();
    let known = SPELLINGS.iter().find(|(written, _)| last.eq_ignore_ascii_case(written)).map(|(_, unit)| *unit);
    let unit = known.unwrap_or(last);
    // A code of another register says nothing to people.
    if unit.bytes().all(|byte| byte.is_ascii_digit()) { String::new() } else { unit.to_owned() }
}

#[cfg(test)]
mod tests {
    use crate::schema::{Schema, SchemaBuilder};
    use crate::value::Value;

    fn schema(values: &[(&str, Value)]) -> Schema {
        let mut builder = SchemaBuilder::default();
        values.iter().for_each(|(name, value)| builder.add(name, value));
        builder.finish(1)
    }

    fn text(text: &str) -> Value {
        Value::Text(text.into())
    }

    fn units(schema: &Schema) -> Vec<&str> {
        schema.attributes.iter().map(|info| info.unit.as_deref().unwrap_or_default()).collect()
    }

    #[test]
    fn units_are_told_beside_the_values() {
        for (written, unit) in [
            ("urn:adv:uom:m", "m"),
            ("urn:ogc:def:uom:UCUM::[ft_i]", "ft"),
            ("#m", "m"),
            ("m2", "m²"),
            ("EPSG:8888", ""),
        ] {
            let mut schema = schema(&[("size", Value::Float(2.5)), ("size.uom", text(written))]);
            schema.set_known_units("m");
            assert_eq!(units(&schema), [unit, ""], "{written}");
        }
        let two = [
            ("measuredHeight", Value::Float(2.5)),
            ("measuredHeight.uom", text("m")),
            ("measuredHeight.uom", text("ft")),
        ];
        let mut schema = schema(&two);
        schema.set_known_units("m");
        assert_eq!(units(&schema), ["", ""]);
    }

    #[test]
    fn heights_have_metres_and_years_none() {
        let values = [
            ("measuredHeight", Value::Float(8.63)),
            ("b3_h_dak_max", Value::Float(21.5)),
            ("b3_volume_lod22", Value::Float(21.5)),
            ("yearOfConstruction", Value::Integer(1650)),
            ("heightroof", Value::Float(30.0)),
            ("hoogte", text("hoog")),
        ];
        let mut in_metres = schema(&values);
        in_metres.set_known_units("m");
        assert_eq!(units(&in_metres), ["m", "m", "m³", "", "", ""]);
        let mut in_feet = schema(&values);
        in_feet.set_known_units("ft");
        assert_eq!(units(&in_feet), ["ft", "m", "m³", "", "", ""]);
    }
}
