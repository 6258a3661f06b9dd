//! Errors as clients see them: `application/problem+json` (RFC 9457).
//!
//! A problem holds only constants, so that nothing of a path or an internal error can leak into it. Only [`Problem::explained`]
//! says more: what is wrong with the body of the request.

use super::response::FullResponse;
use axum::body::Body;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use std::borrow::Cow;

/// Longest explanation in characters.
#[cfg(feature = "bake")]
const MAX_EXPLANATION: usize = 300;

/// The type of problems of which the status says all.
const NO_TYPE: &str = "about:blank";

/// The response to requests for addresses that do not exist.
pub(super) const NO_ROUTE: Problem =
    Problem::not_found("there is nothing at this path; the cities are listed at /v1/cities");

/// An HTTP error with a fixed explanation and at most one extra header.
#[derive(Debug, Clone)]
pub struct Problem {
    r#type: &'static str,
    pub(super) status: StatusCode,
    detail: Cow<'static, str>,
    header: Option<(HeaderName, HeaderValue)>,
}

#[derive(Serialize)]
struct ProblemBody<'a> {
    r#type: &'static str,
    title: &'static str,
    status: u16,
    detail: &'a str,
}

impl Problem {
    /// A problem of any status.
    pub const fn new(status: StatusCode, detail: &'static str) -> Self {
        Self { r#type: NO_TYPE, status, detail: Cow::Borrowed(detail), header: None }
    }

    /// 404.
    pub const fn not_found(detail: &'static str) -> Self {
        Self::new(StatusCode::NOT_FOUND, detail)
    }

    /// 400.
    pub const fn bad_request(detail: &'static str) -> Self {
        Self::new(StatusCode::BAD_REQUEST, detail)
    }

    /// 400 with what is wrong with the body of the request, which is the only place that the explanation may be taken from.
    #[cfg(feature = "bake")]
    pub(super) fn explained(explanation: &str) -> Self {
        let detail = explanation.chars().filter(|c| !c.is_control()).take(MAX_EXPLANATION).collect();
        Self { r#type: NO_TYPE, status: StatusCode::BAD_REQUEST, detail: Cow::Owned(detail), header: None }
    }

    /// Sets the type, by which programs tell problems of the same status apart.
    #[cfg(feature = "bake")]
    pub(super) fn of_type(self, r#type: &'static str) -> Self {
        Self { r#type, ..self }
    }

    /// 503 with `Retry-After: 1`.
    pub fn unavailable(detail: &'static str) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, detail).with(header::RETRY_AFTER, HeaderValue::from_static("1"))
    }

    /// 500 with `Retry-After: 60`: the server's copy of a city has failed, which may be replaced.
    pub(super) fn damaged(detail: &'static str) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, detail).with(header::RETRY_AFTER, HeaderValue::from_static("60"))
    }

    /// Sets the extra header.
    pub fn with(mut self, name: HeaderName, value: HeaderValue) -> Self {
        self.header = Some((name, value));
        self
    }

    pub(super) fn respond(self) -> FullResponse {
        let mut response = FullResponse::new(self.body().into());
        *response.status_mut() = self.status;
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        headers.extend(self.header);
        response
    }

    fn title(&self) -> &'static str {
        self.status.canonical_reason().unwrap_or("Error")
    }

    fn body(&self) -> Vec<u8> {
        let status = self.status.as_u16();
        let body = ProblemBody { r#type: self.r#type, title: self.title(), status, detail: &self.detail };
        serde_json::to_vec(&body).unwrap_or_default()
    }

    /// The response as bytes of HTTP/1.1 that close the connection, for input that hyper could not parse.
    pub(super) fn to_http1(&self) -> Vec<u8> {
        let body = self.body();
        let mut raw = format!(
            "HTTP/1.1 {} {}\r\ncontent-type: application/problem+json\r\ncontent-length: {}\r\n\
             cache-control: no-store\r\nx-content-type-options: nosniff\r\nconnection: close\r\n\r\n",
            self.status.as_u16(),
            self.title(),
            body.len(),
        )
        .into_bytes();
        raw.extend_from_slice(&body);
        raw
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        self.respond().map(Body::from)
    }
}
