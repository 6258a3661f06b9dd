//! Checks whether cities were replaced, added or removed, and opens the new ones.
//!
//! A city that cannot be opened does not replace the version that is served. The start of a server is the first check, at which no
//! city is known yet.

use super::cities::{CityFolders, RetentionPolicy, Store, StoreReload, city_folders};
use super::city::{CityStamp, CityStore};
use super::error::StoreError;
use super::remote::RemoteCity;
use futures_util::{StreamExt as _, stream};
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Consecutive checks that must miss a city, or its whole folder, before it is removed: `bake` replaces a folder by two renames.
const MAX_ABSENT_CHECKS: u32 = 3;

/// Remote cities that are asked for at the same time.
const REMOTES_AT_ONCE: usize = 16;

impl Store {
    /// Checks all folders and, if `include_remote`, all remote cities.
    pub async fn reload(&self, retention: RetentionPolicy, include_remote: bool) -> StoreReload {
        let store = self.clone();
        let checked = tokio::task::spawn_blocking(move || store.check_folders(retention)).await;
        // The task fails only if it is cancelled at the end of the process.
        let unchanged = || (StoreReload::unchanged(self), self.cities.keys().cloned().collect());
        let (mut reload, mut seen) = checked.unwrap_or_else(|_| unchanged());
        let local = reload.failures.len();
        for (remote, opened) in self.check_remotes(include_remote).await {
            seen.extend(self.known(remote).map(|(name, _)| name.clone()));
            match opened {
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
        let texts = |failures: &[StoreError]| failures.iter().map(ToString::to_string).collect();
        let (local, remote) = reload.failures.split_at(local);
        let remote = if include_remote { texts(remote) } else { Arc::clone(&self.failures[1]) };
        let failures = [texts(local), remote, Arc::clone(&self.failures[2])];
        reload.failures_changed = failures != self.failures;
        reload.store.failures = failures;
        reload
    }

    /// The city of a URL, if it could be opened.
    fn known(&self, remote: &RemoteCity) -> Option<(&String, &CityStamp)> {
        let known = self.cities.iter().find(|(_, versions)| versions.current.location() == remote.url);
        known.map(|(name, versions)| (name, &versions.current.stamp))
    }

    /// Opens the remote cities that have changed; none if not `must_ask`. A store that does not respond delays the others little.
    async fn check_remotes(&self, must_ask: bool) -> Vec<(&RemoteCity, Result<Option<CityStore>, StoreError>)> {
        let checks = self.remotes.iter().map(|remote| {
            let known = self.known(remote).map(|(_, stamp)| stamp);
            async move { (remote, if must_ask { remote.open(known).await } else { Ok(None) }) }
        });
        let checks: Vec<_> = checks.collect();
        stream::iter(checks).buffered(REMOTES_AT_ONCE).collect().await
    }

    /// Checks all folders, which reads the disk. Also returns the names of the cities that exist.
    pub(super) fn check_folders(&self, retention: RetentionPolicy) -> (StoreReload, BTreeSet<String>) {
        let mut reload = StoreReload::unchanged(self);
        let mut seen = BTreeSet::new();
        let folders =
            self.cities.iter().filter_map(|(name, city)| Some((city.current.folder()?.to_owned(), name.clone())));
        let known: BTreeMap<PathBuf, String> = folders.collect();
        // The places may name a folder twice.
        let mut checked: BTreeMap<PathBuf, Option<String>> = BTreeMap::new();
        let has_known = |folder: &PathBuf| known.keys().any(|at| at.starts_with(folder));
        for folder in &self.folders {
            match city_folders(folder, &self.reads) {
                Ok(CityFolders { cities, unreadable }) => {
                    if cities.is_empty() && !has_known(folder) {
                        reload.failures.push(StoreError::NoCity(folder.clone()));
                    }
                    for city in cities {
                        if let Some(name) = checked.get(&city) {
                            let [first, second] = [&city; 2].map(|city| city.display().to_string());
                            let same = |name: &String| StoreError::SameName { name: name.clone(), first, second };
                            reload.failures.extend(name.as_ref().map(same));
                            continue;
                        }
                        let name = reload.check_folder(&city, known.get(&city), retention);
                        seen.extend(name.clone());
                        checked.insert(city, name);
                    }
                    // A city that cannot be looked at stays open.
                    for (path, error) in unreadable {
                        seen.extend(known.get(&path).cloned());
                        reload.failures.push(error);
                    }
                }
                // The folder is gone, and its cities with it. `bake` replaces a city by two renames, so that is no failure yet.
                Err(StoreError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound && has_known(folder) => {
                }
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
        let (changed, failures) = (Vec::new(), Vec::new());
        Self { store: store.clone(), changed, closed: 0, failures, absences_changed: false, failures_changed: false }
    }

    /// The store, if everything could be opened. Fails with the first failure.
    pub fn complete(self) -> Result<Store, StoreError> {
        self.failures.into_iter().next().map_or(Ok(self.store), Err)
    }

    /// The store, unless nothing could be opened. Fails with the first failure then.
    pub fn usable(self) -> Result<Store, StoreError> {
        if self.store.cities.is_empty() { self.complete() } else { Ok(self.store) }
    }

    /// Whether [`Self::store`] differs from the store that was checked.
    pub fn must_replace(&self) -> bool {
        !self.changed.is_empty() || self.closed > 0 || self.absences_changed || self.failures_changed
    }

    /// Opens the city in a folder if it has changed. `known` is the city that was opened from there. Returns the city that exists.
    fn check_folder(&mut self, folder: &Path, known: Option<&String>, retention: RetentionPolicy) -> Option<String> {
        let stamp = known.and_then(|name| self.store.city(name)).map(|city| city.stamp.clone());
        match self.store.reads.changed_city(folder, stamp) {
            Ok(None) => known.cloned(),
            Ok(Some(city)) => {
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

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::small_city;

    #[test]
    fn a_start_serves_the_others_while_a_disk_hangs() {
        let root = tempfile::tempdir().unwrap();
        let [good, hung] = ["good", "hung"].map(|name| root.path().join(name));
        small_city::write_city(&good, "good");
        small_city::write_city(&hung, "hung");
        let store = Store { folders: vec![root.path().to_owned()], ..Store::default() };
        let end = store.reads.hang(&hung);
        let (started, _) = store.check_folders(RetentionPolicy::default());
        let names = |store: &Store| store.cities().map(|city| city.manifest().name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&started.store), ["good"]);
        assert!(matches!(&started.failures[..], [StoreError::NoResponse(folder)] if *folder == hung));
        end.send(CityStore::open(&hung).map(Some)).unwrap();
        let (next, _) = started.store.check_folders(RetentionPolicy::default());
        assert_eq!(names(&next.store), ["good", "hung"]);
        assert!(next.failures.is_empty(), "{:?}", next.failures);
    }
}
