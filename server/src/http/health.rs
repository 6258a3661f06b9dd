//! Liveness, readiness and metrics: `/healthz`, `/readyz`, `/metrics`.

use super::access_control::Credentials;
use super::metrics::CurrentCounts;
use super::problem::Problem;
use super::state::AppState;
use axum::extract::State;
use axum::http::header;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};

const NO_STORE: (header::HeaderName, &str) = (header::CACHE_CONTROL, "no-store");

/// Marks requests that came by the listener for operators.
#[derive(Debug, Clone, Copy)]
pub(super) struct ForOperators;

/// Always 200 while the process can respond.
pub(super) async fn alive() -> Response {
    ([NO_STORE], "ok\n").into_response()
}

/// 200 while cities are open and the server is not shutting down, else 503.
pub(super) async fn ready(State(state): State<AppState>) -> Result<Response, Problem> {
    if state.is_ready() {
        Ok(([NO_STORE], "ready\n").into_response())
    } else {
        Err(Problem::unavailable("no city is open, or the server is shutting down"))
    }
}

/// All metrics as OpenMetrics 1.0 text. Private cities are counted for operators only: on `metrics_address`, or with a token.
pub(super) async fn metrics(State(state): State<AppState>, parts: Parts) -> Response {
    let content_type = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    let computed_bytes = state.computed.bytes().await;
    let catalog = state.catalog();
    let (store, access) = (catalog.store(), &catalog.access);
    let is_operator = parts.extensions.get::<ForOperators>().is_some();
    let sees_all = is_operator || access.has_token(Credentials::of(&parts));
    let is_counted = |name: &str| sees_all || access.is_public(name);
    let now = CurrentCounts {
        in_flight: state.in_flight.requests(),
        cities: store.cities().filter(|city| is_counted(&city.manifest().name)).count(),
        failed_cities: if sees_all || !access.is_restricted { store.failures().count() } else { 0 },
        older_versions: store.older_versions(is_counted),
        computed_bytes,
    };
    let text = state.metrics.to_open_metrics(now);
    ([NO_STORE, (header::CONTENT_TYPE, content_type)], text).into_response()
}
