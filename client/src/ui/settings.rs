//! Settings that outlast a run, in the user's configuration folder: the window, the light, bookmarks.

use crate::error::ClientError;
use insula_archive::file::read_text;
use insula_archive::new_file::replace;
use insula_viewer::camera::CameraFile;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Size of the largest accepted file.
const MAX_BYTES: u64 = 4 << 20;
/// Largest number of bookmarks of a city.
const MAX_BOOKMARKS: usize = 200;
/// Longest name of a bookmark, in characters.
const MAX_NAME: usize = 80;
/// Most damaged files that are kept.
const MAX_DAMAGED: u32 = 100;
/// Smallest and largest side of the window, in points.
const WINDOW_SIDES: RangeInclusive<u32> = 100..=16_384;

/// A view with a name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bookmark {
    pub name: String,
    pub camera: CameraFile,
}

/// Content of `settings.json`. Missing fields have their defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct UserSettings {
    /// Inner size of the window, in points.
    pub window: [u32; 2],
    pub full_screen: bool,
    /// Tolerated screen-space error.
    pub tau_px: f64,
    /// Date and time of the light, in the format of `--time`.
    pub time: Option<String>,
    /// Whether the sun casts shadows.
    pub shadows: bool,
    /// Whether the panel of light and detail is shown.
    pub overlay: bool,
    pub counters: bool,
    /// Whether the map is shown.
    pub minimap: bool,
    /// Bookmarks of each city, by its name.
    pub bookmarks: BTreeMap<String, Vec<Bookmark>>,
}

impl Default for UserSettings {
    fn default() -> Self {
        Self {
            window: [1280, 720],
            full_screen: false,
            tau_px: 1.0,
            time: None,
            shadows: true,
            overlay: true,
            counters: false,
            minimap: true,
            bookmarks: BTreeMap::new(),
        }
    }
}

impl UserSettings {
    /// Path of the settings file; `None` without a configuration folder.
    pub fn path() -> Option<PathBuf> {
        directories::ProjectDirs::from("", "", "insula").map(|folders| folders.config_dir().join("settings.json"))
    }

    /// Reads the settings. A file that cannot be used is renamed, the defaults are returned, and the second value says why.
    pub fn load(path: &Path) -> (Self, Option<String>) {
        let error = match Self::read(path) {
            Ok(settings) => return (settings, None),
            Err(error) => error,
        };
        // An earlier one may have bookmarks that somebody wants back.
        let mut names = (1..=MAX_DAMAGED).map(|number| path.with_extension(format!("damaged-{number}.json")));
        let unused = names.find(|name| name.symlink_metadata().is_err());
        let outcome = match unused.filter(|name| fs::rename(path, name).is_ok()) {
            Some(renamed) => format!("renamed to {}", renamed.display()),
            None => "it will be overwritten".to_owned(),
        };
        let note = format!("{}: settings cannot be used ({error}): {outcome}, using the defaults", path.display());
        (Self::default(), Some(note))
    }

    /// Reads and checks the file; a missing file has the defaults.
    fn read(path: &Path) -> Result<Self, String> {
        match read_text(path, MAX_BYTES) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            text => Self::parse(&text.map_err(|error| error.to_string())?),
        }
    }

    fn parse(text: &str) -> Result<Self, String> {
        let settings: Self = serde_json::from_str(text).map_err(|e| e.to_string())?;
        if !(0.1..=1000.0).contains(&settings.tau_px) {
            return Err(format!("tau_px {} is out of range", settings.tau_px));
        }
        if !is_window_size(settings.window) {
            return Err(format!("window {:?} is out of range", settings.window));
        }
        for bookmark in settings.bookmarks.values().flatten() {
            if bookmark.camera.camera().is_none() || bookmark.name.chars().count() > MAX_NAME {
                return Err(format!("invalid bookmark {:.80}", bookmark.name));
            }
        }
        match settings.bookmarks.values().map(Vec::len).max() {
            Some(count) if count > MAX_BOOKMARKS => {
                Err(format!("{count} bookmarks of one city, at most {MAX_BOOKMARKS} are accepted"))
            }
            _ => Ok(settings),
        }
    }

    /// Writes the settings to a temporary file and renames it, so that the file is never incomplete. Fails if it cannot be
    /// written.
    pub fn store(&self, path: &Path) -> Result<(), ClientError> {
        let json = serde_json::to_string_pretty(self).map_err(|e| ClientError::Failed(format!("the settings: {e}")))?;
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(ClientError::file(folder))?;
        }
        replace(path, (json + "\n").as_bytes()).map_err(ClientError::file(path))
    }

    /// Adds a bookmark. A long name is cut. Returns `false` if the city has too many bookmarks.
    pub fn add_bookmark(&mut self, city: &str, name: &str, camera: CameraFile) -> bool {
        let bookmarks = self.bookmarks.entry(city.to_owned()).or_default();
        let has_room = bookmarks.len() < MAX_BOOKMARKS;
        if has_room {
            bookmarks.push(Bookmark { name: name.chars().take(MAX_NAME).collect(), camera });
        }
        has_room
    }
}

/// Whether a window may have this size, in points.
pub fn is_window_size(size: [u32; 2]) -> bool {
    size.iter().all(|side| WINDOW_SIDES.contains(side))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_settings_load_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deeper").join("settings.json");
        assert_eq!(UserSettings::load(&path), (UserSettings::default(), None));
        let mut settings = UserSettings { window: [640, 480], tau_px: 2.0, minimap: false, ..UserSettings::default() };
        let camera: CameraFile = serde_json::from_str(r#"{"position":[1,2,3],"target":[4,5,6]}"#).unwrap();
        assert!(settings.add_bookmark("delft", &"x".repeat(500), camera));
        settings.store(&path).unwrap();
        assert_eq!(UserSettings::load(&path), (settings.clone(), None));
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "the temporary file is left");
        for _ in 0..2 * MAX_BOOKMARKS {
            settings.add_bookmark("delft", "another", camera);
        }
        settings.store(&path).unwrap();
        assert_eq!(UserSettings::load(&path).1, None, "it stored settings that it does not load");
    }

    #[test]
    fn a_damaged_file_is_reported_and_renamed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings.json");
        let wrong_camera = r#"{"bookmarks":{"a":[{"name":"b","camera":{"position":[0,0,0],"target":[0,0,0]}}]}}"#;
        for (damaged, number) in
            ["", "{", "7", r#"{"tau_px":"x"}"#, r#"{"tau_px":0}"#, r#"{"window":[1,1]}"#, wrong_camera]
                .into_iter()
                .zip(1..)
        {
            fs::write(&path, damaged).unwrap();
            let (settings, note) = UserSettings::load(&path);
            assert!(settings == UserSettings::default() && note.unwrap().contains("settings.json"), "{damaged}");
            let kept = folder.path().join(format!("settings.damaged-{number}.json"));
            assert!(!path.exists() && fs::read_to_string(kept).unwrap() == damaged);
        }
        fs::write(&path, r#"{"tau_px":3,"of_a_later_version":1}"#).unwrap();
        assert_eq!(UserSettings::load(&path).0.tau_px, 3.0);
    }
}
