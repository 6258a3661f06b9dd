//! Where an interrupted bake keeps its work.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Folder of finished blocks in the scratch folder.
pub(crate) const PACKS_FOLDER: &str = "packs";

/// The scratch folder of the bake of `out`: `CITY.partial`.
#[must_use]
pub fn scratch_folder(out: &Path) -> PathBuf {
    let mut name = out.file_name().map(OsString::from).unwrap_or_default();
    name.push(".partial");
    out.with_file_name(name)
}

/// Whether a bake of `out` that resumes may find finished work.
#[must_use]
pub fn has_kept_work(out: &Path) -> bool {
    scratch_folder(out).join(PACKS_FOLDER).exists()
}
