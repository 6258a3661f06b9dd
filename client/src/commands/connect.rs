//! From what was typed as a place to a city's manifest and the source of its tiles.
//!
//! In: a server, a plain host or a folder; `--city`, `--disk-cache-mib`. Out: [`City`]. Next: `session`.

use crate::{
    args::Global,
    error::{ClientError, Result},
    stream::{
        fetch::Http,
        source::{
            Source,
            disk::{self, Disk},
            folder,
            server::Server,
            web,
        },
    },
};
use insula_protocol::{
    Manifest,
    manifest::is_name,
    route::{self, CITIES},
};
use insula_viewer::{scene::tile::retry_delay, streamer::FetchError};
use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

/// Largest manifest or list.
const LIMIT_BYTES: usize = 4 << 20;
/// The manifest in a city's folder.
const MANIFEST: &str = "city.json";
/// A city that is on disk opens without the network after so long without an answer.
const OFFLINE: Duration = Duration::from_secs(2);

/// A city that can be streamed.
#[derive(Debug, Clone)]
pub struct City {
    /// Its address for links: `http://host:port/v1/cities/NAME`, or of a plain host; empty for a folder.
    pub address: String,
    /// Checked.
    pub manifest: Manifest,
    /// Its tiles.
    pub source: Arc<dyn Source>,
}

/// What was typed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// An Insula server, and the city if it is named.
    Server {
        /// `http://host:port`.
        base: String,
        /// Which city.
        name: Option<String>,
        /// Nothing but a host was typed: the city may lie there as plain files.
        bare: bool,
    },
    /// A city's folder on a plain host, an address without a slash at its end.
    Web(String),
    /// A city's folder on this machine.
    Folder(PathBuf),
}

impl Place {
    /// Reads a place. Errors: it is none.
    pub fn parse(text: &str) -> Result<Self> {
        let wrong = || {
            ClientError::Usage(format!(
                "{text}: not a city: write http://host:port, http://host:port{CITIES}/NAME, the address of a baked folder \
                 on any host that answers ranges, or a baked folder's path"
            ))
        };
        let Some(scheme_end) = text.find("://").map(|at| at + 3) else {
            let path = Path::new(text);
            let folder = if path.ends_with(MANIFEST) { path.parent().unwrap_or(path) } else { path };
            return if folder.join(MANIFEST).is_file() { Ok(Self::Folder(folder.to_owned())) } else { Err(wrong()) };
        };
        if !["http://", "https://"].contains(&text[..scheme_end].to_lowercase().as_str()) {
            return Err(wrong());
        }
        let host_end = text[scheme_end..].find('/').map_or(text.len(), |at| at + scheme_end);
        let (base, path) = text.split_at(host_end);
        if base.len() == scheme_end || text.contains(|c: char| c.is_whitespace() || c.is_control() || "?#".contains(c))
        {
            return Err(wrong());
        }
        let path = path.trim_end_matches('/');
        let name = match path.strip_prefix(CITIES) {
            Some("") => None,
            Some(name) => match name.strip_prefix('/') {
                Some(name) if is_name(name) => Some(name.to_owned()),
                _ => return Err(wrong()),
            },
            None if path.is_empty() => None,
            None => {
                let folder = path.strip_suffix(MANIFEST).map_or(path, |folder| folder.trim_end_matches('/'));
                return Ok(Self::Web(format!("{base}{folder}")));
            }
        };
        Ok(Self::Server { base: base.to_owned(), name, bare: path.is_empty() })
    }
}

