//! Folders of cities, which people take for a city, and those of the versions of a city.

use super::{MANIFEST_FILE, read_manifest};
use insula_protocol::Manifest;
use insula_protocol::release::is_date;
use std::fs;
use std::path::{Path, PathBuf};

/// At most so many entries of a folder are looked at.
const MAX_ENTRIES: usize = 10_000;

/// The first city by name in a folder, for messages; `None` if it has none, or cannot be read.
pub fn first_city_in(folder: &Path) -> Option<PathBuf> {
    let entries = fs::read_dir(folder).ok()?.take(MAX_ENTRIES);
    entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.join(MANIFEST_FILE).is_file()).min()
}

/// The folder of a city, which may be named by another version of the city beside it and a day, as in `cities/delft@2024-01-31`. Other paths
/// stay as they are.
#[must_use]
pub fn dated_folder(path: PathBuf) -> PathBuf {
    let named = path.file_name().and_then(|name| name.to_str()).and_then(|name| name.rsplit_once('@'));
    let Some((name, date)) = named.filter(|(_, date)| is_date(date) && !path.exists()) else { return path };
    let folder = path.with_file_name(name);
    let Ok(known) = read_manifest(&folder) else { return path };
    let is_meant = |manifest: &Manifest| {
        let of_city = manifest.release.as_ref().filter(|_| manifest.release_name() == known.release_name());
        of_city.is_some_and(|release| release.date == date)
    };
    if is_meant(&known) {
        return folder;
    }
    let beside = folder.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = fs::read_dir(beside).into_iter().flatten().take(MAX_ENTRIES).flatten();
    let versions = entries.map(|entry| folder.with_file_name(entry.file_name()));
    versions.filter(|folder| read_manifest(folder).is_ok_and(|found| is_meant(&found))).min().unwrap_or(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::release::Release;

    #[test]
    fn a_city_and_a_day_name_a_version() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let write = |name: &str, of: &str, date: Option<&str>| {
            let release = date.map(|date| Release {
                of: of.into(),
                date: date.into(),
                bake_origin: [0.0; 3],
                shared: Vec::new(),
            });
            let (name_of_city, version) = (name.to_owned(), "0".to_owned());
            let (format_version, node_cells) = (insula_protocol::manifest::FORMAT_VERSION, 64);
            let manifest = Manifest {
                format_version,
                node_cells,
                name: name_of_city,
                version,
                cell_m: 1.0,
                root_side_m: 64.0,
                release,
                ..Manifest::default()
            };
            fs::create_dir(path(name)).unwrap();
            fs::write(path(name).join(MANIFEST_FILE), serde_json::to_vec(&manifest).unwrap()).unwrap();
        };
        write("town", "town", Some("2020-01-01"));
        write("town-2024", "town", Some("2024-01-31"));
        write("other", "other", Some("2024-01-31"));
        write("plain", "", None);
        let found = |text: &str| dated_folder(path(text));
        assert_eq!(found("town@2024-01-31"), path("town-2024"));
        assert_eq!(found("town-2024@2020-01-01"), path("town"), "any version names the others");
        assert_eq!(found("other@2024-01-31"), path("other"));
        for same in ["town", "town@2024-01-30", "town@2024", "none@2024-01-31", "plain@2024-01-31", "@2024-01-31"] {
            assert_eq!(found(same), path(same));
        }
        fs::create_dir(path("town@2024-01-31")).unwrap();
        assert_eq!(found("town@2024-01-31"), path("town@2024-01-31"), "a folder of that name");
    }

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
