//! Text files in other encodings than UTF-8, which spreadsheets and editors of Windows write; and lists of words in sources.

use super::code_page::CodePage;
use super::file_names::east_asian_pages;
use super::letters::{PageGuess, likely_page};
use super::packed::unpacked_name;
use crate::error::InputError;
use crate::object::ObjectSink;
use crate::problems::ENCODING_GUESSED;
use encoding_rs::{CoderResult, Decoder, Encoding, UTF_8, UTF_16BE, UTF_16LE};
use std::borrow::Cow;
use std::io::{self, BufRead, Cursor, Read};

/// Extensions of formats that are text without a declaration of its encoding. Those of XML have one, and read it.
const EXTENSIONS: &[&str] = &split_words::<24>(
    "json cityjson jsonl ndjson geojson geojsonl geojsons geojsonseq geojsonlines geojsonld txt csv tsv obj mtl off \
    asc osm prj qpj tfw jgw pgw wld",
);
/// Bytes by which an encoding is told.
pub(crate) const START_BYTES: usize = 3;
/// Begins a text in UTF-8 of some programs.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
/// The declaration of XML is looked for in this many bytes.
const DECLARATION_BYTES: u64 = 512;
/// Bytes of letters of UTF-8 that no other encoding has by chance, and those for each byte of another encoding among them.
pub const CERTAIN_BYTES: usize = 4;
const OTHER_BYTES: usize = 9;
/// Bytes by which the code page of texts is guessed that should be in UTF-8.
const SAMPLE_BYTES: usize = 1 << 16;
/// Decoded bytes that are kept ready.
const CHUNK_BYTES: usize = 1 << 16;

/// The words of a text that single blanks separate, for lists of names. There must be `N`, which the compiler checks.
pub const fn split_words<const N: usize>(text: &'static str) -> [&'static str; N] {
    let mut words = [""; N];
    let (mut rest, mut found, mut at) = (text, 0, 0);
    while at < rest.len() {
        if rest.as_bytes()[at] == b' ' {
            words[found] = rest.split_at(at).0;
            (rest, found, at) = (rest.split_at(at + 1).1, found + 1, 0);
        } else {
            at += 1;
        }
    }
    assert!(found + 1 == N, "another number of words");
    words[found] = rest;
    words
}

/// What separates several values in one text, in OpenStreetMap and in tables.
const SEPARATORS: [char; 3] = [';', '|', '\n'];

/// The values of a text that may have several, as `3;4` has.
pub fn values_of(text: &str) -> impl Iterator<Item = &str> {
    text.split(SEPARATORS).map(str::trim).filter(|value| !value.is_empty())
}

/// The first of them, which counts where one is wanted.
pub fn first_value(text: &str) -> &str {
    values_of(text).next().unwrap_or_default()
}

/// Whether one of them is among known ones.
pub fn is_one_of(text: &str, known: &[&str]) -> bool {
    // Most texts have one.
    known.contains(&text) || text.contains(SEPARATORS) && values_of(text).any(|value| known.contains(&value))
}

/// How a file begins that is not read as it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Start {
    /// With a mark that is no part of the text.
    Mark,
    Utf16 {
        is_big_endian: bool,
    },
}

impl Start {
    /// Of a file with a name and first bytes; `None` if it is read as it is. No format begins with the mark of UTF-8; that of UTF-16
    /// may be two numbers of any other file. A text has no zeros, but for those of UTF-16 without a mark.
    pub(crate) fn of(name: &str, start: &[u8]) -> Option<Self> {
        if start.starts_with(BYTE_ORDER_MARK) {
            return Some(Self::Mark);
        }
        let is_big_endian = match start {
            _ if !is_text(name) => return None,
            [0xff, 0xfe, ..] | [1..=0x7f, 0, ..] => false,
            [0xfe, 0xff, ..] | [0, 1..=0x7f, ..] => true,
            _ => return None,
        };
        Some(Self::Utf16 { is_big_endian })
    }

