//! From finished tiles to a city on disk, whole or not at all.
//!
//! In: encoded tiles, block by block. Out: a city folder with `city.json`, `blockmaps.pmtiles`, `subtrees.pmtiles`,
//! `meshes.pmtiles` (if it has meshes) and `fingerprints.bin`.
//! Next: the server, or `insula-client` by byte range.
//!
//! Until the last rename all lies in `CITY.partial`: `scratch` keeps finished tiles in `pack`s and `mesh_pack`s there, so that an
//! interrupted bake can go on; `tree` bounds the nodes; `archive` and `city` lay out the final files.

pub(crate) mod archive;
pub(crate) mod city;
pub(crate) mod fingerprints;
pub(crate) mod mesh_pack;
pub(crate) mod pack;
pub(crate) mod scratch;
pub(crate) mod tree;

use std::{fs, io::Write, path::Path};

use crate::error::BakeError;

/// Writes a small file under a temporary name and renames it.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), BakeError> {
    let temporary = path.with_extension("tmp");
    let written = fs::File::create(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    written.map_err(|cause| BakeError::io(&temporary, "written", cause))?;
    fs::rename(&temporary, path).map_err(|cause| BakeError::io(path, "written", cause))
}

/// Makes the names in a folder as lasting as the files; where the system has no such call, nothing.
pub(crate) fn sync_folder(path: &Path) -> Result<(), BakeError> {
    if cfg!(unix) {
        let synced = fs::File::open(path).and_then(|folder| folder.sync_all());
        synced.map_err(|cause| BakeError::io(path, "written", cause))?;
    }
    Ok(())
}
