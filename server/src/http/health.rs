//! Liveness, readiness and metrics: `/healthz`, `/readyz`, `/metrics`.

use super::{problem::Problem, state::AppState};
use axum::{
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};

const NO_STORE: (header::HeaderName, &str) = (header::CACHE_CONTROL, "no-store");

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

/// All metrics as OpenMetrics 1.0 text.
pub(super) async fn metrics(State(state): State<AppState>) -> Response {
    let content_type = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    let text = state.metrics().to_open_metrics(state.in_flight().requests());
    ([NO_STORE, (header::CONTENT_TYPE, content_type)], text).into_response()
}
