//! GeoTIFF: any file gives terrain, a picture or an error.
#![no_main]

use insula_bake::read::{ReadOptions, read_embedded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let options = ReadOptions { max_source_bytes: 64 << 20, ..ReadOptions::default() };
    let place: &[u8] = b"1\n0\n0\n-1\n500000\n5400000\n";
    let _ = read_embedded(&[("a.tif", bytes), ("a.prj", b"EPSG:25832"), ("a.tfw", place)], &options, &|_| {});
});
