//! Binary subtrees of implicit tilings: which of their tiles, contents and child subtrees exist.

use super::uri;
use crate::bytes::{part, u32_at, u64_at};
use serde::Deserialize;

const MAGIC: &[u8; 4] = b"subt";
const HEADER_BYTES: usize = 24;
/// Contents of one tile; further ones are left out.
const MAX_CONTENTS: usize = 64;

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct SubtreeJson {
    buffers: Option<Vec<BufferJson>>,
    buffer_views: Option<Vec<ViewJson>>,
    tile_availability: AvailabilityJson,
    content_availability: Option<OneOrMany>,
    child_subtree_availability: AvailabilityJson,
    extensions: Option<SubtreeExtensions>,
}

/// Extensions of version 1.0.
#[derive(Debug, Deserialize)]
struct SubtreeExtensions {
    #[serde(default, rename = "3DTILES_multiple_contents")]
    multiple_contents: Option<OldContents>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct OldContents {
    content_availability: Vec<AvailabilityJson>,
}

/// A list since version 1.1.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum OneOrMany {
    Many(Vec<AvailabilityJson>),
    One(AvailabilityJson),
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferJson {
    uri: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct ViewJson {
    buffer: u32,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct AvailabilityJson {
    constant: Option<u8>,
    #[serde(default, alias = "bufferView")]
    bitstream: Option<u32>,
}

/// One bit for each tile, content or child subtree.
#[derive(Debug, Clone, PartialEq)]
enum Availability {
    All(bool),
    Bits(Vec<u8>),
}

impl Availability {
    fn has(&self, index: u64) -> bool {
        match self {
            Self::All(all) => *all,
            Self::Bits(bits) => {
                let byte = usize::try_from(index / 8).ok().and_then(|byte| bits.get(byte));
                byte.is_some_and(|byte| byte >> (index % 8) & 1 == 1)
            }
        }
    }
}

/// Shape of the subtrees of a tiling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SubtreeShape {
    /// 2 for quadtrees, 3 for octrees.
    pub(super) dimensions: u32,
    pub(super) levels: u32,
}

impl SubtreeShape {
    /// The deepest subtrees whose tiles have a number of 64 bits.
    pub(super) fn new(dimensions: u32, levels: u32) -> Option<Self> {
        (levels > 0 && dimensions * levels <= 60).then_some(Self { dimensions, levels })
    }

    fn tiles_above(self, level: u32) -> u64 {
        ((1 << (self.dimensions * level)) - 1) / ((1 << self.dimensions) - 1)
    }
}

/// What exists of a subtree. Tiles are counted by level and in Morton order.
#[derive(Debug, PartialEq)]
pub(super) struct Subtree {
    shape: SubtreeShape,
    tiles: Availability,
    contents: Vec<Availability>,
    child_subtrees: Availability,
}

impl Subtree {
    /// Parses a subtree file, binary or JSON. `load` reads a buffer by its URI. Fails if something is malformed or missing.
    pub(super) fn parse(
        bytes: &[u8],
        shape: SubtreeShape,
        load: &dyn Fn(&str) -> Result<Vec<u8>, String>,
    ) -> Result<Self, String> {
        let (json, own) = split(bytes)?;
        let json: SubtreeJson = serde_json::from_slice(json).map_err(|error| error.to_string())?;
        let mut buffers = Buffers { json: &json, own, load, loaded: Vec::new() };
        let (tile_bits, child_bits) = (shape.tiles_above(shape.levels), 1 << (shape.dimensions * shape.levels));
        let tiles = buffers.availability(&json.tile_availability, tile_bits)?;
        let child_subtrees = buffers.availability(&json.child_subtree_availability, child_bits)?;
        let old = json.extensions.as_ref().and_then(|extensions| extensions.multiple_contents.as_ref());
        let lists: Vec<&AvailabilityJson> = match (&json.content_availability, old) {
            (Some(OneOrMany::Many(many)), _) => many.iter().collect(),
            (Some(OneOrMany::One(one)), _) => vec![one],
            (None, Some(old)) => old.content_availability.iter().collect(),
            (None, None) => Vec::new(),
        };
        let lists = lists.into_iter().take(MAX_CONTENTS);
        let contents = lists.map(|list| buffers.availability(list, tile_bits)).collect::<Result<_, _>>()?;
        Ok(Self { shape, tiles, contents, child_subtrees })
    }

    /// Whether the tile with number `morton` on a level of the subtree exists.
    pub(super) fn has_tile(&self, level: u32, morton: u64) -> bool {
        self.tiles.has(self.shape.tiles_above(level) + morton)
    }

    /// Whether a tile has content number `index`.
    pub(super) fn has_content(&self, index: usize, level: u32, morton: u64) -> bool {
        self.contents.get(index).is_some_and(|contents| contents.has(self.shape.tiles_above(level) + morton))
    }

    /// Whether there is a subtree below, with number `morton` on the level below the last one.
    pub(super) fn has_child(&self, morton: u64) -> bool {
        self.child_subtrees.has(morton)
    }
}

/// The JSON and the binary part of a file.
fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    if !bytes.starts_with(MAGIC) {
        return Ok((bytes, None));
    }
    let cut = || "the subtree is cut short".to_owned();
    let version = u32_at(bytes, 4).ok_or_else(cut)?;
    if version != 1 {
        return Err(format!("version {version} of subtrees is not read"));
    }
    let (json_bytes, binary_bytes) = (u64_at(bytes, 8).ok_or_else(cut)?, u64_at(bytes, 16).ok_or_else(cut)?);
    let json = part(bytes, HEADER_BYTES as u64, json_bytes).ok_or_else(cut)?;
    let binary = part(bytes, (HEADER_BYTES + json.len()) as u64, binary_bytes).ok_or_else(cut)?;
    let padding = json.iter().rev().take_while(|byte| matches!(byte, 0 | b' ')).count();
    Ok((&json[..json.len() - padding], Some(binary)))
}

struct Buffers<'a> {
    json: &'a SubtreeJson,
    own: Option<&'a [u8]>,
    load: &'a dyn Fn(&str) -> Result<Vec<u8>, String>,
    loaded: Vec<(u32, Vec<u8>)>,
}

