//! Addresses of tiles as the server parses them: a path that parses is the only path of its tile.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::{route, TileKind};
use insula_server::http::TileAddress;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|path: &str| {
    if let Some(Ok(TileAddress { city, version, layer, id, lod })) = TileAddress::parse(path) {
        let again = match layer {
            TileKind::Mesh => route::mesh(city, version, id, lod),
            TileKind::Subtree | TileKind::BlockMap => route::tile(city, version, layer, id),
        };
        assert_eq!(again, path);
    }
});
