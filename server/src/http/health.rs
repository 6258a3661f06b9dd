//! What machines ask: is it alive, may requests come, how is it going.
//!
//! In: `/healthz`, `/readyz`, `/metrics`. Out: a word, or counters as text. Next: orchestrators, Prometheus.

use super::{problem::Problem, state::AppState};
use axum::{
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};

const NOT_KEPT: (header::HeaderName, &str) = (header::CACHE_CONTROL, "no-store");

/// The process answers.
pub(super) async fn alive() -> Response {
    ([NOT_KEPT], "ok\n").into_response()
}

/// Cities are open and the server is not shutting down.
pub(super) async fn ready(State(app): State<AppState>) -> Result<Response, Problem> {
    if app.is_ready() {
        Ok(([NOT_KEPT], "ready\n").into_response())
    } else {
        Err(Problem::unavailable("no city is open, or the server is shutting down"))
    }
}

/// OpenMetrics 1.0, as Prometheus reads it.
pub(super) async fn metrics(State(app): State<AppState>) -> Response {
    let kind = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    ([NOT_KEPT, (header::CONTENT_TYPE, kind)], app.metrics().text(app.room().requests())).into_response()
}