/// Finds the city: the one that is named, or the only one.
pub fn connect(http: &Arc<Http>, text: &str, global: &Global) -> Result<City> {
    let disk = match global.disk_cache_mib {
        Some(mib) => Some(Arc::new(disk::Folder::of_user(u64::from(mib) << 20)?)),
        None => None,
    };
    let asker = Asker { http, disk, timeout: Duration::from_secs(u64::from(global.timeout)) };
    match Place::parse(text)? {
        Place::Folder(path) => {
            let file = path.join(MANIFEST);
            let about = std::fs::metadata(&file).map_err(ClientError::file(&file))?;
            if about.len() > LIMIT_BYTES as u64 {
                return Err(ClientError::Failed(format!("{}: too long for a manifest", file.display())));
            }
            let text = std::fs::read(&file).map_err(ClientError::file(&file))?;
            let manifest = read(&file.display().to_string(), &text)?;
            named(&manifest, global)?;
            Ok(City { address: String::new(), manifest, source: Arc::new(folder::open(&path, http)) })
        }
        Place::Web(base) => asker.web(base, global),
        Place::Server { base, name, bare } => {
            if let (Some(a), Some(b)) = (&name, &global.city)
                && a != b
            {
                return Err(ClientError::Usage(format!("{text} names {a}, --city names {b}: leave one out")));
            }
            let name = match name.or_else(|| global.city.clone()) {
                Some(name) if is_name(&name) => name,
                Some(name) => {
                    return Err(ClientError::Usage(format!("--city {name}: not a name: use a-z, 0-9, _ and -")));
                }
                None => match asker.get(&format!("{base}{CITIES}"))? {
                    Some(list) => only_city(&base, &list)?,
                    None if bare => return asker.web(base, global),
                    None => return Err(asker.none(&format!("{base}{CITIES}"))),
                },
            };
            let url = format!("{base}{}", route::manifest(&name));
            let text = asker.get(&url)?.ok_or_else(|| asker.none(&url))?;
            let manifest = read(&url, &text)?;
            let source = Arc::new(Server::new(http.clone(), &base, &manifest));
            Ok(asker.city(url, manifest, source))
        }
    }
}

/// Whether `--city` agrees.
fn named(manifest: &Manifest, global: &Global) -> Result<()> {
    match &global.city {
        Some(name) if *name != manifest.name => {
            Err(ClientError::Usage(format!("the city there is {}, --city names {name}: leave it out", manifest.name)))
        }
        _ => Ok(()),
    }
}

fn read(place: &str, text: &[u8]) -> Result<Manifest> {
    let wrong = |e: &dyn std::fmt::Display| ClientError::Server(format!("{place}: this manifest cannot be used: {e}"));
    let manifest: Manifest = serde_json::from_slice(text).map_err(|e| wrong(&e))?;
    manifest.check().map_err(|e| wrong(&e))?;
    Ok(manifest)
}

/// Asks a host for small files.
struct Asker<'a> {
    http: &'a Arc<Http>,
    disk: Option<Arc<disk::Folder>>,
    timeout: Duration,
}

impl Asker<'_> {
    fn web(&self, base: String, global: &Global) -> Result<City> {
        let url = format!("{base}/{MANIFEST}");
        let text = self.get(&url)?.ok_or_else(|| self.none(&url))?;
        let manifest = read(&url, &text)?;
        named(&manifest, global)?;
        let source = Arc::new(web::open(&base, self.http));
        Ok(self.city(format!("{base}/"), manifest, source))
    }

    fn city(&self, address: String, manifest: Manifest, source: Arc<dyn Source>) -> City {
        let source = match &self.disk {
            Some(folder) => Arc::new(Disk::new(source, folder.clone(), &manifest)),
            None => source,
        };
        City { address, manifest, source }
    }

    fn none(&self, url: &str) -> ClientError {
        ClientError::Server(format!("{url}: there is no such city: see the list at {CITIES}"))
    }

    /// Retries until the timeout: a server that is being started is worth waiting for. `None` if there is no such thing.
    /// What was got once, and was to be kept, is got from the disk if nobody answers.
    fn get(&self, url: &str) -> Result<Option<bytes::Bytes>> {
        let start = Instant::now();
        let kept_as = format!("manifest-{}", blake3::hash(url.as_bytes()).to_hex());
        let kept = self.disk.as_ref().and_then(|disk| disk.read(&kept_as));
        let timeout = if kept.is_some() { OFFLINE.min(self.timeout) } else { self.timeout };
        let mut attempts = 0u8;
        loop {
            match self.http.block_on(self.http.get(url, LIMIT_BYTES)) {
                Ok(bytes) => {
                    if let Some(disk) = &self.disk {
                        disk.replace(&kept_as, &bytes);
                    }
                    return Ok(Some(bytes));
                }
                Err(FetchError::Missing) => return Ok(None),
                Err(error) => {
                    attempts = attempts.saturating_add(1);
                    let wait = retry_delay(attempts, crate::stream::jitter());
                    if start.elapsed() + wait <= timeout {
                        std::thread::sleep(wait);
                        continue;
                    }
                    if let Some(kept) = kept {
                        eprintln!("note: {url}: no answer ({error}); what was fetched before is shown");
                        return Ok(Some(kept));
                    }
                    let secs = timeout.as_secs();
                    return Err(ClientError::Server(format!(
                        "{url}: no answer for {secs} s ({error}): check the address and that the server runs"
                    )));
                }
            }
        }
    }
}

