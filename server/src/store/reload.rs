//! Looks whether cities were replaced, added or removed, and opens what is new.
//!
//! In: a [`Store`]. Out: the next one, with the older versions that clients may still ask for. Next: `http` swaps them.
//!
//! What cannot be opened changes nothing: the city that is served goes on.

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

/// Looks at which a city is missing before it is given up: `bake` replaces a folder by two renames.
const ABSENT_LOOKS: u32 = 3;

/// How long older versions are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RetentionPolicy {
    /// After they were replaced.
    pub time: Duration,
    /// Of one city.
    pub versions: usize,
}

/// What a look found.
#[derive(Debug)]
pub struct StoreReload {
    /// What to serve from now on.
    pub store: Store,
    /// Names of cities with another version than before, new and gone ones too.
    pub changed: Vec<String>,
    /// Older versions that were closed.
    pub closed: usize,
    /// What could not be opened.
    pub failures: Vec<StoreError>,
}

impl Store {
    /// Looks at all folders, and at stores too if `far`.
    pub async fn reload(&self, keep: RetentionPolicy, far: bool) -> StoreReload {
        let near = self.clone();
        // An error is a task that was cancelled at the end of the process: nothing has changed.
        let unchanged = || (StoreReload::of(self), self.cities.keys().cloned().collect());
        let looked = tokio::task::spawn_blocking(move || near.look_near(keep)).await;
        let (mut look, mut seen) = looked.unwrap_or_else(|_| unchanged());
        for remote in &self.remotes {
            let known = self.cities.iter().find(|(_, versions)| versions.current.location() == remote.url());
            seen.extend(known.map(|(name, _)| name.clone()));
            if !far {
                continue;
            }
            match remote.open(known.map(|(_, versions)| versions.current.stamp())).await {
                Ok(Some(city)) => {
                    let name = city.manifest().name.clone();
                    if look.replace(name.clone(), city, keep) {
                        seen.push(name);
                    }
                }
                Ok(None) => {}
                Err(error) => look.failures.push(error),
            }
        }
        look.drop_absent(&seen);
        look.close_old(keep);
        look
    }

    /// Looks at all folders: it reads the disk. Also the names of what is there.
    fn look_near(&self, keep: RetentionPolicy) -> (StoreReload, Vec<String>) {
        let mut look = StoreReload::of(self);
        let mut seen = Vec::new();
        for folder in &self.folders {
            match city_folders(folder) {
                Ok(cities) => cities.iter().for_each(|city| look.at(city, keep, &mut seen)),
                // Everything that came from there stays.
                Err(error) => {
                    seen.extend(self.names_below(folder));
                    look.failures.push(error);
                }
            }
        }
        (look, seen)
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
    fn of(store: &Store) -> Self {
        Self { store: store.clone(), changed: Vec::new(), closed: 0, failures: Vec::new() }
    }

    fn at(&mut self, folder: &Path, keep: RetentionPolicy, seen: &mut Vec<String>) {
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
                if self.replace(name.clone(), city, keep) {
                    seen.push(name);
                }
            }
            Err(error) => {
                seen.extend(known.map(|(name, _)| name));
                self.failures.push(error);
            }
        }
    }

    /// Whether the city is served now.
    fn replace(&mut self, name: String, city: CityStore, keep: RetentionPolicy) -> bool {
        let Some(versions) = self.store.cities.get_mut(&name) else {
            self.changed.push(name);
            // There is none of that name.
            return self.store.insert(city).is_ok();
        };
        if versions.current.location() != city.location() {
            let (first, second) = (versions.current.location().to_owned(), city.location().to_owned());
            self.failures.push(StoreError::SameName { name, first, second });
            return true;
        }
        let other = versions.current.manifest().version != city.manifest().version;
        let replaced = std::mem::replace(&mut versions.current, Arc::new(city));
        if other {
            let version = versions.current.manifest().version.clone();
            versions.older.insert(0, (replaced, Instant::now()));
            versions.older.retain(|(older, _)| older.manifest().version != version);
            self.closed += versions.older.len().saturating_sub(keep.versions);
            versions.older.truncate(keep.versions);
        }
        // Files of the same content, touched or copied anew, are no news to clients.
        self.changed.push(name);
        true
    }

    fn drop_absent(&mut self, seen: &[String]) {
        for (name, versions) in &mut self.store.cities {
            versions.absent = if seen.contains(name) { 0 } else { versions.absent + 1 };
            if versions.absent >= ABSENT_LOOKS {
                self.changed.push(name.clone());
            }
        }
        self.store.cities.retain(|_, versions| versions.absent < ABSENT_LOOKS);
    }

    fn close_old(&mut self, keep: RetentionPolicy) {
        for versions in self.store.cities.values_mut() {
            let before = versions.older.len();
            versions.older.retain(|(_, replaced)| replaced.elapsed() < keep.time);
            self.closed += before - versions.older.len();
        }
    }
}
