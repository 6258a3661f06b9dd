//! Opens bytes as an archive and reads its tiles.

use insula_archive::{Archive, limits::MAX_OPENING_TIME};
use std::{fs, path::PathBuf, time::Instant};

/// Tiles of an archive that are read: a run lists many in a few bytes.
const MAX_TILES: usize = 1000;

/// Panics if a listed tile cannot be read, or has another length than its entry says.
#[allow(clippy::unwrap_used, reason = "a finding is a panic")]
pub fn check(bytes: &[u8]) {
    let folder = ["/dev/shm", "/tmp"].map(PathBuf::from).into_iter().find(|path| path.is_dir()).unwrap();
    let path = folder.join(format!("insula-fuzz-{}.pmtiles", std::process::id()));
    fs::write(&path, bytes).unwrap();
    if let Ok(archive) = Archive::open(&path, Instant::now() + MAX_OPENING_TIME) {
        for (id, length) in archive.lengths().take(MAX_TILES) {
            assert_eq!(archive.tile(id).unwrap().expect("the tile is listed").len(), length.unwrap() as usize);
        }
    }
    let _ = fs::remove_file(&path);
}
