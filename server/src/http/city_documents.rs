//! City list, manifests and OpenAPI document, encoded once per change of a city.

use super::access_control::AccessControl;
use super::content_encoding::EncodedContent;
use super::page_request::PageRequest;
use super::representation::{REVALIDATE, REVALIDATE_PRIVATE};
use crate::store::{CityStore, Store};
use axum::http::HeaderValue;
use insula_protocol::codec::bincode;
use insula_protocol::manifest::Attribution;
use insula_protocol::route;
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Bound;
use std::sync::Arc;

pub(super) const JSON: &str = "application/json";
pub(super) const BINCODE: &str = "application/x-bincode";

/// A page ends early at this size.
const PAGE_BYTES: usize = 1 << 20;

/// The HTTP contract as OpenAPI 3.0; the tests check the server against it.
pub const OPENAPI: &str = include_str!("../../openapi.json");

/// All documents about the cities, ready to be sent.
#[derive(Debug)]
pub(super) struct CityDocuments {
    /// The first page without the private cities.
    pub(super) public_list: ListPage,
    pub(super) full_list: ListPage,
    /// By city name.
    cities: BTreeMap<String, Arc<CityDocument>>,
    pub(super) openapi: Arc<EncodedContent>,
}

/// The manifest of one version of a city.
#[derive(Debug)]
pub(super) struct CityDocument {
    serial: u64,
    pub(super) json: EncodedContent,
    /// `None` over bincode's size limit.
    pub(super) bincode: Option<EncodedContent>,
}

/// Consecutive cities of the list.
#[derive(Debug)]
pub(super) struct ListPage {
    pub(super) content: EncodedContent,
    /// The last city of this page, if there are more.
    pub(super) last: Option<String>,
}

#[derive(Serialize)]
struct CityListEntry<'a> {
    name: &'a str,
    title: &'a str,
    version: &'a str,
    manifest: String,
    nodes: u64,
    /// Size of all archives.
    bytes: u64,
    attribution: &'a [Attribution],
    /// Of which city it is a version, and of which day.
    #[serde(skip_serializing_if = "Option::is_none")]
    version_of: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    date: Option<&'a str>,
}

impl CityDocuments {
    /// Takes the documents of cities that have not changed from `previous`.
    pub(super) fn new(store: &Store, access: &AccessControl, previous: Option<&Self>) -> Self {
        let document = |city: &Arc<CityStore>| {
            let name = city.manifest().name.clone();
            let known = previous.and_then(|previous| previous.cities.get(&name));
            let known = known.filter(|document| document.serial == city.serial()).cloned();
            let document = known.unwrap_or_else(|| Arc::new(CityDocument::new(city, access.is_public(&name))));
            (name, document)
        };
        let openapi = || {
            let openapi_type = "application/vnd.oai.openapi+json";
            Arc::new(EncodedContent::new(OPENAPI.as_bytes().to_vec(), openapi_type, REVALIDATE, ""))
        };
        let list = |is_listed: &dyn Fn(&str) -> bool, is_public: bool| {
            let (body, last) = list_body(store, PageRequest::default(), is_listed);
            ListPage { content: EncodedContent::new(body, JSON, cache_control(is_public), ""), last }
        };
        Self {
            public_list: list(&|name| access.is_public(name), true),
            full_list: list(&|_| true, false),
            cities: store.cities().map(document).collect(),
            openapi: previous.map_or_else(openapi, |previous| previous.openapi.clone()),
        }
    }

    pub(super) fn city(&self, name: &str) -> Option<&CityDocument> {
        self.cities.get(name).map(Arc::as_ref)
    }
}

impl CityDocument {
    fn new(city: &CityStore, is_public: bool) -> Self {
        let manifest = city.manifest();
        let encode = |body, content_type| EncodedContent::new(body, content_type, cache_control(is_public), "accept");
        let text = serde_json::to_vec_pretty(manifest).unwrap_or_default();
        let bincode = bincode::to_bytes(manifest).ok();
        Self { serial: city.serial(), json: encode(text, JSON), bincode: bincode.map(|bytes| encode(bytes, BINCODE)) }
    }
}

impl ListPage {
    /// A page that is encoded for one request.
    pub(super) fn uncompressed(
        store: &Store,
        request: PageRequest<'_>,
        is_listed: &dyn Fn(&str) -> bool,
        is_public: bool,
    ) -> Self {
        let (body, last) = list_body(store, request, is_listed);
        Self { content: EncodedContent::uncompressed(body, JSON, cache_control(is_public)), last }
    }
}

fn cache_control(is_public: bool) -> HeaderValue {
    if is_public { REVALIDATE } else { REVALIDATE_PRIVATE }
}

/// The page's cities as JSON, and the name of the last one if there are more.
fn list_body(
    store: &Store,
    PageRequest { after, limit }: PageRequest<'_>,
    is_listed: &dyn Fn(&str) -> bool,
) -> (Vec<u8>, Option<String>) {
    let start = after.map_or(Bound::Unbounded, Bound::Excluded);
    let mut cities = store.cities_from(start).filter(|city| is_listed(&city.manifest().name)).peekable();
    let (mut entries, mut bytes, mut last) = (Vec::new(), 0, None);
    while let Some(city) = cities.next_if(|_| entries.len() < limit.get() && bytes < PAGE_BYTES) {
        let manifest = city.manifest();
        let entry = serde_json::to_value(list_entry(city)).unwrap_or_default();
        bytes += entry.to_string().len();
        last = Some(&manifest.name);
        entries.push(entry);
    }
    let last = last.filter(|_| cities.peek().is_some()).cloned();
    (serde_json::to_vec_pretty(&entries).unwrap_or_default(), last)
}

fn list_entry(city: &CityStore) -> CityListEntry<'_> {
    let manifest = city.manifest();
    CityListEntry {
        name: &manifest.name,
        title: &manifest.title,
        version: &manifest.version,
        manifest: route::manifest(&manifest.name),
        nodes: manifest.counts.nodes_per_level.iter().sum(),
        bytes: city.file_bytes(),
        attribution: &manifest.attribution,
        version_of: manifest.release.as_ref().map(|release| release.of.as_str()),
        date: manifest.release.as_ref().map(|release| release.date.as_str()),
    }
}
