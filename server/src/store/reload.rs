//! Checks whether cities were replaced, added or removed, and opens the new ones.
//!
//! A city that cannot be opened does not replace the version that is served.

use super::{
    cities::{CityVersions, Store, city_folders},
    city::{CityStamp, CityStore},
    error::StoreError,
};
use std::{
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

/// Consecutive checks that must miss a city before it is removed: `bake` replaces a folder by two renames.
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
                        seen.push(name);
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
    fn check_folders(&self, retention: RetentionPolicy) -> (StoreReload, Vec<String>) {
        let mut reload = StoreReload::unchanged(self);
        let mut seen = Vec::new();
        for folder in &self.folders {
            match city_folders(folder) {
                Ok(cities) => cities.iter().for_each(|city| reload.check_folder(city, retention, &mut seen)),
                // All cities from this folder stay open.
                Err(error) => {
                    seen.extend(self.names_below(folder));
                    reload.failures.push(error);
                }
            }
        }
        (reload, seen)
    }

    fn names_below(&self, folder: &Path) -> Vec<String> {
        let below =
            self.cities.iter().filter(|(_, versions)| Path::new(versions.current.location()).starts_with(folder));
        below.map(|(name, _)| name.clone()).collect()
    }

    fn name_at(&self, folder: &Path) -> Option<(String, &CityVersions)> {
        let found = self.cities.iter().find(|(_, versions)| Path::new(versions.current.location()) == folder);
        found.map(|(name, versions)| (name.clone(), versions))
    }
}

impl StoreReload {
    fn unchanged(store: &Store) -> Self {
        Self { store: store.clone(), changed: Vec::new(), closed: 0, failures: Vec::new() }
    }

    /// Opens the city in a folder if it has changed.
    fn check_folder(&mut self, folder: &Path, retention: RetentionPolicy, seen: &mut Vec<String>) {
        let known = self.store.name_at(folder);
        if let Some((name, versions)) = &known
            && CityStamp::of(folder).is_ok_and(|stamp| stamp == *versions.current.stamp())
        {
            seen.push(name.clone());
            return;
        }
        match CityStore::open(folder) {
            Ok(city) => {
                let name = city.manifest().name.clone();
                if self.replace(name.clone(), city, retention) {
                    seen.push(name);
                }
            }
            Err(error) => {
                seen.extend(known.map(|(name, _)| name));
                self.failures.push(error);
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

    fn remove_absent(&mut self, seen: &[String]) {
        for (name, versions) in &mut self.store.cities {
            versions.absent_checks = if seen.contains(name) { 0 } else { versions.absent_checks + 1 };
            if versions.absent_checks >= MAX_ABSENT_CHECKS {
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