    /// Reads the text as UTF-8 from the start on.
    pub(crate) fn decoded<'a>(self, mut reader: impl BufRead + 'a) -> io::Result<Box<dyn BufRead + 'a>> {
        match self {
            Self::Mark => {
                io::copy(&mut reader.by_ref().take(BYTE_ORDER_MARK.len() as u64), &mut io::sink())?;
                Ok(Box::new(reader))
            }
            Self::Utf16 { is_big_endian } => {
                let encoding = if is_big_endian { UTF_16BE } else { UTF_16LE };
                Ok(Box::new(DecodingReader::new(reader, encoding.new_decoder_with_bom_removal())))
            }
        }
    }
}

/// A small file beside a source in UTF-8.
pub(crate) fn in_utf8(name: &str, bytes: Vec<u8>) -> io::Result<Vec<u8>> {
    let Some(start) = Start::of(name, bytes.get(..START_BYTES).unwrap_or(&bytes)) else { return Ok(bytes) };
    let mut text = Vec::with_capacity(bytes.len());
    start.decoded(&*bytes)?.read_to_end(&mut text)?;
    Ok(text)
}

/// Whether files of a name are text, by the extension.
fn is_text(name: &str) -> bool {
    let extension = unpacked_name(name).rsplit_once('.').map(|(_, extension)| extension);
    extension.is_some_and(|extension| EXTENSIONS.iter().any(|known| known.eq_ignore_ascii_case(extension)))
}

/// The bytes of an XML file as UTF-8, by the encoding that it declares. Fails if they cannot be read, or the encoding is not known.
pub fn in_declared_encoding<'a>(
    label: &str,
    mut inner: Box<dyn BufRead + 'a>,
) -> Result<Box<dyn BufRead + 'a>, InputError> {
    let (head, encoding) = read_declaration(label, &mut inner)?;
    let whole = Cursor::new(head).chain(inner);
    // UTF-16 is UTF-8 already where a file is opened, whatever it declares.
    match encoding == UTF_8 || !encoding.is_ascii_compatible() {
        true => Ok(Box::new(whole)),
        false => Ok(Box::new(DecodingReader::new(whole, encoding.new_decoder()))),
    }
}

/// The first bytes of an XML file, and the encoding that it declares there: UTF-8 without a declaration. Fails if they cannot be read, or
/// the encoding is not known.
pub fn read_declaration(label: &str, inner: &mut dyn BufRead) -> Result<(Vec<u8>, &'static Encoding), InputError> {
    let mut head = Vec::new();
    let read = inner.take(DECLARATION_BYTES).read_to_end(&mut head);
    read.map_err(|cause| InputError::io(label, cause))?;
    let encoding = match declared_encoding(&head) {
        Some(name) => Encoding::for_label(name.as_bytes())
            .ok_or_else(|| InputError::unsupported(label, format!("the text encoding {name} is not known")))?,
        None => UTF_8,
    };
    Ok((head, encoding))
}

/// The code page of a text that does not tell it, by its beginning.
pub fn likely_encoding(head: &[u8]) -> PageGuess {
    // The beginning may end within a letter.
    if std::str::from_utf8(head).map_or_else(|fault| fault.error_len().is_none(), |_| true) {
        return PageGuess { page: CodePage::UTF8, is_sure: true };
    }
    if is_mostly_utf8(head) {
        return PageGuess { page: CodePage::UTF8, is_sure: false };
    }
    let lines = head.iter().rposition(|byte| *byte == b'\n').map_or(head, |end| &head[..end]);
    // So may the last line, in a page of which a letter has two bytes.
    let is_whole = lines.is_ascii() || east_asian_pages(head).count() >= east_asian_pages(lines).count();
    let text = if is_whole { head } else { lines };
    let PageGuess { page, is_sure } = likely_page(text);
    PageGuess { page, is_sure: is_sure && !(page == CodePage::WESTERN && is_hardly_western(text)) }
}

/// Whether a guess is what most texts are in, and needs no warning.
pub fn is_usual(guess: PageGuess) -> bool {
    guess.is_sure && (guess.page == CodePage::UTF8 || guess.page == CodePage::WESTERN)
}

