//! Labels of attributes for people: titles by language, their order, and which attributes are hidden.
//!
//! Labels change no value and no name: filters, tables and scripts go on with the names of the source.

use super::{FIELD_NAMES, MAX_ATTRIBUTES, MAX_NAME_BYTES, NamedValues, Schema};
use crate::attribute_names::Telling;
use crate::suggest;
use crate::value::Value;
use insula_protocol::error::{DecodeError, check_limit, invalid_if};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Maximum bytes of a title.
pub const MAX_TITLE_BYTES: usize = 256;
/// Maximum number of languages of one title.
pub const MAX_LANGUAGES: usize = 64;
/// Maximum bytes of the code of a language, such as `pt-br`.
const MAX_LANGUAGE_BYTES: usize = 35;
/// Most names that a warning suggests.
const MAX_SUGGESTIONS: usize = 3;

/// What people read of one attribute.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttributeLabel {
    /// At most [`MAX_TITLE_BYTES`] bytes. `None`: its name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// Titles by codes of languages ([`is_language`]), at most [`MAX_LANGUAGES`].
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub titles: BTreeMap<String, String>,
    /// Attributes with a number come first, the smallest at the top.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<u32>,
    /// Panels do not show it. It is in the files nevertheless.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hidden: bool,
}

/// The labels of an office, for any of its cities.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Labels {
    /// By the name of the attribute.
    pub attributes: BTreeMap<String, AttributeLabel>,
    /// Units of numbers by the name of the attribute, at most [`MAX_NAME_BYTES`] bytes each.
    pub units: BTreeMap<String, String>,
}

/// A label that has no effect on a city.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UnusedLabel {
    #[error("objects have no attribute {name}{}", did_you_mean(near))]
    UnknownAttribute {
        name: String,
        /// The most similar names, the nearest first.
        near: Vec<String>,
    },
    #[error("{name} is no attribute of numbers: it has no unit")]
    UnitOfNoNumber { name: String },
}

fn did_you_mean(near: &[String]) -> String {
    if near.is_empty() { String::new() } else { format!(": did you mean {}?", near.join(" or ")) }
}

/// An attribute as a panel shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShownValue {
    /// Of the source.
    pub name: String,
    pub title: String,
    /// The value with its unit.
    pub text: String,
}

/// Whether a text is the code of a language in lower case, such as `de` or `pt-br`.
pub fn is_language(code: &str) -> bool {
    let is_part = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit());
    let primary = code.split('-').next().unwrap_or_default();
    (2..=3).contains(&primary.len()) && code.len() <= MAX_LANGUAGE_BYTES && code.split('-').all(is_part)
}

/// The title of a language such as `de-AT`, or else of its first part.
pub fn title_in<'a>(titles: &'a BTreeMap<String, String>, language: &str) -> Option<&'a str> {
    let code = language.to_ascii_lowercase().replace('_', "-");
    let primary = code.split('-').next().unwrap_or_default();
    titles.get(&code).or_else(|| titles.get(primary)).map(String::as_str)
}

impl AttributeLabel {
    /// The title in a language such as `de-AT`, or else in that of its first part, or else the one of all languages.
    pub fn title_in(&self, language: &str) -> Option<&str> {
        title_in(&self.titles, language).or(self.title.as_deref())
    }

    /// Fails if the label breaks a limit. Returns the bytes of its texts.
    fn check(&self) -> Result<usize, DecodeError> {
        check_limit("the languages of a title", self.titles.len(), MAX_LANGUAGES)?;
        invalid_if(self.titles.keys().any(|code| !is_language(code)), "a title in something that is no language")?;
        let mut bytes = 0;
        for title in self.title.iter().chain(self.titles.values()) {
            check_limit("the bytes of a title", title.len(), MAX_TITLE_BYTES)?;
            bytes += title.len();
        }
        Ok(bytes)
    }
}

/// Fails if labels break a limit. Returns the bytes of their texts.
pub(super) fn check(labels: &BTreeMap<String, AttributeLabel>) -> Result<usize, DecodeError> {
    check_limit("the number of labels", labels.len(), MAX_ATTRIBUTES + FIELD_NAMES.len())?;
    let mut bytes = 0;
    for (name, label) in labels {
        check_limit("the bytes of an attribute's name", name.len(), MAX_NAME_BYTES)?;
        bytes += name.len() + label.check()?;
    }
    Ok(bytes)
}

