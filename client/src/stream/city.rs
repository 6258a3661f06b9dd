//! Opens a city: reads its manifest and finds the source of its tiles.

use super::fetch::Http;
use super::jitter::jitter;
use super::location::{CityLocation, page_of};
use super::source::disk::CachedCity;
use super::source::folder;
use crate::error::{ClientError, ListedCity, Result};
use bytes::Bytes;
use insula_archive::city::{MANIFEST_FILE, parse_manifest, read_manifest};
use insula_archive::disk_cache::DiskCache;
use insula_protocol::Manifest;
use insula_protocol::name::is_name;
use insula_protocol::route::{self, CITIES, without_secrets};
use insula_protocol::text::printable;
use insula_viewer::scene::tile::retry_delay;
use insula_viewer::source::server::ServerSource;
use insula_viewer::source::{FetchError, ObjectSource, Transport, web_folder};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Size of the largest manifest or list of cities.
const MAX_MANIFEST_BYTES: usize = 4 << 20;
/// Most cities that are offered to choose from.
const MAX_LISTED: usize = 1000;
/// A city in the disk cache opens offline after this time without a response.
const OFFLINE_AFTER: Duration = Duration::from_secs(2);

/// A city that can be streamed.
#[derive(Debug, Clone)]
pub struct OpenedCity {
    /// URL for view links: `http://host:port/v1/cities/NAME`, or that of a web folder, without a user; empty for a local folder.
    pub address: String,
    /// Checked manifest.
    pub manifest: Manifest,
    pub source: Arc<dyn ObjectSource>,
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
    let mut opener = CityOpener { http, options, query: String::new() };
    match location {
        CityLocation::Folder(path) => opener.local_folder(&path),
        CityLocation::WebFolder(base) => opener.web_folder(&base),
        CityLocation::Server { base, name, share, is_bare_host } => {
            opener.query = share.map(|share| format!("?share={share}")).unwrap_or_default();
            opener.server(&base, name, is_bare_host)
        }
    }
}

struct CityOpener<'a> {
    http: &'a Arc<Http>,
    options: &'a OpenOptions,
    /// Appended to each address that is requested, and shown in no message: the share link, or empty.
    query: String,
}

