//! Opens a city: reads its manifest and finds the source of its tiles.

use super::{
    fetch::Http,
    jitter::jitter,
    location::CityLocation,
    source::{TileSource, disk::CachedCity, folder, server::ServerSource, web},
};
use crate::error::{ClientError, Result};
use bytes::Bytes;
use insula_archive::{
    city::{MANIFEST_FILE, parse_manifest, read_manifest},
    disk_cache::DiskCache,
};
use insula_protocol::{
    Manifest,
    manifest::is_name,
    route::{self, CITIES},
};
use insula_viewer::{scene::tile::retry_delay, streamer::FetchError};
use std::{
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};

/// Size of the largest manifest or list of cities.
const MAX_MANIFEST_BYTES: usize = 4 << 20;
/// A city in the disk cache opens offline after this time without a response.
const OFFLINE_AFTER: Duration = Duration::from_secs(2);

/// A city that can be streamed.
#[derive(Debug, Clone)]
pub struct OpenedCity {
    /// URL for view links: `http://host:port/v1/cities/NAME`, or that of a web folder; empty for a local folder.
    pub address: String,
    /// Checked manifest.
    pub manifest: Manifest,
    pub source: Arc<dyn TileSource>,
}

/// Options of [`open_city`].
#[derive(Debug, Clone)]
pub struct OpenOptions {
    /// Name of the city (`--city`); needed if the server has several.
    pub city: Option<String>,
    /// Cache for manifests and tiles (`--disk-cache-mib`).
    pub disk_cache: Option<Arc<DiskCache>>,
    /// Retries a server for this time before failing.
    pub timeout: Duration,
}

/// Opens the city at `location`. Blocks until its manifest is read. Fails if the server does not respond, or if there is no
/// such city, or if the server has several and none is named.
pub fn open_city(http: &Arc<Http>, location: CityLocation, options: &OpenOptions) -> Result<OpenedCity> {
    let opener = CityOpener { http, options };
    match location {
        CityLocation::Folder(path) => opener.local_folder(&path),
        CityLocation::WebFolder(base) => opener.web_folder(&base),
        CityLocation::Server { base, name, is_bare_host } => opener.server(&base, name, is_bare_host),
    }
}

struct CityOpener<'a> {
    http: &'a Arc<Http>,
    options: &'a OpenOptions,
}

