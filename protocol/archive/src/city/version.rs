//! The version of a city, recomputed from its files.

use super::{MANIFEST_FILE, MAX_MANIFEST_BYTES, SEARCH_FILE};
use crate::file::open_regular;
use insula_protocol::TileKind;
use std::{
    io::{self, Read},
    path::Path,
};

/// The files in the order in which the version covers them, and whether each city has one.
fn hashed_files() -> impl Iterator<Item = (&'static str, bool)> {
    let kinds = [TileKind::BlockMap, TileKind::Subtree, TileKind::Mesh, TileKind::Objects];
    let visibility = (TileKind::Visibility.file_name(), false);
    kinds.into_iter().map(|kind| (kind.file_name(), kind.is_required())).chain([(SEARCH_FILE, false), visibility])
}

/// The version that the files in a city's folder should have: the first 16 hexadecimal digits of the BLAKE3 hash of the
/// archives, the search index, and of the manifest's text with an empty version. `stated` is the version that the manifest has.
///
/// It differs from `stated` if a file is of another bake or was changed. Fails if a file cannot be read.
pub fn content_version(folder: &Path, stated: &str) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    for (name, is_required) in hashed_files() {
        match open_regular(&folder.join(name)) {
            Ok(mut file) => drop(io::copy(&mut file, &mut hasher)?),
            Err(error) if !is_required && error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
    }
    let mut text = String::new();
    open_regular(&folder.join(MANIFEST_FILE))?.take(MAX_MANIFEST_BYTES as u64).read_to_string(&mut text)?;
    // The text itself rather than the parsed manifest: numbers need not survive being parsed and written.
    let unversioned = text.replacen(&format!("\"version\": \"{stated}\""), "\"version\": \"\"", 1);
    hasher.update(unversioned.as_bytes());
    Ok(hasher.finalize().to_hex()[..16].to_owned())
}
