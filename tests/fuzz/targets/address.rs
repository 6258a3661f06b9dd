//! Addresses of tiles: what is one, is the only one of its tile.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::{route, route::Layer};
use insula_server::http::TileAddress;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|path: &str| {
    if let Some(Ok(TileAddress { city, version, layer, id, lod })) = TileAddress::parse(path) {
        let again = match layer {
            Layer::Meshes => route::mesh(city, version, id, lod),
            Layer::Subtrees | Layer::BlockMaps => route::tile(city, version, layer, id),
        };
        assert_eq!(again, path);
    }
});
