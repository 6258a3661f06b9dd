//! Responses whose whole body is in memory, and the CORS headers that all responses share.

use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, Response, header};

const ANY: HeaderValue = HeaderValue::from_static("*");

/// Methods of the addresses of drawings and analyses.
pub(super) const POST_METHODS: HeaderValue = HeaderValue::from_static("POST,OPTIONS");

/// Value of `Referrer-Policy`: the address may hold a share link.
pub(super) const NO_REFERRER: HeaderValue = HeaderValue::from_static("no-referrer");

/// A response whose whole body is in memory.
pub(super) type FullResponse = Response<Bytes>;

/// Lets pages of any origin read the response. This exposes nothing: browsers do not send bearer tokens by themselves.
pub(super) fn with_cors(mut headers: HeaderMap) -> HeaderMap {
    headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, ANY);
    headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, ANY);
    headers
}
