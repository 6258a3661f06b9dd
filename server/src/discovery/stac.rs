//! SpatioTemporal Asset Catalog 1.1: a catalogue of a site, and an item for each city, with the extensions Projection 2.0 and File 2.1.

use super::{CityFile, CityRecord, TILESET_FILE, geovolumes, licence_links, link, web_address};
use chrono::{DateTime, SecondsFormat};
use insula_archive::owned::FileMark;
use insula_protocol::Manifest;
use insula_protocol::manifest::Attribution;
use insula_protocol::name::to_name;
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::time::{SystemTime, UNIX_EPOCH};

pub(super) const CATALOG_FILE: &str = "catalog.json";
const VERSION: &str = "1.1.0";
const EXTENSIONS: [&str; 2] = [
    "https://stac-extensions.github.io/projection/v2.0.0/schema.json",
    "https://stac-extensions.github.io/file/v2.1.0/schema.json",
];
/// SPDX identifiers of licences of open data. Others are `other`, and stand in words beside the source.
const LICENCES: [&str; 16] = [
    "CC0-1.0", "CC-BY-3.0", "CC-BY-4.0", "CC-BY-SA-3.0", "CC-BY-SA-4.0", "CC-BY-NC-4.0", "CC-BY-NC-SA-4.0",
    "CC-BY-ND-4.0", "ODbL-1.0", "ODC-By-1.0", "PDDL-1.0", "DL-DE-BY-2.0", "DL-DE-ZERO-2.0", "OGL-UK-3.0", "etalab-2.0",
    "NLOD-2.0",
];
/// Multihash: BLAKE3 of 32 bytes.
const BLAKE3_PREFIX: &str = "1e20";

/// Path of a city's item in the site.
pub(super) fn item_file(name: &str) -> String {
    format!("cities/{name}/item.json")
}

/// The catalogue of a site.
pub(super) fn catalog(title: &str, cities: &[CityRecord<'_>], url: Option<&str>) -> Value {
    let mut links = vec![
        link("root", "application/json", CATALOG_FILE, title),
        link("data", "application/json", geovolumes::LIST_FILE, "The same cities for OGC API - 3D GeoVolumes"),
    ];
    links.extend(self_link("application/json", CATALOG_FILE, url));
    links.extend(
        cities
            .iter()
            .map(|city| link("item", "application/geo+json", &item_file(&city.manifest.name), &city.manifest.title)),
    );
    json!({
        "type": "Catalog",
        "stac_version": VERSION,
        "id": to_name(title),
        "title": title,
        "description": format!("Models of cities in three dimensions: {title}"),
        "links": links,
    })
}

/// The item of a city.
pub(super) fn item(city: &CityRecord<'_>, url: Option<&str>) -> Value {
    let manifest = city.manifest;
    let file = item_file(&manifest.name);
    let mut links = vec![
        link("root", "application/json", "../../catalog.json", "All cities"),
        link("parent", "application/json", "../../catalog.json", "All cities"),
        link("alternate", "text/html", "index.html", &manifest.title),
    ];
    links.extend(self_link("application/geo+json", &file, url));
    links.extend(licence_links(manifest));
    let mut item = json!({
        "type": "Feature",
        "stac_version": VERSION,
        "stac_extensions": EXTENSIONS,
        "id": manifest.name,
        "geometry": city.extent.map(outline),
        "properties": properties(city),
        "links": links,
        "assets": assets(city),
    });
    // An item without a geometry has no box.
    if let Some(bbox) = city.bbox() {
        item["bbox"] = json!(bbox);
    }
    item
}

/// The document's own address, if it is known. Besides those to sources, it is the only absolute link.
fn self_link(media_type: &str, file: &str, url: Option<&str>) -> Option<Value> {
    url.map(|url| json!({ "rel": "self", "type": media_type, "href": format!("{url}{file}") }))
}

fn properties(city: &CityRecord<'_>) -> Value {
    let manifest = city.manifest;
    let world = manifest.bounds.concat();
    json!({
        "title": manifest.title,
        "description": city.description,
        "datetime": utc(city.time),
        "version": manifest.version,
        "license": licence(manifest),
        "providers": manifest.attribution.iter().map(provider).collect::<Vec<_>>(),
        "proj:code": manifest.crs.as_deref().filter(|crs| is_epsg(crs)),
        "proj:bbox": world,
    })
}

fn is_epsg(crs: &str) -> bool {
    let digits = crs.strip_prefix("EPSG:").unwrap_or_default();
    !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
}

/// A source; its licence in the words of the manifest.
fn provider(source: &Attribution) -> Value {
    let mut provider = json!({ "name": source.text, "roles": ["producer", "licensor"] });
    if let Some(licence) = &source.licence {
        provider["description"] = json!(licence);
    }
    if let Some(url) = web_address(source) {
        provider["url"] = json!(url);
    }
    provider
}

/// SPDX identifier of the licence of all sources; `other` if they differ, or if one is not known.
fn licence(manifest: &Manifest) -> &'static str {
    let known = |source: &Attribution| {
        let words = source.licence.as_deref()?.split_whitespace().collect::<Vec<_>>().join("-");
        LICENCES.into_iter().find(|id| id.eq_ignore_ascii_case(&words))
    };
    let all: BTreeSet<_> = manifest.attribution.iter().map(known).collect();
    match all.into_iter().collect::<Vec<_>>()[..] {
        [Some(id)] => id,
        _ => "other",
    }
}

fn assets(city: &CityRecord<'_>) -> Map<String, Value> {
    let asset = |file: &CityFile, mark: &FileMark| {
        let mut asset = json!({
            "href": file.name,
            "title": file.title,
            "type": file.media_type,
            "roles": [file.role],
            "file:size": mark.bytes,
            "file:checksum": format!("{BLAKE3_PREFIX}{}", mark.hash.to_hex()),
        });
        // Of all files, only the tileset is on the globe, if it is anywhere.
        if file.name == TILESET_FILE && city.extent.is_some() {
            asset["proj:code"] = json!("EPSG:4978");
        }
        (file.key.to_owned(), asset)
    };
    city.files.iter().map(|(file, mark)| asset(file, mark)).collect()
}

/// The extent as an area; two, if it crosses the meridian of 180 degrees (RFC 7946, 3.1.9).
fn outline([west, south, _, east, north, _]: [f64; 6]) -> Value {
    let ring = |west: f64, east: f64| [[[west, south], [east, south], [east, north], [west, north], [west, south]]];
    if west <= east {
        return json!({ "type": "Polygon", "coordinates": ring(west, east) });
    }
    json!({ "type": "MultiPolygon", "coordinates": [ring(west, 180.0), ring(-180.0, east)] })
}

/// A time as RFC 3339 has it; null if it has no such form.
fn utc(time: SystemTime) -> Option<String> {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let time = DateTime::from_timestamp(i64::try_from(seconds).ok()?, 0)?;
    Some(time.to_rfc3339_opts(SecondsFormat::Secs, true))
}
