//! Files that are written under a temporary name and renamed, so that they exist completely or not at all.

use crate::error::BakeError;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

/// Writes a file and synchronises it, so that it survives a power failure. Fails if that is not possible.
pub(crate) fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), BakeError> {
    write_renamed(path, |file| {
        file.write_all(bytes)?;
        file.sync_all()
    })
}

/// Writes a file under a temporary name, and renames it. Fails if that is not possible.
pub(super) fn write_renamed(path: &Path, write: impl FnOnce(&mut fs::File) -> io::Result<()>) -> Result<(), BakeError> {
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
