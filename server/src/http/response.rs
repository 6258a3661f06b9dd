//! Responses whose whole body is in memory.

use axum::{
    body::Bytes,
    http::{HeaderMap, HeaderValue, Response, header},
};
use http_body_util::Full;

const ANY: HeaderValue = HeaderValue::from_static("*");

/// An answer whose bytes are all there: every answer is.
pub(super) type FullResponse = Response<Full<Bytes>>;

/// Any page may read the answers: what is not public asks for a token, which no browser sends of itself.
pub(super) fn with_cors(mut headers: HeaderMap) -> HeaderMap {
    headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, ANY);
    headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, ANY);
    headers
}
