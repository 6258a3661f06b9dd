//! The containers of tiles of version 1.0: b3dm, i3dm, cmpt and pnts.

use crate::bytes::{part, u32_at};
use insula_source::text::json_in_utf8;
use serde_json::{Map, Value};

/// A length of tables that is in truth the start of JSON or of a GLB: the file has an older header without that length.
const FIRST_BYTES_OF_TEXT: u32 = 0x2200_0000;

/// A tile by its first bytes.
#[derive(Debug)]
pub(super) enum Container<'a> {
    /// Buildings with a batch table; the rest is a glTF.
    Batched { tables: Tables<'a>, gltf: &'a [u8] },
    /// One glTF at many places.
    Instanced { tables: Tables<'a>, gltf: InstancedGltf<'a> },
    /// Tiles in one file.
    Composite(Vec<&'a [u8]>),
    /// glTF, binary or JSON.
    Gltf(&'a [u8]),
    /// A format that has no surfaces or was never standard, by its name.
    NotRead(&'static str),
}

/// The glTF of an i3dm.
#[derive(Debug)]
pub(super) enum InstancedGltf<'a> {
    Embedded(&'a [u8]),
    Uri(String),
}

#[derive(Debug, Default)]
pub(super) struct Tables<'a> {
    pub(super) feature_json: Map<String, Value>,
    pub(super) feature_binary: &'a [u8],
    pub(super) batch_json: Map<String, Value>,
    pub(super) batch_binary: &'a [u8],
    /// What to report of a batch table that is not in UTF-8.
    pub(super) guessed: Option<String>,
    /// Number of features, in the headers of files older than version 1.0.
    old_batch_length: Option<u32>,
}

impl Tables<'_> {
    /// Number of features.
    pub(super) fn batch_length(&self) -> u32 {
        let length = self.feature_json.get("BATCH_LENGTH").and_then(Value::as_u64).and_then(|n| u32::try_from(n).ok());
        length.or(self.old_batch_length).unwrap_or(0)
    }

    /// A vector of the feature table that is the same for all features.
    pub(super) fn global_vector(&self, name: &str) -> Option<[f64; 3]> {
        let value = self.feature_json.get(name)?;
        if let Some(numbers) = value.as_array() {
            let numbers: Vec<f64> = numbers.iter().filter_map(Value::as_f64).collect();
            return numbers.try_into().ok();
        }
        let offset = value.get("byteOffset")?.as_u64()?;
        let bytes = part(self.feature_binary, offset, 12)?;
        Some([0, 4, 8].map(|at| f64::from(crate::bytes::f32_at(bytes, at).unwrap_or_default())))
    }
}

/// Tells what a tile is and finds its parts. Fails with what is wrong.
pub(super) fn open(bytes: &[u8]) -> Result<Container<'_>, String> {
    match bytes.get(..4) {
        Some(b"b3dm") => batched(bytes),
        Some(b"i3dm") => instanced(bytes),
        Some(b"cmpt") => composite(bytes),
        Some(b"glTF") => Ok(Container::Gltf(bytes)),
        Some(b"pnts") => Ok(Container::NotRead("point cloud")),
        Some(b"vctr" | b"geom" | b"subt") => Ok(Container::NotRead("tile of a format that is not read")),
        _ if bytes.is_empty() => Err("the tile is empty".to_owned()),
        _ if first_character(bytes) == Some(b'{') => Ok(Container::Gltf(bytes)),
        _ => Err("the tile has an unknown format".to_owned()),
    }
}

/// The first byte that is no space.
pub(super) fn first_character(bytes: &[u8]) -> Option<u8> {
    let text = insula_source::json::without_bom(bytes);
    text.iter().copied().find(|byte| !byte.is_ascii_whitespace())
}

fn cut() -> String {
    "the tile is cut short".to_owned()
}

/// The bytes of the tile, without what follows it. Wrong total lengths are frequent, so only the parts are checked.
fn own_bytes(bytes: &[u8]) -> &[u8] {
    let length = u32_at(bytes, 8).map_or(0, |length| length as usize);
    if length < 12 { bytes } else { bytes.get(..length).unwrap_or(bytes) }
}

