//! Collections as the draft of OGC API - 3D GeoVolumes (22-029) has them, as files.
//!
//! A host of files answers `collections.json`, and with a rule of its own `/collections`, too: links are right at both addresses.

use super::{CityRecord, TILESET_FILE, licence_links, link};
use insula_archive::city::MANIFEST_FILE;
use serde_json::{Value, json};

pub(super) const LIST_FILE: &str = "collections.json";
const TILES_3D: &str = "application/json+3dtiles";
/// Relation of a link to the content of a collection.
const VOLUMES: &str = "http://www.opengis.net/def/rel/ogc/1.0/3d-geovolumes";
/// Longitude and latitude, and height above the ellipsoid.
const CRS_84_H: &str = "http://www.opengis.net/def/crs/OGC/0/CRS84h";
/// The same without heights.
const CRS_84: &str = "http://www.opengis.net/def/crs/OGC/1.3/CRS84";

/// Path of a city's document in the site.
pub(super) fn collection_file(name: &str) -> String {
    format!("collections/{name}.json")
}

/// The list of all cities.
pub(super) fn list(cities: &[CityRecord<'_>]) -> Value {
    json!({
        "links": [link("self", "application/json", LIST_FILE, "All cities")],
        "collections": cities.iter().map(|city| collection(city, "")).collect::<Vec<_>>(),
    })
}

/// A city: its tileset, or else the files of its own format. `root` leads from the document to the site: empty, or with a slash at its end.
pub(super) fn collection(city: &CityRecord<'_>, root: &str) -> Value {
    let manifest = city.manifest;
    let (name, title) = (manifest.name.as_str(), manifest.title.as_str());
    let in_city = |file: &str| format!("{root}cities/{name}/{file}");
    let (content, media_type) = match city.has(TILESET_FILE) {
        true => (in_city(TILESET_FILE), TILES_3D),
        false => (in_city(MANIFEST_FILE), "application/json"),
    };
    let mut links = vec![
        link("self", "application/json", &format!("{root}{}", collection_file(name)), title),
        link("parent", "application/json", &format!("{root}{LIST_FILE}"), "All cities"),
        link("alternate", "text/html", &in_city("index.html"), title),
        link("describedby", "application/geo+json", &in_city("item.json"), "STAC item"),
    ];
    if city.has(TILESET_FILE) {
        links.push(link(VOLUMES, TILES_3D, &content, title));
    }
    links.extend(licence_links(manifest));
    let mut collection = json!({
        "id": name,
        "title": title,
        "description": city.description,
        "collectionType": "3d-container",
        "links": links,
        // Earlier drafts, which most programs follow, have content apart.
        "content": [link("original", media_type, &content, title)],
    });
    if let Some(bbox) = city.bbox() {
        let crs = if bbox.len() == 6 { CRS_84_H } else { CRS_84 };
        collection["extent"] = json!({ "spatial": { "bbox": [bbox], "crs": crs } });
    }
    collection
}
