//! Which cities there are, and each one's manifest.
//!
//! In: `/v1/cities`, `/v1/cities/{city}`. Out: JSON, or bincode where the client asks for it, packed if it likes.
//! Next: the client's scene.

use super::{
    access_control::CityAccess,
    city_documents::{BINCODE, JSON},
    problem::Problem,
    state::AppState,
};
use axum::{
    extract::{Path, State, rejection::PathRejection},
    http::{HeaderMap, Method, header},
    response::{IntoResponse, Response},
};

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
    let (CityAccess::Public | CityAccess::Private) = catalog.access().sight(&city, &headers)?;
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
    use axum::http::HeaderValue;

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