impl Buffers<'_> {
    /// Reads an availability of `count` bits.
    fn availability(&mut self, json: &AvailabilityJson, count: u64) -> Result<Availability, String> {
        match (json.bitstream, json.constant) {
            (Some(view), _) => self.bits(view, count).map(Availability::Bits),
            (None, Some(constant)) => Ok(Availability::All(constant == 1)),
            (None, None) => Err("an availability has neither a constant nor a bitstream".to_owned()),
        }
    }

    fn bits(&mut self, view: u32, count: u64) -> Result<Vec<u8>, String> {
        let views = self.json.buffer_views.as_deref().unwrap_or_default();
        let view = views.get(view as usize).ok_or("a buffer view does not exist")?;
        if view.byte_length < count.div_ceil(8) {
            return Err(format!("a bitstream has {} bytes for {count} bits", view.byte_length));
        }
        let (index, offset, length) = (view.buffer, view.byte_offset, count.div_ceil(8));
        let buffers = self.json.buffers.as_deref().unwrap_or_default();
        let buffer = buffers.get(index as usize).ok_or("a buffer does not exist")?;
        let missing = || "a buffer view is outside of its buffer".to_owned();
        let Some(name) = &buffer.uri else {
            return part(self.own.unwrap_or_default(), offset, length).map(<[u8]>::to_vec).ok_or_else(missing);
        };
        if !self.loaded.iter().any(|(known, _)| *known == index) {
            let bytes = match uri::data_of(name) {
                Some(data) => data.map_err(str::to_owned)?,
                None => (self.load)(name)?,
            };
            self.loaded.push((index, bytes));
        }
        let bytes = self.loaded.iter().find(|(known, _)| *known == index).map_or(&[][..], |(_, bytes)| bytes);
        part(bytes, offset, length).map(<[u8]>::to_vec).ok_or_else(missing)
    }
}
