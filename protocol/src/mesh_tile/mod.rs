//! A leaf's triangles at one level of detail, with the picture that they wear.
//!
//! In: a [`MeshTile`], or a tile of kind `Mesh`. Out: its bytes, and back. Next: `insula-bake` writes them, `insula-client`
//! draws them.
//!
//! Positions are metres from the leaf's south-west corner at the city's height zero ([`crate::Manifest::node_corner`]).
//! Triangles carry no normals: theirs are their own.

mod sample;

pub use sample::cuboid;

use crate::{
    TileId, TileKind,
    codec::byte_reader::ByteReader,
    error::DecodeError,
    mesh::{Attribute, AttributeKind, Mesh},
    tile::{TileReader, TileWriter},
};

/// Most levels of detail of a leaf; 0 is the finest.
pub const MAX_LODS: u8 = 4;
/// Most triangles of a tile, those of dummy vertices among them.
pub const MAX_TRIANGLES: usize = 1 << 18;
/// Most bytes of a tile's coded mesh, and of its picture.
pub const MAX_PART_BYTES: usize = 4 << 20;
/// Most pixels along a picture's side.
pub const MAX_TEXTURE_SIDE_PX: u16 = 4096;
/// Most pixels of a picture.
pub const MAX_TEXTURE_PX: u32 = 1 << 22;
/// Most bytes of a whole tile.
pub const MAX_BYTES: usize = 2 * MAX_PART_BYTES + 1024;

const TAG_META: u8 = 1;
const TAG_MESH: u8 = 2;
const TAG_TEXTURE: u8 = 3;

/// Triangles of one leaf at one level of detail.
///
/// They carry one attribute: texture coordinates if there is a texture, else colours of three components of 8 bits, sRGB.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshTile {
    /// At least one triangle.
    pub mesh: Mesh,
    /// What texture coordinates point into.
    pub texture: Option<TileTexture>,
}

/// A picture, still packed: it is for the reader to unpack, once it has checked that it is of this size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TileTexture {
    /// Width and height, 1 to [`MAX_TEXTURE_SIDE_PX`].
    pub size_px: [u16; 2],
    /// A WebP file of one chunk, `VP8 ` or `VP8L`; sRGB.
    pub bytes: Vec<u8>,
}

/// Where level of detail `lod` of a leaf lies in the archive: `lod` levels below it, at its south-west corner. `None` if it
/// cannot be: a city with meshes is at most [`crate::tile_id::MAX_LEVEL`] + 1 - [`MAX_LODS`] levels deep.
pub fn archive_id(leaf: TileId, lod: u8) -> Option<TileId> {
    if lod >= MAX_LODS {
        return None;
    }
    TileId::new(leaf.level() + lod, leaf.x() << lod, leaf.y() << lod)
}

/// Undoes [`archive_id`] in a city whose leaves are at level `depth`.
pub fn from_archive_id(id: TileId, depth: u8) -> Option<(TileId, u8)> {
    let lod = id.level().checked_sub(depth)?;
    let leaf = id.ancestor(depth)?;
    (archive_id(leaf, lod) == Some(id)).then_some((leaf, lod))
}

impl MeshTile {
    /// The bytes of level of detail `lod` of leaf `id`.
    ///
    /// # Errors
    /// What is over the format's limits or not as [`MeshTile`] says.
    pub fn encode(&self, id: TileId, lod: u8) -> Result<Vec<u8>, DecodeError> {
        self.check()?;
        archive_id(id, lod).ok_or(DecodeError::Invalid("a mesh tile of a leaf or a level of detail that cannot be"))?;
        let mesh = self.mesh.encode()?.bytes;
        limit("a mesh tile's bytes", mesh.len(), MAX_PART_BYTES)?;
        // At most three dummies a triangle: only where they could be too many are they counted.
        if 4 * self.mesh.triangles.len() > MAX_TRIANGLES {
            Mesh::decode_within(&mesh, MAX_TRIANGLES)?;
        }
        let mut meta = vec![lod];
        let mut writer = TileWriter::new(TileKind::Mesh, Some(id));
        if let Some(texture) = &self.texture {
            texture.size_px.iter().for_each(|side| meta.extend(side.to_le_bytes()));
        }
        writer.coded_section(TAG_META, &meta)?;
        writer.coded_section(TAG_MESH, &mesh)?;
        if let Some(texture) = &self.texture {
            writer.coded_section(TAG_TEXTURE, &texture.bytes)?;
        }
        writer.finish()
    }

