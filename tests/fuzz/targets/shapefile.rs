//! A Shapefile and its table, separated by a line `dbf`: any files give a scene or an error.
#![no_main]

use insula_bake::read::{ReadOptions, read_embedded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let options = ReadOptions { max_texture_pixels: 1 << 16, max_source_bytes: 64 << 20, ..ReadOptions::default() };
    let cut = bytes.windows(5).position(|line| line == b"\ndbf\n");
    let (shp, dbf) = cut.map_or((bytes, &b""[..]), |at| (&bytes[..at], &bytes[at + 5..]));
    let _ = read_embedded(&[("a.shp", shp), ("a.dbf", dbf)], &options, &|_| {});
});
