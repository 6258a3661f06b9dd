//! Requests with a body: what drawings and analyses share, in part with what else is computed of a whole city.
//!
//! These are the only routes that read a body, and the only ones that take seconds: so the body is small and must arrive soon, few pieces of
//! work are done at once on threads of their own, few requests wait, and work that nobody waits for ends. They are off by default.

use super::fair_queue::StopFlag;
use super::problem::{NO_ROUTE, Problem};
use super::response::POST_METHODS;
use super::state::{AppState, MessageKind};
use super::tile::{find_city, unknown_name};
use crate::store::{CityStore, StoredCity};
use axum::body::{Body, to_bytes};
use axum::extract::State;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header};
use axum::response::Response;
use bytes::Bytes;
use insula_archive::ReadError;
use insula_export::source::SourceError;
use insula_protocol::route::{Route, RouteError, RouteTemplate};
use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::time::timeout;

const MAX_BODY_BYTES: usize = 64 << 10;
/// Time within which the body must arrive.
const BODY_TIME: Duration = Duration::from_secs(10);

const NOT_JSON: Problem =
    Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "the options must be JSON: content-type: application/json");

/// The response to other methods.
pub(super) async fn other_method(State(state): State<AppState>, uri: Uri) -> Problem {
    if !state.takes_body(RouteTemplate::of_path(uri.path())) {
        return NO_ROUTE;
    }
    Problem::new(
        StatusCode::METHOD_NOT_ALLOWED,
        "what is made here is made of the options in the body of a POST request",
    )
    .with(header::ALLOW, POST_METHODS)
}

/// The city of an address, if the request may have what is computed of all of it. Fails with 404 where that is off.
pub(super) fn requested_city(state: &AppState, request: &Parts) -> Result<Arc<CityStore>, Problem> {
    let path = request.uri.path();
    let template = RouteTemplate::of_path(path);
    if !state.takes_body(template) && template != RouteTemplate::Proposals {
        return Err(NO_ROUTE);
    }
    let name = match Route::parse(path) {
        Ok(Route::Draw { city } | Route::Analyse { city } | Route::Proposals { city }) => city,
        Err(RouteError::InvalidName) => return Err(unknown_name(state, request)),
        _ => return Err(NO_ROUTE),
    };
    let (city, access) = find_city(state, template, name, request)?;
    if access.admits_computed(template) { Ok(city) } else { Err(Problem::not_found("there is no such city")) }
}

/// The body. Fails with 415 if it is not JSON, 413 if it is too large, and 408 if it is slow.
pub(super) async fn json_body(headers: &HeaderMap, body: Body) -> Result<Bytes, Problem> {
    const TOO_LONG: Problem =
        Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "the options are longer than 64 KiB, or the body ended early");
    const TOO_SLOW: Problem = Problem::new(StatusCode::REQUEST_TIMEOUT, "the options did not arrive within 10 seconds");
    if !is_json(headers) {
        return Err(NOT_JSON);
    }
    let read = timeout(BODY_TIME, to_bytes(body, MAX_BODY_BYTES)).await.map_err(|_| TOO_SLOW)?;
    read.map_err(|_| TOO_LONG)
}

/// Pages of other origins cannot send this type without asking, so they cannot make a browser's user compute.
fn is_json(headers: &HeaderMap) -> bool {
    let text = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    text.split(';').next().is_some_and(|kind| kind.trim().eq_ignore_ascii_case("application/json"))
}

/// A response with what was made for one request, which nobody keeps.
pub(super) fn response_with(made: impl Into<Body>, headers: &[(HeaderName, &'static str)]) -> Response {
    let common = [(header::CACHE_CONTROL, "no-store"), (header::X_CONTENT_TYPE_OPTIONS, "nosniff")];
    let all = headers.iter().cloned().chain(common);
    let mut response = Response::new(made.into());
    response.headers_mut().extend(all.map(|(name, value)| (name, HeaderValue::from_static(value))));
    response
}

/// Works with a city whose tiles are read until nobody waits for the work. Waits for the network if the city is in an object store. Fails if
/// its schema cannot be read.
pub(super) fn with_source<T>(
    city: &CityStore,
    (runtime, stop): (&Handle, &StopFlag),
    work: impl FnOnce(&StoredCity<'_>) -> T,
) -> Result<T, SourceError> {
    let read = |kind, id| {
        if stop.is_stopped() {
            return Err(ReadError::Failed("nobody waits for what is computed".to_owned()));
        }
        runtime.block_on(city.checked_tile(kind, id))
    };
    Ok(work(&StoredCity::open(city.manifest(), &read)?))
}

/// The response if the city's files have failed, which is logged.
pub(super) fn unreadable(state: &AppState, city: &CityStore, reason: &dyn Display) -> Problem {
    if state.admits_message(MessageKind::TileFailure) {
        tracing::error!(place = city.location(), %reason, "cannot read a city");
    }
    Problem::damaged("the server cannot read this city")
}
