//! Groups of tiles: the tiles of a decoded group lie one after the other to its end, and encode to the same group.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::tile_group::{self, GroupMember, decode, encode};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    for doublings in 1..=tile_group::MAX_DOUBLINGS {
        let Ok(members) = decode(bytes, 1 << doublings) else { continue };
        let ranges =
            members.iter().filter_map(|member| if let GroupMember::Tile(range) = member { Some(range) } else { None });
        let mut end = None;
        for range in ranges {
            assert!(end.is_none_or(|end| end == range.start));
            end = Some(range.end);
        }
        assert!(end.is_none_or(|end| end == bytes.len()));
        let tiles: Vec<GroupMember<&[u8]>> = members
            .iter()
            .map(|member| match member {
                GroupMember::Tile(range) => GroupMember::Tile(&bytes[range.clone()]),
                GroupMember::Absent => GroupMember::Absent,
                GroupMember::LeftOut => GroupMember::LeftOut,
            })
            .collect();
        // A group with a short head may have more bytes of tiles than `encode` accepts.
        let Ok(again) = encode(&tiles) else { continue };
        let decoded = decode(&again, tiles.len()).unwrap();
        assert!(decoded.len() == tiles.len() && again.len() <= bytes.len());
    }
});
