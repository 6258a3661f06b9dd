//! The container of all tiles: magic, version, kind, a section table, and sections with checksums.
//!
//! `blockmap`, `subtree`, `mesh_tile`, `object_tile` and `visibility_tile` define the contents of the sections.

use crate::codec::byte_reader::ByteReader;
use crate::codec::checksum;
use crate::error::{DecodeError, check_limit, invalid_if};
use crate::{TileId, codec};
use serde::{Deserialize, Serialize};

/// The first four bytes of every tile.
pub const MAGIC: [u8; 4] = *b"INSU";
/// Version of the container and of all tile kinds. Any change of bytes raises it.
pub const VERSION: u16 = 4;
/// Maximum size of a section in bytes, packed or raw.
pub const MAX_SECTION_BYTES: u32 = 16 << 20;
/// Maximum number of sections in one tile.
pub const MAX_SECTIONS: usize = 16;

/// What a tile holds. A city has one archive per kind; the discriminant is the kind's byte in a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum TileKind {
    /// The columns of one node.
    BlockMap = 1,
    /// The nodes that exist below one node.
    Subtree = 2,
    /// A leaf's triangles at one level of detail.
    Mesh = 3,
    /// The schema of the objects' attributes, or a block of objects.
    Objects = 4,
    /// What can be seen from the streets of a part of the city.
    Visibility = 5,
}

impl TileKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Subtree, Self::BlockMap, Self::Mesh, Self::Objects, Self::Visibility];

    /// Whether every city has an archive of this kind. Meshes, objects and visibility are optional.
    pub const fn is_required(self) -> bool {
        !matches!(self, Self::Mesh | Self::Objects | Self::Visibility)
    }

    /// The kind's segment in URLs.
    pub const fn path_segment(self) -> &'static str {
        match self {
            Self::Subtree => "subtrees",
            Self::BlockMap => "blockmaps",
            Self::Mesh => "meshes",
            Self::Objects => "objects",
            Self::Visibility => "visibility",
        }
    }

    /// The inverse of [`TileKind::path_segment`].
    pub fn from_path_segment(segment: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.path_segment() == segment)
    }

    /// The archive's file name in a city's folder.
    pub const fn file_name(self) -> &'static str {
        match self {
            Self::Subtree => "subtrees.pmtiles",
            Self::BlockMap => "blockmaps.pmtiles",
            Self::Mesh => "meshes.pmtiles",
            Self::Objects => "objects.pmtiles",
            Self::Visibility => "visibility.pmtiles",
        }
    }
}

/// How a section's bytes are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum SectionPacking {
    Raw,
    /// One zstd frame.
    Zstd,
}

#[derive(Debug, Serialize, Deserialize)]
struct SectionEntry {
    tag: u8,
    packing: SectionPacking,
    packed_bytes: u32,
    raw_bytes: u32,
    crc32: u32,
}

#[derive(Debug, Serialize, Deserialize)]
struct TileHeader {
    id: Option<TileId>,
    sections: Vec<SectionEntry>,
}

/// Builds a tile section by section.
#[derive(Debug)]
pub struct TileWriter {
    kind: TileKind,
    header: TileHeader,
    body: Vec<u8>,
}

impl TileWriter {
    /// An empty tile. V-BlockMaps have no `id`, so that equal ones have equal bytes.
    pub fn new(kind: TileKind, id: Option<TileId>) -> Self {
        Self { kind, header: TileHeader { id, sections: Vec::new() }, body: Vec::new() }
    }

    /// Adds a section, compressed with zstd if that makes it smaller. An empty section is omitted. Fails beyond
    /// [`MAX_SECTION_BYTES`].
    pub(crate) fn add_section(&mut self, tag: u8, raw: &[u8]) -> Result<(), DecodeError> {
        if raw.is_empty() {
            return Ok(());
        }
        let packed = codec::zstd::compress(raw)?;
        if packed.len() < raw.len() {
            self.push(tag, SectionPacking::Zstd, &packed, raw.len())
        } else {
            self.push(tag, SectionPacking::Raw, raw, raw.len())
        }
    }

    /// Adds a section that is not compressed. An empty section is omitted. Fails beyond [`MAX_SECTION_BYTES`].
    pub fn add_raw_section(&mut self, tag: u8, bytes: &[u8]) -> Result<(), DecodeError> {
        if bytes.is_empty() { Ok(()) } else { self.push(tag, SectionPacking::Raw, bytes, bytes.len()) }
    }

