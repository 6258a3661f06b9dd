//! Folders that the programs keep, known by what they write into them, and paths without links.

use crate::city::{MANIFEST_FILE, MAX_MANIFEST_BYTES};
use crate::file::read_limited;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::{fmt, fs};

/// Marks a published site, and lists its files.
pub const SITE_FILE: &str = "insula-site.json";
/// Marks the store of a bake in steps.
pub const WORK_FILE: &str = "insula-work";
/// Marks the folder of a bake's unfinished work.
pub const SCRATCH_FILE: &str = "insula-bake-scratch";
/// Longest list of a site's files in bytes.
pub const MAX_SITE_LIST_BYTES: u64 = 64 << 20;

/// A folder whose files belong to the programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeptFolder {
    City,
    Site,
    /// Results of a bake in steps.
    WorkStore,
    /// Unfinished work of a bake.
    Scratch,
}

impl fmt::Display for KeptFolder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::City => "a baked city",
            Self::Site => "a published site",
            Self::WorkStore => "a bake's work store",
            Self::Scratch => "a bake's unfinished work",
        })
    }
}

/// What a folder is by its marker; `None` if it is somebody else's, or cannot be read.
pub fn kept_folder(folder: &Path) -> Option<KeptFolder> {
    let folder = &canonical(folder);
    let is_file = |name: &str| fs::symlink_metadata(folder.join(name)).is_ok_and(|found| found.is_file());
    if is_file(WORK_FILE) {
        return Some(KeptFolder::WorkStore);
    }
    if is_file(SCRATCH_FILE) {
        return Some(KeptFolder::Scratch);
    }
    if is_file(SITE_FILE) {
        return Some(KeptFolder::Site);
    }
    (is_file(MANIFEST_FILE) && has_manifest(folder)).then_some(KeptFolder::City)
}

/// The innermost kept folder in which a path lies, also one that does not exist yet. Links are followed as far as the path exists.
pub fn kept_folder_above(path: &Path) -> Option<(PathBuf, KeptFolder)> {
    let found = canonical(path);
    found.ancestors().skip(1).find_map(|folder| Some((folder.to_owned(), kept_folder(folder)?)))
}

/// Whether a folder has the manifest of a city, also of another version of the programs, which may not be able to open it.
pub fn has_manifest(folder: &Path) -> bool {
    let Ok(text) = read_limited(&folder.join(MANIFEST_FILE), MAX_MANIFEST_BYTES as u64) else { return false };
    let Ok(manifest) = serde_json::from_slice::<Value>(&text) else { return false };
    // Members that every manifest has had, and that no other JSON has together.
    let has = |name: &str, is_it: fn(&Value) -> bool| manifest.get(name).is_some_and(is_it);
    let has_numbers = has("format_version", Value::is_u64) && has("tile_version", Value::is_u64);
    has_numbers
        && has("version", Value::is_string)
        && has("root_side_m", Value::is_number)
        && has("settings", Value::is_string)
}

/// The path without links and `..`, as far as it exists. What does not exist is taken for folders that are to be created.
pub fn canonical(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    if let Ok(found) = fs::canonicalize(&absolute) {
        return found;
    }
    let Some(mut plain) = absolute.parent().map(canonical) else { return absolute };
    match absolute.file_name() {
        Some(name) => plain.push(name),
        // It ends in `..`.
        None => {
            plain.pop();
        }
    }
    // A folder that is not there may be left again by `..`, to one that is.
    fs::canonicalize(&plain).unwrap_or(plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_known_by_their_markers() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in ["city", "site/assets", "work/scan", "partial", "source"] {
            fs::create_dir_all(path(name)).unwrap();
        }
        let manifest = r#"{"format_version":9,"tile_version":1,"version":"a","root_side_m":64.0,"settings":""}"#;
        fs::write(path("city/city.json"), manifest).unwrap();
        fs::write(path("source/city.json"), r#"{"type":"CityJSON","version":"2.0"}"#).unwrap();
        for name in ["site/insula-site.json", "work/insula-work", "partial/insula-bake-scratch"] {
            fs::write(path(name), "").unwrap();
        }
        let above = |name: &str| kept_folder_above(&path(name)).map(|(_, kind)| kind);
        assert_eq!(above("city/meshes.pmtiles"), Some(KeptFolder::City));
        assert_eq!(above("city/new/deep/a.csv"), Some(KeptFolder::City));
        assert_eq!(above("site/assets/x"), Some(KeptFolder::Site));
        assert_eq!(above("work/scan/../scan/0"), Some(KeptFolder::WorkStore));
        assert_eq!(above("partial/x"), Some(KeptFolder::Scratch));
        assert_eq!((above("source/city.json"), above("city")), (None, None));
        assert_eq!(kept_folder(&path("none/../city")), Some(KeptFolder::City));
        // Where folders are created on the way.
        assert_eq!(above("none/../city/x"), Some(KeptFolder::City));
        assert_eq!(above("none/more/../../site/assets/new/../x"), Some(KeptFolder::Site));
        assert_eq!(canonical(&path("none/../source/../new")), canonical(folder.path()).join("new"));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(path("city"), path("link")).unwrap();
            assert_eq!(above("link/x"), Some(KeptFolder::City));
            assert_eq!(above("none/../link/x"), Some(KeptFolder::City));
        }
    }
}
