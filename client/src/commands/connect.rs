//! From what was typed as a URL to a city's manifest.
//!
//! In: `http://host:port` or `http://host:port/v1/cities/NAME`, `--city`. Out: [`City`]. Next: `session`.

use crate::{
    args::Global,
    error::{ClientError, Result},
    scene::tile::wait_after,
    stream::fetch::{FetchError, Http},
};
use insula_protocol::{
    Manifest,
    manifest::is_name,
    route::{self, CITIES},
};
use std::{
    sync::Arc,
    time::{Duration, Instant},
};

/// Largest manifest or list.
const LIMIT_BYTES: usize = 4 << 20;

/// A city on a server.
#[derive(Debug, Clone)]
pub struct City {
    /// `http://host:port`.
    pub base: String,
    /// Checked.
    pub manifest: Manifest,
}

/// Splits a URL into the server's part and, if it names one, the city.
pub(crate) fn split(url: &str) -> Result<(String, Option<String>)> {
    let wrong =
        || ClientError::Usage(format!("{url}: not a server: write http://host:port or http://host:port{CITIES}/NAME"));
    let scheme_end = url.find("://").ok_or_else(wrong)? + 3;
    if !["http://", "https://"].contains(&url[..scheme_end].to_lowercase().as_str()) {
        return Err(wrong());
    }
    let host_end = url[scheme_end..].find('/').map_or(url.len(), |at| at + scheme_end);
    let (base, path) = url.split_at(host_end);
    if base.len() == scheme_end || base.contains(char::is_whitespace) {
        return Err(wrong());
    }
    let path = path.trim_end_matches('/');
    let city = match path.strip_prefix(CITIES) {
        Some("") => None,
        Some(name) => Some(name.trim_start_matches('/')),
        None if path.is_empty() => None,
        None => return Err(wrong()),
    };
    match city {
        Some(name) if !is_name(name) => Err(wrong()),
        city => Ok((base.to_owned(), city.map(str::to_owned))),
    }
}

/// Finds the city: the one that is named, or the only one.
pub fn connect(http: &Arc<Http>, url: &str, global: &Global) -> Result<City> {
    let (base, named) = split(url)?;
    if let (Some(a), Some(b)) = (&named, &global.city)
        && a != b
    {
        return Err(ClientError::Usage(format!("{url} names {a}, --city names {b}: leave one out")));
    }
    let timeout = Duration::from_secs(u64::from(global.timeout));
    let name = match named.or_else(|| global.city.clone()) {
        Some(name) if is_name(&name) => name,
        Some(name) => return Err(ClientError::Usage(format!("--city {name}: not a name: use a-z, 0-9, _ and -"))),
        None => only_city(&base, &get(http, &format!("{base}{CITIES}"), timeout)?)?,
    };
    let text = get(http, &format!("{base}{}", route::manifest(&name)), timeout)?;
    let wrong =
        |e: &dyn std::fmt::Display| ClientError::Server(format!("{base}: the manifest of {name} cannot be used: {e}"));
    let manifest: Manifest = serde_json::from_slice(&text).map_err(|e| wrong(&e))?;
    manifest.check().map_err(|e| wrong(&e))?;
    Ok(City { base, manifest })
}

/// Retries until `timeout`: a server that is being started is worth waiting for.
fn get(http: &Arc<Http>, url: &str, timeout: Duration) -> Result<bytes::Bytes> {
    let start = Instant::now();
    let mut attempts = 0u8;
    loop {
        match http.block_on(http.get(url, LIMIT_BYTES)) {
            Ok(bytes) => return Ok(bytes),
            Err(FetchError::Missing) => {
                return Err(ClientError::Server(format!("{url}: there is no such city: see the list at {CITIES}")));
            }
            Err(error) => {
                attempts = attempts.saturating_add(1);
                let wait = wait_after(attempts, crate::stream::queue::jitter());
                if start.elapsed() + wait > timeout {
                    let secs = timeout.as_secs();
                    return Err(ClientError::Server(format!(
                        "{url}: no answer for {secs} s ({error}): check the address and that the server runs"
                    )));
                }
                std::thread::sleep(wait);
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
    fn urls() {
        let ok = |url: &str| split(url).unwrap();
        assert_eq!(ok("http://h:1"), ("http://h:1".into(), None));
        assert_eq!(ok("http://h:1/"), ("http://h:1".into(), None));
        assert_eq!(ok("https://h/v1/cities/"), ("https://h".into(), None));
        assert_eq!(ok("http://h:1/v1/cities/the_hague"), ("http://h:1".into(), Some("the_hague".into())));
        for wrong in
            ["h:1", "ftp://h", "http://", "http://h/x", "http://h/v1/cities/A", "http://h/v1/cities/a/b", "http://a b"]
        {
            assert_eq!(split(wrong).unwrap_err().exit_code(), 2, "{wrong}");
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
