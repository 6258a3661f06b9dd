//! Folders of cities, which people take for a city.

use super::MANIFEST_FILE;
use std::fs;
use std::path::{Path, PathBuf};

/// At most so many entries of a folder are looked at.
const MAX_ENTRIES: usize = 10_000;

/// The first city by name in a folder, for messages; `None` if it has none, or cannot be read.
#[must_use]
pub fn first_city_in(folder: &Path) -> Option<PathBuf> {
    let entries = fs::read_dir(folder).ok()?.take(MAX_ENTRIES);
    entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.join(MANIFEST_FILE).is_file()).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_city_of_a_folder_is_found() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("a")).unwrap();
        assert_eq!(first_city_in(folder.path()), None);
        for name in ["c", "b"] {
            fs::create_dir(folder.path().join(name)).unwrap();
            fs::write(folder.path().join(name).join(MANIFEST_FILE), "{}").unwrap();
        }
        assert_eq!(first_city_in(folder.path()), Some(folder.path().join("b")));
        // A city is no folder of cities.
        assert_eq!(first_city_in(&folder.path().join("b")), None);
        assert_eq!(first_city_in(&folder.path().join("none")), None);
    }
}
