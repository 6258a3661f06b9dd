//! Which cities there are, and each one's manifest.
//!
//! In: `/v1/cities`, `/v1/cities/{city}`. Out: JSON, or bincode where the client asks for it, packed if it likes.
//! Next: the client's scene.

use super::{
    AppState, Problem,
    access::{Access, Sight},
    headers::REVALIDATE,
    packed::Packed,
};
use crate::store::Store;
use axum::{
    extract::{Path, State, rejection::PathRejection},
    http::{HeaderMap, HeaderValue, Method, header},
    response::{IntoResponse, Response},
};
use insula_protocol::{Manifest, codec::bincode, manifest::Attribution, route};
use serde::Serialize;
use std::collections::BTreeMap;

const JSON: &str = "application/json";
const BINCODE: &str = "application/x-bincode";

/// The contract, which the tests hold the server to.
const OPENAPI: &str = include_str!("../../openapi.json");

/// All that can be said of the cities, made once each time that one of them changes.
#[derive(Debug)]
pub(super) struct Manifests {
    /// For everybody, and for who has a token.
    lists: [Packed; 2],
    json: BTreeMap<String, Packed>,
    bincode: BTreeMap<String, Packed>,
    openapi: Packed,
}

/// One line of the list.
#[derive(Serialize)]
struct Listed<'a> {
    name: &'a str,
    title: &'a str,
    version: &'a str,
    manifest: String,
    nodes: u64,
    bytes: u64,
    attribution: &'a [Attribution],
}

impl Manifests {
    pub(super) fn new(store: &Store, access: &Access) -> Self {
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
        let openapi = Packed::new(OPENAPI.as_bytes().to_vec(), "application/vnd.oai.openapi+json", REVALIDATE, "");
        let lists = [false, true].map(|all| list(store, |name| all || !access.is_private(name), all));
        Self { lists, json, bincode, openapi }
    }
}

fn packed(body: Vec<u8>, content_type: &'static str, private: bool) -> Packed {
    Packed::new(body, content_type, cache_control(private), "accept")
}

fn cache_control(private: bool) -> HeaderValue {
    if private { HeaderValue::from_static("private, no-cache") } else { REVALIDATE }
}

fn list(store: &Store, visible: impl Fn(&str) -> bool, private: bool) -> Packed {
    let listed = |manifest: &Manifest| serde_json::to_value(line(manifest)).unwrap_or_default();
    let cities = store.cities().filter(|city| visible(&city.manifest().name));
    let lines: Vec<_> = cities.map(|city| listed(city.manifest())).collect();
    let body = serde_json::to_vec_pretty(&lines).unwrap_or_default();
    Packed::new(body, JSON, cache_control(private), "")
}

fn line(manifest: &Manifest) -> Listed<'_> {
    Listed {
        name: &manifest.name,
        title: &manifest.title,
        version: &manifest.version,
        manifest: route::manifest(&manifest.name),
        nodes: manifest.counts.nodes_per_level.iter().sum(),
        bytes: manifest.counts.bytes_per_level.iter().sum(),
        attribution: &manifest.attribution,
    }
}

/// `/v1/cities`: what the request may see.
pub(super) async fn cities(State(app): State<AppState>, method: Method, headers: HeaderMap) -> Response {
    let catalog = app.catalog();
    let all = catalog.access().has_token(&headers);
    let [public, private] = &catalog.manifests().lists;
    let list = if all { private } else { public };
    list.choose(&headers).clone().answer(&method, &headers).into_response()
}

/// `/v1/openapi.json`
pub(super) async fn openapi(State(app): State<AppState>, method: Method, headers: HeaderMap) -> Response {
    let catalog = app.catalog();
    catalog.manifests().openapi.choose(&headers).clone().answer(&method, &headers).into_response()
}

/// `/v1/cities/{city}`
pub(super) async fn manifest(
    State(app): State<AppState>,
    city: Result<Path<String>, PathRejection>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path(city) = city.map_err(|_| Problem::bad_request("the address is not UTF-8 text"))?;
    let catalog = app.catalog();
    let (Sight::Public | Sight::Private) = catalog.access().sight(&city, &headers)?;
    let manifests = catalog.manifests();
    let bincode = if wants_bincode(&headers) { manifests.bincode.get(&city) } else { None };
    let found = bincode.or_else(|| manifests.json.get(&city)).ok_or(Problem::not_found("there is no such city"))?;
    Ok(found.choose(&headers).clone().answer(&method, &headers).into_response())
}

/// Whether `Accept` likes bincode at least as much as JSON. Wildcards count for JSON: people's browsers send them.
fn wants_bincode(headers: &HeaderMap) -> bool {
    let (mut bincode, mut json) = (0.0f32, 0.0f32);
    let values = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    for item in values.flat_map(|list| list.split(',')) {
        let mut parts = item.split(';').map(str::trim);
        let media = parts.next().unwrap_or_default();
        let quality = parts.find_map(|part| part.strip_prefix("q=")).map_or(1.0, |q| q.parse().unwrap_or(0.0));
        if media.eq_ignore_ascii_case(BINCODE) {
            bincode = quality;
        } else if media.eq_ignore_ascii_case(JSON) || media == "application/*" || media == "*/*" {
            json = json.max(quality);
        }
    }
    bincode > 0.0 && bincode >= json
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accept() {
        let wants = |value: &'static str| {
            wants_bincode(&HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(value))]))
        };
        assert!(wants("application/x-bincode"));
        assert!(wants("application/x-bincode, application/json;q=0.5"));
        assert!(wants("text/html, Application/X-Bincode"));
        assert!(!wants("application/x-bincode;q=0.1, */*"));
        assert!(!wants("application/x-bincode;q=0"));
        assert!(!wants("application/x-bincode;q=nonsense"));
        assert!(!wants("*/*") && !wants("application/json") && !wants(""));
        assert!(!wants_bincode(&HeaderMap::new()));
    }
}
