//! Which cities there are, and each one's manifest.
//!
//! In: `/v1/cities`, `/v1/cities/{city}`. Out: JSON, or bincode where the client asks for it. Next: the client's scene.

use super::{
    AppState, Problem,
    headers::{REVALIDATE, Representation, etag_of},
};
use crate::store::Store;
use axum::{
    extract::{Path, State, rejection::PathRejection},
    http::{HeaderMap, HeaderValue, Method, header},
    response::Response,
};
use bytes::Bytes;
use insula_protocol::{Manifest, codec::bincode, manifest::Attribution, route};
use serde::Serialize;
use std::collections::BTreeMap;

const JSON: &str = "application/json";
const BINCODE: &str = "application/x-bincode";

/// All that can be said of the cities, made once: they do not change while they are open.
#[derive(Debug)]
pub(super) struct Manifests {
    list: Representation,
    json: BTreeMap<String, Representation>,
    bincode: BTreeMap<String, Representation>,
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
    pub(super) fn new(store: &Store) -> Self {
        let mut manifests = Self { list: list(store), json: BTreeMap::new(), bincode: BTreeMap::new() };
        for city in store.cities() {
            let (manifest, name) = (city.manifest(), &city.manifest().name);
            let json = serde_json::to_vec_pretty(manifest).unwrap_or_default();
            manifests.json.insert(name.clone(), representation(json, JSON, true));
            // A manifest over bincode's limit is served as JSON alone.
            if let Ok(bytes) = bincode::to_bytes(manifest) {
                manifests.bincode.insert(name.clone(), representation(bytes, BINCODE, true));
            }
        }
        manifests
    }
}

fn list(store: &Store) -> Representation {
    let listed = |manifest: &Manifest| serde_json::to_value(line(manifest)).unwrap_or_default();
    let lines: Vec<_> = store.cities().map(|city| listed(city.manifest())).collect();
    representation(serde_json::to_vec_pretty(&lines).unwrap_or_default(), JSON, false)
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

fn representation(body: Vec<u8>, content_type: &'static str, by_accept: bool) -> Representation {
    Representation {
        etag: etag_of(&body),
        body: Bytes::from(body),
        content_type: HeaderValue::from_static(content_type),
        cache_control: REVALIDATE,
        vary: by_accept.then_some(HeaderValue::from_static("accept")),
    }
}

/// `/v1/cities`
pub(super) async fn cities(State(app): State<AppState>, method: Method, headers: HeaderMap) -> Response {
    app.manifests().list.clone().answer(&method, &headers)
}

/// `/v1/cities/{city}`
pub(super) async fn manifest(
    State(app): State<AppState>,
    city: Result<Path<String>, PathRejection>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path(city) = city.map_err(|_| Problem::bad_request("the address is not UTF-8 text"))?;
    let manifests = app.manifests();
    let bincode = if wants_bincode(&headers) { manifests.bincode.get(&city) } else { None };
    let found = bincode.or_else(|| manifests.json.get(&city)).ok_or(Problem::not_found("there is no such city"))?;
    Ok(found.clone().answer(&method, &headers))
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
