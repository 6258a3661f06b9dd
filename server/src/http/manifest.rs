//! The city list, manifests as JSON or bincode, and the OpenAPI document.

use super::accept::{accepted, accepts};
use super::access_control::{AccessRequest, CityAccess, Credentials};
use super::city_documents::{BINCODE, JSON, ListPage};
use super::city_page::respond_with_city;
use super::fair_queue::{Shed, StopFlag};
use super::page_request::{PageRequest, page_request};
use super::problem::Problem;
use super::state::AppState;
use super::work_queues::{RequestClient, WorkKind};
use axum::extract::State;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use insula_protocol::route::{CITIES, Route, RouteTemplate};
use std::sync::Arc;

/// `/v1/cities`: the cities that the request may see, in pages. Fails with 400 for an invalid `limit` or `after`, and with 503 if there is no
/// time for a page that is not in memory.
pub(super) async fn list_cities(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let request = page_request(parts.uri.query().unwrap_or_default())?;
    let catalog = state.catalog_now();
    let documents = &catalog.documents;
    let credentials = Credentials::of(&parts);
    let has_token = catalog.access.has_token(credentials);
    let shared = catalog.shared(credentials).filter(|_| !has_token);
    let made;
    let page = if request == PageRequest::default() && shared.is_none() {
        if has_token { &documents.full_list } else { &documents.public_list }
    } else {
        let (catalog, after) = (Arc::clone(&catalog), request.after.map(str::to_owned));
        let work = move |_: &StopFlag| {
            let is_shared = |name: &str| shared.as_ref().is_some_and(|grant| grant.city == name);
            let is_listed = |name: &str| has_token || catalog.access.is_public(name) || is_shared(name);
            let is_public = !has_token && shared.is_none();
            let request = PageRequest { after: after.as_deref(), limit: request.limit };
            ListPage::uncompressed(catalog.store(), request, &is_listed, is_public)
        };
        made = state.work(WorkKind::Lists).run(RequestClient::of(&parts), work).await.map_err(Shed::problem)?;
        &made
    };
    let mut response = page.content.response_to(&parts);
    if let Some(last) = &page.last {
        let prefix = state.public_url.as_ref().map_or("", |url| url.prefix());
        let link = format!("<{prefix}{CITIES}?limit={}&after={last}>; rel=\"next\"", request.limit);
        response.headers_mut().extend(HeaderValue::try_from(link).map(|link| (header::LINK, link)));
    }
    Ok(response)
}

/// `/v1/openapi.json`
pub(super) async fn openapi(State(state): State<AppState>, parts: Parts) -> Response {
    state.catalog().documents.openapi.response_to(&parts)
}

/// `/v1/cities/{city}`; for a browser that opens a share link, a page. Fails with 401 without a required token, 404 for an unknown city.
pub(super) async fn manifest(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    // As in all addresses, a name has one spelling. Another one is that of no city, which could also be private.
    let name = match Route::parse(parts.uri.path()) {
        Ok(Route::Manifest { city }) => city,
        _ => "",
    };
    let catalog = state.catalog();
    let city = catalog.store().city(name);
    let version = city.map(|city| city.manifest().version.as_str());
    let request = AccessRequest { route: RouteTemplate::Manifest, city: name, version };
    let access = catalog.access.authorize(Credentials::of(&parts), request)?;
    let not_found = Problem::not_found("there is no such city");
    if let (CityAccess::Link(_), Some(city)) = (access, city)
        && accepts(&parts.headers, "text/html") > 0.0
    {
        return Ok(respond_with_city(&state, city, access, &parts));
    }
    let document = catalog.documents.city(name).ok_or(not_found)?;
    let bincode = document.bincode.as_ref().filter(|_| prefers_bincode(&parts.headers));
    Ok(bincode.unwrap_or(&document.json).response_to(&parts))
}

/// Whether `Accept` ranks bincode at least as high as JSON. Wildcards count for JSON, because browsers send them.
fn prefers_bincode(headers: &HeaderMap) -> bool {
    let (mut bincode, mut json) = (0.0f32, 0.0f32);
    for (media, quality) in accepted(headers, header::ACCEPT) {
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
    use axum::http::HeaderValue;

    #[test]
    fn bincode_is_sent_only_if_accept_prefers_it() {
        let prefers = |value: &'static str| {
            prefers_bincode(&HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_static(value))]))
        };
        assert!(prefers("application/x-bincode"));
        assert!(prefers("application/x-bincode, application/json;q=0.5"));
        assert!(prefers("text/html, Application/X-Bincode"));
        assert!(!prefers("application/x-bincode;q=0.1, */*"));
        assert!(!prefers("application/x-bincode;q=0"));
        assert!(!prefers("application/x-bincode;q=nonsense"));
        assert!(!prefers("*/*") && !prefers("application/json") && !prefers(""));
        assert!(!prefers_bincode(&HeaderMap::new()));
    }
}
