//! A set of cities from folders, object stores and web servers.

use super::city::CityStore;
use super::error::StoreError;
use super::folder_reads::FolderReads;
use super::remote::RemoteCity;
use super::requests::{StoreMetrics, StoreRequests};
use crate::config::BlockCacheConfig;
use std::collections::BTreeMap;
use std::ops::Bound;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long, and how many, replaced versions stay open.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RetentionPolicy {
    /// Time after the replacement.
    pub time: Duration,
    /// Number per city.
    pub versions: usize,
}

/// Result of a check.
#[derive(Debug)]
pub struct StoreReload {
    /// The cities to serve from now on.
    pub store: Store,
    /// Names of the cities that were replaced, added or removed.
    pub changed: Vec<String>,
    /// Number of older versions that were closed.
    pub closed: usize,
    /// Cities and folders that could not be opened.
    pub failures: Vec<StoreError>,
    /// Some cities are missing for another number of checks than before.
    pub(super) absences_changed: bool,
    /// Others cannot be opened than before.
    pub(super) failures_changed: bool,
}

/// Cities by the name that URLs use. Cheap to clone.
#[derive(Debug, Default, Clone)]
pub struct Store {
    pub(super) folders: Vec<PathBuf>,
    pub(super) reads: Arc<FolderReads>,
    pub(super) remotes: Vec<RemoteCity>,
    pub(super) metrics: Option<StoreMetrics>,
    pub(super) cities: BTreeMap<String, CityVersions>,
    /// What could not be opened at the last check, of the folders and of the remote cities, and the URLs of no known kind.
    pub(super) failures: [Arc<[String]>; 3],
}

/// The current version of a city, and recent ones.
#[derive(Debug, Clone)]
pub(super) struct CityVersions {
    pub(super) current: Arc<CityStore>,
    /// Replaced versions with the time of their replacement, newest first. Clients use them until they fetch the manifest again.
    pub(super) older: Vec<(Arc<CityStore>, Instant)>,
    /// Number of consecutive checks at which the city's folder was missing.
    pub(super) absent_checks: u32,
}

impl Store {
    /// What could not be opened at the last check, a line for each city or folder.
    pub fn failures(&self) -> impl Iterator<Item = &String> {
        self.failures.iter().flat_map(|failures| failures.iter())
    }

    /// Metrics of remote reads; `None` without remote cities.
    pub(crate) fn metrics(&self) -> Option<&StoreMetrics> {
        self.metrics.as_ref()
    }

    /// Adds a city. Fails if there is one of the same name.
    pub fn insert(&mut self, city: CityStore) -> Result<(), StoreError> {
        let name = city.manifest().name.clone();
        if let Some(other) = self.city(&name) {
            let (first, second) = (other.location().to_owned(), city.location().to_owned());
            return Err(StoreError::SameName { name, first, second });
        }
        self.cities.insert(name, CityVersions { current: Arc::new(city), older: Vec::new(), absent_checks: 0 });
        Ok(())
    }

    /// The current version of a city.
    pub fn city(&self, name: &str) -> Option<&Arc<CityStore>> {
        self.cities.get(name).map(|versions| &versions.current)
    }

    /// A given version of a city: the current one or a recent one.
    pub fn version(&self, name: &str, version: &str) -> Option<&Arc<CityStore>> {
        let versions = self.cities.get(name)?;
        let mut all = std::iter::once(&versions.current).chain(versions.older.iter().map(|(city, _)| city));
        all.find(|city| city.manifest().version == version)
    }

    /// The current versions of all cities, by name.
    pub fn cities(&self) -> impl ExactSizeIterator<Item = &Arc<CityStore>> {
        self.cities.values().map(|versions| &versions.current)
    }

    /// The current versions of the cities from a name on.
    pub fn cities_from(&self, start: Bound<&str>) -> impl Iterator<Item = &Arc<CityStore>> {
        self.cities.range::<str, _>((start, Bound::Unbounded)).map(|(_, versions)| &versions.current)
    }

    /// Number of older versions that are still open, of the cities with these names.
    pub fn older_versions(&self, is_counted: impl Fn(&str) -> bool) -> usize {
        let counted = self.cities.iter().filter(|(name, _)| is_counted(name));
        counted.map(|(_, versions)| versions.older.len()).sum()
    }
}

/// The cities of a folder.
#[derive(Debug, Default)]
pub(super) struct CityFolders {
    /// The folder itself if it is a city, else the cities directly inside it, by name.
    pub(super) cities: Vec<PathBuf>,
    /// Folders that may be cities but cannot be looked at, and why.
    pub(super) unreadable: Vec<(PathBuf, StoreError)>,
}

/// Looks for cities in a folder. Fails if it cannot be read.
pub(super) fn city_folders(folder: &Path, reads: &FolderReads) -> Result<CityFolders, StoreError> {
    let mut found = CityFolders::default();
    if reads.has_manifest(folder)? {
        found.cities.push(folder.to_owned());
        return Ok(found);
    }
    for path in reads.entries(folder)? {
        match reads.has_manifest(&path) {
            Ok(true) => found.cities.push(path),
            Ok(false) => {}
            Err(error) => found.unreadable.push((path, error)),
        }
    }
    Ok(found)
}

impl Store {
    /// Opens city folders; a folder that is no city stands for all cities directly inside it. Fails if there is no city, one
    /// cannot be opened, or two have the same name.
    pub fn open<P: AsRef<Path>>(folders: &[P]) -> Result<Self, StoreError> {
        let folders = folders.iter().map(|folder| folder.as_ref().to_owned()).collect();
        Self { folders, ..Self::default() }.check_folders(RetentionPolicy::default()).0.complete()
    }

    /// As [`Self::open`], where a place may also be the URL of a city in an object store or behind a web server. Fails, in
    /// addition, if the cache folder cannot be used or a store does not respond.
    pub async fn open_anywhere(places: &[PathBuf], cache: &BlockCacheConfig) -> Result<Self, StoreError> {
        Self::start(places, cache).await?.complete()
    }

    /// Opens what can be opened, as [`Self::reload`] does, which tries the rest again, except for URLs of no known kind. Fails only if the
    /// cache folder cannot be used.
    pub async fn start(places: &[PathBuf], cache: &BlockCacheConfig) -> Result<StoreReload, StoreError> {
        let is_url = |place: &PathBuf| place.to_str().is_some_and(|text| text.contains("://"));
        let (urls, folders): (Vec<PathBuf>, Vec<PathBuf>) = places.iter().cloned().partition(is_url);
        let (mut store, mut wrong) = (Self { folders, ..Self::default() }, Vec::new());
        if !urls.is_empty() {
            let cache_error = |source| StoreError::Cache { path: cache.folder.clone().unwrap_or_default(), source };
            let metrics = StoreMetrics::new();
            let blocks = Arc::new(metrics.block_cache(cache).map_err(cache_error)?);
            let requests = Arc::new(StoreRequests::new(cache, metrics.clone()));
            for url in urls.iter().filter_map(|url| url.to_str()) {
                match RemoteCity::new(url, requests.clone(), blocks.clone()) {
                    Ok(remote) => store.remotes.push(remote),
                    Err(error) => wrong.push(error),
                }
            }
            store.metrics = Some(metrics);
        }
        store.failures[2] = wrong.iter().map(ToString::to_string).collect();
        let mut opened = store.reload(RetentionPolicy::default(), true).await;
        opened.failures.extend(wrong);
        Ok(opened)
    }
}
