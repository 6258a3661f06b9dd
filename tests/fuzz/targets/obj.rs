//! OBJ with MTL, separated by a line `mtl`: any files give a scene or an error.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_bake::read::{ReadOptions, read_embedded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let options = ReadOptions { max_texture_pixels: 1 << 16, ..ReadOptions::default() };
    let cut = bytes.windows(5).position(|line| line == b"\nmtl\n");
    let (obj, mtl) = cut.map_or((bytes, &b""[..]), |at| (&bytes[..at], &bytes[at + 5..]));
    let _ = read_embedded(&[("a.obj", obj), ("a.mtl", mtl)], &options, &|_| {});
});
