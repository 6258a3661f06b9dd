//! The tile container. The input is used as a tile, and as sections of a tile with valid checksums.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::{
    BlockMap, MeshTile, Subtree, TileId, TileKind, VisibilityTile, object_tile,
    tile::{TileReader, TileWriter},
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    for kind in TileKind::ALL {
        if let Ok(reader) = TileReader::new(bytes, kind) {
            (0..16).for_each(|tag| drop(reader.section(tag, 1 << 16)));
        }
    }
    // The input lists sections: tag, length, bytes.
    let [kind, has_id, sections @ ..] = bytes else { return };
    let mut rest = sections;
    let kind = TileKind::ALL[usize::from(*kind) % TileKind::ALL.len()];
    let mut writer = TileWriter::new(kind, (has_id & 1 == 1).then_some(TileId::ROOT));
    while let [tag, low, high, tail @ ..] = rest {
        let length = usize::from(u16::from_le_bytes([*low, *high])).min(tail.len());
        let (section, after) = tail.split_at(length);
        if writer.add_raw_section(*tag, section).is_err() {
            return;
        }
        rest = after;
    }
    let Ok(tile) = writer.finish() else { return };
    match kind {
        TileKind::BlockMap => drop(BlockMap::decode(TileId::ROOT, &tile)),
        TileKind::Subtree => drop(Subtree::decode(&tile)),
        TileKind::Mesh => drop(MeshTile::decode(TileId::ROOT, 0, &tile)),
        TileKind::Objects => drop(object_tile::decode(object_tile::SCHEMA_ID, &tile)),
        TileKind::Visibility => drop(VisibilityTile::decode(TileId::ROOT, &tile)),
    }
});
