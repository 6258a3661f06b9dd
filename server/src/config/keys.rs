//! Table of all settings: name, documentation, range, and conversion from and to text.

use super::network::Network;
use super::public_url::PublicUrl;
use super::settings::{CorsPolicy, DEFAULT_LISTEN, LogFormat, LogRequests, ServeConfig};
use super::site::{check_accent, check_imprint, check_title, checked_views};
use insula_protocol::name::is_name;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Every setting with its documentation, in the order of `--print-config`.
pub(super) const SETTINGS: [(&str, &str); 55] = [
    ("listen", "HOST:PORT; port 0 picks a free one"),
    ("metrics_address", "HOST:PORT of a listener for /healthz, /readyz and /metrics alone; \"\": all at listen"),
    (
        "public_url",
        "address at which people reach the server, as in \"https://example.org/city/\"; \"\": that of each request",
    ),
    ("threads", "number of worker threads; 0: one per core"),
    (
        "drain_notice_secs",
        "seconds at shutdown for which connections are still accepted after /readyz fails, so that load balancers notice",
    ),
    ("drain_secs", "seconds that requests in flight may take to finish at shutdown"),
    ("tls.certificate", "PEM file of the certificate and its chain; \"\": no TLS"),
    ("tls.key", "PEM file of the private key"),
    ("reload.watch_secs", "seconds between checks for changed cities; 0: only at SIGHUP"),
    ("reload.keep_secs", "seconds for which a replaced version is still served"),
    ("reload.keep_versions", "replaced versions per city that are still served"),
    ("limits.connections", "open connections; further ones are rejected with 503, except for health, and closed"),
    ("limits.client_connections", "open connections per client address; 0: three quarters of limits.connections"),
    ("limits.in_flight", "requests in flight, without health and metrics; further ones are rejected with 503"),
    ("limits.in_flight_bytes", "bytes of responses that wait to be sent; requests over it are rejected with 503"),
    ("limits.client_in_flight", "requests in flight per client address; 0: three quarters of limits.in_flight"),
    ("limits.client_in_flight_bytes", "the same for bytes; 0: three quarters of limits.in_flight_bytes"),
    (
        "limits.cache_bytes",
        "bytes of all caches: tiles, remote blocks, directories, search indexes, results of filters, files of tilesets, parts of drawings",
    ),
    ("limits.tile_bytes", "bytes of it for recently sent tiles"),
    ("limits.header_bytes", "bytes of a request's line and headers"),
    ("limits.headers", "number of headers of a request"),
    ("limits.header_secs", "seconds within which a request's headers must arrive"),
    ("limits.idle_secs", "seconds that a connection may idle between requests"),
    (
        "limits.write_secs",
        "seconds within which a client must take 16 KiB of what waits for it, per connection and HTTP/2 stream",
    ),
    ("limits.streams", "concurrent requests per HTTP/2 connection"),
    ("limits.client_rate", "requests per second and client address; 0: no limit"),
    ("limits.client_burst", "requests that an address may make at once before that rate applies"),
    ("drawings.at_once", "drawings that are made at the same time for clients; 0: none"),
    ("drawings.waiting", "requests that may wait for that; further ones are rejected with 503"),
    ("drawings.secs", "seconds within which a drawing must be made, including the wait"),
    ("drawings.triangles", "triangles of a drawing; larger ones are rejected with 400"),
    ("analyses.at_once", "analyses (sun, sky, shadows) that are made at the same time for clients; 0: none"),
    ("analyses.waiting", "requests that may wait for that; further ones are rejected with 503"),
    ("analyses.secs", "seconds within which an analysis must be made, including the wait"),
    ("analyses.cells", "cells of an analysis with the 500 m around its area; larger ones are rejected with 400"),
    ("cache.memory_bytes", "bytes of limits.cache_bytes for blocks of remote cities, if there are any"),
    ("cache.block_bytes", "bytes of a block, the unit in which remote cities are fetched"),
    ("cache.folder", "folder of the disk cache for blocks; \"\": none"),
    ("cache.folder_bytes", "bytes of the disk cache"),
    ("cache.fetches", "concurrent requests to remote stores"),
    ("cache.timeout_secs", "seconds for which a store that fails or does not respond is retried"),
    ("access.tokens", "file of bearer tokens, one per line; \"\": all cities are public"),
    ("access.share_keys", "file of keys for share links, one \"ID SECRET\" per line, newest last; \"\": no links"),
    ("access.private", "names of the cities that need a token or link; []: all of them, if one of the files is set"),
    ("access.cors", "which pages of other origins may read responses: \"any\", \"none\""),
    ("access.hosts", "hosts that requests may name, as in [\"cities.example.org\"]; []: any"),
    ("access.proxies", "proxies whose X-Forwarded-For names the client, as in [\"10.0.0.0/8\"]; []: none"),
    ("site.title", "name of the site on its pages; \"\": Insula"),
    ("site.logo", "SVG, PNG, JPEG or WebP file of at most 48 KiB that pages show before the title; \"\": none"),
    ("site.accent", "colour of buttons and links, as in \"#0b57a4\"; \"\": that of the viewer"),
    ("site.imprint", "address of the imprint, as in \"https://example.org/imprint\"; \"\": none"),
    ("site.start", "first views of cities, as in [\"delft=84400,446900,420,30,-35,60\"]; []: that of the bake"),
    ("site.proposals", "folder of the proposals that pages show, as CITY/NAME.toml; \"\": none"),
    ("log.format", "\"text\" or \"json\""),
    ("log.requests", "which requests are logged: \"none\", \"errors\" (5xx), \"all\""),
];

