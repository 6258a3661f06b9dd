//! The addresses that are not tiles'.
//!
//! In: an [`AppState`]. Out: a router. Next: `manifest`, `page`, `health`.

use super::{health, index_page, manifest, problem::Problem, state::AppState};
use axum::{
    Router,
    http::{HeaderValue, StatusCode, header},
    routing::get,
};
use insula_protocol::route::CITIES;

/// Everything but tiles, which `app` answers itself.
pub(super) fn router(state: AppState) -> Router {
    Router::new()
        .route("/", get(index_page::index))
        .route(CITIES, get(manifest::cities))
        .route(&format!("{CITIES}/{{city}}"), get(manifest::manifest))
        .route(&format!("{CITIES}/{{city}}/{{version}}/{{layer}}/{{level}}/{{x}}/{{y}}"), get(no_route))
        .route("/v1/openapi.json", get(manifest::openapi))
        .route("/healthz", get(health::alive))
        .route("/readyz", get(health::ready))
        .route("/metrics", get(health::metrics))
        .fallback(no_route)
        .method_not_allowed_fallback(no_method)
        .with_state(state)
}

/// No such route.
async fn no_route() -> Problem {
    Problem::not_found("there is nothing at this address; the cities are listed at /v1/cities")
}

/// A route, but not by this method. The router adds `Allow`.
async fn no_method() -> Problem {
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "this address answers GET, HEAD and OPTIONS only")
        .with(header::ALLOW, HeaderValue::from_static("GET,HEAD,OPTIONS"))
}
