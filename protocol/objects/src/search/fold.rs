//! The form in which texts and queries are compared, and the places of a text at which a match may start.
//!
//! A text becomes glyphs: compatibility forms are replaced (NFKC), letters are lower case, and everything between words is
//! one space. Each glyph has its strong form, with diacritics, and its weak form, without.

use super::unicode::{decompose, is_mark, nfkc};

/// Separates words in folded texts.
pub(super) const SEPARATOR: char = ' ';

/// Longest token of the dictionary in bytes. Longer words are found by their first bytes and then compared in full.
pub(super) const MAX_TOKEN_BYTES: usize = 255;

/// One folded character. `ß` becomes two glyphs with the weak forms `s` and `s`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Glyph {
    pub(super) weak: char,
    pub(super) strong: char,
}

impl Glyph {
    pub(super) const fn plain(c: char) -> Self {
        Self { weak: c, strong: c }
    }
}

/// Folds `text` into `out`, which is cleared. The result has no separator at its ends and no two in a row.
pub(super) fn fold(text: &str, out: &mut Vec<Glyph>) {
    out.clear();
    if text.chars().all(is_plain) {
        text.chars().for_each(|c| push(c, out));
    } else {
        nfkc(text).chars().for_each(|c| push(c, out));
    }
    if out.last().is_some_and(|glyph| glyph.weak == SEPARATOR) {
        out.pop();
    }
}

/// Whether NFKC leaves the character as it is among others of these. For most texts this saves the tables of Unicode.
fn is_plain(c: char) -> bool {
    c.is_ascii()
        || matches!(c, 'À'..='ÿ' | '\u{3041}'..='\u{3096}' | '\u{30a1}'..='\u{30fa}' | 'ー' | '\u{4e00}'..='\u{9fff}')
}

fn push(c: char, out: &mut Vec<Glyph>) {
    if c.is_ascii_alphanumeric() {
        out.push(Glyph::plain(c.to_ascii_lowercase()));
    } else if is_cjk(c) {
        out.push(Glyph::plain(c));
    } else if !c.is_ascii() {
        c.to_lowercase().for_each(|lower| push_lower(lower, out));
    } else {
        push_separator(out);
    }
}

fn push_separator(out: &mut Vec<Glyph>) {
    if out.last().is_some_and(|last| last.weak != SEPARATOR) {
        out.push(Glyph::plain(SEPARATOR));
    }
}

/// Diacritics of Latin, Greek and Cyrillic letters. Marks of other scripts change the letter, and stay.
fn is_diacritic(c: char) -> bool {
    matches!(c, '\u{300}'..='\u{36f}')
}

fn push_lower(c: char, out: &mut Vec<Glyph>) {
    // Letters without a decomposition that people type as others.
    let typed = match c {
        'ß' => "ss",
        'æ' => "ae",
        'œ' => "oe",
        'ø' => "o",
        'ł' => "l",
        'đ' | 'ð' => "d",
        'þ' => "th",
        'ı' => "i",
        _ => "",
    };
    if !typed.is_empty() {
        out.extend(typed.chars().map(|weak| Glyph { weak, strong: c }));
    } else if is_diacritic(c) {
        // A mark that composes with no letter: the letter alone is the weak form.
    } else if !c.is_alphanumeric() && !is_mark(c) {
        push_separator(out);
    } else if matches!(c, '\u{c0}'..'\u{2000}') {
        decompose(c, |weak| {
            if !is_diacritic(weak) {
                out.push(Glyph { weak, strong: c });
            }
        });
    } else {
        out.push(Glyph::plain(c));
    }
}

/// Whether texts of the character's script have no spaces between words: Han, Hiragana, Katakana and Hangul.
pub(super) fn is_cjk(c: char) -> bool {
    matches!(c,
        '\u{3005}'..='\u{3007}' | '\u{3021}'..='\u{3029}' | '\u{3041}'..='\u{3096}' | '\u{309d}'..='\u{309f}'
        | '\u{30a1}'..='\u{30fa}' | '\u{30fc}'..='\u{30ff}' | '\u{31f0}'..='\u{31ff}'
        | '\u{3400}'..='\u{4dbf}' | '\u{4e00}'..='\u{9fff}' | '\u{f900}'..='\u{faff}' | '\u{20000}'..='\u{3ffff}'
        | '\u{1100}'..='\u{11ff}' | '\u{3131}'..='\u{318e}' | '\u{a960}'..='\u{a97c}' | '\u{ac00}'..='\u{d7fb}')
}

