//! The city list, manifests as JSON or bincode, and the OpenAPI document.

use super::{
    city_documents::{BINCODE, JSON},
    problem::Problem,
    state::AppState,
};
use axum::{
    extract::{Path, State, rejection::PathRejection},
    http::{HeaderMap, Method, header},
    response::{IntoResponse, Response},
};

/// `/v1/cities`: the cities that the request may see.
pub(super) async fn list_cities(State(state): State<AppState>, method: Method, headers: HeaderMap) -> Response {
    let catalog = state.catalog();
    let documents = catalog.documents();
    let list = if catalog.access().has_token(&headers) { &documents.full_list } else { &documents.public_list };
    list.select(&headers).clone().respond(&method, &headers).into_response()
}

/// `/v1/openapi.json`
pub(super) async fn openapi(State(state): State<AppState>, method: Method, headers: HeaderMap) -> Response {
    let catalog = state.catalog();
    catalog.documents().openapi.select(&headers).clone().respond(&method, &headers).into_response()
}

/// `/v1/cities/{city}`. Fails with 400 for a name that is not UTF-8, 401 without a required token, 404 for an unknown city.
pub(super) async fn manifest(
    State(state): State<AppState>,
    city: Result<Path<String>, PathRejection>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path(city) = city.map_err(|_| Problem::bad_request("the path is not UTF-8 text"))?;
    let catalog = state.catalog();
    catalog.access().authorize(&city, &headers)?;
    let documents = catalog.documents();
    let bincode = if prefers_bincode(&headers) { documents.bincode.get(&city) } else { None };
    let found = bincode.or_else(|| documents.json.get(&city)).ok_or(Problem::not_found("there is no such city"))?;
    Ok(found.select(&headers).clone().respond(&method, &headers).into_response())
}

/// Whether `Accept` ranks bincode at least as high as JSON. Wildcards count for JSON, because browsers send them.
fn prefers_bincode(headers: &HeaderMap) -> bool {
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