impl CityOpener<'_> {
    fn local_folder(&self, path: &Path) -> Result<OpenedCity> {
        let manifest = read_manifest(path).map_err(|error| ClientError::Failed(error.to_string()))?;
        self.check_name(&manifest)?;
        let source = folder::open(path, &manifest, self.http);
        Ok(OpenedCity { address: String::new(), manifest, source: Arc::new(source) })
    }

    fn web_folder(&self, base: &str) -> Result<OpenedCity> {
        let url = format!("{base}/{MANIFEST_FILE}");
        let missing =
            || format!("{url}: no city here: give the URL of a baked city's folder, which has a {MANIFEST_FILE}");
        let json = match (self.fetch(&url)?, page_of(base)) {
            (Some(json), _) => json,
            // The page of a server has no files beside it.
            (None, Some((server, name))) => return self.server(server, Some(name), false),
            (None, None) => return Err(ClientError::Server(missing())),
        };
        let manifest = read_fetched(&url, &json)?;
        self.check_name(&manifest)?;
        let source = Arc::new(web_folder::open(base, &manifest, &self.transport()));
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
                None => {
                    let advice = "no list of cities here, so this is no Insula server: check the address";
                    return Err(ClientError::Server(format!("{base}{CITIES}: {advice}")));
                }
            },
        };
        let url = format!("{base}{}", route::manifest(&name));
        let missing = || format!("{url}: no such city: see the list at {base}{CITIES}");
        let manifest = self.fetch_manifest(&url, missing)?;
        if manifest.name != name {
            return Err(ClientError::Server(format!(
                "{url}: the server sent city {} instead: check the address, and do not trust this server",
                manifest.name
            )));
        }
        let source = Arc::new(ServerSource::new(self.transport(), base, &self.query, &manifest));
        Ok(self.with_disk_cache(url, manifest, source))
    }

    fn transport(&self) -> Arc<dyn Transport> {
        self.http.clone()
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

    fn with_disk_cache(&self, address: String, manifest: Manifest, source: Arc<dyn ObjectSource>) -> OpenedCity {
        let source = match &self.options.disk_cache {
            Some(folder) => Arc::new(CachedCity::new(source, folder.clone(), &address, &manifest)),
            None => source,
        };
        OpenedCity { address: without_secrets(&address).into_owned(), manifest, source }
    }

    /// `missing` is the message if there is no such file.
    fn fetch_manifest(&self, url: &str, missing: impl FnOnce() -> String) -> Result<Manifest> {
        read_fetched(url, &self.fetch(url)?.ok_or_else(|| ClientError::Server(missing()))?)
    }

    /// Fetches a small file. Fails at `deadline` even if the response is still arriving.
    async fn get_until(&self, deadline: Instant, url: &str) -> Result<Bytes, FetchError> {
        let response = tokio::time::timeout_at(deadline.into(), self.http.get(url, MAX_MANIFEST_BYTES)).await;
        response.unwrap_or_else(|_| Err(FetchError::Network("the response is too slow".into())))
    }

    /// Fetches a small file, with retries until the timeout because the server may be starting. Whatever the server does, this
    /// ends with the timeout. `None` if there is no such file. If the server does not respond, returns the copy in the disk
    /// cache.
    fn fetch(&self, url: &str) -> Result<Option<Bytes>> {
        let start = Instant::now();
        let OpenOptions { disk_cache, timeout, .. } = self.options;
        let cache_name = format!("manifest-{}", blake3::hash(url.as_bytes()).to_hex());
        let cached = disk_cache.as_ref().and_then(|disk| disk.read(&cache_name));
        let timeout = if cached.is_some() { OFFLINE_AFTER.min(*timeout) } else { *timeout };
        let mut attempts = 0u8;
        let request_url = format!("{url}{}", self.query);
        loop {
            match self.http.block_on(self.get_until(start + timeout, &request_url)) {
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
                    let wait = retry_delay(attempts, error.retry_after(), jitter());
                    let is_final = matches!(error, FetchError::Unusable(_));
                    if !is_final && start.elapsed().saturating_add(wait) <= timeout {
                        std::thread::sleep(wait);
                        continue;
                    }
                    if let Some(cached) = cached {
                        let note = format!("note: {url}: no response ({error}), using the disk cache");
                        eprintln!("{}", printable(&note));
                        return Ok(Some(cached));
                    }
                    if is_final {
                        return Err(ClientError::Server(error.to_string()));
                    }
                    let secs = timeout.as_secs();
                    return Err(ClientError::NoResponse(format!(
                        "{url}: no response for {secs} s ({error}): check the address and that the server runs"
                    )));
                }
            }
        }
    }
}

fn read_fetched(url: &str, json: &[u8]) -> Result<Manifest> {
    parse_manifest(json).map_err(|error| ClientError::Server(format!("{url}: invalid manifest: {error}")))
}

/// The city of a server that has only one. Fails if it has several or none.
fn only_city(base: &str, list: &[u8]) -> Result<String> {
    let list: Option<serde_json::Value> = serde_json::from_slice(list).ok();
    let mut cities = list.as_ref().and_then(listed_cities).unwrap_or_default();
    cities.retain(|city| is_name(&city.name));
    match &mut cities[..] {
        [] => {
            let text = format!("{base}: serves no city, or is no Insula server: check the address");
            Err(ClientError::Server(text))
        }
        [only] => Ok(std::mem::take(&mut only.name)),
        _ => Err(ClientError::SeveralCities { base: base.to_owned(), cities }),
    }
}