/// Whether nearly all letters beyond ASCII are in UTF-8. Those of another encoding are so by chance only.
fn is_mostly_utf8(text: &[u8]) -> bool {
    let beyond = |text: &str| text.bytes().filter(|byte| !byte.is_ascii()).count();
    let (mut valid, mut invalid) = (0, 0);
    for chunk in text.utf8_chunks() {
        valid += beyond(chunk.valid());
        invalid += chunk.invalid().len();
    }
    valid >= CERTAIN_BYTES && invalid * OTHER_BYTES <= valid
}

/// A part of a text in a page that is likely. One that is likely in UTF-8 may have parts in another, and one in Windows-1252 parts in UTF-8.
pub fn decoded<'t>(bytes: &'t [u8], page: CodePage) -> Cow<'t, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) if text.is_ascii() || page == CodePage::UTF8 || page == CodePage::WESTERN => text.into(),
        _ if page == CodePage::UTF8 => likely_page(bytes).page.decode(bytes),
        _ => page.decode(bytes),
    }
}

/// A text of a format that has texts in UTF-8. One that is not is in the code page that is likely, and reported.
pub fn expected_in_utf8<'t>(bytes: &'t [u8], sink: &mut dyn ObjectSink) -> Cow<'t, str> {
    if let Ok(text) = std::str::from_utf8(bytes) {
        return text.into();
    }
    let page = likely_encoding(bytes).page;
    let text = page.decode(bytes);
    sink.problem(ENCODING_GUESSED, not_in_utf8(&text, page));
    text
}

/// What to report of a text that a format has in UTF-8, and that is taken in a code page.
pub fn not_in_utf8(text: &str, page: CodePage) -> String {
    let start: String = text.chars().take(64).collect();
    format!("texts are not in UTF-8, as the format demands; taken as {page}: {start}")
}

/// The code page of those of many texts that are not in UTF-8, as a format demands; `None` if all are.
pub fn page_of_others<'t>(texts: impl IntoIterator<Item = &'t [u8]>) -> Option<CodePage> {
    let (mut sample, mut has_others) = (Vec::new(), false);
    for text in texts {
        let Err(fault) = std::str::from_utf8(text) else { continue };
        has_others = true;
        // A text that ends within a letter tells no other page.
        if fault.error_len().is_some() && sample.len() < SAMPLE_BYTES {
            sample.extend_from_slice(&text[..text.len().min(SAMPLE_BYTES)]);
            sample.push(b'\n');
        }
    }
    let page = if sample.is_empty() { CodePage::UTF8 } else { likely_encoding(&sample).page };
    has_others.then_some(page)
}

/// A JSON that a format has in UTF-8. One that is not is in the code page that is likely, with what to report.
pub fn json_in_utf8(json: &[u8]) -> (Cow<'_, [u8]>, Option<String>) {
    let Err(fault) = std::str::from_utf8(json) else { return (json.into(), None) };
    // No letter of any page has this as a part.
    let is_mark = |byte: &u8| *byte == b'"';
    let start = json[..fault.valid_up_to()].iter().rposition(is_mark).unwrap_or(0);
    let sample = &json[start..json.len().min(start.saturating_add(SAMPLE_BYTES))];
    let end = sample.iter().rposition(is_mark).filter(|end| *end > 0).unwrap_or(sample.len());
    let page = likely_encoding(&sample[..end]).page;
    let report = not_in_utf8(&page.decode(&sample[..end]), page);
    (page.decode(json).into_owned().into_bytes().into(), Some(report))
}

/// A line of a text that does not tell its encoding. Equal bytes give equal letters.
pub fn decoded_line(line: &[u8]) -> Cow<'_, str> {
    decoded(line, likely_encoding(line).page)
}

/// Whether bytes that are no UTF-8 are hardly Windows-1252 either. No language of that encoding has four letters beyond ASCII in a row.
fn is_hardly_western(bytes: &[u8]) -> bool {
    bytes.windows(4).any(|letters| letters.iter().all(|byte| *byte >= 0x80))
}

/// The encoding that `<?xml ... encoding="..."?>` names.
fn declared_encoding(head: &[u8]) -> Option<String> {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    if !head.starts_with(b"<?xml") {
        return None;
    }
    let end = head.iter().position(|byte| *byte == b'>')?;
    let declaration = String::from_utf8_lossy(&head[..end]);
    let (_, value) = declaration.split_once("encoding")?;
    let value = value.trim_start().strip_prefix('=')?.trim_start();
    let quote = value.chars().next().filter(|quote| matches!(quote, '"' | '\''))?;
    let name = value.get(1..)?.split(quote).next()?;
    Some(name.trim().to_owned())
}

