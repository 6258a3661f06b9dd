//! Checks whether cities were replaced, added or removed, and opens the new ones.
//!
//! A city that cannot be opened does not replace the version that is served.

use super::{
    cities::{CityFolders, Store, city_folders},
    city::{CityStamp, CityStore},
    error::StoreError,
};
use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

/// Consecutive checks that must miss a city, or its whole folder, before it is removed: `bake` replaces a folder by two renames.
const MAX_ABSENT_CHECKS: u32 = 3;

/// How long, and how many, replaced versions stay open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    absences_changed: bool,
}

impl Store {
    /// Checks all folders and, if `include_remote`, all remote cities.
    pub async fn reload(&self, retention: RetentionPolicy, include_remote: bool) -> StoreReload {
        let store = self.clone();
        let checked = tokio::task::spawn_blocking(move || store.check_folders(retention)).await;
        // The task fails only if it is cancelled at the end of the process.
        let unchanged = || (StoreReload::unchanged(self), self.cities.keys().cloned().collect());
        let (mut reload, mut seen) = checked.unwrap_or_else(|_| unchanged());
        for remote in &self.remotes {
            let known = self.cities.iter().find(|(_, versions)| versions.current.location() == remote.url());
            seen.extend(known.map(|(name, _)| name.clone()));
            if !include_remote {
                continue;
            }
            match remote.open(known.map(|(_, versions)| versions.current.stamp())).await {
                Ok(Some(city)) => {
                    let name = city.manifest().name.clone();
                    if reload.replace(name.clone(), city, retention) {
                        seen.insert(name);
                    }
                }
                Ok(None) => {}
                Err(error) => reload.failures.push(error),
            }
        }
        reload.remove_absent(&seen);
        reload.close_older(retention);
        reload
    }

    /// Checks all folders, which reads the disk. Also returns the names of the cities that exist.
    fn check_folders(&self, retention: RetentionPolicy) -> (StoreReload, BTreeSet<String>) {
        let mut reload = StoreReload::unchanged(self);
        let mut seen = BTreeSet::new();
        let folders =
            self.cities.iter().filter_map(|(name, city)| Some((city.current.folder()?.to_owned(), name.clone())));
        let known: BTreeMap<PathBuf, String> = folders.collect();
        for folder in &self.folders {
            match city_folders(folder) {
                Ok(CityFolders { cities, unreadable }) => {
                    for city in &cities {
                        seen.extend(reload.check_folder(city, known.get(city), retention));
                    }
                    // A city that cannot be looked at stays open.
                    for (path, source) in unreadable {
                        if let Some(name) = known.get(&path) {
                            seen.insert(name.clone());
                            reload.failures.push(StoreError::Io { path, source });
                        }
                    }
                }
                // The folder is gone, and its cities with it.
                Err(StoreError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => {}
                // All cities from this folder stay open.
                Err(error) => {
                    seen.extend(known.iter().filter(|(at, _)| at.starts_with(folder)).map(|(_, name)| name.clone()));
                    reload.failures.push(error);
                }
            }
        }
        (reload, seen)
    }
}

impl StoreReload {
    fn unchanged(store: &Store) -> Self {
        Self { store: store.clone(), changed: Vec::new(), closed: 0, failures: Vec::new(), absences_changed: false }
    }

    /// Whether [`Self::store`] differs from the store that was checked.
    pub fn must_replace(&self) -> bool {
        !self.changed.is_empty() || self.closed > 0 || self.absences_changed
    }

    /// Opens the city in a folder if it has changed. `known` is the city that was opened from there. Returns the city that exists.
    fn check_folder(&mut self, folder: &Path, known: Option<&String>, retention: RetentionPolicy) -> Option<String> {
        let is_unchanged = |name: &String| {
            let city = self.store.city(name);
            city.is_some_and(|city| CityStamp::of(folder).is_ok_and(|stamp| stamp == *city.stamp()))
        };
        if known.is_some_and(is_unchanged) {
            return known.cloned();
        }
        match CityStore::open(folder) {
            Ok(city) => {
                let name = city.manifest().name.clone();
                self.replace(name.clone(), city, retention).then_some(name)
            }
            Err(error) => {
                self.failures.push(error);
                known.cloned()
            }
        }
    }

    /// Makes `city` the current version. `false` if it could not be added.
    fn replace(&mut self, name: String, city: CityStore, retention: RetentionPolicy) -> bool {
        let Some(versions) = self.store.cities.get_mut(&name) else {
            self.changed.push(name);
            return self.store.insert(city).is_ok();
        };
        if versions.current.location() != city.location() {
            let (first, second) = (versions.current.location().to_owned(), city.location().to_owned());
            self.failures.push(StoreError::SameName { name, first, second });
            return true;
        }
        let is_new_version = versions.current.manifest().version != city.manifest().version;
        let replaced = std::mem::replace(&mut versions.current, Arc::new(city));
        if is_new_version {
            let version = versions.current.manifest().version.clone();
            versions.older.insert(0, (replaced, Instant::now()));
            versions.older.retain(|(older, _)| older.manifest().version != version);
            self.closed += versions.older.len().saturating_sub(retention.versions);
            versions.older.truncate(retention.versions);
        }
        self.changed.push(name);
        true
    }

    fn remove_absent(&mut self, seen: &BTreeSet<String>) {
        for (name, versions) in &mut self.store.cities {
            let absent_checks = if seen.contains(name) { 0 } else { versions.absent_checks + 1 };
            self.absences_changed |= absent_checks != versions.absent_checks;
            versions.absent_checks = absent_checks;
            if absent_checks >= MAX_ABSENT_CHECKS {
                self.changed.push(name.clone());
            }
        }
        self.store.cities.retain(|_, versions| versions.absent_checks < MAX_ABSENT_CHECKS);
    }

    fn close_older(&mut self, retention: RetentionPolicy) {
        for versions in self.store.cities.values_mut() {
            let before = versions.older.len();
            versions.older.retain(|(_, replaced)| replaced.elapsed() < retention.time);
            self.closed += before - versions.older.len();
        }
    }
}
