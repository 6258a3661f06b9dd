//! Frozen bytes of a visibility tile: every later program must decode them, and this encoder must still write them. They never
//! change. A new version of the content gets a new file, which `write_vector` (ignored) makes.

use insula_protocol::TileId;
use insula_protocol::visibility_tile::{VisibilityTile, VisibleCell};

const VISIBILITY: &[u8] = include_bytes!("../vectors/v4_visibility.bin");

fn node_id() -> TileId {
    TileId::new(3, 5, 2).unwrap()
}

/// Cells on a slope, some of which do not exist.
fn visibility() -> VisibilityTile {
    let cell = |i: usize| VisibleCell {
        ground: -7 + (i / 4) as i16,
        seen: (0..75).map(|k| if k == 12 { 0 } else { ((k * 7 + i) % 5).min(3) as u8 }).collect(),
    };
    let cells = (0..100).map(|i| (i % 9 != 5).then(|| cell(i))).collect();
    VisibilityTile { id: node_id(), depth: 6, reach: 2, layers_dm: [30, 80, 200], cells }
}

#[test]
fn visibility_tiles_are_frozen() {
    assert!(VisibilityTile::decode(node_id(), VISIBILITY).unwrap() == visibility());
    assert!(visibility().encode().unwrap() == VISIBILITY);
}

#[test]
#[ignore = "writes the frozen file: only for a new version of the content"]
fn write_vector() {
    let path = format!("{}/tests/vectors/v4_visibility.bin", env!("CARGO_MANIFEST_DIR"));
    std::fs::write(path, visibility().encode().unwrap()).unwrap();
}
