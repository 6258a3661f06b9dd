//! CityJSON: any file gives a scene or an error.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_bake::read::{ReadOptions, read_embedded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let options = ReadOptions { max_texture_pixels: 1 << 16, ..ReadOptions::default() };
    let _ = read_embedded(&[("a.city.json", bytes)], &options, &|_| {});
});
