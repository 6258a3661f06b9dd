//! V-BlockMap tiles: whatever decodes round trips.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::{BlockMap, TileId};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(map) = BlockMap::decode(TileId::ROOT, bytes) else { return };
    let _ = map.clone().stand_on_ground();
    let again = map.encode().expect("a decoded map can be encoded");
    let same = BlockMap::decode(TileId::ROOT, &again).expect("an encoded map can be decoded");
    assert_eq!(map, same);
});
