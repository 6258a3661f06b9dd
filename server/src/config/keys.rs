//! The settings' names: one table for the file, the environment, the command line and `--print-config`.
//!
//! In: a name and a value as text. Out: a changed [`ServeConfig`]. Next: `file` says where it came from if it is wrong.

use super::settings::{DEFAULT_LISTEN, LogFormat, LogRequests, ServeConfig};
use insula_protocol::manifest::is_name;
use std::{ops::RangeInclusive, path::PathBuf};

/// Every setting with what it means, in the order of `--print-config`.
pub(super) const SETTINGS: [(&str, &str); 30] = [
    ("listen", "HOST:PORT; port 0 picks a free one"),
    ("threads", "threads that answer; 0: one a core"),
    ("drain_secs", "seconds that requests in flight may take to finish at shutdown"),
    ("tls.certificate", "PEM file of the certificate and its chain; \"\": no TLS"),
    ("tls.key", "PEM file of its private key"),
    ("reload.watch_secs", "seconds between looks at the cities; 0: only at SIGHUP"),
    ("reload.keep_secs", "seconds that a replaced version is still served"),
    ("reload.keep_versions", "replaced versions of one city that are still served"),
    ("limits.connections", "connections at once; those over it are told 503 and closed"),
    ("limits.in_flight", "requests for cities at once; those over it are told 503"),
    ("limits.in_flight_bytes", "bytes of answers that wait to be sent; requests over it are told 503"),
    ("limits.tile_bytes", "bytes of tiles that are kept ready to be sent"),
    ("limits.header_bytes", "bytes of a request's line and headers"),
    ("limits.headers", "headers of a request"),
    ("limits.header_secs", "seconds in which a request's headers must arrive"),
    ("limits.idle_secs", "seconds that a connection may idle between requests"),
    ("limits.write_secs", "seconds in which a client must take 16 KiB of what waits for it"),
    ("limits.streams", "requests at once on one connection of HTTP/2"),
    ("limits.client_rate", "requests a second of one address; 0: no limit"),
    ("limits.client_burst", "requests that an address may make at once before that rate counts"),
    ("cache.memory_bytes", "bytes of blocks of remote cities in memory"),
    ("cache.block_bytes", "bytes that are fetched of a remote city at once"),
    ("cache.folder", "folder for blocks on disk; \"\": none"),
    ("cache.folder_bytes", "bytes of blocks on disk"),
    ("cache.fetches", "requests to stores at once"),
    ("cache.timeout_secs", "seconds after which a store that fails or does not answer is raw_value up"),
    ("access.tokens", "file of bearer tokens, one a line; \"\": everything is public"),
    ("access.private", "cities that ask for a token; []: all of them, if there are tokens"),
    ("log.format", "\"text\" or \"json\""),
    ("log.requests", "requests with a line in the log: \"none\", \"errors\" (5xx), \"all\""),
];

