//! What the server says of its cities, encoded once each time that one of them changes.

use super::{access_control::AccessControl, content_encoding::EncodedContent, representation::REVALIDATE};
use crate::store::Store;
use axum::http::HeaderValue;
use insula_protocol::{Manifest, codec::bincode, manifest::Attribution, route};
use serde::Serialize;
use std::collections::BTreeMap;

pub(super) const JSON: &str = "application/json";
pub(super) const BINCODE: &str = "application/x-bincode";

/// The contract, which the tests hold the server to.
const OPENAPI: &str = include_str!("../../openapi.json");

/// All that can be said of the cities, made once each time that one of them changes.
#[derive(Debug)]
pub(super) struct CityDocuments {
    /// For everybody, and for who has a token.
    pub(super) lists: [EncodedContent; 2],
    pub(super) json: BTreeMap<String, EncodedContent>,
    pub(super) bincode: BTreeMap<String, EncodedContent>,
    pub(super) openapi: EncodedContent,
}

/// One line of the list.
#[derive(Serialize)]
struct CityListEntry<'a> {
    name: &'a str,
    title: &'a str,
    version: &'a str,
    manifest: String,
    nodes: u64,
    bytes: u64,
    attribution: &'a [Attribution],
}

impl CityDocuments {
    pub(super) fn new(store: &Store, access: &AccessControl) -> Self {
        let (mut json, mut bincode) = (BTreeMap::new(), BTreeMap::new());
        for city in store.cities() {
            let (manifest, name) = (city.manifest(), &city.manifest().name);
            let text = serde_json::to_vec_pretty(manifest).unwrap_or_default();
            let private = access.is_private(name);
            json.insert(name.clone(), packed(text, JSON, private));
            // A manifest over bincode's limit is served as JSON alone.
            if let Ok(bytes) = bincode::to_bytes(manifest) {
                bincode.insert(name.clone(), packed(bytes, BINCODE, private));
            }
        }
        let openapi =
            EncodedContent::new(OPENAPI.as_bytes().to_vec(), "application/vnd.oai.openapi+json", REVALIDATE, "");
        let lists = [false, true].map(|all| list(store, |name| all || !access.is_private(name), all));
        Self { lists, json, bincode, openapi }
    }
}

fn packed(body: Vec<u8>, content_type: &'static str, private: bool) -> EncodedContent {
    EncodedContent::new(body, content_type, cache_control(private), "accept")
}

fn cache_control(private: bool) -> HeaderValue {
    if private { HeaderValue::from_static("private, no-cache") } else { REVALIDATE }
}

fn list(store: &Store, visible: impl Fn(&str) -> bool, private: bool) -> EncodedContent {
    let listed = |manifest: &Manifest| serde_json::to_value(line(manifest)).unwrap_or_default();
    let cities = store.cities().filter(|city| visible(&city.manifest().name));
    let lines: Vec<_> = cities.map(|city| listed(city.manifest())).collect();
    let body = serde_json::to_vec_pretty(&lines).unwrap_or_default();
    EncodedContent::new(body, JSON, cache_control(private), "")
}

fn line(manifest: &Manifest) -> CityListEntry<'_> {
    CityListEntry {
        name: &manifest.name,
        title: &manifest.title,
        version: &manifest.version,
        manifest: route::manifest(&manifest.name),
        nodes: manifest.counts.nodes_per_level.iter().sum(),
        bytes: manifest.counts.bytes_per_level.iter().sum(),
        attribution: &manifest.attribution,
    }
}
