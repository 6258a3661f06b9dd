//! What is text, packed in every way that clients understand, once.
//!
//! In: bytes. Out: [`EncodedContent`], of which `Accept-Encoding` chooses. Next: `manifest`.

use super::representation::{Representation, etag_of};
use axum::http::{HeaderMap, HeaderValue, header};
use bytes::Bytes;
use std::io::Write;

/// Below this the headers are the larger part.
const MIN_BYTES: usize = 256;
const ZSTD_LEVEL: i32 = 19;
const BROTLI_QUALITY: i32 = 9;

/// The same content, packed variously; all of it smaller than the plain one, which comes last.
#[derive(Debug, Clone)]
pub(super) struct EncodedContent(Vec<(&'static str, Representation)>);

impl EncodedContent {
    /// Packs `body`; `vary` are the headers that chose it before the packing is chosen.
    pub(super) fn new(body: Vec<u8>, content_type: &'static str, cache_control: HeaderValue, vary: &str) -> Self {
        let names = if vary.is_empty() { "accept-encoding".to_owned() } else { format!("{vary}, accept-encoding") };
        let of = |encoding: &'static str, body: Vec<u8>| {
            let representation = Representation {
                etag: etag_of(&body),
                body: Bytes::from(body),
                content_type: HeaderValue::from_static(content_type),
                cache_control: cache_control.clone(),
                encoding: (encoding != "identity").then_some(HeaderValue::from_static(encoding)),
                vary: HeaderValue::try_from(&names).ok(),
            };
            (encoding, representation)
        };
        let mut all = Vec::new();
        if body.len() >= MIN_BYTES {
            let packed = [("br", brotli(&body)), ("zstd", zstd(&body)), ("gzip", gzip(&body))];
            let smaller = packed.into_iter().filter_map(|(name, bytes)| Some((name, bytes?)));
            all.extend(smaller.filter(|(_, bytes)| bytes.len() < body.len()).map(|(name, bytes)| of(name, bytes)));
            all.sort_by_key(|(_, representation)| representation.body.len());
        }
        all.push(of("identity", body));
        Self(all)
    }

    /// The one that the client likes best; the smallest of those it likes alike.
    pub(super) fn choose(&self, headers: &HeaderMap) -> &Representation {
        let wishes = wishes(headers);
        let liked = |name: &str| {
            let named = wishes.iter().find(|(wish, _)| wish.eq_ignore_ascii_case(name));
            let any = || wishes.iter().find(|(wish, _)| *wish == "*" && name != "identity");
            // Plain is fine with everybody who does not refuse it, after everything that is named.
            named.or_else(any).map_or(if name == "identity" { f32::MIN_POSITIVE } else { 0.0 }, |(_, quality)| *quality)
        };
        let mut best = &self.0[self.0.len() - 1];
        for candidate in self.0.iter().rev() {
            if liked(candidate.0) > 0.0 && liked(candidate.0) >= liked(best.0) {
                best = candidate;
            }
        }
        &best.1
    }
}

/// Names and qualities in `Accept-Encoding`.
fn wishes(headers: &HeaderMap) -> Vec<(&str, f32)> {
    let values = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    let items = values.flat_map(|list| list.split(','));
    let wish = |item: &'_ str| {
        let mut parts = item.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default().len();
        let quality = parts.find_map(|part| part.strip_prefix("q=")).map_or(1.0, |q| q.parse().unwrap_or(0.0));
        (name, quality)
    };
    items
        .map(|item| {
            let (length, quality) = wish(item);
            (&item.trim_start()[..length], quality)
        })
        .collect()
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
    fn the_client_chooses() {
        let text = "a city of many words, ".repeat(100).into_bytes();
        let packed = EncodedContent::new(text.clone(), "text/plain", HeaderValue::from_static("no-cache"), "accept");
        let chosen = |wish: &'static str| {
            let headers = HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(wish))]);
            packed.choose(&headers).encoding.clone().map(|value| value.to_str().unwrap().to_owned())
        };
        assert_eq!(packed.choose(&HeaderMap::new()).encoding, None);
        for (wish, wanted) in [
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
            assert_eq!(chosen(wish).as_deref(), wanted, "{wish}");
        }
        let smallest = chosen("gzip, deflate, br, zstd").unwrap();
        let size = |wish: &str| packed.0.iter().find(|(name, _)| *name == wish).map(|(_, r)| r.body.len()).unwrap();
        assert!(["gzip", "br", "zstd"].iter().all(|name| size(name) >= size(&smallest)));
        let tags: std::collections::BTreeSet<_> = packed.0.iter().map(|(_, r)| r.etag.as_bytes()).collect();
        assert_eq!(tags.len(), 4, "each has a tag of its own");
        let mut plain = Vec::new();
        std::io::Read::read_to_end(
            &mut flate2::read::GzDecoder::new(&*packed.0.iter().find(|(n, _)| *n == "gzip").unwrap().1.body),
            &mut plain,
        )
        .unwrap();
        assert_eq!(plain, text);
        assert_eq!(EncodedContent::new(b"short".to_vec(), "text/plain", HeaderValue::from_static(""), "").0.len(), 1);
    }
}
