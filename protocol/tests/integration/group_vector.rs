//! Frozen bytes of a group of tiles: every later program must decode them, and this encoder must still write them. They never change.
//! A new version of the format gets a new file, which `write_vector` (ignored) makes.

use insula_protocol::tile_group::{GroupMember, decode, encode};

const GROUP: &[u8] = include_bytes!("../vectors/v4_group.group");

/// Tiles of 0 to 400 bytes, places without one, and one that did not fit.
fn members() -> Vec<GroupMember<Vec<u8>>> {
    let tile = |i: usize| (0..i * i * 2).map(|k| ((k * 31 + i) % 251) as u8).collect();
    let member = |i: usize| match i {
        3 | 7 => GroupMember::Absent,
        12 => GroupMember::LeftOut,
        _ => GroupMember::Tile(tile(i)),
    };
    (0..16).map(member).collect()
}

#[test]
fn groups_are_frozen() {
    let found = decode(GROUP, 16).unwrap().into_iter().map(|member| match member {
        GroupMember::Tile(range) => GroupMember::Tile(GROUP[range].to_vec()),
        GroupMember::Absent => GroupMember::Absent,
        GroupMember::LeftOut => GroupMember::LeftOut,
    });
    assert!(found.collect::<Vec<_>>() == members());
    assert!(encode(&members()).unwrap() == GROUP);
}

#[test]
#[ignore = "writes the frozen file: only for a new version of the format"]
fn write_vector() {
    let path = format!("{}/tests/vectors/v4_group.group", env!("CARGO_MANIFEST_DIR"));
    std::fs::write(path, encode(&members()).unwrap()).unwrap();
}
