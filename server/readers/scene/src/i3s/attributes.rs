//! Attributes of the features of a node: one small file for each attribute.

use super::layer::{AttributeJson, FieldJson, HeaderJson};
use super::resources::{Resource, Resources};
use crate::bytes::{Number, NumberType, part, u32_at};
use insula_source::attributes::{AttributeValue, Attributes, MAX_ATTRIBUTES};
use insula_source::code_page::CodePage;
use insula_source::problems::ENCODING_GUESSED;
use insula_source::text::{not_in_utf8, page_of_others};
use std::borrow::Cow;

/// Names of the types of numbers.
pub(super) const NUMBERS: &str = "Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Float32 Float64";

#[derive(Debug, Default)]
pub(super) struct NodeAttributes {
    columns: Vec<(String, Vec<Option<AttributeValue>>)>,
}

impl NodeAttributes {
    /// Reads the attributes in the folder `nodes/N`. Attributes that cannot be read, and texts in other code pages, are passed to `fault`.
    pub(super) fn read(
        resources: &Resources<'_, '_>,
        folder: &str,
        layer: (&[AttributeJson], &[FieldJson]),
        fault: &mut dyn FnMut(&'static str, String),
    ) -> Self {
        let mut columns = Vec::new();
        for json in layer.0.iter().take(MAX_ATTRIBUTES) {
            let is_date = layer.1.iter().any(|field| field.name == json.name && field.r#type == "esriFieldTypeDate");
            let path = format!("{folder}/attributes/{}/0", json.key);
            let read = resources.read(&path, Resource::Binary).map_err(|error| error.to_string());
            let mut guessed = |what: String| fault(ENCODING_GUESSED, format!("{}: {what}", json.name));
            let values = read.and_then(|(_, bytes)| column(json, is_date, &bytes, &mut guessed).map_err(str::to_owned));
            match values {
                Ok(values) => columns.push((json.name.clone(), values)),
                Err(what) => fault("attribute is not read", format!("{path}: {what}")),
            }
        }
        Self { columns }
    }

    /// The attributes of a feature by its number in the node.
    pub(super) fn get(&self, feature: usize) -> Attributes {
        let mut attributes = Attributes::default();
        for (name, values) in &self.columns {
            if let Some(Some(value)) = values.get(feature) {
                attributes.push(name, value.clone());
            }
        }
        attributes
    }
}

/// The values of an attribute. Texts in another code page than UTF-8 are passed to `guessed`. Fails if they are cut short or have an unknown
/// type.
fn column(
    json: &AttributeJson,
    is_date: bool,
    bytes: &[u8],
    guessed: &mut dyn FnMut(String),
) -> Result<Vec<Option<AttributeValue>>, &'static str> {
    let values = json.attribute_values.as_ref().or(json.object_ids.as_ref());
    let value_type = values.map_or("", |values| values.value_type.as_str());
    let count = u32_at(bytes, 0).ok_or("it is cut short")? as usize;
    let header_bytes = 4 * json.header.len().max(1) as u64;
    if value_type.eq_ignore_ascii_case("String") {
        let texts = texts(bytes, header_of(&json.header, header_bytes), count)?;
        let page = page_of_others(texts.iter().copied()).unwrap_or(CodePage::UTF8);
        return Ok(texts.into_iter().map(|text| text_value(text, page, is_date, guessed)).collect());
    }
    let number = number(value_type).ok_or("its type is not known")?;
    let width = number.bytes();
    // Numbers of eight bytes start at a multiple of eight.
    let start = header_bytes.next_multiple_of(width as u64);
    let data = part(bytes, start, count as u64 * width as u64).ok_or("it is cut short")?;
    Ok(data.chunks_exact(width).map(|bytes| number.read(bytes, 0).map(Number::to_attribute)).collect())
}

/// Bytes of the header of texts: their number, and the number of their bytes.
fn header_of(header: &[HeaderJson], bytes: u64) -> u64 {
    if header.len() < 2 { 8 } else { bytes }
}

fn texts(bytes: &[u8], start: u64, count: usize) -> Result<Vec<&[u8]>, &'static str> {
    let lengths = part(bytes, start, 4 * count as u64).ok_or("it is cut short")?;
    let mut at = start + lengths.len() as u64;
    let mut texts = Vec::with_capacity(count);
    for length in lengths.chunks_exact(4) {
        let length = u64::from(u32_at(length, 0).unwrap_or_default());
        texts.push(part(bytes, at, length).ok_or("it is cut short")?);
        at += length;
    }
    Ok(texts)
}

