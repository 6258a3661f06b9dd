//! Files that are written under a temporary name and renamed, so that they exist completely or not at all.

use crate::error::BakeError;
use crate::hash::ShortHash;
use insula_protocol::codec::bincode;
use serde::Serialize;
use serde::de::DeserializeOwned;
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

/// The first bytes of a pack: what it is, and the hash of what its content is made from.
pub(super) fn pack_head(magic: [u8; 4], input: ShortHash) -> Vec<u8> {
    [magic.as_slice(), input.as_slice()].concat()
}

/// Writes a pack without synchronising: [`read_pack`] detects a file that a power failure cut short. `bytes` begin with
/// [`pack_head`], then come what `entries` have the places of, the entries in bincode, their length in 8 bytes, and a BLAKE3
/// hash of everything before. Fails if the file cannot be written.
pub(super) fn write_pack<T: Serialize>(path: &Path, mut bytes: Vec<u8>, entries: &[T]) -> Result<(), BakeError> {
    let list = bincode::to_bytes(&entries).map_err(|_| BakeError::Scratch { path: path.to_owned() })?;
    bytes.extend_from_slice(&list);
    bytes.extend_from_slice(&(list.len() as u64).to_le_bytes());
    bytes.extend_from_slice(blake3::hash(&bytes).as_bytes());
    write_renamed(path, |file| file.write_all(&bytes))
}

/// The entries given to [`write_pack`]; `None` if there is no such file, it does not begin with `head`, or its hash is wrong.
pub(super) fn read_pack<T: DeserializeOwned>(path: &Path, head: &[u8]) -> Option<Vec<T>> {
    let bytes = fs::read(path).ok()?;
    let (body, hash) = bytes.split_last_chunk::<HASH_BYTES>()?;
    if !body.starts_with(head) || blake3::hash(body) != *hash {
        return None;
    }
    let (body, length) = body.split_last_chunk::<8>()?;
    let start = body.len().checked_sub(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    bincode::long_from_bytes(&body[start..]).ok()
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
