//! The media types and codings that a request accepts.

use axum::http::{HeaderMap, HeaderName, header};

/// The quality with which `Accept` names exactly this media type; 0 if it does not.
pub(super) fn accepts(headers: &HeaderMap, media: &str) -> f32 {
    let named = accepted(headers, header::ACCEPT).find(|(name, _)| name.eq_ignore_ascii_case(media));
    named.map_or(0.0, |(_, quality)| quality)
}

/// Names and quality values in `Accept` or `Accept-Encoding`.
pub(super) fn accepted(headers: &HeaderMap, header: HeaderName) -> impl Iterator<Item = (&str, f32)> {
    let values = headers.get_all(header).iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|list| list.split(',')).map(|item| {
        let mut parts = item.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default();
        (name, parts.find_map(|part| part.strip_prefix("q=")).map_or(1.0, |q| q.parse().unwrap_or(0.0)))
    })
}
