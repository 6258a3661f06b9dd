//! The code page of a text that does not tell it: the one in which its letters are the most likely.
//!
//! For each language, letters have a probability by their rank in it, and so do signs, capitals within words, and letters of two
//! scripts in one word. The sums of the logarithms are compared.

use super::code_page::{CP850, CP852, CodePage};
use super::file_names::east_asian_pages;
use encoding_rs::{
    BIG5, EUC_JP, EUC_KR, Encoding, GBK, IBM866, ISO_8859_2, ISO_8859_5, KOI8_U, SHIFT_JIS, WINDOWS_874, WINDOWS_1250,
    WINDOWS_1251, WINDOWS_1252, WINDOWS_1253, WINDOWS_1254, WINDOWS_1255, WINDOWS_1256, WINDOWS_1257,
};
use std::ops::RangeInclusive;
use std::sync::LazyLock;

/// Letters beyond ASCII of languages, the most frequent first.
const WESTERN: &[&str] =
    &["üäößéÜÖÄ", "éèàêçôîûâùïëœÉÈÀÊÇ", "óíáñéúüº", "çãáéóíêõàúâô", "àèòùìé", "äöåéÄÖÅ", "åøæéØÅÆ"];
/// The same of languages with fewer speakers.
const WESTERN_TOO: &[&str] = &["áíðþóöúæéý", "ëéïöüè"];
const CENTRAL: &[&str] =
    &["łóąężśćńźŁŚŻ", "íáéěýžšřčůúňóťďŠČŘŽ", "áíéýčšžúľťôňóäď", "áéöóőíüúű", "čšžćđŠČŽ", "ăşţîâŞŢ"];
const CYRILLIC: &[&str] = &[
    "оеаинтсрвлкмдпуяыьгзбчйхжшюцщэфъё",
    "оанивіертскулдмпязьбгйчхцжїюєшщфґ",
    "аоиетнрсвлкдпмзъгбучяжщцхйшюфь",
    "аиоенрстувкјмдлпзгбшцчћхжњђфљџ",
    "аноіеркстлпувямдзыьцбгўйжшчэхюфё",
];
const BALTIC: &[&str] = &["ėšųžąįčūęŠŽ", "āīēšņūļžčķģŠŽ"];
const TURKISH: &[&str] = &["ışüğçöİŞÇÜÖ"];
const GREEK: &[&str] = &["αοιετσνηυρπκλςμωγδάόίέθχφήύβώξζψ"];
const HEBREW: &[&str] = &["יוהלארתבמשנדכחעקפםטגזסןצךףץ"];
const ARABIC: &[&str] = &["اليمنورتبهعدسفكقحةأجىشصخطذضإئزثءغظؤآپچژگ"];
const THAI: &[&str] = &["านรอกเงมยลวดทสตะปบคหแจพชขใไโผซ่้ิีึืุู็์ัำ"];

/// Signs of many texts.
const SIGNS: &str = "\u{a0}’–—„“”«»°²³§№€…½±·";
/// Logarithms of probabilities: of the most frequent letter beyond ASCII among these, and of each further rank by the one before it. Of
/// languages of Latin letters, a quarter and three quarters.
const LATIN_RANKS: [f64; 2] = [-1.386, -0.288];
/// Of others, a tenth and nine tenths.
const RANKS: [f64; 2] = [-2.303, -0.105];
/// Of a letter that a language does not have.
const FOREIGN: f64 = -6.9;
/// Of a letter beyond ASCII, and of one of ASCII, in a language of Latin letters.
const ACCENTED: f64 = -2.66;
const PLAIN: f64 = -0.07;
const SIGN: f64 = -4.0;
const RARE_SIGN: f64 = -7.0;
const CONTROL: f64 = -14.0;
/// What is added for a sign right after or before a letter,
const SIGN_AT_LETTER: f64 = -3.0;
/// for a letter right after a digit, or one of East Asia after one of ASCII,
const LETTER_AT_DIGIT: f64 = -2.3;
/// for a capital within a word, and at its beginning.
const INNER_CAPITAL: f64 = -4.6;
const CAPITAL: f64 = -0.7;
/// Of a letter of East Asia: of the syllables of Japan, one of the frequent letters, of Korea, and any other.
const KANA: f64 = -4.5;
const FREQUENT: f64 = -6.6;
const HANGUL: f64 = -6.2;
const RARE: f64 = -11.5;
/// The best page is sure if the next one that has other letters is this far behind.
const SURE: f64 = 1.5;

