//! The files of the browser viewer: `/assets/{hash}/{file}` and `/service-worker.js`.
//!
//! They are compressed when the viewer is built. All are public, and immutable under the hash of all of them.

use super::problem::Problem;
use super::state::AppState;
use axum::extract::State;
use axum::http::request::Parts;
use axum::http::{HeaderValue, header};
use axum::response::Response;
use insula_protocol::route::Route;

const NO_FILE: Problem = Problem::not_found("the viewer of this server has no such file: load the page again");
/// The service worker fetches from its own host, and runs no other script.
const WORKER_POLICY: HeaderValue = HeaderValue::from_static("default-src 'none'; connect-src 'self'");

/// `/assets/{hash}/{file}`. Fails with 404 for files of another version.
pub(super) async fn asset(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let Ok(Route::Asset { hash, file }) = Route::parse(parts.uri.path()) else { return Err(NO_FILE) };
    let content = state.viewer.as_ref().and_then(|viewer| viewer.file(hash, file)).ok_or(NO_FILE)?;
    Ok(content.response_to(&parts))
}

/// `/service-worker.js`
pub(super) async fn service_worker(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let content = state.viewer.as_ref().and_then(|viewer| viewer.service_worker()).ok_or(NO_FILE)?;
    let mut response = content.response_to(&parts);
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, WORKER_POLICY);
    Ok(response)
}
