//! Routes other than tiles, which [`HttpService`](super::HttpService) serves itself.

use super::{health, index_page, manifest, problem::Problem, state::AppState};
use axum::{
    Router,
    http::{HeaderValue, StatusCode, header},
    routing::get,
};
use insula_protocol::route::CITIES;

pub(super) const ALLOWED_METHODS: HeaderValue = HeaderValue::from_static("GET,HEAD,OPTIONS");

/// The router of everything but tiles.
pub(super) fn router(state: AppState) -> Router {
    Router::new()
        .route("/", get(index_page::index))
        .route(CITIES, get(manifest::list_cities))
        .route(&format!("{CITIES}/{{city}}"), get(manifest::manifest))
        // Tile requests by GET and HEAD do not get here. This route makes other methods 405 instead of 404.
        .route(&format!("{CITIES}/{{city}}/{{version}}/{{layer}}/{{level}}/{{x}}/{{y}}"), get(not_found))
        .route("/v1/openapi.json", get(manifest::openapi))
        .route("/healthz", get(health::alive))
        .route("/readyz", get(health::ready))
        .route("/metrics", get(health::metrics))
        .fallback(not_found)
        .method_not_allowed_fallback(method_not_allowed)
        .with_state(state)
}

async fn not_found() -> Problem {
    Problem::not_found("there is nothing at this path; the cities are listed at /v1/cities")
}

async fn method_not_allowed() -> Problem {
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "only GET, HEAD and OPTIONS are supported")
        .with(header::ALLOW, ALLOWED_METHODS)
}