fn check_version(bytes: &[u8]) -> Result<(), String> {
    match u32_at(bytes, 4).ok_or_else(cut)? {
        1 => Ok(()),
        version => Err(format!("version {version} of the tile's format is not read")),
    }
}

fn batched(bytes: &[u8]) -> Result<Container<'_>, String> {
    check_version(bytes)?;
    let bytes = own_bytes(bytes);
    let number = |at: usize| u32_at(bytes, at).ok_or_else(cut);
    // Headers of 20 and 24 bytes came before the one of 28.
    let (start, lengths, old_batch_length) = if number(20)? >= FIRST_BYTES_OF_TEXT {
        (20, [0, 0, number(16)?, 0], Some(number(12)?))
    } else if number(24)? >= FIRST_BYTES_OF_TEXT {
        (24, [0, 0, number(12)?, number(16)?], Some(number(20)?))
    } else {
        (28, [number(12)?, number(16)?, number(20)?, number(24)?], None)
    };
    let (mut tables, rest) = tables(bytes, start, lengths)?;
    tables.old_batch_length = old_batch_length;
    Ok(Container::Batched { tables, gltf: rest })
}

fn instanced(bytes: &[u8]) -> Result<Container<'_>, String> {
    check_version(bytes)?;
    let bytes = own_bytes(bytes);
    let number = |at: usize| u32_at(bytes, at).ok_or_else(cut);
    let (tables, rest) = tables(bytes, 32, [number(12)?, number(16)?, number(20)?, number(24)?])?;
    let gltf = match number(28)? {
        0 => InstancedGltf::Uri(String::from_utf8_lossy(rest).trim_matches(['\0', ' ', '\n', '\r']).to_owned()),
        1 => InstancedGltf::Embedded(rest),
        format => return Err(format!("glTF format {format} of an i3dm does not exist")),
    };
    Ok(Container::Instanced { tables, gltf })
}

/// The tables after a header, and what follows them. Lengths: of the feature table's JSON and binary, and of the batch table's.
fn tables(bytes: &[u8], start: usize, lengths: [u32; 4]) -> Result<(Tables<'_>, &[u8]), String> {
    let mut at = start as u64;
    let mut parts = [&bytes[..0]; 4];
    for (found, length) in parts.iter_mut().zip(lengths) {
        *found = part(bytes, at, u64::from(length)).ok_or_else(cut)?;
        at += u64::from(length);
    }
    let rest = usize::try_from(at).ok().and_then(|at| bytes.get(at..)).ok_or_else(cut)?;
    let [feature_json, feature_binary, batch_json, batch_binary] = parts;
    let feature_json = object(feature_json).map_err(|error| format!("the feature table is no JSON: {error}"))?;
    let (batch_json, guessed) = json_in_utf8(batch_json);
    let batch_json = object(&batch_json).map_err(|error| format!("the batch table is no JSON: {error}"))?;
    Ok((Tables { feature_json, feature_binary, batch_json, batch_binary, guessed, old_batch_length: None }, rest))
}

/// Parses the JSON of a table, which may be empty and is padded.
fn object(text: &[u8]) -> Result<Map<String, Value>, serde_json::Error> {
    let padding = text.iter().rev().take_while(|byte| matches!(byte, 0 | b' ' | b'\n')).count();
    match &text[..text.len() - padding] {
        [] => Ok(Map::new()),
        text => serde_json::from_slice(text),
    }
}

fn composite(bytes: &[u8]) -> Result<Container<'_>, String> {
    check_version(bytes)?;
    let count = u32_at(bytes, 12).ok_or_else(cut)?;
    let mut inner = Vec::new();
    let mut rest = bytes.get(16..).ok_or_else(cut)?;
    for _ in 0..count {
        // Every tile has at least 12 bytes, so an absurd count ends here.
        let length = u32_at(rest, 8).filter(|length| *length >= 12).ok_or_else(cut)?;
        let (tile, after) = rest.split_at_checked(length as usize).ok_or_else(cut)?;
        inner.push(tile);
        rest = after;
    }
    Ok(Container::Composite(inner))
}
