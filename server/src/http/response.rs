//! Responses whose whole body is in memory, and the CORS headers that all responses share.

use axum::{
    body::Bytes,
    http::{HeaderMap, HeaderValue, Response, header},
};
use http_body_util::Full;

const ANY: HeaderValue = HeaderValue::from_static("*");

/// A response whose whole body is in memory.
pub(super) type FullResponse = Response<Full<Bytes>>;

/// Lets pages of any origin read the response. This exposes nothing: browsers do not send bearer tokens by themselves.
pub(super) fn with_cors(mut headers: HeaderMap) -> HeaderMap {
    headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, ANY);
    headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, ANY);
    headers
}
