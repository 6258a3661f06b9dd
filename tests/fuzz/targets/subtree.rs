//! Subtree tiles: whatever decodes round trips.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::Subtree;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(subtree) = Subtree::decode(bytes) else { return };
    let Ok(again) = subtree.encode() else { return };
    assert_eq!(Subtree::decode(&again).expect("an encoded subtree can be decoded").nodes, subtree.nodes);
});
