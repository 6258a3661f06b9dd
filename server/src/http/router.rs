//! The addresses that are not tiles'.
//!
//! In: an [`AppState`]. Out: a router. Next: `manifest`, `page`, `health`.

use super::{
    AppState,
    error::{no_method, no_route},
    health, manifest, page,
};
use axum::{Router, routing::get};
use insula_protocol::route::CITIES;

/// Everything but tiles, which `app` answers itself.
pub(super) fn router(state: AppState) -> Router {
    Router::new()
        .route("/", get(page::index))
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