/// The likely page of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PageGuess {
    pub page: CodePage,
    /// No other page is nearly as likely.
    pub is_sure: bool,
}

/// What a byte is in a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ByteKind {
    Digit,
    /// Another sign of ASCII.
    Separator,
    Lower,
    Capital,
    Sign,
}

/// The bytes of a page as letters of a language.
struct PageTable {
    page: CodePage,
    /// Logarithm of the probability of the page.
    prior: f64,
    bytes: [(ByteKind, f64); 256],
}

static TABLES: LazyLock<Vec<PageTable>> = LazyLock::new(|| {
    let mut tables = Vec::new();
    for PageFamily { pages, languages } in families() {
        for (page, prior) in pages {
            tables.extend(languages.iter().map(|letters| PageTable { page, prior, bytes: meanings(page, letters) }));
        }
    }
    tables
});

/// Code pages with the logarithms of their probabilities, and the languages that are written in them.
struct PageFamily {
    pages: Vec<(CodePage, f64)>,
    languages: &'static [&'static str],
}

fn families() -> Vec<PageFamily> {
    let known = |encoding: &'static Encoding, prior: f64| (CodePage::Known(encoding), prior);
    let of = |page, languages| PageFamily { pages: vec![page], languages };
    let western = vec![known(WINDOWS_1252, 0.0), (CodePage::Dos(&CP850), -4.0)];
    let central = vec![known(WINDOWS_1250, -1.0), known(ISO_8859_2, -3.0), (CodePage::Dos(&CP852), -4.0)];
    let cyrillic = vec![known(WINDOWS_1251, -1.0), known(KOI8_U, -3.0), known(IBM866, -3.0), known(ISO_8859_5, -3.0)];
    vec![
        PageFamily { pages: western, languages: WESTERN },
        of(known(WINDOWS_1252, -2.0), WESTERN_TOO),
        PageFamily { pages: central, languages: CENTRAL },
        PageFamily { pages: cyrillic, languages: CYRILLIC },
        of(known(WINDOWS_1257, -2.0), BALTIC),
        of(known(WINDOWS_1254, -2.0), TURKISH),
        of(known(WINDOWS_1253, -2.0), GREEK),
        of(known(WINDOWS_1255, -2.0), HEBREW),
        of(known(WINDOWS_1256, -2.0), ARABIC),
        of(known(WINDOWS_874, -2.0), THAI),
    ]
}

/// What each byte of a page is, and the logarithm of its probability in a language.
fn meanings(page: CodePage, letters: &str) -> [(ByteKind, f64); 256] {
    let is_latin = letters.starts_with(|letter: char| letter < '\u{250}');
    let [first, each] = if is_latin { LATIN_RANKS } else { RANKS };
    let case = |letter: char| if letter.is_uppercase() { ByteKind::Capital } else { ByteKind::Lower };
    std::array::from_fn(|byte| {
        let byte = byte as u8;
        let Some(letter) = page.decode(&[byte]).chars().next() else { return (ByteKind::Sign, CONTROL) };
        if letter.is_ascii_alphabetic() {
            return (case(letter), if is_latin { PLAIN } else { FOREIGN });
        }
        if letter.is_ascii() {
            return (if letter.is_ascii_digit() { ByteKind::Digit } else { ByteKind::Separator }, 0.0);
        }
        let lower = letter.to_lowercase().next().unwrap_or(letter);
        let rank = |wanted: char| letters.chars().position(|known| known == wanted);
        let accent = if is_latin { ACCENTED } else { 0.0 };
        match rank(letter).or_else(|| rank(lower)) {
            Some(rank) => (case(letter), accent + first + rank as f64 * each),
            None if letter.is_alphabetic() => (case(letter), accent + FOREIGN),
            // Pages of encoding_rs have control codes and letters of private use where they have none.
            None if letter.is_control() || letter >= '\u{e000}' => (ByteKind::Sign, CONTROL),
            None if SIGNS.contains(letter) => (ByteKind::Sign, SIGN),
            None => (ByteKind::Sign, RARE_SIGN),
        }
    })
}

