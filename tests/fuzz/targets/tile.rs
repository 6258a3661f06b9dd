//! The tile container. The input is used as a tile, and as sections of a tile with valid checksums.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::{BlockMap, Subtree, TileId, TileKind, tile::{TileReader, TileWriter}};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    for kind in [TileKind::BlockMap, TileKind::Subtree] {
        if let Ok(reader) = TileReader::new(bytes, kind) {
            (0..16).for_each(|tag| drop(reader.section(tag, 1 << 16)));
        }
    }
    // The input lists sections: tag, length, bytes.
    let [kind, has_id, sections @ ..] = bytes else { return };
    let mut rest = sections;
    let kind = if kind & 1 == 0 { TileKind::BlockMap } else { TileKind::Subtree };
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
    let _ = BlockMap::decode(TileId::ROOT, &tile);
    let _ = Subtree::decode(&tile);
});
