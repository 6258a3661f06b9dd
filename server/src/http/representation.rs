//! Conditional requests and byte ranges (RFC 9110, 13 and 14): 200, 206, 304, 412 or 416 for a given content.

use super::problem::Problem;
use super::response::FullResponse;
use axum::body::Body;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::Response;
use bytes::Bytes;
use std::ops::Range;

/// `Cache-Control` of public content that never changes under its URL.
pub(super) const IMMUTABLE: HeaderValue = HeaderValue::from_static("public, max-age=31536000, immutable");
/// `Cache-Control` of private content that never changes under its URL.
pub(super) const IMMUTABLE_PRIVATE: HeaderValue = HeaderValue::from_static("private, max-age=31536000, immutable");
/// `Cache-Control` of public content that may change.
pub(super) const REVALIDATE: HeaderValue = HeaderValue::from_static("no-cache");
/// `Cache-Control` of private content that may change.
pub(super) const REVALIDATE_PRIVATE: HeaderValue = HeaderValue::from_static("private, no-cache");

/// Content with the headers that describe it.
#[derive(Debug, Clone)]
pub(super) struct Representation {
    pub(super) body: Bytes,
    pub(super) content_type: HeaderValue,
    pub(super) etag: HeaderValue,
    pub(super) cache_control: HeaderValue,
    /// Content coding of `body`; `None` for identity.
    pub(super) encoding: Option<HeaderValue>,
    /// Request headers that selected this content.
    pub(super) vary: Option<HeaderValue>,
}

/// A strong ETag from a hash of the content.
pub(super) fn etag_of(bytes: &[u8]) -> HeaderValue {
    let hash = blake3::hash(bytes).to_hex();
    quoted(&hash[..32])
}

/// `tag` in quotes. A tag with characters that a header may not hold becomes the empty tag.
pub(super) fn quoted(tag: &str) -> HeaderValue {
    HeaderValue::try_from(format!("\"{tag}\"")).unwrap_or(HeaderValue::from_static("\"\""))
}

impl Representation {
    /// Content in no coding, for requests with any headers, that never changes under its URL.
    pub(super) fn immutable(body: Bytes, etag: HeaderValue, content_type: &'static str, is_public: bool) -> Self {
        let cache_control = if is_public { IMMUTABLE } else { IMMUTABLE_PRIVATE };
        let content_type = HeaderValue::from_static(content_type);
        Self { body, content_type, etag, cache_control, encoding: None, vary: None }
    }

    /// As [`Self::immutable`], of content that may change.
    pub(super) fn changing(body: Bytes, content_type: &'static str, is_public: bool) -> Self {
        let cache_control = if is_public { REVALIDATE } else { REVALIDATE_PRIVATE };
        let etag = etag_of(&body);
        Self { cache_control, ..Self::immutable(body, etag, content_type, is_public) }
    }

    /// The response to a GET or HEAD request with these headers.
    pub(super) fn respond(self, method: &Method, request: &HeaderMap) -> FullResponse {
        if !if_match(request, &self.etag) {
            return Problem::new(StatusCode::PRECONDITION_FAILED, "the content has another ETag than If-Match")
                .respond();
        }
        if if_none_match(request, &self.etag) {
            return self.with_body(StatusCode::NOT_MODIFIED, Bytes::new());
        }
        let length = self.body.len() as u64;
        if *method == Method::HEAD {
            // RFC 9110, 14.2: ranges are defined for GET only.
            let mut response = self.with_body(StatusCode::OK, Bytes::new());
            response.headers_mut().insert(header::CONTENT_LENGTH, HeaderValue::from(length));
            return response;
        }
        match requested_range(request, &self.etag, length) {
            RequestedRange::Whole => self.with_body(StatusCode::OK, self.body.clone()),
            RequestedRange::Part(part) => {
                let body = self.body.slice(part.start as usize..part.end as usize);
                let mut response = self.with_body(StatusCode::PARTIAL_CONTENT, body);
                let content_range = format!("bytes {}-{}/{length}", part.start, part.end - 1);
                let content_range = HeaderValue::try_from(content_range).map(|value| (header::CONTENT_RANGE, value));
                response.headers_mut().extend(content_range);
                response
            }
            RequestedRange::Unsatisfiable => {
                let problem = Problem::new(StatusCode::RANGE_NOT_SATISFIABLE, "the range is outside the content");
                match HeaderValue::try_from(format!("bytes */{length}")) {
                    Ok(value) => problem.with(header::CONTENT_RANGE, value).respond(),
                    Err(_) => problem.respond(),
                }
            }
        }
    }

    /// As [`Self::respond`], as handlers return it.
    pub(super) fn response_to(self, request: &Parts) -> Response {
        self.respond(&request.method, &request.headers).map(Body::from)
    }

    fn with_body(&self, status: StatusCode, body: Bytes) -> FullResponse {
        let length = body.len();
        let mut response = FullResponse::new(body);
        *response.status_mut() = status;
        let headers = response.headers_mut();
        headers.reserve(12);
        headers.insert(header::ETAG, self.etag.clone());
        headers.insert(header::CACHE_CONTROL, self.cache_control.clone());
        headers.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
        headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
        headers.extend(self.vary.clone().map(|vary| (header::VARY, vary)));
        if status != StatusCode::NOT_MODIFIED {
            headers.insert(header::CONTENT_LENGTH, HeaderValue::from(length));
            headers.insert(header::CONTENT_TYPE, self.content_type.clone());
            headers.extend(self.encoding.clone().map(|encoding| (header::CONTENT_ENCODING, encoding)));
        }
        response
    }
}

/// Whether a request is neither conditional nor for a range.
pub(super) fn is_unconditional(request: &HeaderMap) -> bool {
    let conditions = [header::IF_NONE_MATCH, header::RANGE, header::IF_MATCH];
    !conditions.iter().any(|condition| request.contains_key(condition))
}

