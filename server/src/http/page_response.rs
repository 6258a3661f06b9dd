//! What the responses with pages share: headers, and the address by which the client knows the server.

use super::representation::Representation;
use super::request_host::request_host;
use super::response::NO_REFERRER;
use super::state::AppState;
use crate::share_link;
use axum::http::request::Parts;
use axum::http::{HeaderValue, Uri, header};
use axum::response::Response;
use bytes::Bytes;

/// Responds with a page under a Content-Security-Policy. `vary` names the headers on which its content depends.
pub(super) fn respond(
    html: String,
    policy: &'static str,
    is_public: bool,
    vary: Option<HeaderValue>,
    request: &Parts,
) -> Response {
    let representation =
        Representation { vary, ..Representation::changing(Bytes::from(html), "text/html; charset=utf-8", is_public) };
    let mut response = representation.response_to(request);
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(policy));
    response.headers_mut().insert(header::REFERRER_POLICY, NO_REFERRER);
    response
}

/// What precedes all paths of this server for its users: the configured address, else scheme and host of the request. `None` for a host
/// that has not the form of one.
pub(super) fn known_origin(state: &AppState, request: &Parts) -> Option<String> {
    if let Some(url) = &state.public_url {
        return Some(url.base().to_owned());
    }
    let host = request_host(&request.uri, &request.headers)?;
    let is_allowed = |b: u8| b.is_ascii_alphanumeric() || b".:-[]_".contains(&b);
    (!host.is_empty() && host.bytes().all(is_allowed)).then(|| format!("{}://{host}", state.scheme))
}

/// As [`known_origin`], with a placeholder.
pub(super) fn displayed_origin(state: &AppState, request: &Parts) -> String {
    known_origin(state, request).unwrap_or_else(|| format!("{}://HOST", state.scheme))
}

/// The address of the server's root relative to that of the request, so that pages work below any path of a proxy: empty, or with a slash
/// at its end.
pub(super) fn relative_root(uri: &Uri) -> String {
    "../".repeat(uri.path().matches('/').count().saturating_sub(1))
}

/// A path of this server, relative to the page that has this root.
pub(super) fn relative(root: &str, path: &str) -> String {
    let rest = path.trim_start_matches('/');
    if root.is_empty() && rest.is_empty() { "./".to_owned() } else { format!("{root}{rest}") }
}

/// The share link of the request as a query. Only for requests whose link has been verified.
pub(super) fn share_query(uri: &Uri) -> Option<String> {
    uri.query().and_then(share_link::from_query).map(|link| format!("?{}={link}", share_link::PARAMETER))
}
