//! Mesh tiles: a leaf's triangles at one level of detail, with their texture.
//!
//! Positions are metres from the leaf's south-west corner at the city's height zero ([`crate::Manifest::node_corner`]).
//! There are no normals: triangles are flat.

mod cuboid;

use crate::codec::byte_reader::ByteReader;
pub use crate::codec::object_names::NO_OBJECT;
use crate::codec::object_names::{Naming, code_list};
use crate::codec::range::{BitCoder, RangeDecoder, RangeEncoder};
use crate::error::{DecodeError, check_limit, invalid_if};
use crate::manifest::MAX_STONES;
use crate::mesh::{Attribute, AttributeKind, EncodedMesh, Mesh};
use crate::tile::{TileReader, TileWriter};
use crate::{TileId, TileKind};
pub use cuboid::cuboid;
use image::{ImageFormat, ImageReader, Limits};
use std::io::Cursor;

/// Maximum number of levels of detail of a leaf; 0 is the finest.
pub const MAX_LODS: u8 = 6;
/// Maximum number of triangles of a tile, including those of dummy vertices.
pub const MAX_TRIANGLES: usize = 1 << 20;
/// Maximum size in bytes of a tile's coded mesh, and of its texture.
pub const MAX_PART_BYTES: usize = 4 << 20;
/// Maximum number of pixels along a texture's side.
pub const MAX_TEXTURE_SIDE_PX: u16 = 4096;
/// Maximum number of pixels of a texture.
pub const MAX_TEXTURE_PX: u32 = 1 << 22;
/// Maximum size of a tile in bytes.
pub const MAX_BYTES: usize = 2 * MAX_PART_BYTES + 1024;

const TAG_META: u8 = 1;
const TAG_MESH: u8 = 2;
const TAG_TEXTURE: u8 = 3;
const TAG_OBJECTS: u8 = 4;
const TAG_LANDMARKS: u8 = 5;

/// Bits of a vertex's ambient occlusion.
pub const OCCLUSION_BITS: u8 = 5;

/// Triangles of one leaf at one level of detail.
///
/// The mesh's first attribute has texture coordinates if there is a texture, else colours of three 8-bit sRGB components. A mesh
/// with landmarks may have a second one: each vertex's visible share of the sky, [`OCCLUSION_BITS`] wide.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshTile {
    /// At least one triangle.
    pub mesh: Mesh,
    pub texture: Option<TileTexture>,
    /// Object of each triangle, [`NO_OBJECT`] for those of none; empty if no triangle has one.
    pub objects: Vec<u32>,
    /// Those of the objects that are landmarks, ascending.
    pub landmarks: Vec<LandmarkObject>,
}

fn read_objects(tile: &TileReader<'_>, mesh: &Mesh) -> Result<Vec<u32>, DecodeError> {
    let section = tile.section(TAG_OBJECTS, MAX_PART_BYTES)?;
    if section.is_empty() {
        return Ok(Vec::new());
    }
    let mut coder = RangeDecoder::new(&section);
    let objects = code_objects(&mut coder, &mesh.triangles, mesh.positions.len(), &[])?;
    invalid_if(objects.iter().all(|object| *object == NO_OBJECT), "a section of objects that no triangle shows")?;
    match coder.unread_bytes() {
        0 => Ok(objects),
        unread => Err(DecodeError::TrailingBytes(unread)),
    }
}

/// A compressed image; [`TileTexture::decode`] decompresses it within its stated size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TileTexture {
    /// Width and height, 1 to [`MAX_TEXTURE_SIDE_PX`].
    pub size_px: [u16; 2],
    /// A WebP file of one chunk, `VP8 ` or `VP8L`, in sRGB.
    pub bytes: Vec<u8>,
}

/// The id under which a leaf's level of detail is stored in the archive: `lod` levels below the leaf, at its south-west
/// corner. `None` if `lod` or the resulting level is too large.
pub fn archive_id(leaf: TileId, lod: u8) -> Option<TileId> {
    if lod >= MAX_LODS {
        return None;
    }
    TileId::new(leaf.level() + lod, leaf.x() << lod, leaf.y() << lod)
}

