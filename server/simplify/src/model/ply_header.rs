//! The header of a PLY: its elements and their properties.

use super::triangle_model::ModelError;

/// A header has no more lines.
const MAX_LINES: usize = 10_000;

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlyNumber {
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
pub struct PlyProperty {
    pub name: String,
    /// Type of a list's length; `None` for a single value.
    pub length: Option<PlyNumber>,
    pub number: PlyNumber,
}

/// A list of rows with the same properties.
#[derive(Debug)]
pub struct PlyElement {
    pub name: String,
    pub count: u64,
    pub properties: Vec<PlyProperty>,
}

/// How rows are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlyEncoding {
    Text,
    /// Binary, little-endian.
    Little,
    /// Binary, big-endian.
    Big,
}

/// What stands before the rows.
#[derive(Debug)]
pub struct PlyHeader {
    pub encoding: PlyEncoding,
    pub elements: Vec<PlyElement>,
    /// Images of `comment TextureFile`.
    pub textures: Vec<String>,
    /// Byte of the first row.
    pub data_start: usize,
}

impl PlyHeader {
    /// Parses the header of a file. Fails if it is incomplete or invalid.
    pub fn parse(bytes: &[u8]) -> Result<Self, ModelError> {
        let mut elements: Vec<PlyElement> = Vec::new();
        let (mut encoding, mut textures, mut start) = (None, Vec::new(), 0);
        for number in 1..=MAX_LINES {
            let error = |what| ModelError::Line { what, line: number, format: "PLY" };
            let rest = bytes.get(start..).unwrap_or(&[]);
            let end = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
            let end = end.ok_or(error("the header has no end_header"))?;
            let line = String::from_utf8_lossy(&rest[..end]);
            start += end + 1;
            if rest[end] == b'\r' && rest.get(end + 1) == Some(&b'\n') {
                start += 1;
            }
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words[..] {
                ["ply"] if number == 1 => {}
                _ if number == 1 => return Err(error("no word `ply`")),
                ["end_header"] => {
                    let encoding = encoding.ok_or(error("the header has no format"))?;
                    return Ok(Self { encoding, elements, textures, data_start: start });
                }
                ["format", name, ..] => encoding = Some(encoding_of(name).ok_or(error("unknown format"))?),
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| error("the count of an element is no whole number"))?;
                    elements.push(PlyElement { name: name.into(), count, properties: Vec::new() });
                }
                ["property", ..] => {
                    let property = property_of(&words).ok_or(error("invalid property"))?;
                    let element = elements.last_mut().ok_or(error("property before any element"))?;
                    element.properties.push(property);
                }
                ["comment", word, _, ..] if word.eq_ignore_ascii_case("texturefile") => {
                    let after = line.to_ascii_lowercase().find("texturefile").map_or(0, |at| at + "texturefile".len());
                    textures.push(line.get(after..).unwrap_or("").trim().to_owned());
                }
                _ => {}
            }
        }
        Err(ModelError::Line { what: "the header has no end_header", line: MAX_LINES, format: "PLY" })
    }
}

impl PlyElement {
    /// Places of properties that are single values; `None` if one is missing.
    pub fn places<const N: usize>(&self, names: [&str; N]) -> Option<[usize; N]> {
        let mut found = [0; N];
        for (place, name) in found.iter_mut().zip(names) {
            *place = self.properties.iter().position(|property| property.name == name && property.length.is_none())?;
        }
        Some(found)
    }
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