impl CityOpener<'_> {
    fn local_folder(&self, path: &Path) -> Result<OpenedCity> {
        let manifest = read_manifest(path).map_err(|error| ClientError::Failed(error.to_string()))?;
        self.check_name(&manifest)?;
        Ok(OpenedCity { address: String::new(), manifest, source: Arc::new(folder::open(path, self.http)) })
    }

    fn web_folder(&self, base: &str) -> Result<OpenedCity> {
        let url = format!("{base}/{MANIFEST_FILE}");
        let manifest = self.fetch_manifest(&url)?;
        self.check_name(&manifest)?;
        let source = Arc::new(web::open(base, self.http));
        Ok(self.with_disk_cache(format!("{base}/"), manifest, source))
    }

    fn server(&self, base: &str, name: Option<String>, is_bare_host: bool) -> Result<OpenedCity> {
        if let (Some(a), Some(b)) = (&name, &self.options.city)
            && a != b
        {
            return Err(ClientError::Usage(format!(
                "{base}{CITIES}/{a} names city {a}, --city names {b}: use one of them"
            )));
        }
        let name = match name.or_else(|| self.options.city.clone()) {
            Some(name) if is_name(&name) => name,
            Some(name) => {
                return Err(ClientError::Usage(format!("--city {name}: not a city name: use a-z, 0-9, _ and -")));
            }
            None => match self.fetch(&format!("{base}{CITIES}"))? {
                Some(list) => only_city(base, &list)?,
                None if is_bare_host => return self.web_folder(base),
                None => return Err(no_such_city(&format!("{base}{CITIES}"))),
            },
        };
        let url = format!("{base}{}", route::manifest(&name));
        let manifest = self.fetch_manifest(&url)?;
        let source = Arc::new(ServerSource::new(self.http.clone(), base, &manifest));
        Ok(self.with_disk_cache(url, manifest, source))
    }

    /// Fails if `--city` names another city.
    fn check_name(&self, manifest: &Manifest) -> Result<()> {
        match &self.options.city {
            Some(name) if *name != manifest.name => Err(ClientError::Usage(format!(
                "this location has city {}, --city names {name}: leave --city out",
                manifest.name
            ))),
            _ => Ok(()),
        }
    }

    fn with_disk_cache(&self, address: String, manifest: Manifest, source: Arc<dyn TileSource>) -> OpenedCity {
        let source = match &self.options.disk_cache {
            Some(folder) => Arc::new(CachedCity::new(source, folder.clone(), &manifest)),
            None => source,
        };
        OpenedCity { address, manifest, source }
    }

    fn fetch_manifest(&self, url: &str) -> Result<Manifest> {
        let json = self.fetch(url)?.ok_or_else(|| no_such_city(url))?;
        parse_manifest(&json).map_err(|error| ClientError::Server(format!("{url}: invalid manifest: {error}")))
    }

    /// Fetches a small file, with retries until the timeout because the server may be starting. `None` if there is no such
    /// file. If the server does not respond, returns the copy in the disk cache.
    fn fetch(&self, url: &str) -> Result<Option<Bytes>> {
        let start = Instant::now();
        let OpenOptions { disk_cache, timeout, .. } = self.options;
        let cache_name = format!("manifest-{}", blake3::hash(url.as_bytes()).to_hex());
        let cached = disk_cache.as_ref().and_then(|disk| disk.read(&cache_name));
        let timeout = if cached.is_some() { OFFLINE_AFTER.min(*timeout) } else { *timeout };
        let mut attempts = 0u8;
        loop {
            match self.http.block_on(self.http.get(url, MAX_MANIFEST_BYTES)) {
                Ok(bytes) => {
                    if let Some(disk) = disk_cache
                        && let Err(error) = disk.replace(&cache_name, &bytes)
                    {
                        tracing::debug!("{url} cannot be written to the disk cache: {error}");
                    }
                    return Ok(Some(bytes));
                }
                Err(FetchError::Missing) => return Ok(None),
                Err(error) => {
                    attempts = attempts.saturating_add(1);
                    let wait = retry_delay(attempts, None, jitter());
                    if start.elapsed() + wait <= timeout {
                        std::thread::sleep(wait);
                        continue;
                    }
                    if let Some(cached) = cached {
                        eprintln!("note: {url}: no response ({error}), using the disk cache");
                        return Ok(Some(cached));
                    }
                    let secs = timeout.as_secs();
                    return Err(ClientError::Server(format!(
                        "{url}: no response for {secs} s ({error}): check the address and that the server runs"
                    )));
                }
            }
        }
    }
}

fn no_such_city(url: &str) -> ClientError {
    ClientError::Server(format!("{url}: no such city: see the list at {CITIES}"))
}

/// The city of a server that has only one. Fails if it has several or none.
fn only_city(base: &str, list: &[u8]) -> Result<String> {
    let list: Option<serde_json::Value> = serde_json::from_slice(list).ok();
    let mut names = list.as_ref().and_then(city_names).unwrap_or_default();
    match (names.pop(), names.is_empty()) {
        (Some(name), true) if is_name(&name) => Ok(name),
        (Some(last), false) => {
            names.push(last);
            let names = names.join(", ");
            Err(ClientError::Usage(format!("{base} has several cities: choose one with --city: {names}")))
        }
        _ => Err(ClientError::Server(format!("{base}: serves no city, or is no Insula server: check the address"))),
    }
}

/// Names in a list of cities: strings or objects with a `name`, as an array or under `cities`.
fn city_names(list: &serde_json::Value) -> Option<Vec<String>> {
    let list = list.get("cities").unwrap_or(list).as_array()?;
    let name = |entry: &serde_json::Value| entry.as_str().or_else(|| entry.get("name")?.as_str()).map(str::to_owned);
    list.iter().map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_list_of_one_city_needs_no_name() {
        let only = |text: &str| only_city("http://h", text.as_bytes());
        assert_eq!(only(r#"["delft"]"#).unwrap(), "delft");
        assert_eq!(only(r#"{"cities":[{"name":"delft","title":"Delft"}]}"#).unwrap(), "delft");
        let several = only(r#"[{"name":"a"},{"name":"b"}]"#).unwrap_err();
        assert!(several.to_string().contains("a, b") && several.exit_code() == 2, "{several}");
        for invalid in ["[]", "<html>", "{}", r#"[{"title":"x"}]"#, r#"["../x"]"#] {
            assert_eq!(only(invalid).unwrap_err().exit_code(), 1, "{invalid}");
        }
    }
}
