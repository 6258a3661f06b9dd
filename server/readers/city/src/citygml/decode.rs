//! Bytes of an XML file as UTF-8, whatever its encoding.

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE};
use insula_source::error::InputError;
use insula_source::text::{DecodingReader, read_declaration};
use std::io::{self, BufRead, Chain, Cursor, Read};

/// A single tag or text may have this many bytes.
const MAX_EVENT_BYTES: u64 = 128 << 20;

/// The bytes of a file, of which the first were looked at.
type FileBytes<'a> = Chain<Cursor<Vec<u8>>, Box<dyn BufRead + 'a>>;

/// Decodes a file to UTF-8 by its byte order mark or XML declaration. Bytes that are invalid in the encoding become
/// U+FFFD.
pub(super) struct TextReader<'a> {
    inner: DecodingReader<FileBytes<'a>>,
    /// Bytes that the current tag or text may still have.
    event_bytes_left: u64,
    /// Whether reading failed because a tag or text was too long.
    pub(super) is_event_too_long: bool,
}

impl<'a> TextReader<'a> {
    /// Fails if the file cannot be read or declares an unknown encoding. `known` is the encoding of a file that says it is in UTF-8, and is
    /// not.
    pub(super) fn new(
        label: &str,
        mut inner: Box<dyn BufRead + 'a>,
        known: Option<&'static Encoding>,
    ) -> Result<Self, InputError> {
        let (head, encoding) = read_declaration(label, &mut inner)?;
        let encoding = known.filter(|_| encoding == UTF_8).unwrap_or(encoding);
        let encoding = match head.get(..2) {
            // The first character of XML, without a mark before it.
            Some(b"<\0") => UTF_16LE,
            Some(b"\0<") => UTF_16BE,
            _ if encoding.is_ascii_compatible() => encoding,
            // A declaration that can be read byte by byte is not UTF-16, whatever it says.
            _ => UTF_8,
        };
        let inner = DecodingReader::new(Cursor::new(head).chain(inner), encoding.new_decoder());
        Ok(Self { inner, event_bytes_left: MAX_EVENT_BYTES, is_event_too_long: false })
    }

    /// Whether any byte was invalid in the encoding.
    pub(super) fn has_invalid_bytes(&self) -> bool {
        self.inner.has_invalid_bytes
    }

    /// The encoding that the text so far is likely in, if it is not in the one that the file says.
    pub(super) fn likely_encoding(&self) -> Option<&'static Encoding> {
        self.inner.likely_encoding()
    }

    /// Begins a tag or text.
    pub(super) fn begin_event(&mut self) {
        self.event_bytes_left = MAX_EVENT_BYTES;
    }

    pub(super) fn max_event_bytes() -> u64 {
        MAX_EVENT_BYTES
    }
}

impl Read for TextReader<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

impl BufRead for TextReader<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.event_bytes_left == 0 {
            self.is_event_too_long = true;
            return Err(io::Error::other("a tag or text is too long"));
        }
        self.inner.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        self.inner.consume(count);
        self.event_bytes_left = self.event_bytes_left.saturating_sub(count as u64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(bytes: &[u8]) -> (String, bool) {
        let mut reader = TextReader::new("x", Box::new(bytes), None).unwrap();
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        (text, reader.has_invalid_bytes())
    }

    #[test]
    fn decodes_by_declaration_and_byte_order_mark() {
        let latin = decode(b"<?xml version='1.0' encoding = 'ISO-8859-1'?><a>Stra\xDFe</a>");
        assert_eq!(latin, ("<?xml version='1.0' encoding = 'ISO-8859-1'?><a>Straße</a>".into(), false));
        assert_eq!(decode(b"\xEF\xBB\xBF<a>\xE6\xA8\xAA</a>"), ("<a>横</a>".into(), false));
        let utf16: Vec<u8> =
            "\u{FEFF}<?xml encoding=\"UTF-16\"?><a>ü</a>".encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert_eq!(decode(&utf16), ("<?xml encoding=\"UTF-16\"?><a>ü</a>".into(), false));
        for text in ["<?xml encoding=\"UTF-16\"?><a>ü</a>", "<a>横</a>"] {
            for bytes_of in [u16::to_le_bytes, u16::to_be_bytes] {
                let bytes: Vec<u8> = text.encode_utf16().flat_map(bytes_of).collect();
                assert_eq!(decode(&bytes), (text.into(), false), "without a mark");
            }
        }
        assert_eq!(decode(b"<?xml encoding=\"UTF-16\"?><a/>").0, "<?xml encoding=\"UTF-16\"?><a/>");
    }

    #[test]
    fn replaces_invalid_bytes_and_refuses_unknown_encodings() {
        assert_eq!(decode(b"<a>\xFF\xE6</a>"), ("<a>\u{FFFD}\u{FFFD}</a>".into(), true));
        assert!(TextReader::new("x", Box::new(&b"<?xml encoding='klingon'?>"[..]), None).is_err());
    }

    #[test]
    fn limits_the_length_of_an_event() {
        let endless = io::BufReader::new(io::repeat(b'a'));
        let mut reader = TextReader::new("x", Box::new(endless), None).unwrap();
        let count = io::copy(&mut reader, &mut io::sink());
        assert!(count.is_err() && reader.is_event_too_long);
    }
}