/// The value of a text, which is in `page` if it is not in UTF-8; `None` if it is empty.
fn text_value(bytes: &[u8], page: CodePage, is_date: bool, guessed: &mut dyn FnMut(String)) -> Option<AttributeValue> {
    let text = std::str::from_utf8(bytes).map_or_else(|_| page.decode(bytes), Cow::from);
    if std::str::from_utf8(bytes).is_err() {
        guessed(not_in_utf8(&text, page));
    }
    let text = text.trim_end_matches('\0');
    let date = is_date.then(|| AttributeValue::date(text)).flatten();
    (!text.is_empty()).then(|| date.unwrap_or_else(|| AttributeValue::Text(text.to_owned())))
}

fn number(name: &str) -> Option<NumberType> {
    let name = match name {
        "Oid32" => "UInt32",
        "Oid64" => "UInt64",
        name => name,
    };
    NumberType::by_name(NUMBERS, name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str, is_date: bool, bytes: &[u8]) -> Result<Vec<Option<AttributeValue>>, &'static str> {
        column(&serde_json::from_str(json).unwrap(), is_date, bytes, &mut |what| panic!("{what}"))
    }

    const TEXTS: &str = r#"{"header":[{"property":"count"},{"property":"attributeValuesByteCount"}],
        "attributeValues":{"valueType":"String"}}"#;
    const DOUBLES: &str = r#"{"header":[{"property":"count"}],"attributeValues":{"valueType":"Float64"}}"#;

    fn text_bytes(lengths: &[u32], text: &[u8]) -> Vec<u8> {
        let mut bytes = [lengths.len() as u32, text.len() as u32]
            .iter()
            .chain(lengths)
            .flat_map(|n| n.to_le_bytes())
            .collect::<Vec<_>>();
        bytes.extend_from_slice(text);
        bytes
    }

    #[test]
    fn texts_end_with_zeros_and_may_be_missing() {
        let bytes = text_bytes(&[5, 0, 1], b"Wien\0\0");
        let text = |text: &str| Some(AttributeValue::Text(text.to_owned()));
        assert_eq!(read(TEXTS, false, &bytes), Ok(vec![text("Wien"), None, None]));
        let bytes = text_bytes(&[11], b"2021-03-04\0");
        assert_eq!(read(TEXTS, true, &bytes), Ok(vec![Some(AttributeValue::Date { year: 2021, month: 3, day: 4 })]));
    }

    #[test]
    fn texts_in_other_pages_are_reported() {
        let json = serde_json::from_str(TEXTS).unwrap();
        let bytes = text_bytes(&[5, 1, 7], b"K\xf6ln\0aStra\xdfe\0");
        let mut reports = Vec::new();
        let values = column(&json, false, &bytes, &mut |what| reports.push(what)).unwrap();
        let text = |text: &str| Some(AttributeValue::Text(text.to_owned()));
        assert_eq!(values, [text("Köln"), text("a"), text("Straße")]);
        assert!(reports.len() == 2 && reports[1].contains("windows-1252: Straße"), "{reports:?}");
    }

    #[test]
    fn numbers_of_eight_bytes_are_aligned() {
        let mut bytes = vec![1, 0, 0, 0, 9, 9, 9, 9];
        bytes.extend_from_slice(&2.5_f64.to_le_bytes());
        assert_eq!(read(DOUBLES, false, &bytes), Ok(vec![Some(AttributeValue::Float(2.5))]));
    }

    #[test]
    fn whole_numbers_of_64_bits_keep_their_digits() {
        let json = DOUBLES.replace("Float64", "UInt64");
        let values = |number: u64| {
            let mut bytes = vec![1, 0, 0, 0, 9, 9, 9, 9];
            bytes.extend_from_slice(&number.to_le_bytes());
            read(&json, false, &bytes)
        };
        assert_eq!(values(7), Ok(vec![Some(AttributeValue::Integer(7))]));
        assert_eq!(values(u64::MAX), Ok(vec![Some(AttributeValue::Text("18446744073709551615".into()))]));
    }

    #[test]
    fn absurd_counts_are_refused_at_every_length() {
        let texts = text_bytes(&[5, 1], b"Wien\0\0");
        for length in 0..texts.len() {
            assert!(read(TEXTS, false, &texts[..length]).is_err(), "{length}");
        }
        assert!(read(TEXTS, false, &[255; 64]).is_err());
        assert!(read(DOUBLES, false, &[255; 64]).is_err());
        assert!(read("{}", false, &[0; 64]).is_err());
    }
}