/// The field of a setting, with its range.
enum SettingField<'a> {
    Address(&'a mut String),
    OptionalAddress(&'a mut Option<String>),
    Url(&'a mut Option<PublicUrl>),
    File(&'a mut Option<PathBuf>),
    Checked(&'a mut String, fn(&str) -> Result<(), String>),
    Views(&'a mut Vec<String>),
    Names(&'a mut Vec<String>),
    Usize(&'a mut usize, RangeInclusive<usize>),
    U64(&'a mut u64, RangeInclusive<u64>),
    U32(&'a mut u32, RangeInclusive<u32>),
    Rate(&'a mut f64),
    Format(&'a mut LogFormat),
    Requests(&'a mut LogRequests),
    Cors(&'a mut CorsPolicy),
    Hosts(&'a mut Vec<String>),
    Networks(&'a mut Vec<Network>),
}

const CORS: [(&str, CorsPolicy); 2] = [("any", CorsPolicy::Any), ("none", CorsPolicy::None)];
const FORMATS: [(&str, LogFormat); 2] = [("text", LogFormat::Text), ("json", LogFormat::Json)];
const REQUESTS: [(&str, LogRequests); 3] =
    [("none", LogRequests::None), ("errors", LogRequests::Errors), ("all", LogRequests::All)];

fn field<'a>(config: &'a mut ServeConfig, key: &str) -> Option<SettingField<'a>> {
    const DAY: u64 = 86_400;
    let limits = &mut config.limits;
    Some(match key {
        "listen" => SettingField::Address(&mut config.listen),
        "metrics_address" => SettingField::OptionalAddress(&mut config.metrics_address),
        "public_url" => SettingField::Url(&mut config.public_url),
        "drain_notice_secs" => SettingField::U64(&mut config.drain_notice_secs, 0..=3600),
        "threads" => SettingField::Usize(&mut config.threads, 0..=1024),
        "drain_secs" => SettingField::U64(&mut config.drain_secs, 0..=DAY),
        "tls.certificate" => SettingField::File(&mut config.tls.certificate),
        "tls.key" => SettingField::File(&mut config.tls.key),
        "reload.watch_secs" => SettingField::U64(&mut config.reload.watch_secs, 0..=DAY),
        "reload.keep_secs" => SettingField::U64(&mut config.reload.keep_secs, 0..=30 * DAY),
        "reload.keep_versions" => SettingField::Usize(&mut config.reload.keep_versions, 0..=1000),
        "limits.connections" => SettingField::Usize(&mut limits.connections, 1..=1_000_000),
        "limits.client_connections" => SettingField::Usize(&mut limits.client_connections, 0..=1_000_000),
        "limits.client_in_flight" => SettingField::Usize(&mut limits.client_in_flight, 0..=1_000_000),
        "limits.client_in_flight_bytes" => SettingField::Usize(&mut limits.client_in_flight_bytes, 0..=1 << 40),
        "limits.in_flight" => SettingField::Usize(&mut limits.in_flight, 1..=1_000_000),
        "limits.in_flight_bytes" => SettingField::Usize(&mut limits.in_flight_bytes, 1 << 20..=1 << 40),
        "limits.cache_bytes" => SettingField::Usize(&mut limits.cache_bytes, 0..=1 << 40),
        "limits.tile_bytes" => SettingField::Usize(&mut limits.tile_bytes, 0..=1 << 40),
        "limits.header_bytes" => SettingField::Usize(&mut limits.header_bytes, 8192..=1 << 20),
        "limits.headers" => SettingField::Usize(&mut limits.headers, 8..=1000),
        "limits.header_secs" => SettingField::U64(&mut limits.header_secs, 1..=DAY),
        "limits.idle_secs" => SettingField::U64(&mut limits.idle_secs, 1..=DAY),
        "limits.write_secs" => SettingField::U64(&mut limits.write_secs, 1..=DAY),
        "limits.streams" => SettingField::U32(&mut limits.streams, 1..=10_000),
        "limits.client_rate" => SettingField::Rate(&mut limits.client_rate),
        "limits.client_burst" => SettingField::U32(&mut limits.client_burst, 1..=1_000_000),
        "drawings.at_once" => SettingField::Usize(&mut config.drawings.at_once, 0..=64),
        "drawings.waiting" => SettingField::Usize(&mut config.drawings.waiting, 0..=1000),
        "drawings.secs" => SettingField::U64(&mut config.drawings.secs, 1..=3600),
        "drawings.triangles" => SettingField::Usize(&mut config.drawings.triangles, 1000..=4_000_000),
        "analyses.at_once" => SettingField::Usize(&mut config.analyses.at_once, 0..=64),
        "analyses.waiting" => SettingField::Usize(&mut config.analyses.waiting, 0..=1000),
        "analyses.secs" => SettingField::U64(&mut config.analyses.secs, 1..=3600),
        "analyses.cells" => SettingField::U64(&mut config.analyses.cells, 1000..=64 << 20),
        "cache.memory_bytes" => SettingField::U64(&mut config.cache.memory_bytes, 0..=1 << 40),
        "cache.block_bytes" => SettingField::U64(&mut config.cache.block_bytes, 4096..=16 << 20),
        "cache.folder" => SettingField::File(&mut config.cache.folder),
        "cache.folder_bytes" => SettingField::U64(&mut config.cache.folder_bytes, 0..=1 << 50),
        "cache.fetches" => SettingField::Usize(&mut config.cache.fetches, 1..=10_000),
        "cache.timeout_secs" => SettingField::U64(&mut config.cache.timeout_secs, 1..=3600),
        "access.tokens" => SettingField::File(&mut config.access.tokens),
        "access.share_keys" => SettingField::File(&mut config.access.share_keys),
        "access.cors" => SettingField::Cors(&mut config.access.cors),
        "access.hosts" => SettingField::Hosts(&mut config.access.hosts),
        "access.proxies" => SettingField::Networks(&mut config.access.proxies),
        "access.private" => SettingField::Names(&mut config.access.private),
        "site.title" => SettingField::Checked(&mut config.site.title, check_title),
        "site.logo" => SettingField::File(&mut config.site.logo),
        "site.accent" => SettingField::Checked(&mut config.site.accent, check_accent),
        "site.imprint" => SettingField::Checked(&mut config.site.imprint, check_imprint),
        "site.start" => SettingField::Views(&mut config.site.start),
        "site.proposals" => SettingField::File(&mut config.site.proposals),
        "log.format" => SettingField::Format(&mut config.log.format),
        "log.requests" => SettingField::Requests(&mut config.log.requests),
        _ => return None,
    })
}

/// A value as its source gave it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum RawValue {
    /// Text of any type, from the environment or the command line.
    Untyped(String),
    /// A TOML string.
    Text(String),
    /// A TOML number, as written.
    Number(String),
    /// A TOML array of strings.
    List(Vec<String>),
    /// Any other TOML value.
    Other,
}

impl RawValue {
    fn text(&self) -> Result<&str, String> {
        match self {
            Self::Text(text) | Self::Untyped(text) => Ok(text),
            _ => Err("expected a text in quotes".into()),
        }
    }

    fn number(&self) -> Result<&str, String> {
        match self {
            Self::Number(text) | Self::Untyped(text) => Ok(text),
            _ => Err("expected a number without quotes".into()),
        }
    }

    /// A list of `kind`. In a text of any type, `separator` is between its members.
    fn list(&self, separator: char, kind: &str) -> Result<Vec<String>, String> {
        match self {
            Self::List(all) => Ok(all.clone()),
            Self::Untyped(text) => {
                Ok(text.split(separator).filter(|member| !member.is_empty()).map(str::to_owned).collect())
            }
            _ => Err(format!("expected a list of {kind}")),
        }
    }
}

/// Sets one key. Fails with what is wrong with the value, or if the key is unknown.
pub(super) fn set(config: &mut ServeConfig, key: &str, value: &RawValue) -> Result<(), String> {
    let Some(field) = field(config, key) else {
        return Err(format!("there is no such key{}", suggestion(key)));
    };
    let given = || value.text().map(|text| Some(text).filter(|text| !text.is_empty()));
    match field {
        SettingField::Address(field) => {
            check_address(value.text()?)?;
            *field = value.text()?.to_owned();
        }
        SettingField::OptionalAddress(field) => {
            given()?.map_or(Ok(()), check_address)?;
            *field = given()?.map(str::to_owned);
        }
        SettingField::Url(field) => *field = given()?.map(str::parse::<PublicUrl>).transpose()?,
        SettingField::File(field) => *field = given()?.map(PathBuf::from),
        SettingField::Checked(field, check) => {
            check(value.text()?)?;
            *field = value.text()?.to_owned();
        }
        // A camera has commas itself.
        SettingField::Views(field) => {
            *field = checked_views(&value.list(';', "first views, such as [\"delft=X,Y,Z,A,P,F\"]")?)?;
        }
        SettingField::Names(field) => *field = checked_names(&value.list(',', "names, such as [\"delft\"]")?)?,
        SettingField::Hosts(field) => *field = checked_hosts(&value.list(',', "hosts, such as [\"localhost\"]")?)?,
        SettingField::Networks(field) => {
            *field = parse_networks(&value.list(',', "networks, such as [\"10.0.0.0/8\"]")?)?;
        }
        SettingField::Usize(field, range) => *field = parse_integer(value.number()?, &range)?,
        SettingField::U64(field, range) => *field = parse_integer(value.number()?, &range)?,
        SettingField::U32(field, range) => *field = parse_integer(value.number()?, &range)?,
        SettingField::Rate(field) => {
            let text = value.number()?;
            let rate = text.parse().ok().filter(|rate| (0.0..=1e9).contains(rate));
            *field = rate.ok_or(format!("{text} is not a number from 0 to 1e9"))?;
        }
        SettingField::Format(field) => *field = parse_choice(value.text()?, &FORMATS)?,
        SettingField::Requests(field) => *field = parse_choice(value.text()?, &REQUESTS)?,
        SettingField::Cors(field) => *field = parse_choice(value.text()?, &CORS)?,
    }
    Ok(())
}

/// The value of a key as TOML.
pub(super) fn get(config: &mut ServeConfig, key: &str) -> String {
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let word = |found: Option<&str>| quoted(found.unwrap_or_default());
    let list = |all: &[String]| format!("[{}]", all.iter().map(|text| quoted(text)).collect::<Vec<_>>().join(", "));
    match field(config, key) {
        Some(SettingField::Address(text)) => quoted(text),
        Some(SettingField::Url(url)) => quoted(url.as_ref().map_or("", PublicUrl::as_str)),
        Some(SettingField::File(path)) => {
            quoted(&path.as_ref().map(|path| path.display().to_string()).unwrap_or_default())
        }
        Some(SettingField::Checked(text, _)) => quoted(text),
        Some(SettingField::Names(all) | SettingField::Hosts(all) | SettingField::Views(all)) => list(all),
        Some(SettingField::Networks(all)) => list(&all.iter().map(ToString::to_string).collect::<Vec<_>>()),
        Some(SettingField::OptionalAddress(address)) => quoted(address.as_deref().unwrap_or_default()),
        Some(SettingField::Usize(size, _)) => size.to_string(),
        Some(SettingField::U64(number, _)) => number.to_string(),
        Some(SettingField::U32(number, _)) => number.to_string(),
        Some(SettingField::Rate(rate)) => format!("{rate:?}"),
        Some(SettingField::Format(format)) => word(FORMATS.iter().find(|(_, f)| f == format).map(|(word, _)| *word)),
        Some(SettingField::Requests(which)) => word(REQUESTS.iter().find(|(_, r)| r == which).map(|(word, _)| *word)),
        Some(SettingField::Cors(cors)) => word(CORS.iter().find(|(_, c)| c == cors).map(|(word, _)| *word)),
        None => String::new(),
    }
}

fn parse_networks(networks: &[String]) -> Result<Vec<Network>, String> {
    networks.iter().map(|network| network.parse()).collect()
}

fn checked_hosts(hosts: &[String]) -> Result<Vec<String>, String> {
    let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || b".-_:[]".contains(&byte);
    let is_host = |host: &&String| {
        let has_port = host.rsplit_once(':').is_some_and(|(name, port)| {
            !name.ends_with(':') && !port.ends_with(']') && port.bytes().all(|b| b.is_ascii_digit())
        });
        !host.is_empty() && host.bytes().all(is_allowed) && !has_port
    };
    match hosts.iter().find(|host| !is_host(host)) {
        Some(invalid) => Err(format!("{invalid:?} is not a host without port, such as \"localhost\" or \"[::1]\"")),
        None => Ok(hosts.to_vec()),
    }
}

fn parse_integer<T: std::str::FromStr + PartialOrd + std::fmt::Display>(
    text: &str,
    range: &RangeInclusive<T>,
) -> Result<T, String> {
    let number = text.replace('_', "").parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("{text} is not a whole number from {} to {}", range.start(), range.end()))
}

fn parse_choice<T: Copy>(text: &str, choices: &[(&str, T)]) -> Result<T, String> {
    let found = choices.iter().find(|(word, _)| *word == text).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let words: Vec<_> = choices.iter().map(|(word, _)| format!("{word:?}")).collect();
        format!("{text:?} is none of {}", words.join(", "))
    })
}

fn checked_names(names: &[String]) -> Result<Vec<String>, String> {
    match names.iter().find(|name| !is_name(name)) {
        Some(invalid) => Err(format!("{invalid:?} is not a city's name: a-z, 0-9, _ and -")),
        None => Ok(names.to_vec()),
    }
}

/// A hint for a misspelt key: the known key with the same last part, or the same letters without underscores.
fn suggestion(key: &str) -> String {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    let found =
        SETTINGS.iter().find(|(known, _)| last(known) == last(key) || known.replace('_', "") == key.replace('_', ""));
    found.map(|(known, _)| format!("; did you mean {known}?")).unwrap_or_default()
}

/// Fails unless `text` has the form `HOST:PORT`.
pub fn check_address(text: &str) -> Result<(), String> {
    match text.rsplit_once(':') {
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => Ok(()),
        _ => Err(format!("{text:?} is not HOST:PORT, such as {DEFAULT_LISTEN}")),
    }
}
