//! A tileset: any file gives a scene or an error.
#![no_main]

use insula_bake::read::{ReadOptions, read_embedded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let options = ReadOptions { max_texture_pixels: 1 << 16, max_source_bytes: 64 << 20, ..ReadOptions::default() };
    let _ = read_embedded(&[("tileset.json", bytes)], &options, &|_| {});
});
