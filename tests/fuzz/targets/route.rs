//! Addresses: a path that parses is the only path of its route.
#![no_main]

use insula_protocol::route::{Route, RouteTemplate};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|path: &str| {
    let template = RouteTemplate::of_path(path);
    if let Ok(route) = Route::parse(path) {
        assert_eq!(route.path(), path);
        assert_eq!(route.template(), template);
    }
});
