//! Visibility tiles. The input is used as a tile, and as the sections of one with valid checksums: whatever decodes round trips.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::{TileId, TileKind, VisibilityTile, tile::TileWriter};
use libfuzzer_sys::fuzz_target;

fn check(id: TileId, bytes: &[u8]) {
    let Ok(tile) = VisibilityTile::decode(id, bytes) else { return };
    let again = tile.encode().expect("a decoded tile can be encoded");
    assert_eq!(VisibilityTile::decode(id, &again).expect("an encoded tile can be decoded"), tile);
    for node in [TileId::ROOT, id] {
        let corner = (id.x() << (tile.depth - id.level()), id.y() << (tile.depth - id.level()));
        let _ = tile.set_at(corner.0, corner.1, 0.0).map(|set| set.may_see(node));
    }
}

fuzz_target!(|bytes: &[u8]| {
    check(TileId::ROOT, bytes);
    let [depth, x, y, meta_and_sets @ ..] = bytes else { return };
    let Some((meta, sets)) = meta_and_sets.split_at_checked(9) else { return };
    let level = depth % 18;
    let Some(id) = TileId::new(level, u32::from(*x) % (1 << level), u32::from(*y) % (1 << level)) else { return };
    let mut writer = TileWriter::new(TileKind::Visibility, Some(id));
    writer.add_raw_section(1, meta).unwrap();
    if writer.add_raw_section(2, sets).is_ok() {
        check(id, &writer.finish().unwrap());
    }
});
