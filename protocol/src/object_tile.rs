//! Tiles of a city's objects: one with the schema of their attributes, and blocks of objects.
//!
//! This module defines their addresses and their container. `insula-objects` defines their content.

use crate::error::{DecodeError, check_limit, invalid_if};
use crate::tile::{TileReader, TileWriter};
use crate::{TileId, TileKind};

/// Objects of a block.
pub const BLOCK_OBJECTS: u32 = 512;
/// The place of the schema in the archive.
pub const SCHEMA_ID: TileId = TileId::ROOT;
/// Maximum size in bytes of a tile's content.
pub const MAX_CONTENT_BYTES: usize = 4 << 20;
/// Maximum size of a tile in bytes.
pub const MAX_BYTES: usize = MAX_CONTENT_BYTES + 1024;

/// Level of the archive at which blocks are stored. It has one place for each block of 2^32 objects.
const BLOCK_LEVEL: u8 = 12;
const TAG_CONTENT: u8 = 1;

/// The block of an object.
pub const fn block_of_object(object: u32) -> u32 {
    object / BLOCK_OBJECTS
}

/// The place of a block in the archive. The bits of its number alternate between x and y, so that neighbours are near each other in the
/// file. `None` for blocks of objects above 2^32.
pub fn block_id(block: u32) -> Option<TileId> {
    let bits = |first: u32| (0..16).fold(0, |sum, k| sum | (block >> (2 * k + first) & 1) << k);
    TileId::new(BLOCK_LEVEL, bits(0), bits(1))
}

/// The inverse of [`block_id`]. `None` for other places.
pub fn block_number(id: TileId) -> Option<u32> {
    let spread = |v: u32| (0..u32::from(BLOCK_LEVEL)).fold(0, |sum, k| sum | (v >> k & 1) << (2 * k));
    (id.level() == BLOCK_LEVEL).then(|| spread(id.x()) | spread(id.y()) << 1)
}

/// The tile of a schema or block. Fails if the content is empty or too long.
pub fn encode(id: TileId, content: &[u8]) -> Result<Vec<u8>, DecodeError> {
    check_limit("the size of an object tile's content", content.len(), MAX_CONTENT_BYTES)?;
    invalid_if(content.is_empty(), "an object tile without content")?;
    let mut writer = TileWriter::new(TileKind::Objects, Some(id));
    writer.add_section(TAG_CONTENT, content)?;
    writer.finish()
}

/// The content of the tile at `id`. Fails on any bytes that are not that tile.
pub fn decode(id: TileId, bytes: &[u8]) -> Result<Vec<u8>, DecodeError> {
    let tile = TileReader::new(bytes, TileKind::Objects)?;
    invalid_if(tile.id != Some(id), "the object tile is of another block")?;
    let content = tile.section(TAG_CONTENT, MAX_CONTENT_BYTES)?;
    if content.is_empty() { Err(DecodeError::Invalid("an object tile without content")) } else { Ok(content) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_block_has_its_place() {
        for block in (0..70_000).chain([(1 << 23) - 1, (1 << 24) - 1]) {
            assert_eq!(block_number(block_id(block).unwrap()), Some(block));
        }
        assert_eq!(block_id(1 << 24), None);
        assert_eq!(block_number(SCHEMA_ID), None);
    }

    #[test]
    fn tiles_round_trip_and_name_their_place() {
        let (first, second) = (block_id(1).unwrap(), block_id(2).unwrap());
        let bytes = encode(first, b"content").unwrap();
        assert_eq!(decode(first, &bytes).unwrap(), b"content");
        assert!(decode(second, &bytes).is_err());
        assert!(encode(first, b"").is_err());
        assert!((0..bytes.len()).all(|end| decode(first, &bytes[..end]).is_err()));
    }
}
