//! The encoding of texts: named by a `.cpg` file, by a number in the table's header, or not at all.

use insula_source::code_page::CodePage;
use insula_source::text::{CERTAIN_BYTES, decoded, is_usual, likely_encoding};

/// Encodings by the header's number. That of ANSI (0x57 and the like) names none: programs write it for the code page of any computer.
const LANGUAGES: &[(&[u8], &str)] = &[
    (&[0x01, 0x0b, 0x0d, 0x0f, 0x11, 0x15, 0x18, 0x19, 0x1b], "437"),
    (&[0x02, 0x0a, 0x0e, 0x10, 0x12, 0x14, 0x16, 0x1a, 0x1d, 0x25, 0x37], "850"),
    (&[0x1f, 0x22, 0x23, 0x40, 0x64, 0x87], "852"),
    (&[0x04], "macintosh"),
    (&[0x96], "x-mac-cyrillic"),
    (&[0x13, 0x7b], "shift_jis"),
    (&[0x4d, 0x7a], "gbk"),
    (&[0x4e, 0x79], "euc-kr"),
    (&[0x4f, 0x78], "big5"),
    (&[0x50, 0x7c], "windows-874"),
    (&[0x26, 0x65, 0x66], "ibm866"),
    (&[0x7d], "windows-1255"),
    (&[0x7e], "windows-1256"),
    (&[0xc8], "windows-1250"),
    (&[0xc9], "windows-1251"),
    (&[0xca], "windows-1254"),
    (&[0xcb], "windows-1253"),
    (&[0xcc], "windows-1257"),
];

/// Encodings by the number of a code page.
const CODE_PAGES: &[(&str, &str)] = &[
    ("65001", "utf-8"),
    ("932", "shift_jis"),
    ("936", "gbk"),
    ("54936", "gb18030"),
    ("949", "euc-kr"),
    ("950", "big5"),
    ("866", "ibm866"),
    ("874", "windows-874"),
    ("20866", "koi8-r"),
    ("21866", "koi8-u"),
    ("20932", "euc-jp"),
    ("51932", "euc-jp"),
];
const ADVICE: &str = "write the right encoding, such as UTF-8, into a .cpg file beside it if letters are wrong";

/// The encoding of a table by the text of its `.cpg` file, else by the number in its header; `None` if neither tells.
pub(super) fn encoding_of(code_page: Option<&str>, language: u8) -> Option<CodePage> {
    let by_language = || LANGUAGES.iter().find(|(numbers, _)| numbers.contains(&language)).map(|(_, label)| *label);
    code_page.and_then(by_name).or_else(|| by_language().and_then(CodePage::by_label))
}

/// The encoding of a name such as `UTF-8`, `1252`, `ANSI 1252`, `ISO 8859-1`, `88591`, `OEM 850` or `LDID/87`.
fn by_name(name: &str) -> Option<CodePage> {
    let name = name.trim();
    let digits: String = name.chars().filter(char::is_ascii_digit).collect();
    if name.to_ascii_uppercase().starts_with("LDID") {
        return encoding_of(None, digits.parse().ok()?);
    }
    if let Some(page) = CodePage::by_label(name) {
        return Some(page);
    }
    if let Some((_, label)) = CODE_PAGES.iter().find(|(number, _)| *number == digits) {
        return CodePage::by_label(label);
    }
    match digits.strip_prefix("8859") {
        Some(part) => CodePage::by_label(&format!("iso-8859-{part}")),
        None if digits.len() == 4 && digits.starts_with("125") => CodePage::by_label(&format!("windows-{digits}")),
        None if digits == "8" && name.to_ascii_uppercase().contains("UTF") => CodePage::by_label("utf-8"),
        None => CodePage::by_label(&digits),
    }
}

/// Texts of a table, by which its encoding is checked or guessed.
#[derive(Default)]
pub(super) struct TextSample {
    /// Texts beyond ASCII, in a line each.
    bytes: Vec<u8>,
    /// Bytes of letters of UTF-8.
    utf8_bytes: usize,
    has_other_bytes: bool,
}

impl TextSample {
    pub(super) fn add(&mut self, field: &[u8]) {
        if field.is_ascii() {
            return;
        }
        let (valid, fault) = match std::str::from_utf8(field) {
            Ok(_) => (field, None),
            Err(fault) => (&field[..fault.valid_up_to()], Some(fault)),
        };
        self.utf8_bytes += valid.iter().filter(|byte| !byte.is_ascii()).count();
        // A narrow column ends within a letter.
        self.has_other_bytes |= fault.is_some_and(|fault| fault.error_len().is_some());
        self.bytes.extend_from_slice(field);
        self.bytes.push(b'\n');
    }