/// Whether there is no `If-Match`, or it is `*` or names this ETag by the strong comparison (RFC 9110, 13.1.1).
fn if_match(request: &HeaderMap, etag: &HeaderValue) -> bool {
    !request.contains_key(header::IF_MATCH)
        || tags(request, &header::IF_MATCH).any(|tag| tag == "*" || tag.as_bytes() == etag.as_bytes())
}

/// Whether `If-None-Match` is `*` or names this ETag by the weak comparison (RFC 9110, 13.1.2).
fn if_none_match(request: &HeaderMap, etag: &HeaderValue) -> bool {
    tags(request, &header::IF_NONE_MATCH)
        .any(|tag| tag == "*" || tag.strip_prefix("W/").unwrap_or(tag).as_bytes() == etag.as_bytes())
}

/// The tags of a condition. A foreign ETag may contain a comma and be split wrongly, but its parts never equal one of ours, which
/// contain none.
fn tags<'a>(request: &'a HeaderMap, condition: &HeaderName) -> impl Iterator<Item = &'a str> + use<'a> {
    let lists = request.get_all(condition).iter().filter_map(|value| value.to_str().ok());
    lists.flat_map(|list| list.split(',')).map(str::trim)
}

#[derive(Debug, PartialEq, Eq)]
enum RequestedRange {
    Whole,
    Part(Range<u64>),
    Unsatisfiable,
}

fn requested_range(request: &HeaderMap, etag: &HeaderValue, length: u64) -> RequestedRange {
    let if_range_holds = request.get(header::IF_RANGE).is_none_or(|condition| condition == etag);
    match request.get(header::RANGE).and_then(|value| value.to_str().ok()) {
        Some(range) if if_range_holds => parse_range(range, length),
        _ => RequestedRange::Whole,
    }
}

/// Parses a single byte range. Several ranges, other units and malformed headers give the whole content, as RFC 9110, 14.2
/// permits.
fn parse_range(text: &str, length: u64) -> RequestedRange {
    let Some((unit, range)) = text.split_once('=') else { return RequestedRange::Whole };
    let Some((first, last)) = range.trim().split_once('-') else { return RequestedRange::Whole };
    let is_number = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    if !unit.trim().eq_ignore_ascii_case("bytes") || !is_number(first) || !is_number(last) {
        return RequestedRange::Whole;
    }
    // A number that does not fit into u64 lies beyond the end of any content.
    let number = |text: &str| text.parse().unwrap_or(u64::MAX);
    let part = match (first, last) {
        ("", "") => return RequestedRange::Whole,
        ("", suffix) => length.saturating_sub(number(suffix))..length,
        (first, "") => number(first)..length,
        (first, last) if number(last) < number(first) => return RequestedRange::Whole,
        (first, last) => number(first)..number(last).saturating_add(1).min(length),
    };
    if part.start < part.end { RequestedRange::Part(part) } else { RequestedRange::Unsatisfiable }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn range_headers_are_parsed() {
        let huge = "99999999999999999999999999";
        for (text, expected) in [
            ("bytes=0-0", RequestedRange::Part(0..1)),
            ("bytes=2-4", RequestedRange::Part(2..5)),
            ("bytes=5-", RequestedRange::Part(5..10)),
            ("bytes=5-99", RequestedRange::Part(5..10)),
            ("bytes=-3", RequestedRange::Part(7..10)),
            ("bytes=-99", RequestedRange::Part(0..10)),
            ("BYTES=0-9", RequestedRange::Part(0..10)),
            (&format!("bytes=3-{huge}"), RequestedRange::Part(3..10)),
            (&format!("bytes={huge}-"), RequestedRange::Unsatisfiable),
            ("bytes=10-", RequestedRange::Unsatisfiable),
            ("bytes=-0", RequestedRange::Unsatisfiable),
            ("bytes=4-2", RequestedRange::Whole),
            ("bytes=0-1,3-4", RequestedRange::Whole),
            ("bytes=+1-2", RequestedRange::Whole),
            ("bytes=-", RequestedRange::Whole),
            ("bytes", RequestedRange::Whole),
            ("lines=1-2", RequestedRange::Whole),
        ] {
            assert_eq!(parse_range(text, 10), expected, "{text}");
        }
        assert_eq!(parse_range("bytes=0-", 0), RequestedRange::Unsatisfiable);
    }

    #[test]
    fn if_none_match_compares_weakly() {
        let matches = |value: &'static str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::IF_NONE_MATCH, HeaderValue::from_static(value));
            if_none_match(&headers, &quoted("abc"))
        };
        assert!(matches("\"abc\"") && matches("W/\"abc\"") && matches("\"x\", \"abc\"") && matches("*"));
        assert!(!matches("abc") && !matches("\"ab\"") && !matches(""));
    }

    #[test]
    fn if_match_compares_strongly() {
        let status = |value: &'static str, method: &Method| {
            let body = Bytes::from_static(b"0123");
            let representation = Representation::immutable(body, quoted("abc"), "text/plain", true);
            let headers = HeaderMap::from_iter([(header::IF_MATCH, HeaderValue::from_static(value))]);
            assert!(!is_unconditional(&headers));
            representation.respond(method, &headers).status()
        };
        for method in [Method::GET, Method::HEAD] {
            for value in ["\"abc\"", "*", "\"x\", \"abc\""] {
                assert_eq!(status(value, &method), StatusCode::OK, "{value}");
            }
            for value in ["W/\"abc\"", "\"ab\"", "abc", ""] {
                assert_eq!(status(value, &method), StatusCode::PRECONDITION_FAILED, "{value}");
            }
        }
    }
}