/// The inverse of [`archive_id`] in a city whose leaves are at level `depth`: the leaf and its level of detail.
pub fn from_archive_id(id: TileId, depth: u8) -> Option<(TileId, u8)> {
    let lod = id.level().checked_sub(depth)?;
    let leaf = id.ancestor(depth)?;
    (archive_id(leaf, lod) == Some(id)).then_some((leaf, lod))
}

impl MeshTile {
    /// Encodes level of detail `lod` of leaf `id`. Fails if the tile exceeds the format's limits or breaks the rules of
    /// [`MeshTile`].
    pub fn encode(&self, id: TileId, lod: u8) -> Result<Vec<u8>, DecodeError> {
        self.check()?;
        archive_id(id, lod).ok_or(DecodeError::Invalid("a mesh tile's leaf or level of detail is too deep"))?;
        let EncodedMesh { bytes: mesh, corners, .. } = self.mesh.encode()?;
        check_limit("the size of a mesh tile's mesh", mesh.len(), MAX_PART_BYTES)?;
        // There are at most three dummy triangles per triangle, so only large meshes need a count.
        if 4 * self.mesh.triangles.len() > MAX_TRIANGLES {
            Mesh::decode_within(&mesh, MAX_TRIANGLES)?;
        }
        let mut meta = vec![lod];
        let mut writer = TileWriter::new(TileKind::Mesh, Some(id));
        if let Some(texture) = &self.texture {
            texture.size_px.iter().for_each(|side| meta.extend(side.to_le_bytes()));
        }
        writer.add_raw_section(TAG_META, &meta)?;
        writer.add_raw_section(TAG_MESH, &mesh)?;
        if let Some(texture) = &self.texture {
            writer.add_raw_section(TAG_TEXTURE, &texture.bytes)?;
        }
        if self.objects.iter().any(|object| *object != NO_OBJECT) {
            writer.add_raw_section(TAG_OBJECTS, &self.code_objects(&mesh, &corners)?)?;
        }
        if !self.landmarks.is_empty() {
            writer.add_raw_section(TAG_LANDMARKS, &encode_landmarks(&self.landmarks, &self.objects)?)?;
        }
        writer.finish()
    }

    /// The section of objects, in the order of the triangles of the coded `mesh`, whose corners come from `corners` of this one.
    fn code_objects(&self, mesh: &[u8], corners: &[u32]) -> Result<Vec<u8>, DecodeError> {
        let coded = Mesh::decode_within(mesh, MAX_TRIANGLES)?;
        let objects: Vec<u32> = corners.iter().step_by(3).map(|corner| self.objects[*corner as usize / 3]).collect();
        let mut coder = RangeEncoder::default();
        code_objects(&mut coder, &coded.triangles, coded.positions.len(), &objects)?;
        Ok(coder.finish())
    }