impl Schema {
    /// Takes the labels of the attributes and fields that the city has. Returns those that have no effect.
    pub fn set_labels(&mut self, labels: &Labels) -> Vec<UnusedLabel> {
        let mut unused = Vec::new();
        for (name, label) in &labels.attributes {
            if self.is_known(name) {
                self.labels.insert(name.clone(), label.clone());
            } else {
                let candidates = self.attributes.iter().map(|info| info.name.as_str());
                let near = suggest::nearest_few(name, candidates, MAX_SUGGESTIONS);
                unused.push(UnusedLabel::UnknownAttribute {
                    name: name.clone(),
                    near: near.into_iter().map(str::to_owned).collect(),
                });
            }
        }
        for (name, unit) in &labels.units {
            // Unknown names were reported above, as each unit is a part of a label.
            let is_known = self.is_known(name);
            match self.attributes.iter_mut().find(|info| info.name == *name) {
                Some(info) if info.value_type.is_number() => info.unit = Some(unit.clone()),
                None if !is_known => {}
                _ => unused.push(UnusedLabel::UnitOfNoNumber { name: name.clone() }),
            }
        }
        unused
    }

    /// Whether a name is that of an attribute or of a field.
    fn is_known(&self, name: &str) -> bool {
        FIELD_NAMES.contains(&name) || self.index_of(name).is_some()
    }

    /// What people read for the name of an attribute or field.
    pub fn title_of<'a>(&'a self, name: &'a str, language: &str) -> &'a str {
        self.labels.get(name).and_then(|label| label.title_in(language)).unwrap_or(name)
    }

    /// Whether panels show an attribute.
    pub fn is_shown(&self, name: &str) -> bool {
        !self.labels.get(name).is_some_and(|label| label.hidden)
    }

