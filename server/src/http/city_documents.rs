//! City list, manifests and OpenAPI document, encoded once per change of the cities.

use super::{
    access_control::AccessControl,
    content_encoding::EncodedContent,
    representation::{REVALIDATE, REVALIDATE_PRIVATE},
};
use crate::store::Store;
use axum::http::HeaderValue;
use insula_protocol::{Manifest, codec::bincode, manifest::Attribution, route};
use serde::Serialize;
use std::collections::BTreeMap;

pub(super) const JSON: &str = "application/json";
pub(super) const BINCODE: &str = "application/x-bincode";

/// The HTTP contract; the tests check the server against it.
const OPENAPI: &str = include_str!("../../openapi.json");

/// All documents about the cities, ready to be sent.
#[derive(Debug)]
pub(super) struct CityDocuments {
    /// Without the private cities.
    pub(super) public_list: EncodedContent,
    pub(super) full_list: EncodedContent,
    /// Manifests by city name.
    pub(super) json: BTreeMap<String, EncodedContent>,
    /// Manifests by city name; one over bincode's size limit is missing.
    pub(super) bincode: BTreeMap<String, EncodedContent>,
    pub(super) openapi: EncodedContent,
}

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
            json.insert(name.clone(), encode_manifest(text, JSON, private));
            if let Ok(bytes) = bincode::to_bytes(manifest) {
                bincode.insert(name.clone(), encode_manifest(bytes, BINCODE, private));
            }
        }
        let openapi_type = "application/vnd.oai.openapi+json";
        Self {
            public_list: encode_list(store, |name| !access.is_private(name), false),
            full_list: encode_list(store, |_| true, true),
            json,
            bincode,
            openapi: EncodedContent::new(OPENAPI.as_bytes().to_vec(), openapi_type, REVALIDATE, ""),
        }
    }
}

fn encode_manifest(body: Vec<u8>, content_type: &'static str, private: bool) -> EncodedContent {
    EncodedContent::new(body, content_type, cache_control(private), "accept")
}

fn cache_control(private: bool) -> HeaderValue {
    if private { REVALIDATE_PRIVATE } else { REVALIDATE }
}

fn encode_list(store: &Store, is_listed: impl Fn(&str) -> bool, private: bool) -> EncodedContent {
    let cities = store.cities().filter(|city| is_listed(&city.manifest().name));
    let entries: Vec<_> =
        cities.map(|city| serde_json::to_value(list_entry(city.manifest())).unwrap_or_default()).collect();
    let body = serde_json::to_vec_pretty(&entries).unwrap_or_default();
    EncodedContent::new(body, JSON, cache_control(private), "")
}

fn list_entry(manifest: &Manifest) -> CityListEntry<'_> {
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