    /// Decodes level of detail `lod` of leaf `id`. The texture is not decompressed. Fails on any bytes that are not
    /// that tile.
    pub fn decode(id: TileId, lod: u8, bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, TileKind::Mesh)?;
        let meta = tile.section(TAG_META, 5)?;
        let mut reader = ByteReader::new(&meta);
        invalid_if(tile.id != Some(id) || reader.u8()? != lod, "the mesh tile is of another leaf or level of detail")?;
        let bytes = tile.section(TAG_TEXTURE, MAX_PART_BYTES)?;
        let texture =
            if bytes.is_empty() { None } else { Some(TileTexture { size_px: [reader.u16()?, reader.u16()?], bytes }) };
        reader.finish()?;
        let mesh = Mesh::decode_within(&tile.section(TAG_MESH, MAX_PART_BYTES)?, MAX_TRIANGLES)?;
        let objects = read_objects(&tile, &mesh)?;
        let section = tile.section(TAG_LANDMARKS, MAX_LANDMARKS_BYTES)?;
        let landmarks = decode_landmarks(&section, &objects)?;
        let tile = Self { mesh, texture, objects, landmarks };
        tile.check()?;
        Ok(tile)
    }

    fn check(&self) -> Result<(), DecodeError> {
        check_limit("the number of a mesh tile's triangles", self.mesh.triangles.len(), MAX_TRIANGLES)?;
        invalid_if(self.mesh.triangles.is_empty(), "a mesh tile has no triangles")?;
        if !self.objects.is_empty() && self.objects.len() != self.mesh.triangles.len() {
            return Err(DecodeError::Invalid("a mesh tile has objects of other than its triangles"));
        }
        let (attribute, occlusion) = match &self.mesh.attributes[..] {
            [attribute] => (attribute, None),
            [attribute, occlusion] => (attribute, Some(occlusion)),
            _ => return Err(DecodeError::Invalid("a mesh tile must have one or two attributes")),
        };
        let is_share = |a: &Attribute| (a.kind, a.components, a.bits) == (AttributeKind::Other, 1, OCCLUSION_BITS);
        invalid_if(!occlusion.is_none_or(is_share), "a mesh tile's second attribute must be occlusion")?;
        check_landmarks(&self.landmarks, &self.objects)?;
        if let Some(texture) = &self.texture {
            texture.check()?;
            let max = attribute.range[0] + attribute.range[1] * ((1u32 << attribute.bits) - 1) as f32;
            let is_inside = [attribute.range[0], max].iter().all(|v| (-0.001..=1.001).contains(v));
            if attribute.kind != AttributeKind::TexCoord || attribute.components != 2 || !is_inside {
                return Err(DecodeError::Invalid("a textured mesh needs texture coordinates from 0 to 1"));
            }
        } else {
            let is_rgb = (attribute.components, attribute.bits) == (3, 8);
            if attribute.kind != AttributeKind::Colour || !is_rgb {
                return Err(DecodeError::Invalid("a mesh without texture needs colours of three 8-bit components"));
            }
        }
        Ok(())
    }

    /// The texture coordinates of corner `3 t + k`, 0 to 1 from left to right and from top to bottom.
    pub fn uv(&self, corner: usize) -> [f32; 2] {
        let (attribute, value) = self.value(corner);
        [0, 1].map(|k| (attribute.range[0] + attribute.range[1] * value[k] as f32).clamp(0.0, 1.0))
    }

    /// The sRGB colour of corner `3 t + k` of a mesh without texture.
    pub fn rgb(&self, corner: usize) -> [u8; 3] {
        let (_, value) = self.value(corner);
        [0, 1, 2].map(|k| value[k].min(255) as u8)
    }

    /// Visible share of the sky at corner `3 t + k`, 0 to 1; `None` if the tile does not have it.
    pub fn occlusion(&self, corner: usize) -> Option<f32> {
        let attribute = self.mesh.attributes.get(1)?;
        let value = attribute.values[attribute.corners[corner] as usize][0];
        Some(value as f32 / ((1u32 << OCCLUSION_BITS) - 1) as f32)
    }

    fn value(&self, corner: usize) -> (&Attribute, [u32; 4]) {
        // `check` ensures an attribute, and the codec ensures a value for each corner.
        let attribute = &self.mesh.attributes[0];
        (attribute, attribute.values[attribute.corners[corner] as usize])
    }
}

impl TileTexture {
    /// Number of pixels.
    pub fn pixels(&self) -> u32 {
        u32::from(self.size_px[0]) * u32::from(self.size_px[1])
    }