impl PageTable {
    /// The logarithm of the probability of a text. Words of ASCII count nothing.
    fn score(&self, text: &[u8]) -> f64 {
        let (mut total, mut word, mut is_beyond) = (self.prior, 0.0, false);
        let mut before = ByteKind::Separator;
        for byte in text {
            let (kind, score) = self.bytes[usize::from(*byte)];
            match (kind, before) {
                (ByteKind::Lower | ByteKind::Capital, _) => {
                    word += score;
                    is_beyond |= !byte.is_ascii();
                    word += match (before, kind) {
                        (ByteKind::Lower, ByteKind::Capital) => INNER_CAPITAL,
                        (ByteKind::Lower | ByteKind::Capital, _) => 0.0,
                        (_, ByteKind::Capital) => CAPITAL,
                        _ => 0.0,
                    };
                    word += match before {
                        ByteKind::Sign => SIGN_AT_LETTER,
                        ByteKind::Digit if !byte.is_ascii() => LETTER_AT_DIGIT,
                        _ => 0.0,
                    };
                    before = kind;
                    continue;
                }
                (ByteKind::Sign, ByteKind::Lower | ByteKind::Capital) => total += score + SIGN_AT_LETTER,
                _ => total += score,
            }
            if is_beyond {
                total += word;
            }
            (word, is_beyond, before) = (0.0, false, kind);
        }
        if is_beyond { total + word } else { total }
    }
}

/// A code page of East Asia.
struct EastAsianPage {
    encoding: &'static Encoding,
    /// Logarithm of its probability.
    prior: f64,
    /// First bytes of syllables of Japan.
    kana: RangeInclusive<u8>,
    /// First bytes of frequent letters, and the logarithm of the probability of each.
    frequent: RangeInclusive<u8>,
    score: f64,
}

fn east_asian() -> [EastAsianPage; 5] {
    // A range from 1 to 0 has no bytes.
    let page = |encoding, prior, frequent, score| {
        let kana = RangeInclusive::new(1, 0);
        EastAsianPage { encoding, prior, kana, frequent, score }
    };
    [
        EastAsianPage { kana: 0x82..=0x83, ..page(SHIFT_JIS, -1.0, 0x88..=0x97, FREQUENT) },
        page(GBK, -1.0, 0xb0..=0xd7, FREQUENT),
        page(BIG5, -1.0, 0xa4..=0xc6, FREQUENT),
        page(EUC_KR, -2.0, 0xb0..=0xc8, HANGUL),
        EastAsianPage { kana: 0xa4..=0xa5, ..page(EUC_JP, -1.0, 0xb0..=0xcf, FREQUENT) },
    ]
}

/// The logarithm of the probability of a text in a code page of East Asia, in which it can be.
fn east_asian_score(encoding: &'static Encoding, text: &[u8]) -> Option<f64> {
    let page = east_asian().into_iter().find(|page| page.encoding == encoding)?;
    let (mut score, mut at, mut is_in_word) = (page.prior, 0, false);
    while let Some(&lead) = text.get(at) {
        if lead.is_ascii() {
            (is_in_word, at) = (lead.is_ascii_alphabetic(), at + 1);
            continue;
        }
        let is_half = encoding == SHIFT_JIS && (0xa1..=0xdf).contains(&lead);
        // The second bytes of frequent letters of China are none of ASCII.
        let is_full = encoding != GBK || text.get(at + 1).is_some_and(|byte| *byte > 0xa0);
        score += if is_half || page.kana.contains(&lead) {
            KANA
        } else if is_full && page.frequent.contains(&lead) {
            page.score
        } else {
            RARE
        };
        if is_in_word {
            score += LETTER_AT_DIGIT;
        }
        (is_in_word, at) = (false, at + if is_half { 1 } else { 2 });
    }
    Some(score)
}

