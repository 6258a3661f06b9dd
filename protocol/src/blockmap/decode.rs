//! A V-BlockMap from bytes that anyone may have made.

use super::{
    BlockMap, COLUMNS, MAX_TEXELS, Z_SHIFT_MAX,
    encode::{COLOUR_STEP_MAX, tag},
    flag, geometry,
    looks::{self, Loss},
    strip_rows, walls,
};
use crate::{
    codec::{range::Decoder, varint::Reader},
    error::DecodeError,
    texel::AO_MAX,
    tile::{Kind, MAX_SECTION_BYTES, TileReader},
};

impl BlockMap {
    /// Reads a tile. Allocates at most what [`COLUMNS`] and [`MAX_TEXELS`] allow. The same functions that wrote the columns
    /// read them.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, Kind::BlockMap)?;
        let (mut map, loss) = read_meta(&tile)?;
        let columns = tile.section(tag::COLUMNS, MAX_SECTION_BYTES as usize)?;
        let mut coder = Decoder::new(&columns);
        geometry::columns(&mut coder, &mut map);
        walls::exposed(&mut coder, &mut map);
        check_strips(&map)?;
        let steps = walls::facades(&map);
        walls::walls(&mut coder, &mut map, &steps);
        looks::looks(&mut coder, &mut map, &steps, loss);
        if coder.left() > 0 {
            return Err(DecodeError::TrailingBytes(coder.left()));
        }
        map.check()?;
        Ok(map)
    }
}

fn read_meta(tile: &TileReader<'_>) -> Result<(BlockMap, Loss), DecodeError> {
    let meta = tile.section(tag::META, 12)?;
    let mut reader = Reader::new(&meta);
    let (cell_m, z_base_cells, z_shift) = (reader.f32()?, reader.u32()? as i32, reader.u8()?);
    let loss = Loss { colour: reader.u16()?, ao: reader.u8()? };
    reader.finish()?;
    if cell_m <= 0.0 || z_shift > Z_SHIFT_MAX {
        return Err(DecodeError::Invalid("cell size or height step out of range"));
    }
    if !(Loss::NONE.colour..=COLOUR_STEP_MAX).contains(&loss.colour) || !(Loss::NONE.ao..=AO_MAX).contains(&loss.ao) {
        return Err(DecodeError::Invalid("step of colours or occlusion out of range"));
    }
    Ok((BlockMap::empty(tile.id, cell_m, z_base_cells, z_shift), loss))
}

/// Heights and the number of strip texels; checked before any is allocated.
fn check_strips(map: &BlockMap) -> Result<(), DecodeError> {
    let mut sum = 0;
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
        if map.z_min[i] >= map.z_max[i] || map.z_max[i] > super::Z_CODE_MAX {
            return Err(DecodeError::Invalid("a column's heights are turned around or out of range"));
        }
        if map.flags[i] & flag::EXPOSED != 0 {
            sum += usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1);
        }
    }
    if sum > MAX_TEXELS {
        let (found, limit) = (sum as u64, MAX_TEXELS as u64);
        return Err(DecodeError::Limit { what: "the number of strip texels", found, limit });
    }
    Ok(())
}
