//! Names of files as other systems write them: in another case, in another Unicode normal form, and in archives in the code page of the
//! computer that packed them.

use encoding_rs::{BIG5, EUC_JP, EUC_KR, Encoding, GBK, IBM866, SHIFT_JIS, WINDOWS_1250, WINDOWS_1251, WINDOWS_1252};
use percent_encoding::percent_decode_str;
use std::borrow::Cow;
use unicode_normalization::UnicodeNormalization;

/// Code pages of names. A name is guessed to be in one of the first.
fn code_pages() -> [&'static Encoding; 9] {
    [SHIFT_JIS, GBK, BIG5, EUC_KR, EUC_JP, WINDOWS_1252, WINDOWS_1251, WINDOWS_1250, IBM866]
}

/// Number of the code pages that are guessed: those of East Asia.
const GUESSED: usize = 5;
/// Letters of East Asia for each other sign beyond ASCII that may stand between them, such as a number in a circle.
const PER_OTHER: usize = 8;

/// The same for names that differ in case or Unicode normal form only.
pub fn key(name: &str) -> String {
    name.nfc().flat_map(char::to_lowercase).nfc().collect()
}

/// A text with each `%20` and the like replaced; unchanged if the result is no UTF-8. Anything that is no such code stays.
pub fn percent_decoded(text: &str) -> String {
    percent_decode_str(text).decode_utf8().map_or_else(|_| text.to_owned(), Cow::into_owned)
}

/// The name that bytes most likely mean; `None` if they may be of any western code page.
pub fn guess(raw: &[u8]) -> Option<String> {
    match std::str::from_utf8(raw) {
        Ok(name) => Some(name.to_owned()),
        Err(_) => decode(east_asian_pages(raw).next()?, raw),
    }
}

/// The code pages of East Asia that bytes can be in that are no UTF-8; none if they may be of any western one.
pub(crate) fn east_asian_pages(raw: &[u8]) -> impl Iterator<Item = &'static Encoding> + '_ {
    // Letters with accents stand alone between others; those of East Asia have two bytes each.
    let has_pairs = raw.windows(2).any(|pair| !pair[0].is_ascii() && !pair[1].is_ascii());
    let is_likely = |page: &&'static Encoding| decode(page, raw).is_some_and(|text| is_east_asian(&text));
    code_pages().into_iter().take(if has_pairs { GUESSED } else { 0 }).filter(is_likely)
}

/// All names that bytes can mean.
pub fn candidates(raw: &[u8]) -> impl Iterator<Item = String> + '_ {
    code_pages().into_iter().filter_map(|page| decode(page, raw))
}

/// `None` if the bytes are none of the code page.
fn decode(page: &'static Encoding, raw: &[u8]) -> Option<String> {
    page.decode_without_bom_handling_and_without_replacement(raw).map(|name| name.into_owned())
}

/// Whether the letters of a name beyond ASCII are of East Asia. Those of half width, which bytes of other code pages mean in that of
/// Japan, are rare in true names.
fn is_east_asian(name: &str) -> bool {
    let is_half = |c: char| ('\u{ff61}'..='\u{ffdc}').contains(&c);
    let is_full = |c: char| matches!(c, '\u{3000}'..='\u{9fff}' | '\u{ac00}'..='\u{d7af}' | '\u{ff01}'..='\u{ff60}');
    let (mut half, mut full, mut others) = (0, 0, 0);
    for c in name.chars().filter(|c| !c.is_ascii()) {
        match c {
            c if is_half(c) => half += 1,
            c if is_full(c) => full += 1,
            _ => others += 1,
        }
    }
    full > half && full >= PER_OTHER * others
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decodes_percent_codes() {
        assert_eq!(percent_decoded("%E6%A8%AA%"), "横%");
        assert_eq!(percent_decoded("100%zz"), "100%zz");
        assert_eq!(percent_decoded("%FF"), "%FF");
    }

    #[test]
    fn names_that_differ_in_case_or_normal_form_have_one_key() {
        assert_eq!(key("appearance/UPPER.PNG"), key("Appearance/upper.png"));
        assert_eq!(key("Gebäude.jpg"), key("GEBA\u{308}UDE.JPG"));
        assert_eq!(key("か\u{3099}.jpg"), key("が.jpg"));
        assert_ne!(key("a.jpg"), key("b.jpg"));
    }

    #[test]
    fn east_asian_names_are_guessed_and_others_are_candidates() {
        // The second byte of the first is that of a backslash.
        assert_eq!(guess(b"udx/\x95\x5c\x93\x8c\x8b\x9e.jpg").as_deref(), Some("udx/表東京.jpg"));
        assert_eq!(guess("東京.jpg".as_bytes()).as_deref(), Some("東京.jpg"));
        assert_eq!(guess(GBK.encode("北京建筑.jpg").0.as_ref()).as_deref(), Some("北京建筑.jpg"));
        assert_eq!(guess(b"Geb\x84ude.jpg"), None, "code page 437");
        assert_eq!(guess(b"Geb\xe4ude.jpg"), None, "code page 1252");
        for (page, name) in
            [(WINDOWS_1252, "Gebäude"), (BIG5, "臺北"), (EUC_KR, "서울"), (WINDOWS_1251, "Дом"), (IBM866, "Дом")]
        {
            let (raw, ..) = page.encode(name);
            let raw = if page == IBM866 { std::borrow::Cow::Borrowed(&b"\x84\xae\xac"[..]) } else { raw };
            assert!(candidates(&raw).any(|found| found == name), "{name}");
        }
    }
}
