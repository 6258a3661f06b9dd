//! What is kept from one run to the next: the window, the light, bookmarks.
//!
//! In: a file in the user's configuration folder, which may be missing or damaged. Out: [`Settings`]. Next: `window`.

use crate::error::ClientError;
use insula_viewer::camera::CameraFile;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// Largest file that is read.
const MOST_BYTES: u64 = 4 << 20;
/// Most bookmarks of a city, and longest name of one.
pub const MOST_BOOKMARKS: usize = 200;
const MOST_NAME: usize = 80;

/// A view with a name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bookmark {
    /// For people.
    pub name: String,
    /// Where from.
    pub camera: CameraFile,
}

/// The file's content; what it lacks is as in a first run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Inner size of the window, in points.
    pub window: [u32; 2],
    /// Whether it fills the screen.
    pub full_screen: bool,
    /// Tolerated error.
    pub tau_px: f64,
    /// Hour and date of the light, as `--time` has them.
    pub time: Option<String>,
    /// Whether the sun casts shadows.
    pub shadows: bool,
    /// Whether the counters are shown.
    pub overlay: bool,
    /// Whether the map is shown.
    pub minimap: bool,
    /// By city.
    pub bookmarks: BTreeMap<String, Vec<Bookmark>>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            window: [1280, 720],
            full_screen: false,
            tau_px: 1.0,
            time: None,
            shadows: true,
            overlay: true,
            minimap: true,
            bookmarks: BTreeMap::new(),
        }
    }
}

impl Settings {
    /// Where they are kept; none on a system without such a folder.
    pub fn path() -> Option<PathBuf> {
        directories::ProjectDirs::from("", "", "insula").map(|folders| folders.config_dir().join("settings.json"))
    }

    /// Reads them. What cannot be used is laid aside under another name and told.
    pub fn load(path: &Path) -> (Self, Option<String>) {
        let damaged = match fs::metadata(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return (Self::default(), None),
            Err(error) => error.to_string(),
            Ok(about) if about.len() > MOST_BYTES => format!("{} bytes are too many", about.len()),
            Ok(_) => match fs::read_to_string(path).map_err(|e| e.to_string()).and_then(|text| Self::parse(&text)) {
                Ok(settings) => return (settings, None),
                Err(why) => why,
            },
        };
        let aside = path.with_extension("damaged.json");
        let kept = match fs::rename(path, &aside) {
            Ok(()) => format!("it is kept as {}", aside.display()),
            Err(_) => "it will be replaced".to_owned(),
        };
        let note = format!("{}: settings cannot be used ({damaged}); {kept}, going on without", path.display());
        (Self::default(), Some(note))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let settings: Self = serde_json::from_str(text).map_err(|e| e.to_string())?;
        if !(0.1..=1000.0).contains(&settings.tau_px) {
            return Err(format!("tau_px {}", settings.tau_px));
        }
        if settings.window.iter().any(|side| !(100..=16_384).contains(side)) {
            return Err(format!("window {:?}", settings.window));
        }
        for bookmark in settings.bookmarks.values().flatten() {
            if bookmark.camera.camera().is_none() || bookmark.name.chars().count() > MOST_NAME {
                return Err(format!("bookmark {:.80}", bookmark.name));
            }
        }
        match settings.bookmarks.values().map(Vec::len).max() {
            Some(most) if most > MOST_BOOKMARKS => Err(format!("{most} bookmarks of one city")),
            _ => Ok(settings),
        }
    }

    /// Writes them under another name first: there is never half a file.
    pub fn store(&self, path: &Path) -> Result<(), ClientError> {
        let json = serde_json::to_string_pretty(self).map_err(|e| ClientError::Failed(format!("the settings: {e}")))?;
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(ClientError::file(folder))?;
        }
        let part = path.with_extension(format!("{}.part", std::process::id()));
        fs::write(&part, json + "\n").map_err(ClientError::file(&part))?;
        fs::rename(&part, path).map_err(ClientError::file(path))
    }

    /// Adds a bookmark; the name is cut to its limit. `false`: there are too many.
    pub fn keep(&mut self, city: &str, name: &str, camera: CameraFile) -> bool {
        let bookmarks = self.bookmarks.entry(city.to_owned()).or_default();
        let room = bookmarks.len() < MOST_BOOKMARKS;
        if room {
            bookmarks.push(Bookmark { name: name.chars().take(MOST_NAME).collect(), camera });
        }
        room
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("insula-settings-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn what_is_stored_comes_back() {
        let folder = folder("back");
        let path = folder.join("deeper").join("settings.json");
        assert_eq!(Settings::load(&path), (Settings::default(), None));
        let mut settings = Settings { window: [640, 480], tau_px: 2.0, minimap: false, ..Settings::default() };
        let camera: CameraFile = serde_json::from_str(r#"{"position":[1,2,3],"target":[4,5,6]}"#).unwrap();
        assert!(settings.keep("delft", &"x".repeat(500), camera));
        settings.store(&path).unwrap();
        assert_eq!(Settings::load(&path), (settings.clone(), None));
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "a part was left");
        for _ in 0..2 * MOST_BOOKMARKS {
            settings.keep("delft", "another", camera);
        }
        settings.store(&path).unwrap();
        assert_eq!(Settings::load(&path).1, None, "it wrote what it does not read");
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_damaged_file_is_told_and_laid_aside() {
        let folder = folder("damaged");
        let path = folder.join("settings.json");
        let wrong_camera = r#"{"bookmarks":{"a":[{"name":"b","camera":{"position":[0,0,0],"target":[0,0,0]}}]}}"#;
        for damaged in ["", "{", "7", r#"{"tau_px":"x"}"#, r#"{"tau_px":0}"#, r#"{"window":[1,1]}"#, wrong_camera] {
            fs::write(&path, damaged).unwrap();
            let (settings, note) = Settings::load(&path);
            assert!(settings == Settings::default() && note.unwrap().contains("settings.json"), "{damaged}");
            assert!(!path.exists() && fs::read_to_string(folder.join("settings.damaged.json")).unwrap() == damaged);
        }
        fs::write(&path, r#"{"tau_px":3,"of a later version":1}"#).unwrap();
        assert_eq!(Settings::load(&path).0.tau_px, 3.0);
        fs::remove_dir_all(folder).unwrap();
    }
}