    /// Whether no text is beyond ASCII.
    pub(super) fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The encoding of the texts, of which the table tells one or none, and what to warn of.
    pub(super) fn encoding(&self, told: Option<CodePage>) -> (CodePage, Option<String>) {
        let is_utf8 = !self.has_other_bytes && self.utf8_bytes > 0;
        let guess = likely_encoding(&self.bytes);
        let although =
            |page: CodePage, told: CodePage| (page, Some(format!("taken as {page}, not as {told}; {ADVICE}")));
        match told {
            None if is_utf8 => (CodePage::UTF8, None),
            None if is_usual(guess) => (guess.page, None),
            None => (guess.page, Some(format!("taken as {}, which nothing tells; {ADVICE}", guess.page))),
            // Texts of the told encoding are none of these.
            Some(told) if told == CodePage::UTF8 && self.has_other_bytes && guess.page == CodePage::UTF8 => {
                (CodePage::UTF8, Some(format!("some texts are not in UTF-8; {ADVICE}")))
            }
            Some(told) if told == CodePage::UTF8 && self.has_other_bytes => although(guess.page, told),
            Some(told) if told != CodePage::UTF8 && is_utf8 && self.utf8_bytes >= CERTAIN_BYTES => {
                although(CodePage::UTF8, told)
            }
            Some(told) if told == CodePage::WESTERN && guess.page != told && guess.is_sure => {
                although(guess.page, told)
            }
            Some(told) => (told, None),
        }
    }
}

/// The text of a field. One that is cut within a letter of UTF-8, because the column is too narrow, ends before it.
pub(super) fn decode(field: &[u8], encoding: CodePage) -> String {
    match std::str::from_utf8(field) {
        Err(fault) if encoding == CodePage::UTF8 && fault.error_len().is_none() => {
            String::from_utf8_lossy(&field[..fault.valid_up_to()]).into_owned()
        }
        _ => decoded(field, encoding).into_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_encodings() {
        let name = |text| by_name(text).map(|page| page.to_string());
        for (text, expected) in [
            ("UTF-8", "UTF-8"),
            (" utf 8", "UTF-8"),
            ("ANSI 1252", "windows-1252"),
            ("ANSI 1251", "windows-1251"),
            ("88591", "windows-1252"),
            ("ISO 8859-2", "ISO-8859-2"),
            ("LDID/19", "Shift_JIS"),
            ("LDID/201", "windows-1251"),
            ("CP932", "Shift_JIS"),
            ("OEM 936", "GBK"),
            ("OEM 850", "CP850"),
            ("cp437", "CP437"),
            ("852", "CP852"),
            ("LDID/1", "CP437"),
            ("LDID/100", "CP852"),
            ("20866", "KOI8-R"),
        ] {
            assert_eq!(name(text).as_deref(), Some(expected), "{text}");
        }
        assert_eq!((name("klingon"), name("LDID/87")), (None, None));
        assert_eq!(encoding_of(Some("klingon"), 0x13), Some(CodePage::Known(encoding_rs::SHIFT_JIS)));
        assert_eq!((encoding_of(None, 0), encoding_of(None, 0x57)), (None, None));
    }

    #[test]
    fn texts_of_any_encoding() {
        let of = |language| encoding_of(None, language).unwrap();
        assert_eq!(decode(b"Stra\xdfe", CodePage::WESTERN), "Straße");
        assert_eq!(decode("Straße".as_bytes(), CodePage::UTF8), "Straße");
        assert_eq!(decode(&"Straße".as_bytes()[..5], CodePage::UTF8), "Stra");
        assert_eq!(decode(b"\x93\x8c\x8b\x9e", of(0x13)), "東京");
        // As dBASE wrote them on DOS.
        assert_eq!(decode(b"Stra\xe1e \x81", of(0x01)), "Straße ü");
        assert_eq!(decode(b"S\xc6o", of(0x02)), "São");
        assert_eq!(decode(b"\x9d\xa2d\xab", of(0x64)), "Łódź");
    }

    #[test]
    fn encodings_are_guessed_and_checked() {
        let settle = |told: Option<CodePage>, texts: &[&[u8]]| {
            let mut sample = TextSample::default();
            texts.iter().for_each(|text| sample.add(text));
            let (page, warning) = sample.encoding(told);
            (page.to_string(), warning.is_some())
        };
        let known = |page: &str, has_warning: bool| (page.to_owned(), has_warning);
        let (russian, ..) = encoding_rs::WINDOWS_1251.encode("Жилой дом на улице Ленина");
        let (chinese, ..) = encoding_rs::GBK.encode("人民公园");
        let (utf8, western) = ("Straße, Köln".as_bytes(), &b"Stra\xdfe, K\xf6ln"[..]);
        assert_eq!(settle(None, &[&russian]), known("windows-1251", true));
        assert_eq!(settle(None, &[&chinese]), known("GBK", true));
        assert_eq!(settle(None, &[western]), known("windows-1252", false));
        assert_eq!(settle(None, &[utf8]), known("UTF-8", false));
        // A narrow column of other letters is no UTF-8.
        assert_eq!(settle(None, &[b"caf\xe9"]).0, "windows-1252");
        let western_page = Some(CodePage::WESTERN);
        assert_eq!(settle(western_page, &[western]), known("windows-1252", false));
        assert_eq!(settle(western_page, &[&russian]), known("windows-1251", true));
        assert_eq!(settle(western_page, &[utf8]), known("UTF-8", true));
        assert_eq!(settle(Some(CodePage::UTF8), &[utf8, &utf8[..5]]), known("UTF-8", false));
        assert!(settle(Some(CodePage::UTF8), &[utf8, western]).1);
        let gbk = encoding_of(None, 0x4d);
        assert_eq!(settle(gbk, &[&chinese]), known("GBK", false));
    }
}