/// Reads the list of cities: names, or objects with a `name`, bare or under `cities`.
fn names(list: &serde_json::Value) -> Option<Vec<String>> {
    let list = list.get("cities").unwrap_or(list).as_array()?;
    let name = |entry: &serde_json::Value| entry.as_str().or_else(|| entry.get("name")?.as_str()).map(str::to_owned);
    list.iter().map(name).collect()
}

fn only_city(base: &str, text: &[u8]) -> Result<String> {
    let list: Option<serde_json::Value> = serde_json::from_slice(text).ok();
    let mut names = list.as_ref().and_then(names).unwrap_or_default();
    match (names.pop(), names.is_empty()) {
        (Some(name), true) if is_name(&name) => Ok(name),
        (Some(last), false) => {
            names.push(last);
            let names = names.join(", ");
            Err(ClientError::Usage(format!("{base} has several cities: name one with --city: {names}")))
        }
        _ => Err(ClientError::Server(format!("{base}: serves no city, or is no Insula server: check the address"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places() {
        let server = |base: &str, name: Option<&str>, bare| Place::Server {
            base: base.into(),
            name: name.map(str::to_owned),
            bare,
        };
        let ok = |text: &str| Place::parse(text).unwrap();
        assert_eq!(ok("http://h:1"), server("http://h:1", None, true));
        assert_eq!(ok("http://h:1/"), server("http://h:1", None, true));
        assert_eq!(ok("https://h/v1/cities/"), server("https://h", None, false));
        assert_eq!(ok("http://h:1/v1/cities/the_hague"), server("http://h:1", Some("the_hague"), false));
        for web in ["https://h/maps/delft", "https://h/maps/delft/", "https://h/maps/delft/city.json"] {
            assert_eq!(ok(web), Place::Web("https://h/maps/delft".into()));
        }
        for wrong in [
            "h:1",
            "ftp://h",
            "http://",
            "http://h/v1/cities/A",
            "http://h/v1/cities/a/b",
            "http://a b",
            "nowhere",
            "http://h/x?y",
        ] {
            assert_eq!(Place::parse(wrong).unwrap_err().exit_code(), 2, "{wrong}");
        }
    }

    #[test]
    fn lists() {
        let one = |text: &str| only_city("http://h", text.as_bytes());
        assert_eq!(one(r#"["delft"]"#).unwrap(), "delft");
        assert_eq!(one(r#"{"cities":[{"name":"delft","title":"Delft"}]}"#).unwrap(), "delft");
        let several = one(r#"[{"name":"a"},{"name":"b"}]"#).unwrap_err();
        assert!(several.to_string().contains("a, b") && several.exit_code() == 2, "{several}");
        for wrong in ["[]", "<html>", "{}", r#"[{"title":"x"}]"#, r#"["../x"]"#] {
            assert_eq!(one(wrong).unwrap_err().exit_code(), 1, "{wrong}");
        }
    }
}