/// Where a setting is kept, and what it may be.
enum SettingField<'a> {
    Address(&'a mut String),
    File(&'a mut Option<PathBuf>),
    Names(&'a mut Vec<String>),
    Size(&'a mut usize, RangeInclusive<usize>),
    Long(&'a mut u64, RangeInclusive<u64>),
    Number(&'a mut u32, RangeInclusive<u32>),
    Rate(&'a mut f64),
    Format(&'a mut LogFormat),
    Requests(&'a mut LogRequests),
}

const FORMATS: [(&str, LogFormat); 2] = [("text", LogFormat::Text), ("json", LogFormat::Json)];
const REQUESTS: [(&str, LogRequests); 3] =
    [("none", LogRequests::None), ("errors", LogRequests::Errors), ("all", LogRequests::All)];

fn field<'a>(config: &'a mut ServeConfig, key: &str) -> Option<SettingField<'a>> {
    const DAY: u64 = 86_400;
    let limits = &mut config.limits;
    Some(match key {
        "listen" => SettingField::Address(&mut config.listen),
        "threads" => SettingField::Size(&mut config.threads, 0..=1024),
        "drain_secs" => SettingField::Long(&mut config.drain_secs, 0..=DAY),
        "tls.certificate" => SettingField::File(&mut config.tls.certificate),
        "tls.key" => SettingField::File(&mut config.tls.key),
        "reload.watch_secs" => SettingField::Long(&mut config.reload.watch_secs, 0..=DAY),
        "reload.keep_secs" => SettingField::Long(&mut config.reload.keep_secs, 0..=30 * DAY),
        "reload.keep_versions" => SettingField::Size(&mut config.reload.keep_versions, 0..=1000),
        "limits.connections" => SettingField::Size(&mut limits.connections, 1..=1_000_000),
        "limits.in_flight" => SettingField::Size(&mut limits.in_flight, 1..=1_000_000),
        "limits.in_flight_bytes" => SettingField::Size(&mut limits.in_flight_bytes, 1 << 20..=1 << 40),
        "limits.tile_bytes" => SettingField::Size(&mut limits.tile_bytes, 0..=1 << 40),
        "limits.header_bytes" => SettingField::Size(&mut limits.header_bytes, 8192..=1 << 20),
        "limits.headers" => SettingField::Size(&mut limits.headers, 8..=1000),
        "limits.header_secs" => SettingField::Long(&mut limits.header_secs, 1..=DAY),
        "limits.idle_secs" => SettingField::Long(&mut limits.idle_secs, 1..=DAY),
        "limits.write_secs" => SettingField::Long(&mut limits.write_secs, 1..=DAY),
        "limits.streams" => SettingField::Number(&mut limits.streams, 1..=10_000),
        "limits.client_rate" => SettingField::Rate(&mut limits.client_rate),
        "limits.client_burst" => SettingField::Number(&mut limits.client_burst, 1..=1_000_000),
        "cache.memory_bytes" => SettingField::Long(&mut config.cache.memory_bytes, 0..=1 << 40),
        "cache.block_bytes" => SettingField::Long(&mut config.cache.block_bytes, 4096..=16 << 20),
        "cache.folder" => SettingField::File(&mut config.cache.folder),
        "cache.folder_bytes" => SettingField::Long(&mut config.cache.folder_bytes, 0..=1 << 50),
        "cache.fetches" => SettingField::Size(&mut config.cache.fetches, 1..=10_000),
        "cache.timeout_secs" => SettingField::Long(&mut config.cache.timeout_secs, 1..=3600),
        "access.tokens" => SettingField::File(&mut config.access.tokens),
        "access.private" => SettingField::Names(&mut config.access.private),
        "log.format" => SettingField::Format(&mut config.log.format),
        "log.requests" => SettingField::Requests(&mut config.log.requests),
        _ => return None,
    })
}

/// A value as it was raw_value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum RawValue {
    /// Without a type: environment, command line.
    Plain(String),
    /// Quoted in a file.
    Text(String),
    /// A number in a file.
    Number(String),
    /// A list of texts in a file.
    List(Vec<String>),
    /// Anything else in a file.
    Other,
}

/// Sets one key. Errors: what is wrong with the value, or that there is no such key.
pub(super) fn set(config: &mut ServeConfig, key: &str, raw_value: &RawValue) -> Result<(), String> {
    let Some(field) = field(config, key) else {
        return Err(format!("there is no such key{}", nearest(key)));
    };
    match (field, raw_value) {
        (SettingField::Address(field), RawValue::Text(text) | RawValue::Plain(text)) => {
            check_address(text)?;
            *field = text.clone();
        }
        (SettingField::File(field), RawValue::Text(text) | RawValue::Plain(text)) => {
            *field = (!text.is_empty()).then(|| PathBuf::from(text));
        }
        (SettingField::Names(field), RawValue::List(names)) => *field = checked_names(names)?,
        (SettingField::Names(field), RawValue::Plain(text)) => {
            let names: Vec<String> = text.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect();
            *field = checked_names(&names)?;
        }
        (SettingField::Size(field, range), RawValue::Number(text) | RawValue::Plain(text)) => {
            *field = whole(text, &range)?
        }
        (SettingField::Long(field, range), RawValue::Number(text) | RawValue::Plain(text)) => {
            *field = whole(text, &range)?
        }
        (SettingField::Number(field, range), RawValue::Number(text) | RawValue::Plain(text)) => {
            *field = whole(text, &range)?
        }
        (SettingField::Rate(field), RawValue::Number(text) | RawValue::Plain(text)) => {
            let rate = text.parse().ok().filter(|rate| (0.0..=1e9).contains(rate));
            *field = rate.ok_or(format!("{text} is not a number from 0 to 1e9"))?;
        }
        (SettingField::Format(field), RawValue::Text(text) | RawValue::Plain(text)) => *field = choice(text, &FORMATS)?,
        (SettingField::Requests(field), RawValue::Text(text) | RawValue::Plain(text)) => {
            *field = choice(text, &REQUESTS)?
        }
        (SettingField::Size(..) | SettingField::Long(..) | SettingField::Number(..) | SettingField::Rate(_), _) => {
            return Err("a number is wanted, without quotes".into());
        }
        (SettingField::Names(_), _) => return Err("a list of names is wanted, as in [\"delft\"]".into()),
        _ => return Err("a text in quotes is wanted".into()),
    }
    Ok(())
}

/// Its value as TOML.
pub(super) fn get(config: &mut ServeConfig, key: &str) -> String {
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let word = |found: Option<&str>| quoted(found.unwrap_or_default());
    match field(config, key) {
        Some(SettingField::Address(text)) => quoted(text),
        Some(SettingField::File(path)) => {
            quoted(&path.as_ref().map(|path| path.display().to_string()).unwrap_or_default())
        }
        Some(SettingField::Names(names)) => {
            format!("[{}]", names.iter().map(|n| quoted(n)).collect::<Vec<_>>().join(", "))
        }
        Some(SettingField::Size(size, _)) => size.to_string(),
        Some(SettingField::Long(number, _)) => number.to_string(),
        Some(SettingField::Number(number, _)) => number.to_string(),
        Some(SettingField::Rate(rate)) => format!("{rate:?}"),
        Some(SettingField::Format(format)) => word(FORMATS.iter().find(|(_, f)| f == format).map(|(word, _)| *word)),
        Some(SettingField::Requests(which)) => word(REQUESTS.iter().find(|(_, r)| r == which).map(|(word, _)| *word)),
        None => String::new(),
    }
}

fn whole<T: std::str::FromStr + PartialOrd + std::fmt::Display>(
    text: &str,
    range: &RangeInclusive<T>,
) -> Result<T, String> {
    let number = text.replace('_', "").parse().ok().filter(|number| range.contains(number));
    number.ok_or_else(|| format!("{text} is not a whole number from {} to {}", range.start(), range.end()))
}

fn choice<T: Copy>(text: &str, choices: &[(&str, T)]) -> Result<T, String> {
    let found = choices.iter().find(|(word, _)| *word == text).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let words: Vec<_> = choices.iter().map(|(word, _)| format!("{word:?}")).collect();
        format!("{text:?} is none of {}", words.join(", "))
    })
}

fn checked_names(names: &[String]) -> Result<Vec<String>, String> {
    match names.iter().find(|name| !is_name(name)) {
        Some(wrong) => Err(format!("{wrong:?} is not a city's name: a-z, 0-9, _ and -")),
        None => Ok(names.to_vec()),
    }
}

/// A hint for a slip: the key of the same last word.
fn nearest(key: &str) -> String {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    let found =
        SETTINGS.iter().find(|(known, _)| last(known) == last(key) || known.replace('_', "") == key.replace('_', ""));
    found.map(|(known, _)| format!("; did you mean {known}?")).unwrap_or_default()
}

/// Whether `text` looks like `HOST:PORT`.
pub fn check_address(text: &str) -> Result<(), String> {
    match text.rsplit_once(':') {
        Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => Ok(()),
        _ => Err(format!("{text:?} is not HOST:PORT, as in {DEFAULT_LISTEN}")),
    }
}
