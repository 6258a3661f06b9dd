//! Values of options. Each function says in its error what it expects.

use crate::config::{DEFAULT_LISTEN, check_address};
use clap::builder::{PathBufValueParser, TypedValueParser};
use insula_archive::city::{MANIFEST_FILE, dated_folder};
use insula_protocol::TileId;
use insula_protocol::blockmap::Quality;
use insula_protocol::name::is_name;
use insula_protocol::release::is_date;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Longitude and latitude in degrees, height in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeoPlace(pub [f64; 3]);

fn parse_number<T: FromStr>(text: &str, is_allowed: impl FnOnce(&T) -> bool, expected: &str) -> Result<T, String> {
    text.parse().ok().filter(is_allowed).ok_or_else(|| format!("expected {expected}"))
}

/// The folder of a city, also as that of another version and a day: `CITY@2024-01-31`.
pub(super) fn city_parser() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(dated_folder)
}

pub(super) fn parse_date(text: &str) -> Result<String, String> {
    if is_date(text) { Ok(text.to_owned()) } else { Err("expected a day, such as 2024-01-31".to_owned()) }
}

pub(super) fn parse_ratio(text: &str) -> Result<f64, String> {
    parse_number(text, |ratio: &f64| *ratio > 0.0 && *ratio <= 1.0, "a number above 0 and at most 1, such as 0.1")
}

pub(super) fn parse_samples(text: &str) -> Result<usize, String> {
    parse_number(text, |samples| (1..=10_000_000).contains(samples), "a number between 1 and 10000000, such as 200000")
}

pub(super) fn parse_max_error(text: &str) -> Result<f64, String> {
    parse_number(text, |error: &f64| *error >= 0.0 && error.is_finite(), "a length of at least 0, such as 0.5")
}

pub(super) fn parse_cell(text: &str) -> Result<f64, String> {
    parse_number(text, |cell_m| (0.01..=1000.0).contains(cell_m), "metres between 0.01 and 1000, such as 0.5")
}

pub(super) fn parse_metres(text: &str) -> Result<f64, String> {
    parse_number(text, |metres| (0.0..=1e6).contains(metres), "metres between 0 and 1000000, such as 500")
}

pub(super) fn parse_positive_metres(text: &str) -> Result<f64, String> {
    parse_number(text, |metres| (0.01..=1000.0).contains(metres), "metres between 0.01 and 1000, such as 0.25")
}

pub(super) fn parse_kilometres(text: &str) -> Result<f64, String> {
    parse_number(text, |kilometres| (0.1..=500.0).contains(kilometres), "kilometres between 0.1 and 500, such as 30")
}

pub(super) fn parse_crs(text: &str) -> Result<String, String> {
    let code = text.strip_prefix("EPSG:").or_else(|| text.strip_prefix("epsg:")).unwrap_or(text);
    match code.parse::<u32>() {
        Ok(code) if code > 0 => Ok(format!("EPSG:{code}")),
        _ => Err("expected the code of a projected system, such as EPSG:25832".into()),
    }
}

/// Parses numbers that are separated by commas.
pub(super) fn parse_numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|word| word.trim().parse().ok().filter(|number: &f64| number.is_finite())).collect();
    numbers?.try_into().ok()
}

pub(super) fn parse_place(text: &str) -> Result<GeoPlace, String> {
    match parse_numbers(text) {
        Some([lon, lat, height_m]) if lon.abs() <= 180.0 && lat.abs() <= 90.0 => Ok(GeoPlace([lon, lat, height_m])),
        _ => Err("expected longitude, latitude and height, such as 4.357,52.011,3".into()),
    }
}

/// Parses sizes such as `600MiB`, `2GB`, `1G`, `1073741824`.
pub(super) fn parse_bytes(text: &str) -> Result<u64, String> {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    let factor: Option<u64> = match unit.to_ascii_lowercase().as_str() {
        "" | "b" => Some(1),
        "k" | "kib" => Some(1 << 10),
        "m" | "mib" => Some(1 << 20),
        "g" | "gib" => Some(1 << 30),
        "kb" => Some(1_000),
        "mb" => Some(1_000_000),
        "gb" => Some(1_000_000_000),
        _ => None,
    };
    let bytes = number.parse::<u64>().ok().zip(factor).and_then(|(number, factor)| number.checked_mul(factor));
    bytes.ok_or_else(|| "expected a size, such as 600MiB or 2GB".into())
}

pub(super) fn parse_quality(text: &str) -> Result<Quality, String> {
    match text.parse::<f32>() {
        _ if text == "lossless" => Ok(Quality::Lossless),
        Ok(db) if (20.0..=60.0).contains(&db) => Ok(Quality::Decibels(db)),
        _ => Err("expected decibels between 20 and 60, such as 36, or the word lossless".into()),
    }
}

pub(super) fn parse_name(text: &str) -> Result<String, String> {
    if is_name(text) { Ok(text.into()) } else { Err("expected 1 to 64 of a-z, 0-9, _ and -".into()) }
}

pub(super) fn parse_address(text: &str) -> Result<String, String> {
    check_address(text).map(|()| text.to_owned()).map_err(|_| format!("expected HOST:PORT, such as {DEFAULT_LISTEN}"))
}

/// Parses the name of a city, or a city's folder.
pub(super) fn parse_signed_city(text: &str) -> Result<String, String> {
    let is_folder = || Path::new(text).join(MANIFEST_FILE).is_file();
    if is_name(text) || is_folder() {
        Ok(text.into())
    } else {
        Err("expected a name of 1 to 64 of a-z, 0-9, _ and -, or a city's folder".into())
    }
}

/// Parses an address of a web site, which gets a slash at the end.
pub(super) fn parse_site_address(text: &str) -> Result<String, String> {
    let rest = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || b".-_~:[]/%".contains(&byte);
    match rest {
        Some(rest) if !rest.is_empty() && rest.bytes().all(is_allowed) => {
            Ok(format!("{}/", text.trim_end_matches('/')))
        }
        _ => Err("expected an address such as https://HOST/PATH".into()),
    }
}

pub(super) fn parse_tile(text: &str) -> Result<TileId, String> {
    let mut parts = text.split('/').map(str::parse::<u32>);
    let id = match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(Ok(level)), Some(Ok(x)), Some(Ok(y)), None) => {
            u8::try_from(level).ok().and_then(|level| TileId::new(level, x, y))
        }
        _ => None,
    };
    id.ok_or_else(|| "expected level/x/y with x and y below 2^level, such as 3/2/5".into())
}