/// Whether a match may start at `c`, which follows `before`: at each word, and at each character of CJK.
pub(super) fn is_start(before: char, c: char) -> bool {
    c != SEPARATOR && (before == SEPARATOR || is_cjk(c) || is_cjk(before))
}

pub(super) fn weak_string(glyphs: impl IntoIterator<Item = Glyph>) -> String {
    glyphs.into_iter().map(|glyph| glyph.weak).collect()
}

/// A token of a weak string: what the dictionary has at one start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct WordToken<'a> {
    pub(super) text: &'a str,
    /// Its start in the string, in bytes.
    pub(super) at: usize,
    /// The string ends with it, so that a longer token may be meant.
    pub(super) last: bool,
    /// A single CJK character at the end of the string, which the token before it has as well.
    pub(super) implied: bool,
}

/// The tokens of a weak string, one per start: a word, or a CJK character with the next one if that is CJK too.
pub(super) fn tokens(weak: &str) -> impl Iterator<Item = WordToken<'_>> {
    let mut before = SEPARATOR;
    weak.char_indices().filter_map(move |(at, c)| {
        let previous = std::mem::replace(&mut before, c);
        is_start(previous, c).then(|| {
            let rest = &weak[at..];
            let bytes = if is_cjk(c) {
                let next = rest[c.len_utf8()..].chars().next().filter(|next| is_cjk(*next));
                c.len_utf8() + next.map_or(0, char::len_utf8)
            } else {
                rest.find(|c| c == SEPARATOR || is_cjk(c)).unwrap_or(rest.len())
            };
            let last = bytes == rest.len();
            WordToken {
                text: cut(&rest[..bytes], MAX_TOKEN_BYTES),
                at,
                last,
                implied: last && bytes == c.len_utf8() && is_cjk(c) && is_cjk(previous),
            }
        })
    })
}

/// The start of `text` in at most `bytes` bytes, cut between characters.
pub(super) fn cut(text: &str, bytes: usize) -> &str {
    &text[..text.floor_char_boundary(bytes)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weak(text: &str) -> String {
        let mut glyphs = Vec::new();
        fold(text, &mut glyphs);
        weak_string(glyphs)
    }

    #[test]
    fn texts_fold_to_what_people_type() {
        for (text, folded) in [
            ("  Oude   Delft 123-A ", "oude delft 123 a"),
            ("Müllerstraße", "mullerstrasse"),
            ("MÜLLERSTRASSE", "mullerstrasse"),
            ("Mu\u{308}ller", "muller"),
            ("Ĳsselkade", "ijsselkade"),
            ("Łódź, Ærø", "lodz aero"),
            ("İstanbul", "istanbul"),
            ("ﾏﾙﾉｳﾁ１丁目", "マルノウチ1丁目"),
            ("が ガ", "が ガ"),
            ("’s-Gravenhage", "s gravenhage"),
            ("Ελλάδα", "ελλαδα"),
            ("...", ""),
            ("", ""),
        ] {
            assert_eq!(weak(text), folded, "{text}");
        }
    }

    #[test]
    fn tokens_are_words_and_pairs_of_cjk_characters() {
        let list = |text| tokens(text).map(|token| token.text).collect::<Vec<_>>();
        assert_eq!(list("oude delft 12"), ["oude", "delft", "12"]);
        assert_eq!(list("丸の内1丁目"), ["丸の", "の内", "内", "1", "丁目", "目"]);
        assert_eq!(list("jr東京 bay"), ["jr", "東京", "京", "bay"]);
        let tokens: Vec<_> = tokens("丸の").collect();
        assert_eq!((tokens[0].last, tokens[0].implied), (true, false));
        assert_eq!((tokens[1].last, tokens[1].implied), (true, true));
        let long = "é".repeat(200);
        assert_eq!(list(&long)[0].len(), 254);
    }
}
