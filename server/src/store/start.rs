//! Opens cities for the first time: the check of a store that knows none yet.

use super::cities::{RetentionPolicy, Store, StoreReload};
use super::error::StoreError;
use super::remote::RemoteCity;
use super::requests::{StoreMetrics, StoreRequests};
use crate::config::BlockCacheConfig;
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