    /// Reads the tile of level of detail `lod` of leaf `id`; the picture is not looked into.
    ///
    /// # Errors
    /// Anything that is no such tile.
    pub fn decode(id: TileId, lod: u8, bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, TileKind::Mesh)?;
        let meta = tile.section(TAG_META, 5)?;
        let mut reader = ByteReader::new(&meta);
        if tile.id != Some(id) || reader.u8()? != lod {
            return Err(DecodeError::Invalid("the mesh of another leaf or level of detail"));
        }
        let bytes = tile.section(TAG_TEXTURE, MAX_PART_BYTES)?;
        let texture =
            if bytes.is_empty() { None } else { Some(TileTexture { size_px: [reader.u16()?, reader.u16()?], bytes }) };
        reader.finish()?;
        let mesh = Mesh::decode_within(&tile.section(TAG_MESH, MAX_PART_BYTES)?, MAX_TRIANGLES)?;
        let tile = Self { mesh, texture };
        tile.check()?;
        Ok(tile)
    }

    fn check(&self) -> Result<(), DecodeError> {
        limit("a mesh tile's triangles", self.mesh.triangles.len(), MAX_TRIANGLES)?;
        if self.mesh.triangles.is_empty() {
            return Err(DecodeError::Invalid("a mesh tile without triangles"));
        }
        let [attribute] = &self.mesh.attributes[..] else {
            return Err(DecodeError::Invalid("a mesh tile's corners carry one thing"));
        };
        match &self.texture {
            Some(texture) => {
                texture.check()?;
                let most = attribute.range[0] + attribute.range[1] * ((1u32 << attribute.bits) - 1) as f32;
                let inside = [attribute.range[0], most].iter().all(|v| (-0.001..=1.001).contains(v));
                if attribute.kind != AttributeKind::TexCoord || attribute.components != 2 || !inside {
                    return Err(DecodeError::Invalid("a textured mesh's corners carry places in its picture"));
                }
            }
            None => {
                let is_rgb = (attribute.components, attribute.bits) == (3, 8);
                if attribute.kind != AttributeKind::Colour || !is_rgb {
                    return Err(DecodeError::Invalid("a plain mesh's corners carry colours of three bytes"));
                }
            }
        }
        Ok(())
    }

    /// Where corner `3 t + k` lies in the texture, 0 to 1: from its left to its right, from its top to its bottom.
    pub fn uv(&self, corner: usize) -> [f32; 2] {
        let (attribute, value) = self.value(corner);
        [0, 1].map(|k| (attribute.range[0] + attribute.range[1] * value[k] as f32).clamp(0.0, 1.0))
    }

    /// The colour of corner `3 t + k` of a mesh without texture, sRGB.
    pub fn rgb(&self, corner: usize) -> [u8; 3] {
        let (_, value) = self.value(corner);
        [0, 1, 2].map(|k| value[k].min(255) as u8)
    }

    fn value(&self, corner: usize) -> (&Attribute, [u32; 4]) {
        // Both are there: `check` has seen to the attribute, the codec to a value for each corner.
        let attribute = &self.mesh.attributes[0];
        (attribute, attribute.values[attribute.corners[corner] as usize])
    }
}

impl TileTexture {
    /// Pixels.
    pub fn pixels(&self) -> u32 {
        u32::from(self.size_px[0]) * u32::from(self.size_px[1])
    }

    fn check(&self) -> Result<(), DecodeError> {
        limit("a texture's bytes", self.bytes.len(), MAX_PART_BYTES)?;
        limit("a texture's pixels", self.pixels() as usize, MAX_TEXTURE_PX as usize)?;
        if self.size_px.iter().any(|side| !(1..=MAX_TEXTURE_SIDE_PX).contains(side)) {
            return Err(DecodeError::Invalid("a texture's sides are 1 to 4096 pixels"));
        }
        // Nothing else has its size at its beginning alone.
        let is_plain = matches!(self.bytes.get(8..16), Some(b"WEBPVP8 " | b"WEBPVP8L"));
        if is_plain && self.bytes.starts_with(b"RIFF") {
            Ok(())
        } else {
            Err(DecodeError::Invalid("a texture is no WebP file of one chunk"))
        }
    }
}

fn limit(what: &'static str, found: usize, limit: usize) -> Result<(), DecodeError> {
    if found > limit { Err(DecodeError::Limit { what, found: found as u64, limit: limit as u64 }) } else { Ok(()) }
}
