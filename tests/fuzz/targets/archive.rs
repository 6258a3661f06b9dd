//! PMTiles directories: every listed tile lies inside the file.
#![no_main]

mod open_archive;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| open_archive::check(bytes));
