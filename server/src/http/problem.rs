//! Errors as clients see them: `application/problem+json` (RFC 9457).
//!
//! In: a status and a fixed sentence. Out: a response. Next: the client's retry.
//!
//! A problem holds only constants: nothing of the request, of a path or of an inner error can leak into it.

use super::response::FullResponse;
use axum::{
    http::{HeaderName, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use http_body_util::Full;
use serde::Serialize;

/// What went wrong, for the client.
#[derive(Debug, Clone)]
pub struct Problem {
    status: StatusCode,
    detail: &'static str,
    header: Option<(HeaderName, HeaderValue)>,
}

#[derive(Serialize)]
struct Body {
    r#type: &'static str,
    title: &'static str,
    status: u16,
    detail: &'static str,
}

impl Problem {
    /// Any status with a sentence.
    pub const fn new(status: StatusCode, detail: &'static str) -> Self {
        Self { status, detail, header: None }
    }

    /// What was asked for does not exist: 404.
    pub const fn not_found(detail: &'static str) -> Self {
        Self::new(StatusCode::NOT_FOUND, detail)
    }

    /// What was asked for cannot be: 400.
    pub const fn bad_request(detail: &'static str) -> Self {
        Self::new(StatusCode::BAD_REQUEST, detail)
    }

    /// Not now: 503, with the seconds after which to ask again.
    pub fn unavailable(detail: &'static str) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, detail).with(header::RETRY_AFTER, HeaderValue::from_static("1"))
    }

    /// With one header more.
    pub fn with(mut self, name: HeaderName, value: HeaderValue) -> Self {
        self.header = Some((name, value));
        self
    }
}

impl Problem {
    pub(super) fn answer(self) -> FullResponse {
        let body = Full::new(self.body().into());
        let mut response = FullResponse::new(body);
        *response.status_mut() = self.status;
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
        headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        headers.extend(self.header);
        response
    }

    fn body(&self) -> Vec<u8> {
        let title = self.status.canonical_reason().unwrap_or("Error");
        let body = Body { r#type: "about:blank", title, status: self.status.as_u16(), detail: self.detail };
        serde_json::to_vec(&body).unwrap_or_default()
    }

    /// The whole answer as HTTP/1.1 has it, for what never became a request.
    pub(super) fn raw(&self) -> Vec<u8> {
        let body = self.body();
        let title = self.status.canonical_reason().unwrap_or("Error");
        let mut raw = format!(
            "HTTP/1.1 {} {title}\r\ncontent-type: application/problem+json\r\ncontent-length: {}\r\n\
             cache-control: no-store\r\nx-content-type-options: nosniff\r\nconnection: close\r\n\r\n",
            self.status.as_u16(),
            body.len(),
        )
        .into_bytes();
        raw.extend_from_slice(&body);
        raw
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        self.answer().into_response()
    }
}
