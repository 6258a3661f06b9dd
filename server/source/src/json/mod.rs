//! What the readers of JSON formats share.

pub mod attributes;
pub mod lenient;
pub mod members;
pub mod metadata;
pub mod position;

/// A text without its byte order mark.
pub fn without_bom(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}
