//! Where an interrupted bake keeps its work.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Name of the file in the scratch folder that says what its packs are made from. Without it they are not reused.
pub(crate) const STATE_FILE: &str = "state.json";

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
    scratch_folder(out).join(STATE_FILE).exists()
}
