//! Decoding of V-BlockMaps from untrusted bytes.

use super::encode::{MAX_COLOUR_STEP, TAG_COLUMNS, TAG_GROUND, TAG_META, TAG_OBJECTS, TAG_REFLECTIVE, TAG_THIN};
use super::ground::{self, NodeGround};
use super::objects::{self, ColumnObjects};
use super::texel_coder::QuantisationSteps;
use super::{BlockMap, Z_SHIFT_MAX, reflective, thin};
use crate::codec::byte_reader::ByteReader;
use crate::codec::range::RangeDecoder;
use crate::error::{DecodeError, invalid_if};
use crate::texel::AO_MAX;
use crate::tile::{MAX_SECTION_BYTES, TileReader};
use crate::{TileId, TileKind};

impl BlockMap {
    /// Decodes the tile of node `id`. The bytes do not contain the id, because equal nodes of a city share one tile.
    /// Fails on any bytes that are not such a tile. Allocates at most what [`COLUMNS`](super::COLUMNS) and
    /// [`MAX_TEXELS`](super::MAX_TEXELS) allow.
    pub fn decode(id: TileId, bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, TileKind::BlockMap)?;
        invalid_if(tile.id.is_some(), "a V-BlockMap tile has an id")?;
        let (mut map, steps) = read_meta(id, &tile)?;
        let columns = tile.section(TAG_COLUMNS, MAX_SECTION_BYTES as usize)?;
        let mut coder = RangeDecoder::new(&columns);
        map.walk(&mut coder, steps)?;
        check_end(&coder)?;
        map.ground = read_ground(&tile)?;
        read_reflective(&tile, &mut map)?;
        read_thin(&tile, &mut map)?;
        map.objects = read_objects(&tile, &map)?;
        map.check()?;
        Ok(map)
    }
}

fn read_objects(tile: &TileReader<'_>, map: &BlockMap) -> Result<Option<Box<ColumnObjects>>, DecodeError> {
    let section = tile.section(TAG_OBJECTS, MAX_SECTION_BYTES as usize)?;
    if section.is_empty() {
        return Ok(None);
    }
    let mut coder = RangeDecoder::new(&section);
    let objects = objects::code(&mut coder, map, &ColumnObjects::default())?;
    check_end(&coder)?;
    invalid_if(objects.is_empty(), "a section of objects that no column shows")?;
    Ok(Some(Box::new(objects)))
}

fn read_ground(tile: &TileReader<'_>) -> Result<Option<Box<NodeGround>>, DecodeError> {
    let section = tile.section(TAG_GROUND, MAX_SECTION_BYTES as usize)?;
    if section.is_empty() {
        return Ok(None);
    }
    let mut ground = Box::<NodeGround>::default();
    let mut coder = RangeDecoder::new(&section);
    ground::code(&mut coder, &mut ground)?;
    invalid_if(ground.squares == 0, "a ground without squares")?;
    check_end(&coder)?;
    Ok(Some(ground))
}

/// Sets the flags of reflective columns.
fn read_reflective(tile: &TileReader<'_>, map: &mut BlockMap) -> Result<(), DecodeError> {
    let section = tile.section(TAG_REFLECTIVE, MAX_SECTION_BYTES as usize)?;
    if section.is_empty() {
        return Ok(());
    }
    let mut coder = RangeDecoder::new(&section);
    reflective::code(&mut coder, map)?;
    check_end(&coder)
}

fn read_thin(tile: &TileReader<'_>, map: &mut BlockMap) -> Result<(), DecodeError> {
    let section = tile.section(TAG_THIN, MAX_SECTION_BYTES as usize)?;
    if section.is_empty() {
        return Ok(());
    }
    let mut coder = RangeDecoder::new(&section);
    thin::code(&mut coder, map)?;
    check_end(&coder)
}

/// Fails on bytes after the last value of a section.
fn check_end(coder: &RangeDecoder<'_>) -> Result<(), DecodeError> {
    match coder.unread_bytes() {
        0 => Ok(()),
        unread => Err(DecodeError::TrailingBytes(unread)),
    }
}

fn read_meta(id: TileId, tile: &TileReader<'_>) -> Result<(BlockMap, QuantisationSteps), DecodeError> {
    let meta = tile.section(TAG_META, 12)?;
    let mut reader = ByteReader::new(&meta);
    let (cell_m, z_base_cells, z_shift) = (reader.f32()?, reader.u32()? as i32, reader.u8()?);
    let steps = QuantisationSteps { colour: reader.u16()?, ao: reader.u8()? };
    reader.finish()?;
    invalid_if(cell_m <= 0.0 || z_shift > Z_SHIFT_MAX, "a V-BlockMap's cell size or height step is out of range")?;
    let least = QuantisationSteps::LOSSLESS;
    if !(least.colour..=MAX_COLOUR_STEP).contains(&steps.colour) || !(least.ao..=AO_MAX).contains(&steps.ao) {
        return Err(DecodeError::Invalid("a V-BlockMap's step of colours or occlusion is out of range"));
    }
    Ok((BlockMap::empty(id, cell_m, z_base_cells, z_shift), steps))
}
