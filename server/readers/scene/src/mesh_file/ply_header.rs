//! The header of a PLY: its elements and their properties.

use insula_source::error::InputError;

/// A header has no more lines.
const MAX_LINES: usize = 10_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PlyNumber {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl PlyNumber {
    fn by_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }
}

/// A property of an element.
#[derive(Debug)]
pub(super) struct PlyProperty {
    pub(super) name: String,
    /// Type of a list's length; `None` for a single value.
    pub(super) length: Option<PlyNumber>,
    pub(super) number: PlyNumber,
}

/// A list of rows with the same properties.
#[derive(Debug)]
pub(super) struct PlyElement {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<PlyProperty>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PlyEncoding {
    Text,
    Little,
    Big,
}

#[derive(Debug)]
pub(super) struct PlyHeader {
    pub(super) encoding: PlyEncoding,
    pub(super) elements: Vec<PlyElement>,
    /// Images of `comment TextureFile`.
    pub(super) textures: Vec<String>,
    /// Of the first row.
    pub(super) data_start: usize,
}

/// Parses a header. Fails if it is incomplete or invalid.
pub(super) fn parse(label: &str, bytes: &[u8]) -> Result<PlyHeader, InputError> {
    let mut elements: Vec<PlyElement> = Vec::new();
    let (mut encoding, mut textures, mut start) = (None, Vec::new(), 0);
    for line_number in 1..=MAX_LINES {
        let damaged = |what: &str| InputError::damaged(label, format!("line {line_number}"), what);
        let rest = bytes.get(start..).unwrap_or(&[]);
        let end = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
        let end = end.ok_or_else(|| damaged("the header has no end_header"))?;
        let line = String::from_utf8_lossy(&rest[..end]);
        start += end + 1;
        if rest[end] == b'\r' && rest.get(end + 1) == Some(&b'\n') {
            start += 1;
        }
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["end_header"] => {
                let encoding = encoding.ok_or_else(|| damaged("the header has no format"))?;
                return Ok(PlyHeader { encoding, elements, textures, data_start: start });
            }
            ["format", name, ..] => encoding = Some(encoding_of(name).ok_or_else(|| damaged("unknown format"))?),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| damaged("the count of an element is no whole number"))?;
                elements.push(PlyElement { name: name.into(), count, properties: Vec::new() });
            }
            ["property", ..] => {
                let property = property_of(&words).ok_or_else(|| damaged("invalid property"))?;
                let element = elements.last_mut().ok_or_else(|| damaged("property before any element"))?;
                element.properties.push(property);
            }
            ["comment", word, _, ..] if word.eq_ignore_ascii_case("texturefile") => {
                let after = line.to_ascii_lowercase().find("texturefile").map_or(0, |at| at + "texturefile".len());
                textures.push(line.get(after..).unwrap_or("").trim().to_owned());
            }
            _ => {}
        }
    }
    Err(InputError::damaged(label, format!("line {MAX_LINES}"), "the header has no end_header"))
}

fn encoding_of(name: &str) -> Option<PlyEncoding> {
    Some(match name {
        "ascii" => PlyEncoding::Text,
        "binary_little_endian" => PlyEncoding::Little,
        "binary_big_endian" => PlyEncoding::Big,
        _ => return None,
    })
}

fn property_of(words: &[&str]) -> Option<PlyProperty> {
    match *words {
        ["property", "list", length, item, name] => Some(PlyProperty {
            name: name.into(),
            length: Some(PlyNumber::by_name(length)?),
            number: PlyNumber::by_name(item)?,
        }),
        ["property", item, name] => {
            Some(PlyProperty { name: name.into(), length: None, number: PlyNumber::by_name(item)? })
        }
        _ => None,
    }
}