/// Decodes bytes to UTF-8. Those that are invalid in the encoding become U+FFFD.
pub struct DecodingReader<R> {
    inner: R,
    decoder: Decoder,
    chunk: Box<[u8]>,
    start: usize,
    end: usize,
    is_finished: bool,
    /// Whether any byte was invalid in the encoding.
    pub has_invalid_bytes: bool,
    /// The first bytes with such among them, as they are in the file.
    invalid: Vec<u8>,
}

impl<R: BufRead> DecodingReader<R> {
    /// Decodes what `inner` has.
    pub fn new(inner: R, decoder: Decoder) -> Self {
        let chunk = vec![0; CHUNK_BYTES].into_boxed_slice();
        Self {
            inner,
            decoder,
            chunk,
            start: 0,
            end: 0,
            is_finished: false,
            has_invalid_bytes: false,
            invalid: Vec::new(),
        }
    }

    /// The encoding that the bytes so far are likely in, if they should be in UTF-8, and are not.
    pub fn likely_encoding(&self) -> Option<&'static Encoding> {
        if self.decoder.encoding() != UTF_8 || self.invalid.is_empty() {
            return None;
        }
        match likely_encoding(&self.invalid).page {
            CodePage::Known(encoding) if encoding != UTF_8 => Some(encoding),
            _ => None,
        }
    }

    fn decode_chunk(&mut self) -> io::Result<()> {
        (self.start, self.end) = (0, 0);
        while self.end == 0 && !self.is_finished {
            let bytes = match self.inner.fill_buf() {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                bytes => bytes?,
            };
            let is_last = bytes.is_empty();
            let (result, read, written, has_invalid) = self.decoder.decode_to_utf8(bytes, &mut self.chunk, is_last);
            if has_invalid && self.invalid.len() < CHUNK_BYTES {
                self.invalid.extend_from_slice(&bytes[..read]);
            }
            self.inner.consume(read);
            self.end = written;
            self.has_invalid_bytes |= has_invalid;
            self.is_finished = is_last && result == CoderResult::InputEmpty;
        }
        Ok(())
    }
}

impl<R: BufRead> Read for DecodingReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

