//! The container: a GLB's chunks, or JSON alone.

use super::document::{Document, check_required};
use super::schema::Root;
use super::version1;
use crate::bytes::u32_at;
use insula_source::error::InputError;
use insula_source::text::json_in_utf8;

const GLB_MAGIC: &[u8] = b"glTF";
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;

/// A few bytes of JSON must not become gigabytes: more objects or values are refused.
const MAX_OBJECTS: usize = 1 << 22;
const MAX_VALUES: usize = 1 << 24;

/// Parses a GLB or JSON. Fails if it is damaged, of another version or requires unknown extensions.
pub(super) fn parse<'a>(label: &str, bytes: &'a [u8]) -> Result<Document<'a>, InputError> {
    let (json, binary, version) = if bytes.starts_with(GLB_MAGIC) {
        glb(label, bytes)?
    } else {
        (bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None, 2)
    };
    let (json, guessed) = json_in_utf8(trim_padding(json));
    check_size(label, &json)?;
    Ok(Document { guessed, ..parse_json(label, &json, binary, version)? })
}

fn parse_json<'a>(
    label: &str,
    json: &[u8],
    binary: Option<&'a [u8]>,
    version: u32,
) -> Result<Document<'a>, InputError> {
    if version == 1 {
        return version1::parse(label, json, binary);
    }
    let root: Root = match serde_json::from_slice(json) {
        Ok(root) => root,
        Err(_) if version1::is_version_1(json) => return version1::parse(label, json, binary),
        Err(error) => return Err(InputError::json(label, &error)),
    };
    if root.asset.version.starts_with("1.") || root.asset.version.starts_with("0.") {
        return version1::parse(label, json, binary);
    }
    if !root.asset.version.starts_with("2.") && root.asset.version != "2" {
        let what = format!("glTF version \"{}\" is not supported", root.asset.version);
        return Err(InputError::unsupported(label, what));
    }
    check_required(label, &root)?;
    Ok(Document { root, binary, guessed: None })
}

/// Fails if JSON has too many objects or values.
fn check_size(label: &str, json: &[u8]) -> Result<(), InputError> {
    for (byte, limit, what) in
        [(b'{', MAX_OBJECTS, "its number of JSON objects"), (b',', MAX_VALUES, "its number of JSON values")]
    {
        if json.iter().filter(|own| **own == byte).count() > limit {
            return Err(InputError::TooLarge { path: label.to_owned(), what: what.to_owned(), limit: limit as u64 });
        }
    }
    Ok(())
}

/// Padding of the JSON chunk: blanks, or zeros of careless writers.
fn trim_padding(json: &[u8]) -> &[u8] {
    let end = json.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    &json[..end]
}

/// The JSON, the binary chunk and the version of a GLB.
type GlbParts<'a> = (&'a [u8], Option<&'a [u8]>, u32);

fn glb<'a>(label: &str, bytes: &'a [u8]) -> Result<GlbParts<'a>, InputError> {
    let damaged = |place: usize, what: &str| InputError::damaged(label, format!("byte {place}"), what);
    let word = |at: usize| u32_at(bytes, at).ok_or_else(|| damaged(at, "the GLB header is incomplete"));
    let version = word(4)?;
    // Some writers do not count their padding: the length in the header may exceed the file's.
    let bytes = &bytes[..bytes.len().min((word(8)? as usize).max(12))];
    if version == 1 {
        let (length, format) = (word(12)? as usize, word(16)?);
        if format != 0 {
            return Err(damaged(16, "the content of the GLB is not JSON"));
        }
        let rest = bytes.get(20..).ok_or_else(|| damaged(20, "the GLB has no content"))?;
        let (json, binary) = rest.split_at_checked(length).ok_or_else(|| damaged(12, "the GLB's JSON is cut short"))?;
        return Ok((json, Some(binary), 1));
    }
    if version != 2 {
        return Err(InputError::unsupported(label, format!("GLB version {version} is not supported")));
    }
    let mut at = 12;
    let (mut json, mut binary) = (None, None);
    while let (Some(length), Some(kind)) = (u32_at(bytes, at), u32_at(bytes, at + 4)) {
        let start = at + 8;
        let chunk = bytes.get(start..).and_then(|rest| rest.get(..length as usize));
        match kind {
            JSON_CHUNK if json.is_none() => {
                json = Some(chunk.ok_or_else(|| damaged(at, "the GLB's JSON is cut short"))?);
            }
            BINARY_CHUNK if binary.is_none() => {
                binary = Some(chunk.ok_or_else(|| damaged(at, "the GLB's binary chunk is cut short"))?);
            }
            _ => {}
        }
        let Some(next) = start.checked_add(length as usize) else { break };
        at = next;
    }
    Ok((json.ok_or_else(|| damaged(12, "the GLB has no JSON chunk"))?, binary, 2))
}