    fn check(&self) -> Result<(), DecodeError> {
        check_limit("the size of a texture", self.bytes.len(), MAX_PART_BYTES)?;
        check_limit("the number of a texture's pixels", self.pixels() as usize, MAX_TEXTURE_PX as usize)?;
        if self.size_px.iter().any(|side| !(1..=MAX_TEXTURE_SIDE_PX).contains(side)) {
            return Err(DecodeError::Invalid("a texture's sides must be 1 to 4096 pixels"));
        }
        // Other WebP files can contain a second size.
        let is_simple = matches!(self.bytes.get(8..16), Some(b"WEBPVP8 " | b"WEBPVP8L"));
        invalid_if(!is_simple || !self.bytes.starts_with(b"RIFF"), "a texture is not a WebP file of one chunk")
    }
}

/// Writes or reads the object of each triangle. Fails if no triangle has an object.
fn code_objects<C: BitCoder>(
    coder: &mut C,
    triangles: &[[u32; 3]],
    vertices: usize,
    objects: &[u32],
) -> Result<Vec<u32>, DecodeError> {
    let list = code_list(coder, if C::WRITES { distinct(objects) } else { Vec::new() }, triangles.len())?;
    let mut naming = Naming::new(coder, &list);
    // One more than the last triangle at each vertex.
    let mut last = vec![0usize; vertices];
    let mut out: Vec<u32> = Vec::with_capacity(triangles.len());
    for (t, triangle) in triangles.iter().enumerate() {
        let mut before = triangle.map(|vertex| last[vertex as usize]);
        before.sort_unstable_by(|a, b| b.cmp(a));
        let known = before.iter().filter(|t| **t > 0).count();
        let agree = before[..known].windows(2).all(|pair| out[pair[0] - 1] == out[pair[1] - 1]);
        let context = known + if agree { 4 } else { 0 };
        let candidates: [Option<u32>; 3] = before.map(|t| t.checked_sub(1).map(|t| out[t]));
        let value = objects.get(t).copied().unwrap_or(0);
        out.push(naming.name(0, context, candidates.into_iter().flatten(), value));
        triangle.iter().for_each(|vertex| last[*vertex as usize] = t + 1);
    }
    Ok(out)
}

fn distinct(objects: &[u32]) -> Vec<u32> {
    let mut list: Vec<u32> = objects.iter().copied().filter(|object| *object != NO_OBJECT).collect();
    list.sort_unstable();
    list.dedup();
    list
}

/// Most bytes that decoding may take beyond the texels: per texel, and in all.
const DECODING_BYTES_PER_TEXEL: u64 = 16;
const DECODING_BYTES: u64 = 1 << 20;

impl TileTexture {
    /// Decodes the texture: three bytes per texel in sRGB, row by row from the upper left.
    ///
    /// Fails as [`decode_webp`] does.
    pub fn decode(&self) -> Result<Vec<u8>, DecodeError> {
        decode_webp(&self.bytes, self.size_px.map(u32::from))
    }
}

/// Decodes a WebP file of a stated width and height, which bound the memory that is taken: three bytes per texel in sRGB.
///
/// Fails if the file is damaged, takes more memory than an image of that size needs, or is of another size.
pub fn decode_webp(file: &[u8], size_px: [u32; 2]) -> Result<Vec<u8>, DecodeError> {
    let damaged = |_| DecodeError::Invalid("a mesh's texture is damaged");
    let [width_px, height_px] = size_px;
    let texels = u64::from(width_px) * u64::from(height_px);
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(width_px), Some(height_px));
    limits.max_alloc = Some(texels.saturating_mul(DECODING_BYTES_PER_TEXEL).saturating_add(DECODING_BYTES));
    let mut reader = ImageReader::with_format(Cursor::new(file), ImageFormat::WebP);
    reader.limits(limits);
    let rgb = reader.decode().map_err(damaged)?.into_rgb8();
    invalid_if(rgb.dimensions() != (width_px, height_px), "a mesh's texture is not of its stated size")?;
    Ok(rgb.into_raw())
}

/// Maximum number of landmarks in a tile.
pub const MAX_LANDMARKS: usize = 64;
/// Anchors lie within this many metres of the leaf's corner along each axis.
pub const MAX_ANCHOR_M: f32 = 1e5;
const ENTRY_BYTES: usize = 17;
/// Maximum size of the section in bytes.
const MAX_LANDMARKS_BYTES: usize = MAX_LANDMARKS * ENTRY_BYTES;
/// Stands for a landmark in its own colours.
const NO_STONE: u8 = u8::MAX;