/// A list of cities: names or objects, as an array or under `cities`. At most [`MAX_LISTED`] are taken.
fn listed_cities(list: &serde_json::Value) -> Option<Vec<ListedCity>> {
    let list = list.get("cities").unwrap_or(list).as_array()?;
    let city = |entry: &serde_json::Value| match entry.as_str() {
        Some(name) => Some(ListedCity { name: name.to_owned(), ..ListedCity::default() }),
        None => serde_json::from_value(entry.clone()).ok(),
    };
    list.iter().take(MAX_LISTED).map(city).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::http;
    use std::io::Write;

    /// Answers every request with `head` and then a byte of `body` each `pause`, until the client gives up.
    fn serve_slowly(head: &'static str, body: Vec<u8>, pause: Duration) -> String {
        let address = http::serve(move |_, stream| {
            stream.write_all(head.as_bytes()).ok()?;
            let sent = body.iter().try_for_each(|byte| {
                std::thread::sleep(pause);
                stream.write_all(&[*byte])
            });
            sent.ok()?;
            // Each response ends its connection.
            None
        });
        format!("http://{address}")
    }

    fn open(base: &str, name: Option<&str>, timeout: Duration) -> Result<OpenedCity> {
        let http = Arc::new(Http::new(None).unwrap());
        let location =
            CityLocation::Server { base: base.into(), name: name.map(str::to_owned), is_bare_host: false, share: None };
        open_city(&http, location, &OpenOptions { city: None, disk_cache: None, timeout })
    }

    #[test]
    fn slow_and_busy_servers_are_given_up_at_the_timeout() {
        let timeout = Duration::from_millis(700);
        let drip = "HTTP/1.1 200 OK\r\ncontent-length: 4000\r\n\r\n";
        let busy = "HTTP/1.1 503 Busy\r\nretry-after: 99999999\r\nconnection: close\r\ncontent-length: 0\r\n\r\n";
        for (head, bytes) in [(drip, 4000), (busy, 0)] {
            let base = serve_slowly(head, vec![b' '; bytes], Duration::from_millis(20));
            for name in [None, Some("town")] {
                let begin = Instant::now();
                assert_eq!(open(&base, name, timeout).unwrap_err().exit_code(), 1);
                // All of the bytes would take 80 s.
                assert!(begin.elapsed() < Duration::from_secs(60), "{name:?}: {:?}", begin.elapsed());
            }
        }
    }

    #[test]
    fn missing_cities_are_explained_by_what_the_address_is() {
        let base = serve_slowly(
            "HTTP/1.1 404 Not Found\r\nconnection: close\r\ncontent-length: 0\r\n\r\n",
            vec![],
            Duration::ZERO,
        );
        let http = Arc::new(Http::new(None).unwrap());
        let message = |place: &str| {
            let location = CityLocation::parse(format!("{base}{place}")).unwrap();
            let options = OpenOptions { city: None, disk_cache: None, timeout: Duration::from_secs(5) };
            open_city(&http, location, &options).unwrap_err().to_string()
        };
        let list = format!("{base}/v1/cities");
        assert!(message("/v1/cities/town").ends_with(&format!("see the list at {list}")));
        for (place, advice) in
            [("/maps/delft", "has a city.json"), ("", "has a city.json"), ("/v1/cities", "check the address")]
        {
            let message = message(place);
            assert!(message.ends_with(advice) && !message.contains("see the list"), "{message}");
        }
    }

    #[test]
    fn a_page_with_a_wrong_capital_opens_its_city() {
        let manifest = serde_json::to_vec(&insula_test_support::small_city::empty_manifest(3)).unwrap();
        let address = http::serve(move |request, stream| {
            let (status, body) = match request.target() {
                "/v1/cities/test" => ("200 OK", &manifest[..]),
                _ => ("404 Not Found", &b""[..]),
            };
            let head = format!("HTTP/1.1 {status}\r\nconnection: close\r\ncontent-length: {}\r\n\r\n", body.len());
            stream.write_all(&[head.as_bytes(), body].concat()).ok()?;
            None
        });
        let http = Arc::new(Http::new(None).unwrap());
        let location = CityLocation::parse(format!("http://{address}/cities/Test")).unwrap();
        let options = OpenOptions { city: None, disk_cache: None, timeout: Duration::from_secs(5) };
        let opened = open_city(&http, location, &options).unwrap();
        assert_eq!(opened.address, format!("http://{address}/v1/cities/test"));
    }

    #[test]
    fn a_manifest_of_another_city_is_refused() {
        let manifest = insula_test_support::small_city::empty_manifest(3);
        let body = serde_json::to_vec(&manifest).unwrap();
        let head = "HTTP/1.1 200 OK\r\nconnection: close\r\n\r\n";
        let serve = || serve_slowly(head, body.clone(), Duration::ZERO);
        let error = open(&serve(), Some("town"), Duration::from_secs(5)).unwrap_err();
        assert!(error.to_string().contains("sent city test instead"), "{error}");
    }

    #[test]
    fn pictures_and_links_name_no_user() {
        let body = serde_json::to_vec(&insula_test_support::small_city::empty_manifest(3)).unwrap();
        let base = serve_slowly("HTTP/1.1 200 OK\r\nconnection: close\r\n\r\n", body, Duration::ZERO);
        let opened = open(&base.replace("//", "//me:secret@"), Some("test"), Duration::from_secs(5)).unwrap();
        assert_eq!(opened.address, format!("{base}/v1/cities/test"));
    }

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
