//! Files that are written under a temporary name and renamed, so that they exist completely or not at all.

use crate::error::BakeError;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

const HASH_BYTES: usize = blake3::OUT_LEN;

/// Writes a file and synchronises it, so that it survives a power failure. Fails if that is not possible.
pub(crate) fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), BakeError> {
    write_renamed(path, |file| {
        file.write_all(bytes)?;
        file.sync_all()
    })
}

/// Writes `bytes` and their BLAKE3 hash, without synchronising: [`read_hashed`] detects a file that a power failure cut
/// short. Fails if the file cannot be written.
pub(super) fn write_hashed(path: &Path, mut bytes: Vec<u8>) -> Result<(), BakeError> {
    bytes.extend_from_slice(blake3::hash(&bytes).as_bytes());
    write_renamed(path, |file| file.write_all(&bytes))
}

/// The bytes given to [`write_hashed`]; `None` if there is no such file, its hash is wrong, or it does not begin with
/// `magic`.
pub(super) fn read_hashed(path: &Path, magic: [u8; 4]) -> Option<Vec<u8>> {
    let mut bytes = fs::read(path).ok()?;
    let body = bytes.len().checked_sub(HASH_BYTES)?;
    let is_intact = blake3::hash(&bytes[..body]).as_bytes()[..] == bytes[body..] && bytes.starts_with(&magic);
    bytes.truncate(body);
    is_intact.then_some(bytes)
}

fn write_renamed(path: &Path, write: impl FnOnce(&mut fs::File) -> io::Result<()>) -> Result<(), BakeError> {
    let temporary = path.with_extension("tmp");
    remove_file(&temporary)?;
    let written = fs::File::create_new(&temporary).and_then(|mut file| write(&mut file));
    written.map_err(|cause| BakeError::io(&temporary, "written", cause))?;
    fs::rename(&temporary, path).map_err(|cause| BakeError::io(path, "written", cause))
}

/// Synchronises a folder's entries, on systems that can. Fails if the system reports an error.
pub(crate) fn sync_folder(path: &Path) -> Result<(), BakeError> {
    if cfg!(unix) {
        let synced = fs::File::open(path).and_then(|folder| folder.sync_all());
        synced.map_err(|cause| BakeError::io(path, "written", cause))?;
    }
    Ok(())
}

/// Removes a folder with its content, if it exists. Only for folders whose content was checked ([`super::ownership`]).
/// Links in it are removed, not followed. Fails if it exists and cannot be removed.
pub(super) fn remove_folder(path: &Path) -> Result<(), BakeError> {
    ignore_missing(path, fs::remove_dir_all(path))
}

/// Removes a file, if it exists. Fails if it exists and cannot be removed.
pub(super) fn remove_file(path: &Path) -> Result<(), BakeError> {
    ignore_missing(path, fs::remove_file(path))
}

fn ignore_missing(path: &Path, removed: io::Result<()>) -> Result<(), BakeError> {
    match removed {
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(BakeError::io(path, "removed", cause)),
        _ => Ok(()),
    }
}
