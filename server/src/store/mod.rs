//! Baked cities on disk, opened once and read without copies.
//!
//! In: city folders (design 10). Out: a [`Store`]: manifests, and tiles as [`bytes::Bytes`] by layer and id.
//! Next: `http` serves them; the commands `inspect` and `verify` read them.
//!
//! Everything that a request could stumble over is checked when a city is opened: the manifest, the archives' directories,
//! that every tile lies inside its file. What is inside a tile is the client's to check (or `verify`'s).

mod archive;
mod city;
mod directory;
mod error;

pub use archive::Archive;
pub use city::CityStore;
pub use error::{ArchiveError, StoreError};

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

/// The manifest's name in a city's folder.
pub const MANIFEST_FILE: &str = "city.json";

/// Several cities, by the name that URLs use.
#[derive(Debug, Default)]
pub struct Store {
    cities: BTreeMap<String, Arc<CityStore>>,
}

impl Store {
    /// Opens city folders, and the city folders directly inside the others. Errors: a folder that is neither, a damaged
    /// city, two cities of one name.
    pub fn open<P: AsRef<Path>>(folders: &[P]) -> Result<Self, StoreError> {
        let mut store = Self::default();
        for folder in folders {
            for city in city_folders(folder.as_ref())? {
                store.insert(CityStore::open(&city)?)?;
            }
        }
        Ok(store)
    }

    /// Adds a city. Errors: there is one of that name.
    pub fn insert(&mut self, city: CityStore) -> Result<(), StoreError> {
        let name = city.manifest().name.clone();
        if let Some(other) = self.cities.get(&name) {
            let (first, second) = (other.folder().to_owned(), city.folder().to_owned());
            return Err(StoreError::SameName { name, first, second });
        }
        self.cities.insert(name, Arc::new(city));
        Ok(())
    }

    /// The city of that name.
    pub fn city(&self, name: &str) -> Option<&Arc<CityStore>> {
        self.cities.get(name)
    }

    /// All cities, by name.
    pub fn cities(&self) -> impl ExactSizeIterator<Item = &Arc<CityStore>> {
        self.cities.values()
    }
}

/// The folder itself if it is a city, else the cities directly inside it, by name.
fn city_folders(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    if folder.join(MANIFEST_FILE).is_file() {
        return Ok(vec![folder.to_owned()]);
    }
    let unreadable = |source| StoreError::Io { path: folder.to_owned(), source };
    let mut cities = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.join(MANIFEST_FILE).is_file() {
            cities.push(path);
        }
    }
    cities.sort();
    if cities.is_empty() { Err(StoreError::NoCity(folder.to_owned())) } else { Ok(cities) }
}
