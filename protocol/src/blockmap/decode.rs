//! A V-BlockMap from bytes that anyone may have made.

use super::{
    BlockMap, Z_SHIFT_MAX,
    appearance::Loss,
    encode::{COLOUR_STEP_MAX, tag},
};
use crate::{
    TileId, TileKind,
    codec::{byte_reader::ByteReader, range::RangeDecoder},
    error::DecodeError,
    texel::AO_MAX,
    tile::{MAX_SECTION_BYTES, TileReader},
};

impl BlockMap {
    /// Reads the tile of node `id`. The bytes do not say whose they are: equal squares of a city are one tile. Allocates at most what [`COLUMNS`](super::COLUMNS) and
    /// [`MAX_TEXELS`](super::MAX_TEXELS) allow.
    pub fn decode(id: TileId, bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, TileKind::BlockMap)?;
        if tile.id.is_some() {
            return Err(DecodeError::Invalid("a V-BlockMap with a name"));
        }
        let (mut map, loss) = read_meta(id, &tile)?;
        let columns = tile.section(tag::COLUMNS, MAX_SECTION_BYTES as usize)?;
        let mut coder = RangeDecoder::new(&columns);
        map.walk(&mut coder, loss)?;
        if coder.unread_bytes() > 0 {
            return Err(DecodeError::TrailingBytes(coder.unread_bytes()));
        }
        map.check()?;
        Ok(map)
    }
}

fn read_meta(id: TileId, tile: &TileReader<'_>) -> Result<(BlockMap, Loss), DecodeError> {
    let meta = tile.section(tag::META, 12)?;
    let mut reader = ByteReader::new(&meta);
    let (cell_m, z_base_cells, z_shift) = (reader.f32()?, reader.u32()? as i32, reader.u8()?);
    let loss = Loss { colour: reader.u16()?, ao: reader.u8()? };
    reader.finish()?;
    if cell_m <= 0.0 || z_shift > Z_SHIFT_MAX {
        return Err(DecodeError::Invalid("cell size or height step out of range"));
    }
    if !(Loss::NONE.colour..=COLOUR_STEP_MAX).contains(&loss.colour) || !(Loss::NONE.ao..=AO_MAX).contains(&loss.ao) {
        return Err(DecodeError::Invalid("step of colours or occlusion out of range"));
    }
    Ok((BlockMap::empty(id, cell_m, z_base_cells, z_shift), loss))
}
