//! What the readers of JSON formats share.

pub(crate) mod attributes;
pub(crate) mod lenient;
pub(crate) mod metadata;
pub(crate) mod position;

/// A text without its byte order mark.
pub(crate) fn without_bom(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}
