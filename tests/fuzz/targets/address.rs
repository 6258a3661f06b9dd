//! Addresses of tiles: what is one, is the only one of its tile.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::route;
use insula_server::http::TileAddress;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|path: &str| {
    if let Some(Ok(address)) = TileAddress::parse(path)
        && let Some(layer) = address.layer
    {
        assert_eq!(route::tile(address.city, address.version, layer, address.id), path);
    }
});