/// An object whose surface is smooth, with ambient occlusion at its vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LandmarkObject {
    pub object: u32,
    /// Index into the manifest's `stones`; `None` if it has its own colours.
    pub stone: Option<u8>,
    /// Origin of the stone's pattern, in the coordinates of the tile's positions. It is the same place in all tiles, so that the
    /// pattern has no seam at the border of a leaf.
    pub anchor_m: [f32; 3],
}

/// The section's bytes. Fails as [`check`].
fn encode_landmarks(landmarks: &[LandmarkObject], objects: &[u32]) -> Result<Vec<u8>, DecodeError> {
    check_landmarks(landmarks, objects)?;
    let mut bytes = Vec::with_capacity(landmarks.len() * ENTRY_BYTES);
    for LandmarkObject { object, stone, anchor_m } in landmarks {
        bytes.extend(object.to_le_bytes());
        bytes.push(stone.unwrap_or(NO_STONE));
        anchor_m.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    Ok(bytes)
}

/// Reads a section. Fails if it is no list of entries, and as [`check`].
fn decode_landmarks(section: &[u8], objects: &[u32]) -> Result<Vec<LandmarkObject>, DecodeError> {
    let mut reader = ByteReader::new(section);
    let count = section.len() / ENTRY_BYTES;
    check_limit("the number of a mesh tile's landmarks", count, MAX_LANDMARKS)?;
    let mut landmarks = Vec::with_capacity(count);
    for _ in 0..count {
        let (object, stone) = (reader.u32()?, Some(reader.u8()?).filter(|stone| *stone != NO_STONE));
        landmarks.push(LandmarkObject { object, stone, anchor_m: [reader.f32()?, reader.f32()?, reader.f32()?] });
    }
    reader.finish()?;
    check_landmarks(&landmarks, objects)?;
    Ok(landmarks)
}

/// Fails if there are too many entries, if they are not ascending by object, if an object has no triangle, or if a number is out of
/// range.
fn check_landmarks(landmarks: &[LandmarkObject], objects: &[u32]) -> Result<(), DecodeError> {
    check_limit("the number of a mesh tile's landmarks", landmarks.len(), MAX_LANDMARKS)?;
    invalid_if(!landmarks.is_sorted_by(|a, b| a.object < b.object), "a mesh tile's landmarks are not in order")?;
    for entry in landmarks {
        // Comparisons with NaN are false.
        let is_near = entry.anchor_m.iter().all(|v| v.abs() <= MAX_ANCHOR_M);
        if !is_near || entry.stone.is_some_and(|stone| usize::from(stone) >= MAX_STONES) {
            return Err(DecodeError::Invalid("a landmark has a number out of range"));
        }
        invalid_if(entry.object == NO_OBJECT || !objects.contains(&entry.object), "a landmark has no triangle")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    #[test]
    fn decodes_a_webp_of_the_stated_size_only() {
        let image = RgbImage::from_fn(70, 30, |x, y| Rgb([x as u8, y as u8, 9]));
        let mut webp = Cursor::new(Vec::new());
        image.write_to(&mut webp, ImageFormat::WebP).unwrap();
        let webp = webp.into_inner();
        let decode = |size_px, bytes: &[u8]| TileTexture { size_px, bytes: bytes.to_vec() }.decode();
        assert_eq!(decode([70, 30], &webp).unwrap(), image.into_raw());
        for (size_px, bytes) in
            [([70, 31], &webp[..]), ([71, 30], &webp), ([35, 15], &webp), ([70, 30], &webp[..60]), ([70, 30], &[])]
        {
            assert!(matches!(decode(size_px, bytes), Err(DecodeError::Invalid(_))), "{size_px:?}");
        }
    }
}