/// The likely page of a text that is not in UTF-8. Windows-1252 if nothing tells another.
pub(crate) fn likely_page(text: &[u8]) -> PageGuess {
    let single = TABLES.iter().map(|table| (table.score(text), table.page));
    let east_asian = east_asian_pages(text);
    let east_asian = east_asian.filter_map(|page| Some((east_asian_score(page, text)?, CodePage::Known(page))));
    let mut scores: Vec<(f64, CodePage)> = single.chain(east_asian).collect();
    scores.sort_by(|first, second| second.0.total_cmp(&first.0));
    let (best, page) = scores.first().copied().unwrap_or((0.0, CodePage::WESTERN));
    let letters = page.decode(text);
    let other = scores.iter().find(|(_, other)| *other != page && other.decode(text) != letters);
    let is_sure = other.is_none_or(|(score, _)| best - score >= SURE);
    // Many pages have the letters of western Europe in their places.
    let is_western = CodePage::WESTERN.decode(text) == letters;
    PageGuess { page: if is_western { CodePage::WESTERN } else { page }, is_sure }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_known_by_their_letters() {
        for (page, words) in [
            (WINDOWS_1252, "Höhe;Straße;Größe"),
            (WINDOWS_1252, "Hauteur du bâtiment;à l’église"),
            (WINDOWS_1252, "København;højde"),
            (WINDOWS_1251, "высота;Жилой дом;улица Ленина 5"),
            (WINDOWS_1251, "НАЗВАНИЕ;ВЫСОТА;ЭТАЖНОСТЬ"),
            (WINDOWS_1251, "поверховість;Вулиця Хрещатик"),
            (KOI8_U, "высота;Жилой дом;улица Ленина 5"),
            (IBM866, "высота;Жилой дом;улица Ленина 5"),
            (ISO_8859_5, "высота;Жилой дом;улица Ленина 5"),
            (WINDOWS_1250, "wysokość;Łódź;źródło;Świętokrzyska"),
            (WINDOWS_1250, "výška;Náměstí;Příkop;Želetava"),
            (ISO_8859_2, "wysokość;Łódź;źródło"),
            (WINDOWS_1253, "ύψος κτιρίου;Οδός Αθηνάς"),
            (WINDOWS_1254, "yükseklik;kat sayısı;İstanbul;Beyoğlu;Şişli"),
            (WINDOWS_1257, "aukštų skaičius;Gedimino gatvė;pastatų"),
            (WINDOWS_1255, "גובה הבניין;רחוב"),
            (WINDOWS_1256, "ارتفاع المبنى;شارع"),
            (WINDOWS_874, "ความสูง;ถนน"),
            (GBK, "高度;人民公园;北京建筑"),
            (BIG5, "臺北市;高度"),
            (EUC_KR, "건물 높이;서울"),
            (EUC_JP, "建物の高さ"),
            (SHIFT_JIS, "建物の高さ;東京都庁"),
        ] {
            let (bytes, ..) = page.encode(words);
            let line = [b"id;", &*bytes, b";12\n"].concat();
            assert_eq!(likely_page(&line).page, CodePage::Known(page), "{words}");
        }
        let of_dos = b"Stra\xe1e;H\x94he;Geb\x84ude;K\x94ln;N\x81rnberg;M\x84rz";
        assert_eq!(likely_page(of_dos).page, CodePage::Dos(&CP850));
        // Windows-1250, 1252 and 1254 have this letter in one place.
        assert_eq!(likely_page(b"K\xf6ln"), PageGuess { page: CodePage::WESTERN, is_sure: true });
        assert!(!likely_page(b"S\xe3o").is_sure, "of Portugal or of Romania");
        assert_eq!(likely_page(b"").page, CodePage::WESTERN);
    }
}