    /// The attributes in the order in which they are shown: those whose labels have a number come first, then name, address, use, year
    /// and height; the others follow in the order of the source. Pages, windows, commands and tables all have this order.
    pub fn display_order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.attributes.len()).collect();
        order.sort_by_cached_key(|index| self.rank(*index));
        order
    }

    /// The place of an attribute among those that are shown: smaller ones come first.
    pub(super) fn rank(&self, attribute: usize) -> (u32, Telling, usize) {
        let name = self.attributes.get(attribute).map_or("", |info| info.name.as_str());
        let order = self.labels.get(name).and_then(|label| label.order).unwrap_or(u32::MAX);
        (order, Telling::of_name(name), attribute)
    }

    /// A value as people read it: numbers have the unit of their attribute.
    pub fn text_of(&self, name: &str, value: &Value) -> String {
        let info = self.attributes.iter().find(|info| info.name == name && info.value_type.is_number());
        match info.and_then(|info| info.unit.as_ref()) {
            Some(unit) => format!("{value} {unit}"),
            None => value.to_string(),
        }
    }

    /// The attributes of an object as a panel shows them, with titles in a language.
    pub fn shown(&self, values: &NamedValues, language: &str) -> Vec<ShownValue> {
        let visible = values.iter().filter(|(name, _)| self.is_shown(name));
        let shown = visible.map(|(name, value)| ShownValue {
            name: name.to_owned(),
            title: self.title_of(name, language).to_owned(),
            text: self.text_of(name, value),
        });
        shown.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schema::SchemaBuilder;

    fn schema() -> Schema {
        let mut builder = SchemaBuilder::default();
        builder.add("status", &Value::Text("in use".into()));
        builder.add("bouwjaar", &Value::Integer(1650));
        builder.add("dak", &Value::Float(8.63));
        builder.finish(1)
    }

    fn label(title: &str) -> AttributeLabel {
        AttributeLabel { title: Some(title.into()), ..AttributeLabel::default() }
    }

    #[test]
    fn titles_order_units_and_hiding_are_those_of_the_labels() {
        let mut schema = schema();
        let titles = [("de", "Baujahr"), ("pt-br", "Ano")].map(|(code, title)| (code.to_owned(), title.to_owned()));
        let labels = Labels {
            attributes: [
                ("bouwjaar".to_owned(), AttributeLabel { titles: titles.into(), ..label("Built in") }),
                ("dak".to_owned(), AttributeLabel { order: Some(1), ..label("Roof") }),
                ("status".to_owned(), AttributeLabel { hidden: true, ..AttributeLabel::default() }),
                ("height".to_owned(), label("Height")),
            ]
            .into(),
            units: [("dak".to_owned(), "m".to_owned())].into(),
        };
        assert_eq!(schema.set_labels(&labels), []);
        schema.check().unwrap();
        assert_eq!(schema.display_order(), [2, 1, 0]);
        let title = |language| schema.title_of("bouwjaar", language);
        assert_eq!(
            ["de_AT", "pt-BR", "pt", "", "xx"].map(title),
            ["Baujahr", "Ano", "Built in", "Built in", "Built in"]
        );
        assert_eq!((schema.title_of("height", "de"), schema.title_of("other", "de")), ("Height", "other"));
        let values = vec![(0, Value::Text("in use".into())), (1, Value::Integer(1650)), (2, Value::Float(8.63))];
        let shown = schema.shown(&NamedValues::new(&schema, values), "de");
        let texts: Vec<_> = shown.iter().map(|row| format!("{}: {}", row.title, row.text)).collect();
        assert_eq!(texts, ["Roof: 8.63 m", "Baujahr: 1650"]);
        let json = serde_json::to_string(&schema).unwrap();
        assert_eq!(serde_json::from_str::<Schema>(&json).unwrap(), schema);
    }

    #[test]
    fn telling_attributes_come_first_and_the_others_keep_their_order() {
        let names = ["identificatie", "b3_h_maaiveld", "oorspronkelijkbouwjaar", "status", "bldg:measuredHeight"];
        let names: Vec<&str> = names
            .into_iter()
            .chain(["gebruiksdoel", "addr:street", "addr:housenumber", "name:en", "number", "naam"])
            .collect();
        let mut builder = SchemaBuilder::default();
        names.iter().for_each(|name| builder.add(name, &Value::Integer(1)));
        let shown: Vec<&str> = builder.finish(1).display_order().into_iter().map(|index| names[index]).collect();
        let telling = ["name:en", "naam", "addr:street", "addr:housenumber", "gebruiksdoel", "oorspronkelijkbouwjaar"];
        assert_eq!(shown[..6], telling);
        assert_eq!(shown[6..], ["bldg:measuredHeight", "identificatie", "b3_h_maaiveld", "status", "number"]);
    }

    #[test]
    fn labels_without_effect_are_named_with_what_is_near() {
        let mut schema = schema();
        let labels = Labels {
            attributes: [("bouwjar", label("Year")), ("zzzzzz", label("?")), ("status", label("State"))]
                .map(|(name, label)| (name.to_owned(), label))
                .into(),
            units: [("status", "m"), ("bouwjar", "a")].map(|(name, unit)| (name.to_owned(), unit.to_owned())).into(),
        };
        let unused: Vec<String> = schema.set_labels(&labels).iter().map(ToString::to_string).collect();
        let expected = [
            "objects have no attribute bouwjar: did you mean bouwjaar?",
            "objects have no attribute zzzzzz",
            "status is no attribute of numbers: it has no unit",
        ];
        assert_eq!(unused, expected);
        assert_eq!(schema.labels.len(), 1);
    }

    #[test]
    fn labels_beyond_the_limits_are_refused() {
        let long = "a".repeat(MAX_TITLE_BYTES + 1);
        let in_language = |code: &str| AttributeLabel {
            titles: [(code.to_owned(), "a".to_owned())].into(),
            ..AttributeLabel::default()
        };
        for wrong in [label(&long), in_language("DE"), in_language(""), in_language("de--at"), in_language("deutsch")] {
            let mut schema = schema();
            schema.labels.insert("dak".into(), wrong.clone());
            assert!(schema.check().is_err(), "{wrong:?}");
        }
        let mut many = schema();
        many.labels = (0..=MAX_ATTRIBUTES + 4).map(|k| (k.to_string(), AttributeLabel::default())).collect();
        assert!(many.check().is_err());
    }
}