    fn push(&mut self, tag: u8, packing: SectionPacking, bytes: &[u8], raw_bytes: usize) -> Result<(), DecodeError> {
        self.header.sections.push(SectionEntry {
            tag,
            packing,
            packed_bytes: length(bytes.len())?,
            raw_bytes: length(raw_bytes)?,
            crc32: checksum(bytes),
        });
        self.body.extend_from_slice(bytes);
        Ok(())
    }

    /// The tile's bytes. Fails if the header cannot be serialised.
    pub fn finish(self) -> Result<Vec<u8>, DecodeError> {
        let header = codec::bincode::to_bytes(&self.header)?;
        let mut out = Vec::with_capacity(16 + header.len() + self.body.len());
        out.extend_from_slice(&MAGIC);
        out.extend_from_slice(&VERSION.to_le_bytes());
        out.push(self.kind as u8);
        out.push(0);
        out.extend_from_slice(&length(header.len())?.to_le_bytes());
        out.extend_from_slice(&checksum(&header).to_le_bytes());
        out.extend_from_slice(&header);
        out.extend_from_slice(&self.body);
        Ok(out)
    }
}

/// A length as stored. Fails beyond [`MAX_SECTION_BYTES`].
fn length(bytes: usize) -> Result<u32, DecodeError> {
    check_limit("the size of a section", bytes, MAX_SECTION_BYTES as usize)?;
    Ok(bytes as u32)
}

/// A tile with valid header and checksums. The contents of its sections are not checked yet.
#[derive(Debug)]
pub struct TileReader<'a> {
    /// The node's id; `None` in V-BlockMaps.
    pub id: Option<TileId>,
    sections: Vec<(SectionEntry, &'a [u8])>,
}

impl<'a> TileReader<'a> {
    /// Checks magic, version, kind, lengths and all checksums. Fails on the first violation, and on trailing bytes.
    pub fn new(bytes: &'a [u8], kind: TileKind) -> Result<Self, DecodeError> {
        let mut reader = ByteReader::new(bytes);
        if reader.array()? != MAGIC {
            return Err(DecodeError::Magic);
        }
        let found = reader.u16()?;
        if found != VERSION {
            return Err(DecodeError::Version { found, known: VERSION });
        }
        let found = reader.u8()?;
        if found != kind as u8 {
            return Err(DecodeError::TileKind { found, wanted: kind as u8 });
        }
        invalid_if(reader.u8()? != 0, "a tile's reserved byte is not zero")?;
        let (header_bytes, crc32) = (reader.u32()? as usize, reader.u32()?);
        let header = reader.take(header_bytes)?;
        if checksum(header) != crc32 {
            return Err(DecodeError::Checksum("the tile header"));
        }
        let header: TileHeader = codec::bincode::from_bytes(header)?;
        let sections = Self::read_sections(header.sections, &mut reader)?;
        reader.finish()?;
        Ok(Self { id: header.id, sections })
    }

    fn read_sections(
        entries: Vec<SectionEntry>,
        reader: &mut ByteReader<'a>,
    ) -> Result<Vec<(SectionEntry, &'a [u8])>, DecodeError> {
        check_limit("the number of a tile's sections", entries.len(), MAX_SECTIONS)?;
        let mut sections: Vec<(SectionEntry, &[u8])> = Vec::with_capacity(entries.len());
        for entry in entries {
            check_limit("the size of a section", entry.raw_bytes as usize, MAX_SECTION_BYTES as usize)?;
            if sections.iter().any(|(other, _)| other.tag == entry.tag) {
                return Err(DecodeError::Invalid("two sections of a tile have the same tag"));
            }
            let packed = reader.take(entry.packed_bytes as usize)?;
            if checksum(packed) != entry.crc32 {
                return Err(DecodeError::Checksum("a section"));
            }
            sections.push((entry, packed));
        }
        Ok(sections)
    }

    /// The uncompressed bytes of a section; empty if the tile has no such section. Fails before allocating if they
    /// exceed `limit_bytes`, and if they do not decompress to the announced size.
    pub fn section(&self, tag: u8, limit_bytes: usize) -> Result<Vec<u8>, DecodeError> {
        let Some((entry, packed)) = self.sections.iter().find(|(entry, _)| entry.tag == tag) else {
            return Ok(Vec::new());
        };
        let raw_bytes = entry.raw_bytes as usize;
        check_limit("the size of a section", raw_bytes, limit_bytes)?;
        match entry.packing {
            SectionPacking::Raw if packed.len() == raw_bytes => Ok(packed.to_vec()),
            SectionPacking::Raw => Err(DecodeError::Truncated { wanted: raw_bytes, found: packed.len() }),
            SectionPacking::Zstd => codec::zstd::decompress(packed, raw_bytes),
        }
    }
}
