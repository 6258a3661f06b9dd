//! PMTiles directories: every listed tile lies inside the file.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_archive::{Archive, limits::MAX_OPENING_TIME};
use libfuzzer_sys::fuzz_target;
use std::{fs, path::PathBuf, time::Instant};

fuzz_target!(|bytes: &[u8]| {
    let folder = ["/dev/shm", "/tmp"].map(PathBuf::from).into_iter().find(|path| path.is_dir()).unwrap();
    let path = folder.join(format!("insula-fuzz-{}.pmtiles", std::process::id()));
    fs::write(&path, bytes).unwrap();
    if let Ok(archive) = Archive::open(&path, Instant::now() + MAX_OPENING_TIME) {
        // A run lists many tiles in a few bytes, so only some are checked.
        for (id, length) in archive.lengths().take(1000) {
            assert_eq!(archive.tile(id).unwrap().expect("the tile is listed").len(), length as usize);
        }
    }
    let _ = fs::remove_file(&path);
});
