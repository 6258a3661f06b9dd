//! Builds a schema in one pass over all values, in bounded memory.

use super::{AttributeInfo, MAX_ATTRIBUTES, MAX_DISTINCT, MAX_NAME_BYTES, MAX_TOP, Schema};
use crate::value::{MAX_TEXT_BYTES, Value, ValueType};
use std::collections::BTreeMap;

/// Distinct values of one attribute are counted while they have at most this many bytes together.
const MAX_DISTINCT_BYTES: usize = 256 << 10;
/// Distinct values of all attributes are counted while they have at most this many bytes together.
const MAX_COUNTED_BYTES: usize = 64 << 20;
/// Bytes of a counted value besides its text, roughly.
const VALUE_BYTES: usize = 64;

/// Collects the attributes of all objects of a city.
///
/// An attribute of integers and floats becomes one of floats, any other mixture of types becomes one of texts.
#[derive(Debug, Clone, Default)]
pub struct SchemaBuilder {
    indices: BTreeMap<String, usize>,
    attributes: Vec<Statistics>,
    units: BTreeMap<String, String>,
    counted_bytes: usize,
    dropped: u64,
}

/// What is known of the values of one attribute.
#[derive(Debug, Clone)]
struct Statistics {
    name: String,
    value_type: ValueType,
    count: u64,
    range: Option<[f64; 2]>,
    /// Occurrences of each value, by its text in the type in which it was added.
    values: BTreeMap<String, u64>,
    values_bytes: usize,
    /// Whether a value was left out of `values`.
    has_more: bool,
}

impl SchemaBuilder {
    /// Counts a value of an object. Names are cut to [`MAX_NAME_BYTES`], texts to 4096 bytes. Attributes beyond
    /// [`MAX_ATTRIBUTES`] and values without a name or that are not finite are dropped, see [`SchemaBuilder::dropped`].
    pub fn add(&mut self, name: &str, value: &Value) {
        let name = cut(name, MAX_NAME_BYTES);
        let is_invalid = name.is_empty() || matches!(value, Value::Float(value) if !value.is_finite());
        let index = self.indices.get(name).copied();
        if is_invalid || (index.is_none() && self.attributes.len() >= MAX_ATTRIBUTES) {
            self.dropped += 1;
            return;
        }
        let index = index.unwrap_or_else(|| {
            self.indices.insert(name.to_owned(), self.attributes.len());
            self.attributes.push(Statistics::new(name, value.type_of()));
            self.attributes.len() - 1
        });
        if let Some(statistics) = self.attributes.get_mut(index) {
            self.counted_bytes += statistics.add(value, MAX_COUNTED_BYTES.saturating_sub(self.counted_bytes));
        }
    }

    /// Sets the unit of an attribute, cut to [`MAX_NAME_BYTES`]. It has no effect if no object has the attribute.
    pub fn set_unit(&mut self, name: &str, unit: &str) {
        let name = cut(name, MAX_NAME_BYTES);
        if self.units.len() < MAX_ATTRIBUTES || self.units.contains_key(name) {
            self.units.insert(name.to_owned(), cut(unit, MAX_NAME_BYTES).to_owned());
        }
    }

    /// Number of values that were dropped.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// The schema of `objects` objects, without searchable attributes. It passes [`Schema::check`].
    pub fn finish(mut self, objects: u32) -> Schema {
        let attributes = self.attributes.into_iter().map(|statistics| {
            let unit = self.units.remove(&statistics.name);
            AttributeInfo { unit, ..statistics.finish() }
        });
        let mut schema = Schema { objects, attributes: attributes.collect(), ..Schema::default() };
        bound_texts(&mut schema);
        schema
    }
}

impl Statistics {
    fn new(name: &str, value_type: ValueType) -> Self {
        Self {
            name: name.to_owned(),
            value_type,
            count: 0,
            range: None,
            values: BTreeMap::new(),
            values_bytes: 0,
            has_more: false,
        }
    }

    /// Returns the bytes of a new counted value, at most `room`.
    fn add(&mut self, value: &Value, room: usize) -> usize {
        self.count += 1;
        self.value_type = match (self.value_type, value.type_of()) {
            (known, new) if known == new => known,
            (known, new) if known.is_number() && new.is_number() => ValueType::Float,
            _ => ValueType::Text,
        };
        if let Some(number) = value.as_f64() {
            let [min, max] = self.range.unwrap_or([number; 2]);
            self.range = Some([min.min(number), max.max(number)]);
        }
        let text = value.to_string();
        let text = cut(&text, MAX_TEXT_BYTES);
        if let Some(count) = self.values.get_mut(text) {
            *count += 1;
            return 0;
        }
        let bytes = text.len() + VALUE_BYTES;
        if self.values.len() > MAX_DISTINCT || self.values_bytes + bytes > MAX_DISTINCT_BYTES || bytes > room {
            self.has_more = true;
            return 0;
        }
        self.values_bytes += bytes;
        self.values.insert(text.to_owned(), 1);
        bytes
    }

    /// The attribute, without its unit.
    fn finish(self) -> AttributeInfo {
        let has_range = !matches!(self.value_type, ValueType::Text | ValueType::Bool);
        let range = self.range.filter(|_| has_range);
        let is_counted = !self.has_more && self.values.len() <= MAX_DISTINCT;
        let distinct = is_counted.then_some(self.values.len() as u32);
        let mut top: Vec<(String, u64)> = self.values.into_iter().collect();
        // Values of the same count stay in the order of their texts.
        top.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        top.truncate(MAX_TOP);
        let [min, max] = [range.map(|[min, _]| min), range.map(|[_, max]| max)];
        AttributeInfo {
            name: self.name,
            value_type: self.value_type,
            unit: None,
            count: self.count,
            min,
            max,
            distinct,
            top,
        }
    }
}

/// Removes most frequent values of the last attributes until the texts are within the limit of a schema. Only a city of thousands
/// of attributes with long texts needs that.
fn bound_texts(schema: &mut Schema) {
    let mut bytes = 0;
    for attribute in &mut schema.attributes {
        bytes += attribute.name.len() + attribute.unit.as_ref().map_or(0, String::len);
        attribute.top.retain(|(text, _)| {
            let is_kept = bytes + text.len() <= super::MAX_TOTAL_BYTES / 2;
            bytes += if is_kept { text.len() } else { 0 };
            is_kept
        });
    }
}

/// The longest start of a text of at most `bytes` bytes that does not cut a character.
fn cut(text: &str, bytes: usize) -> &str {
    text.get(..text.floor_char_boundary(bytes)).unwrap_or(text)
}
