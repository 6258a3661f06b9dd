//! URIs of buffers and images: `data:` with its content, or the path of a file.

use super::fault::Fault;
use base64::Engine;
use base64::alphabet::{STANDARD, URL_SAFE};
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

/// Where a URI leads.
#[derive(Debug, PartialEq)]
pub(super) enum Target {
    Content(Vec<u8>),
    /// Percent-decoded, with `/`.
    File(String),
}

const LENIENT: GeneralPurposeConfig = GeneralPurposeConfig::new()
    .with_decode_padding_mode(DecodePaddingMode::Indifferent)
    .with_decode_allow_trailing_bits(true);

/// Resolves a URI. `take_bytes` is asked before content is decoded.
pub(super) fn resolve(uri: &str, take_bytes: impl Fn(u64) -> Result<(), Fault>) -> Result<Target, Fault> {
    let Some(data) = uri.get(..5).filter(|scheme| scheme.eq_ignore_ascii_case("data:")).map(|_| &uri[5..]) else {
        let path = percent_encoding::percent_decode_str(uri).decode_utf8_lossy();
        return Ok(Target::File(path.replace('\\', "/")));
    };
    let fault = |what: &str| Fault::new("invalid data URI", what);
    let (header, content) = data.split_once(',').ok_or_else(|| fault("it has no comma"))?;
    take_bytes(content.len() as u64)?;
    if !header.to_ascii_lowercase().ends_with(";base64") {
        return Ok(Target::Content(percent_encoding::percent_decode_str(content).collect()));
    }
    let alphabet = if content.contains(['-', '_']) { &URL_SAFE } else { &STANDARD };
    let engine = GeneralPurpose::new(alphabet, LENIENT);
    let decoded = if content.contains(|c: char| c.is_ascii_whitespace() || c == '%') {
        let text: Vec<u8> =
            percent_encoding::percent_decode_str(content).filter(|byte| !byte.is_ascii_whitespace()).collect();
        engine.decode(text)
    } else {
        engine.decode(content)
    };
    decoded.map(Target::Content).map_err(|error| fault(&error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content(uri: &str) -> Option<Vec<u8>> {
        match resolve(uri, |_| Ok(())) {
            Ok(Target::Content(bytes)) => Some(bytes),
            _ => None,
        }
    }

    #[test]
    fn data_uris_give_their_content() {
        assert_eq!(content("data:application/octet-stream;base64,AAEC/w==").as_deref(), Some(&[0, 1, 2, 255][..]));
        assert_eq!(content("DATA:;BASE64,AAEC_w").as_deref(), Some(&[0, 1, 2, 255][..]), "URL alphabet, no padding");
        assert_eq!(content("data:;base64,AAEC\n%2Fw%3D%3D").as_deref(), Some(&[0, 1, 2, 255][..]));
        assert_eq!(content("data:text/plain,a%20b").as_deref(), Some(&b"a b"[..]));
        assert_eq!(content("data:;base64,!"), None);
        assert_eq!(content("data:;base64"), None);
    }

    #[test]
    fn other_uris_are_files() {
        let file = |uri| resolve(uri, |_| Err(Fault::new("asked", "")));
        assert_eq!(file("a%20b\\c.png"), Ok(Target::File("a b/c.png".into())));
        assert_eq!(file("%ff.bin"), Ok(Target::File("\u{fffd}.bin".into())));
        assert!(file("data:,x").is_err(), "the budget is asked");
    }
}
