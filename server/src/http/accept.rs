//! The media types that a request accepts.

use axum::http::{HeaderMap, header};

/// The quality with which `Accept` names exactly this media type; 0 if it does not.
pub(super) fn accepts(headers: &HeaderMap, media: &str) -> f32 {
    accepted_media(headers).find(|(name, _)| name.eq_ignore_ascii_case(media)).map_or(0.0, |(_, quality)| quality)
}

/// Names and quality values in `Accept`.
pub(super) fn accepted_media(headers: &HeaderMap) -> impl Iterator<Item = (&str, f32)> {
    let values = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|list| list.split(',')).map(|item| {
        let mut parts = item.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default();
        (name, parts.find_map(|part| part.strip_prefix("q=")).map_or(1.0, |q| q.parse().unwrap_or(0.0)))
    })
}
