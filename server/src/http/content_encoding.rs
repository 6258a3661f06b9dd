//! Text responses, compressed once in every supported content coding (RFC 9110, 12.5.3).

use super::accept::accepted;
use super::representation::{Representation, etag_of};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;
use bytes::Bytes;
use std::io::Write;

/// Smaller bodies are not compressed: their headers dominate.
const MIN_COMPRESSED_BYTES: usize = 256;
const ZSTD_LEVEL: i32 = 19;
const BROTLI_QUALITY: i32 = 9;

/// `Vary` of content that only its coding is selected by.
const ACCEPT_ENCODING: HeaderValue = HeaderValue::from_static("accept-encoding");

/// The same content in several codings by ascending size. The uncompressed one is last, and the largest.
#[derive(Debug, Clone)]
pub(super) struct EncodedContent(Vec<(&'static str, Representation)>);

impl EncodedContent {
    /// Compresses `body`. `vary` lists the request headers, besides `Accept-Encoding`, that selected this content.
    pub(super) fn new(body: Vec<u8>, content_type: &'static str, cache_control: HeaderValue, vary: &str) -> Self {
        let vary = if vary.is_empty() { "accept-encoding".to_owned() } else { format!("{vary}, accept-encoding") };
        let compressed = match body.len() >= MIN_COMPRESSED_BYTES {
            true => vec![("br", brotli(&body)), ("zstd", zstd(&body)), ("gzip", gzip(&body))],
            false => Vec::new(),
        };
        let compressed = compressed.into_iter().filter_map(|(coding, bytes)| Some((coding, Bytes::from(bytes?))));
        Self::of(body.into(), compressed, content_type, cache_control, HeaderValue::try_from(vary).ok())
    }

    /// `body` in no coding, for content that is made for one request.
    pub(super) fn uncompressed(body: Vec<u8>, content_type: &'static str, cache_control: HeaderValue) -> Self {
        Self::of(body.into(), [], content_type, cache_control, Some(ACCEPT_ENCODING))
    }

    /// Content that was compressed before.
    pub(super) fn compressed_before(
        plain: Bytes,
        brotli: Bytes,
        gzip: Bytes,
        content_type: &'static str,
        cache_control: HeaderValue,
    ) -> Self {
        Self::of(plain, [("br", brotli), ("gzip", gzip)], content_type, cache_control, Some(ACCEPT_ENCODING))
    }

    /// The content, and of its compressed forms those that are smaller.
    fn of(
        plain: Bytes,
        compressed: impl IntoIterator<Item = (&'static str, Bytes)>,
        content_type: &'static str,
        cache_control: HeaderValue,
        vary: Option<HeaderValue>,
    ) -> Self {
        let represent = |coding: &'static str, body: Bytes| {
            let representation = Representation {
                etag: etag_of(&body),
                body,
                content_type: HeaderValue::from_static(content_type),
                cache_control: cache_control.clone(),
                encoding: (coding != "identity").then_some(HeaderValue::from_static(coding)),
                vary: vary.clone(),
            };
            (coding, representation)
        };
        let smaller = compressed.into_iter().filter(|(_, bytes)| bytes.len() < plain.len());
        let mut all: Vec<_> = smaller.map(|(coding, bytes)| represent(coding, bytes)).collect();
        all.sort_by_key(|(_, representation)| representation.body.len());
        all.push(represent("identity", plain));
        Self(all)
    }

    /// The response to a GET or HEAD request, in the coding that it prefers.
    pub(super) fn response_to(&self, request: &Parts) -> Response {
        self.select(&request.headers).clone().response_to(request)
    }

    /// The coding that the client prefers; among equally preferred ones the smallest.
    fn select(&self, headers: &HeaderMap) -> &Representation {
        let accepted: Vec<_> = accepted(headers, header::ACCEPT_ENCODING).collect();
        let quality = |coding: &str| {
            let named = accepted.iter().find(|(name, _)| name.eq_ignore_ascii_case(coding));
            let wildcard = || accepted.iter().find(|(name, _)| *name == "*" && coding != "identity");
            // Identity is always acceptable unless the client excludes it, but any coding that is named comes first.
            let default = if coding == "identity" { f32::MIN_POSITIVE } else { 0.0 };
            named.or_else(wildcard).map_or(default, |(_, quality)| *quality)
        };
        let mut best = &self.0[self.0.len() - 1];
        for candidate in self.0.iter().rev() {
            if quality(candidate.0) > 0.0 && quality(candidate.0) >= quality(best.0) {
                best = candidate;
            }
        }
        &best.1
    }
}

fn gzip(body: &[u8]) -> Option<Vec<u8>> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(body).ok()?;
    encoder.finish().ok()
}

fn zstd(body: &[u8]) -> Option<Vec<u8>> {
    zstd::bulk::compress(body, ZSTD_LEVEL).ok()
}

fn brotli(body: &[u8]) -> Option<Vec<u8>> {
    let parameters = brotli::enc::BrotliEncoderParams { quality: BROTLI_QUALITY, ..Default::default() };
    let mut out = Vec::new();
    brotli::BrotliCompress(&mut &*body, &mut out, &parameters).ok()?;
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accept_encoding_selects_the_coding() {
        let text = "a city of many words, ".repeat(100).into_bytes();
        let content = EncodedContent::new(text.clone(), "text/plain", HeaderValue::from_static("no-cache"), "accept");
        let selected = |accept: &'static str| {
            let headers = HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(accept))]);
            content.select(&headers).encoding.clone().map(|value| value.to_str().unwrap().to_owned())
        };
        assert_eq!(content.select(&HeaderMap::new()).encoding, None);
        for (accept, expected) in [
            ("gzip", Some("gzip")),
            ("br", Some("br")),
            ("zstd", Some("zstd")),
            ("GZIP;q=0.5", Some("gzip")),
            ("gzip, br;q=0.5", Some("gzip")),
            ("gzip;q=0", None),
            ("identity", None),
            ("deflate", None),
            ("", None),
            ("gzip;q=nonsense", None),
            ("identity;q=0.5, gzip;q=0.1", None),
            ("identity;q=0, gzip;q=0.1", Some("gzip")),
            ("*;q=0", None),
        ] {
            assert_eq!(selected(accept).as_deref(), expected, "{accept}");
        }
        let smallest = selected("gzip, deflate, br, zstd").unwrap();
        let body = |coding: &str| content.0.iter().find(|(name, _)| *name == coding).map(|(_, r)| &r.body).unwrap();
        assert!(["gzip", "br", "zstd"].iter().all(|coding| body(coding).len() >= body(&smallest).len()));
        let tags: std::collections::BTreeSet<_> = content.0.iter().map(|(_, r)| r.etag.as_bytes()).collect();
        assert_eq!(tags.len(), 4, "each coding has its own ETag");
        let mut plain = Vec::new();
        std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(&body("gzip")[..]), &mut plain).unwrap();
        assert_eq!(plain, text);
        assert_eq!(EncodedContent::new(b"short".to_vec(), "text/plain", HeaderValue::from_static(""), "").0.len(), 1);
    }
}