impl<R: BufRead> BufRead for DecodingReader<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.start == self.end {
            self.decode_chunk()?;
        }
        Ok(&self.chunk[self.start..self.end])
    }

    fn consume(&mut self, count: usize) {
        self.start = self.end.min(self.start + count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::utf16;

    #[test]
    fn words_are_those_between_blanks() {
        assert_eq!(split_words("a höhe 高さ"), ["a", "höhe", "高さ"]);
        assert_eq!(split_words("a"), ["a"]);
    }

    #[test]
    fn a_text_may_have_several_values() {
        assert_eq!(values_of(" 3; 4|5\n;").collect::<Vec<_>>(), ["3", "4", "5"]);
        assert_eq!(
            (first_value("3;4"), first_value("; 4"), first_value(";"), first_value("a b")),
            ("3", "4", "", "a b")
        );
        assert!(is_one_of("a;b", &["b"]) && is_one_of("b", &["b"]) && !is_one_of("ab", &["b"]));
    }

    #[test]
    fn texts_are_read_in_utf8_and_other_files_as_they_are() {
        let text = "{\"höhe\": 12, \"建物\": 1}";
        let read = |name: &str, bytes: &[u8]| in_utf8(name, bytes.to_vec()).unwrap();
        let marked = format!("\u{feff}{text}");
        for is_big_endian in [false, true] {
            for text_of in [text, &marked] {
                let bytes = utf16(text_of, is_big_endian);
                assert_eq!(read("a/B.GeoJSON.gz", &bytes), text.as_bytes(), "big endian {is_big_endian}");
                assert_eq!(read("a.las", &bytes), bytes);
            }
        }
        assert_eq!(read("a.csv", marked.as_bytes()), text.as_bytes());
        // Heights of -2 m of a tile of SRTM.
        assert_eq!(read("N52E004.hgt", b"\xff\xfe\xff\xfe"), b"\xff\xfe\xff\xfe");
        for short in [&b""[..], b"{", b"\xff", b"\xef\xbb"] {
            assert_eq!(read("a.json", short), short);
        }
    }

    #[test]
    fn texts_of_unknown_encodings_are_guessed_by_their_beginning() {
        let table = "名称,高さ,備考\n市役所庁舎,12,①\n東京都庁第一本庁舎,243,\n表";
        let (bytes, ..) = encoding_rs::SHIFT_JIS.encode(table);
        let guess = likely_encoding(&bytes[..bytes.len() - 1]);
        assert_eq!(guess, PageGuess { page: CodePage::Known(encoding_rs::SHIFT_JIS), is_sure: true });
        assert_eq!(decoded(&bytes, guess.page), table);
        assert_eq!(likely_encoding("höhe;Köln\n建".as_bytes()).page, CodePage::UTF8);
        let mixed = ["Жилой дом;".as_bytes(), b"K\xf6ln\n"].concat();
        assert_eq!(likely_encoding(&mixed), PageGuess { page: CodePage::UTF8, is_sure: false });
        let western = b"h\xf6he;Stra\xdfe\n";
        assert_eq!((likely_encoding(western).page, &*decoded_line(western)), (CodePage::WESTERN, "höhe;Straße\n"));
        assert!(is_usual(likely_encoding(western)) && !is_usual(guess));
        assert_eq!(decoded(b"K\xf6ln", CodePage::UTF8), "Köln", "a later line than the first ones");
        assert_eq!(decoded_line(b"usemtl p\xe4\xe4ovi"), "usemtl pääovi");
        let (russian, ..) = encoding_rs::WINDOWS_1251.encode("usemtl кирпичная стена");
        assert_eq!(decoded_line(&russian), "usemtl кирпичная стена");
        assert!(is_hardly_western(&russian) && !is_hardly_western(western));
    }

    #[test]
    fn texts_of_formats_in_utf8_are_in_one_page_if_they_are_not() {
        let (russian, ..) = encoding_rs::WINDOWS_1251.encode("улица Ленина");
        let western = CodePage::WESTERN;
        assert_eq!(page_of_others([&b"a"[..], "Köln".as_bytes()]), None);
        assert_eq!(page_of_others([&b"a"[..], b"K\xf6ln"]), Some(western));
        assert_eq!(page_of_others([&*russian]).map(|page| page.to_string()).as_deref(), Some("windows-1251"));
        // Cut within a letter.
        assert_eq!(page_of_others([&"Straß".as_bytes()[..5]]), Some(CodePage::UTF8));
        assert_eq!(page_of_others([&"Straß".as_bytes()[..5], b"K\xf6ln"]), Some(western));
    }

    #[test]
    fn a_json_in_another_page_is_taken_as_it_is_likely() {
        let text = r#"{"n": "a", "m": [{"name": "市役所 \u4e00 表"}, {"b": "東京都庁"}]}"#;
        assert_eq!(json_in_utf8(text.as_bytes()), (text.as_bytes().into(), None));
        // Its last byte is that of a backslash.
        let (bytes, ..) = encoding_rs::SHIFT_JIS.encode(text);
        let (json, report) = json_in_utf8(&bytes);
        assert_eq!(std::str::from_utf8(&json), Ok(text));
        assert!(report.unwrap().contains("Shift_JIS"));
        let (json, report) = json_in_utf8(b"{\"a\": \"K\xf6ln");
        assert!(json.ends_with("Köln".as_bytes()) && report.unwrap().contains("windows-1252: \"Köln"));
    }

    #[test]
    fn chunks_end_anywhere() {
        let text = "x😀".repeat(CHUNK_BYTES / 3);
        let bytes = utf16(&text, false);
        let mut found = String::new();
        let reader = io::BufReader::with_capacity(7, &*bytes);
        let mut decoded = Start::Utf16 { is_big_endian: false }.decoded(reader).unwrap();
        decoded.read_to_string(&mut found).unwrap();
        assert!(found == text);
    }
}
