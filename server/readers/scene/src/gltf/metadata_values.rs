//! Packed values of a property of EXT_structural_metadata.

use crate::bytes::{Number, NumberType};
use insula_source::attributes::MAX_ATTRIBUTES;
use insula_source::code_page::CodePage;
use insula_source::text::{not_in_utf8, page_of_others};
use serde_json::Value;

/// Names of the types of numbers.
pub(super) const NUMBERS: &str = "INT8 UINT8 INT16 UINT16 INT32 UINT32 INT64 UINT64 FLOAT32 FLOAT64";

/// A number of a list; null beyond its end or if it is not finite.
fn value_at(number: NumberType, bytes: &[u8], index: usize) -> Value {
    match index.checked_mul(number.bytes()).and_then(|at| number.read(bytes, at)) {
        None => Value::Null,
        Some(Number::Signed(value)) => Value::from(value),
        Some(Number::Unsigned(value)) => Value::from(value),
        // The shortest text that gives the same 32 bits, not its long expansion.
        Some(Number::Single(value)) => Value::from(value.to_string().parse().unwrap_or(f64::from(value))),
        Some(Number::Double(value)) => Value::from(value),
    }
}

fn offset_at(number: NumberType, bytes: &[u8], index: usize) -> Option<usize> {
    value_at(number, bytes, index).as_u64().and_then(|offset| usize::try_from(offset).ok())
}

/// The values of all features.
#[derive(Debug)]
pub(super) struct Values {
    pub(super) bytes: Vec<u8>,
    pub(super) component: NumberType,
    /// Components of a vector or matrix; 1 for others.
    pub(super) width: usize,
    pub(super) is_text: bool,
    pub(super) is_bool: bool,
    pub(super) is_array: bool,
    /// Length of arrays of equal length.
    pub(super) fixed_count: Option<u32>,
    pub(super) array_offsets: Option<(Vec<u8>, NumberType)>,
    pub(super) text_offsets: Option<(Vec<u8>, NumberType)>,
    /// That of texts that are not in UTF-8.
    pub(super) page: CodePage,
}

impl Values {
    /// Fails if there are fewer values than features.
    pub(super) fn check(&self, features: usize) -> Result<(), &'static str> {
        let entries = features.checked_add(1).ok_or("too many features")?;
        let holds = |offsets: &(Vec<u8>, NumberType)| {
            entries.checked_mul(offsets.1.bytes()).is_some_and(|n| n <= offsets.0.len())
        };
        if self.is_array && self.fixed_count.is_none() {
            let offsets = self.array_offsets.as_ref().ok_or("it has no array offsets")?;
            return if holds(offsets) { Ok(()) } else { Err("it has too few array offsets") };
        }
        if self.is_text {
            let offsets = self.text_offsets.as_ref().ok_or("it has no string offsets")?;
            return if self.is_array || holds(offsets) { Ok(()) } else { Err("it has too few string offsets") };
        }
        let items =
            features.checked_mul(self.fixed_count.unwrap_or(1) as usize).and_then(|n| n.checked_mul(self.width));
        let needed = items.and_then(|items| {
            if self.is_bool { Some(items.div_ceil(8)) } else { items.checked_mul(self.component.bytes()) }
        });
        if needed.is_some_and(|needed| needed <= self.bytes.len()) { Ok(()) } else { Err("it has too few values") }
    }

    /// The value of a feature, as JSON.
    pub(super) fn value(&self, feature: usize) -> Value {
        if !self.is_array {
            return self.element(feature);
        }
        let (start, end) = match (self.fixed_count, &self.array_offsets) {
            (Some(count), _) => {
                let start = feature.saturating_mul(count as usize);
                (start, start.saturating_add(count as usize))
            }
            (None, Some((bytes, number))) => {
                let offset = |index: usize| offset_at(*number, bytes, index).unwrap_or(0);
                (offset(feature), offset(feature.saturating_add(1)))
            }
            (None, None) => (0, 0),
        };
        // More would not become attributes.
        let end = end.min(start.saturating_add(MAX_ATTRIBUTES));
        Value::Array((start..end).map(|index| self.element(index)).collect())
    }

    fn element(&self, index: usize) -> Value {
        if self.is_bool {
            return self.bytes.get(index / 8).map_or(Value::Null, |byte| Value::Bool(byte >> (index % 8) & 1 == 1));
        }
        if self.is_text {
            return self.text(index).map_or(Value::Null, Value::String);
        }
        if self.width == 1 {
            return value_at(self.component, &self.bytes, index);
        }
        let start = index.saturating_mul(self.width);
        Value::Array(
            (start..start.saturating_add(self.width)).map(|k| value_at(self.component, &self.bytes, k)).collect(),
        )
    }

    /// Takes the code page that is likely for texts that are not in UTF-8. Returns what to report of them, if there are any.
    pub(super) fn settle_page(&mut self) -> Option<String> {
        self.page = page_of_others(self.texts())?;
        let is_other = |text: &&[u8]| std::str::from_utf8(text).is_err();
        let count = self.texts().filter(is_other).count();
        let first = self.texts().find(is_other).map(|text| self.page.decode(text)).unwrap_or_default();
        Some(format!("{count} {}", not_in_utf8(&first, self.page)))
    }

    /// The texts. Of those that share their bytes with others, as many as have twice the bytes together.
    fn texts(&self) -> impl Iterator<Item = &[u8]> {
        let offsets = self.text_offsets.as_ref().filter(|_| self.is_text);
        let count = offsets.map_or(0, |(bytes, number)| (bytes.len() / number.bytes()).saturating_sub(1));
        let mut bytes_left = self.bytes.len().saturating_mul(2);
        (0..count).map_while(move |index| {
            let text = self.text_bytes(index).unwrap_or_default();
            bytes_left = bytes_left.checked_sub(text.len())?;
            Some(text)
        })
    }

    fn text(&self, index: usize) -> Option<String> {
        let bytes = self.text_bytes(index)?;
        Some(std::str::from_utf8(bytes).map_or_else(|_| self.page.decode(bytes).into_owned(), str::to_owned))
    }

    fn text_bytes(&self, index: usize) -> Option<&[u8]> {
        let (bytes, number) = self.text_offsets.as_ref()?;
        let (start, end) = (offset_at(*number, bytes, index)?, offset_at(*number, bytes, index.checked_add(1)?)?);
        self.bytes.get(start..end)
    }
}
