//! Texts of a PDF.
//!
//! Western letters are in Helvetica, which every reader has. A text with other letters of Europe is drawn as outlines of a font that is part
//! of the program. Letters of East Asia are in a font that the reader has to have, as all letters of an SVG are.

use super::pt;
use epaint_default_fonts::UBUNTU_LIGHT;
use insula_protocol::text::printable;
use pdf_writer::types::{CidFontType, FontFlags, SystemInfo};
use pdf_writer::{Content, Name, Pdf, Rect, Ref, Str, TextStr};
use skrifa::instance::{LocationRef, Size};
use skrifa::outline::OutlinePen;
use skrifa::{FontRef, GlyphId, MetadataProvider};

/// Names of objects in the file.
const ASIAN_FONT: Ref = Ref::new(30);
const ASIAN_GLYPHS: Ref = Ref::new(31);
const ASIAN_METRICS: Ref = Ref::new(32);
/// Names of the fonts on the page.
const WESTERN: &[u8] = b"F";
const ASIAN: &[u8] = b"J";

/// The letters of the bytes from 0x80 on in the encoding of the western font; NUL where there is none.
const FROM_0X80: [char; 32] = [
    '\u{20ac}', '\0', '\u{201a}', '\u{192}', '\u{201e}', '\u{2026}', '\u{2020}', '\u{2021}', '\u{2c6}', '\u{2030}',
    '\u{160}', '\u{2039}', '\u{152}', '\0', '\u{17d}', '\0', '\0', '\u{2018}', '\u{2019}', '\u{201c}', '\u{201d}',
    '\u{2022}', '\u{2013}', '\u{2014}', '\u{2dc}', '\u{2122}', '\u{161}', '\u{203a}', '\u{153}', '\0', '\u{17e}',
    '\u{178}',
];

/// A font of East Asia by the name that readers know, and the encoding of its letters.
#[derive(Debug, PartialEq, Eq)]
struct AsianFont {
    name: &'static str,
    encoding: &'static str,
    collection: &'static str,
    supplement: i32,
}

const JAPANESE: AsianFont =
    AsianFont { name: "HeiseiKakuGo-W5", encoding: "UniJIS-UTF16-H", collection: "Japan1", supplement: 5 };
const KOREAN: AsianFont =
    AsianFont { name: "HYGoThic-Medium", encoding: "UniKS-UTF16-H", collection: "Korea1", supplement: 2 };
/// It has all of Unicode's first 20,902 ideographs.
const CHINESE: AsianFont =
    AsianFont { name: "STSong-Light", encoding: "UniGB-UTF16-H", collection: "GB1", supplement: 5 };

/// Letters that a PDF does not have as they are.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PdfLetters {
    /// Question marks are in their place.
    pub lost: String,
    /// The reader needs a font for them.
    pub of_reader: String,
}

impl PdfLetters {
    /// What to tell people of them, a line each. `advice` says what helps against letters that are lost, or is empty.
    #[must_use]
    pub fn messages(&self, advice: &str) -> Vec<String> {
        let Self { lost, of_reader } = self;
        let lost =
            (!lost.is_empty()).then(|| format!("warning: the .pdf has ? in place of {}{advice}", printable(lost)));
        let of_reader = (!of_reader.is_empty())
            .then(|| format!("note: readers of the .pdf need a font with {}", printable(of_reader)));
        lost.into_iter().chain(of_reader).collect()
    }
}

pub(super) struct TextFonts {
    own: Option<FontRef<'static>>,
    asian: Option<&'static AsianFont>,
}

impl TextFonts {
    /// Those that these texts need.
    pub(super) fn of<'t>(texts: impl Iterator<Item = &'t str>) -> Self {
        Self { own: FontRef::new(UBUNTU_LIGHT).ok(), asian: asian_font(texts) }
    }

    /// Name and place of each font that is an object of the file, besides the western one.
    pub(super) fn others(&self) -> Option<(Name<'static>, Ref)> {
        self.asian.map(|_| (Name(ASIAN), ASIAN_FONT))
    }

    /// Adds the objects of [`Self::others`].
    pub(super) fn add_to(&self, pdf: &mut Pdf) {
        let Some(font) = self.asian else { return };
        let (name, encoding) = (Name(font.name.as_bytes()), Name(font.encoding.as_bytes()));
        let whole = format!("{}-{}", font.name, font.encoding);
        pdf.type0_font(ASIAN_FONT)
            .base_font(Name(whole.as_bytes()))
            .encoding_predefined(encoding)
            .descendant_font(ASIAN_GLYPHS);
        let ordering = Str(font.collection.as_bytes());
        pdf.cid_font(ASIAN_GLYPHS)
            .subtype(CidFontType::Type0)
            .base_font(name)
            .system_info(SystemInfo { registry: Str(b"Adobe"), ordering, supplement: font.supplement })
            .font_descriptor(ASIAN_METRICS)
            .default_width(1000.0);
        pdf.font_descriptor(ASIAN_METRICS)
            .name(name)
            .flags(FontFlags::SYMBOLIC)
            .bbox(Rect::new(0.0, -120.0, 1000.0, 880.0))
            .italic_angle(0.0)
            .ascent(880.0)
            .descent(-120.0)
            .cap_height(740.0)
            .stem_v(90.0);
    }

    /// Width of a text of size 1; in Helvetica exact for digits and spaces.
    pub(super) fn width(&self, text: &str) -> f64 {
        let is_outlined = self.is_outlined(text);
        let of_letter = |c: char| if is_outlined && !is_asian(c) { self.advance(c) } else { width(c) };
        text.chars().map(of_letter).sum()
    }

    /// Writes a text that begins at a place in millimetres.
    pub(super) fn show(&self, content: &mut Content, at_mm: [f64; 2], size_mm: f64, text: &str) {
        if self.is_outlined(text) {
            let [mut left, base] = at_mm;
            for (is_of_asia, run) in runs(text) {
                match is_of_asia {
                    true => show_run(content, [left, base], size_mm, run),
                    false => self.draw(content, [left, base], size_mm, run),
                }
                let of_letter = |c: char| if is_of_asia { width(c) } else { self.advance(c) };
                left += size_mm * run.chars().map(of_letter).sum::<f64>();
            }
            return;
        }
        show_run(content, at_mm, size_mm, text);
    }

    /// Draws the outlines of a text, which readers find by its letters all the same.
    fn draw(&self, content: &mut Content, [x, y]: [f64; 2], size_mm: f64, text: &str) {
        let Some(own) = &self.own else { return };
        let mut marked = content.begin_marked_content_with_properties(Name(b"Span"));
        marked.properties().actual_text(TextStr(text));
        drop(marked);
        let (mut pen, scale, outlines) = (x, size_mm / units_per_em(own), own.outline_glyphs());
        for c in text.chars() {
            if let Some(outline) = self.glyph_or_mark(c).and_then(|glyph| outlines.get(glyph)) {
                let mut path = GlyphPath { content: &mut *content, at_mm: [pen, y], scale, last: [0.0; 2] };
                // The font is part of the program: none of its outlines is damaged.
                let _ = outline.draw(Size::unscaled(), &mut path);
            }
            pen += size_mm * self.advance(c);
        }
        content.fill_nonzero().end_marked_content();
    }

    /// Whether a text has letters that no font of the reader has for certain, but the font of the program has. Then all of it but the
    /// letters of East Asia is in that font: how wide it is in another one is not known.
    fn is_outlined(&self, text: &str) -> bool {
        text.chars().any(|c| western(c).is_none() && !is_asian(c) && self.glyph(c).is_some())
    }

    fn glyph(&self, c: char) -> Option<GlyphId> {
        self.own.as_ref()?.charmap().map(c).filter(|glyph| glyph.to_u32() > 0)
    }

    /// The glyph of a letter, or of a question mark if the font has none.
    fn glyph_or_mark(&self, c: char) -> Option<GlyphId> {
        self.glyph(c).or_else(|| self.glyph('?'))
    }

    /// Width of a letter of the program's font of size 1.
    fn advance(&self, c: char) -> f64 {
        let units = |own: &FontRef<'static>| {
            let metrics = own.glyph_metrics(Size::unscaled(), LocationRef::default());
            Some(f64::from(metrics.advance_width(self.glyph_or_mark(c)?)?) / units_per_em(own))
        };
        self.own.as_ref().and_then(units).unwrap_or_default()
    }

    /// Letters of a text that the file does not have.
    fn letters(&self, text: &str) -> PdfLetters {
        let is_outlined = self.is_outlined(text);
        let is_there = |c: char| if is_outlined { self.glyph(c).is_some() } else { western(c).is_some() };
        let others = text.chars().filter(|c| is_asian(*c) || !is_there(*c));
        let (of_reader, lost) = others.partition(|c| is_asian(*c));
        PdfLetters { lost, of_reader }
    }
}

/// The first letters of texts that a PDF with them does not have.
pub(super) fn letters_of<'t>(texts: impl Iterator<Item = &'t str> + Clone) -> PdfLetters {
    const MAX_LETTERS: usize = 8;
    let fonts = TextFonts::of(texts.clone());
    let mut all = PdfLetters::default();
    for text in texts {
        let PdfLetters { lost, of_reader } = fonts.letters(text);
        all.lost.push_str(&lost);
        all.of_reader.push_str(&of_reader);
    }
    let first = |letters: &str| letters.chars().take(MAX_LETTERS).collect();
    PdfLetters { lost: first(&all.lost), of_reader: first(&all.of_reader) }
}

/// The font for the letters of East Asia in some texts; `None` if they have none.
fn asian_font<'t>(texts: impl Iterator<Item = &'t str>) -> Option<&'static AsianFont> {
    let mut found = None;
    for c in texts.flat_map(str::chars).filter(|c| is_asian(*c)) {
        match c {
            '\u{3040}'..='\u{30ff}' => return Some(&JAPANESE),
            '\u{1100}'..='\u{11ff}' | '\u{3130}'..='\u{318f}' | '\u{ac00}'..='\u{d7af}' => found = Some(&KOREAN),
            _ => found = found.or(Some(&CHINESE)),
        }
    }
    found
}

/// Kana, hangul, ideographs and their full stops and brackets, all as wide as they are high.
fn is_asian(c: char) -> bool {
    matches!(
        u32::from(c),
        0x1100..=0x11ff | 0x3000..=0x318f | 0x31f0..=0x31ff | 0x3400..=0x4dbf | 0x4e00..=0x9fff | 0xac00..=0xd7af
            | 0xf900..=0xfaff | 0xff01..=0xff60 | 0x2_0000..=0x3_ffff
    )
}

/// A letter in the encoding of the western font; `None` if it has none.
fn western(c: char) -> Option<u8> {
    let byte = u8::try_from(u32::from(c)).ok().filter(|byte| (0x20..0x7f).contains(byte) || *byte >= 0xa0);
    byte.or_else(|| FROM_0X80.iter().position(|known| *known == c && c != '\0').map(|place| 0x80 + place as u8))
}

/// A text as runs in one font, by whether it is the Asian one.
fn runs(text: &str) -> Vec<(bool, &str)> {
    let (mut runs, mut rest) = (Vec::new(), text);
    while let Some(first) = rest.chars().next() {
        let is_of_asia = is_asian(first);
        let end = rest.find(|c: char| is_asian(c) != is_of_asia).unwrap_or(rest.len());
        let (run, others) = rest.split_at(end);
        runs.push((is_of_asia, run));
        rest = others;
    }
    runs
}

/// A run in the encoding of its font.
fn encoded((is_of_asia, run): (bool, &str)) -> Vec<u8> {
    match is_of_asia {
        true => run.encode_utf16().flat_map(u16::to_be_bytes).collect(),
        false => run.chars().map(|c| western(c).unwrap_or(b'?')).collect(),
    }
}

/// Writes a text in fonts of the reader.
fn show_run(content: &mut Content, at_mm: [f64; 2], size_mm: f64, text: &str) {
    let [x, y] = at_mm.map(pt);
    content.begin_text().set_font(Name(WESTERN), pt(size_mm)).next_line(x, y);
    let mut is_western = true;
    for (is_of_asia, run) in runs(text) {
        if is_western == is_of_asia {
            is_western = !is_of_asia;
            content.set_font(Name(if is_of_asia { ASIAN } else { WESTERN }), pt(size_mm));
        }
        content.show(Str(&encoded((is_of_asia, run))));
    }
    content.end_text();
}

fn units_per_em(font: &FontRef<'_>) -> f64 {
    f64::from(font.metrics(Size::unscaled(), LocationRef::default()).units_per_em).max(1.0)
}

/// Width of a letter of size 1.
fn width(c: char) -> f64 {
    match c {
        ' ' | '.' | ',' | ':' => 0.278,
        'm' => 0.833,
        'N' => 0.722,
        c if is_asian(c) => 1.0,
        _ => 0.556,
    }
}

/// Appends the outline of a glyph to the page's path.
struct GlyphPath<'c> {
    content: &'c mut Content,
    at_mm: [f64; 2],
    /// Millimetres of a unit of the font.
    scale: f64,
    /// End of the path in units of the font.
    last: [f32; 2],
}

impl GlyphPath<'_> {
    fn place(&self, x: f32, y: f32) -> [f32; 2] {
        let [left, bottom] = self.at_mm;
        [left + f64::from(x) * self.scale, bottom + f64::from(y) * self.scale].map(pt)
    }
}

impl OutlinePen for GlyphPath<'_> {
    fn move_to(&mut self, x: f32, y: f32) {
        self.last = [x, y];
        let [x, y] = self.place(x, y);
        self.content.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.last = [x, y];
        let [x, y] = self.place(x, y);
        self.content.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let [x0, y0] = self.last;
        let towards = |from: f32, to: f32| from + (to - from) * 2.0 / 3.0;
        self.curve_to(towards(x0, x1), towards(y0, y1), towards(x, x1), towards(y, y1), x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.last = [x, y];
        let [first, second, end] = [self.place(x1, y1), self.place(x2, y2), self.place(x, y)];
        self.content.cubic_to(first[0], first[1], second[0], second[1], end[0], end[1]);
    }

    fn close(&mut self) {
        self.content.close_path();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(text: &str) -> String {
        let mut content = Content::new();
        TextFonts::of([text].into_iter()).show(&mut content, [10.0, 20.0], 3.0, text);
        String::from_utf8_lossy(&content.finish()).into_owned()
    }

    #[test]
    fn western_texts_are_in_the_encoding_of_their_font() {
        assert_eq!(encoded((false, "30\u{b0}\n")), b"30\xb0?");
        assert_eq!(encoded((false, "\u{20ac} \u{2013} \u{178}")), b"\x80 \x96 \x9f");
        assert!((TextFonts::of([].into_iter()).width("100 m") - 2.779).abs() < 1e-9);
        assert!(shown("100 m").contains("/F ") && !shown("100 m").contains("Span"));
    }

    #[test]
    fn other_texts_of_europe_are_outlines() {
        for text in [
            "\u{141}\u{f3}d\u{17a}",
            "\u{391}\u{3b8}\u{3ae}\u{3bd}\u{3b1}",
            "\u{41c}\u{43e}\u{441}\u{43a}\u{432}\u{430}",
        ] {
            let page = shown(text);
            assert!(page.contains("/ActualText") && page.contains(" c\n") && !page.contains("Tj"), "{page}");
            assert_eq!(letters_of([text].into_iter()), PdfLetters::default());
            let width = TextFonts::of([text].into_iter()).width(text) / text.chars().count() as f64;
            assert!((0.3..0.9).contains(&width), "{text}: {width}");
        }
    }

    #[test]
    fn letters_of_east_asia_are_in_fonts_of_the_reader() {
        for (text, font) in
            [("\u{6771}\u{4eac} A", &CHINESE), ("\u{6771}\u{4eac}\u{306e}", &JAPANESE), ("\u{c11c}\u{c6b8}", &KOREAN)]
        {
            assert_eq!(asian_font([text].into_iter()), Some(font));
            assert!(shown(text).contains("/J "), "{}", shown(text));
        }
        assert_eq!(runs("a\u{6771}"), [(false, "a"), (true, "\u{6771}")]);
        assert_eq!(encoded((true, "\u{6771}")), [0x67, 0x71]);
        let letters = letters_of(["\u{6771}\u{4eac} \u{5d0}"].into_iter());
        assert_eq!((letters.lost.as_str(), letters.of_reader.as_str()), ("\u{5d0}", "\u{6771}\u{4eac}"));
        let messages = letters.messages("; write it in others");
        assert_eq!((messages.len(), PdfLetters::default().messages("")), (2, Vec::new()));
        assert!(messages[0].contains('?') && messages[0].ends_with("in others") && messages[1].contains("a font"));
    }

    #[test]
    fn other_letters_of_europe_stay_beside_those_of_east_asia() {
        let (europe, both) = ("Miasto \u{141}\u{f3}d\u{17a} ", "Miasto \u{141}\u{f3}d\u{17a} \u{6771}\u{4eac}");
        let page = shown(both);
        // The letters as UTF-16 in the mark of the outlines, then two letters of the reader's font.
        assert!(page.contains("/ActualText") && page.contains(" c\n"), "{page}");
        assert_eq!((page.matches("Tj").count(), page.contains("/J ")), (1, true), "{page}");
        let lost = |text: &str| letters_of([text].into_iter()).lost;
        assert_eq!(
            (lost(both), letters_of([both].into_iter()).of_reader.as_str()),
            (String::new(), "\u{6771}\u{4eac}")
        );
        let width = |text: &str| TextFonts::of([text].into_iter()).width(text);
        assert!((width(both) - width(europe) - 2.0).abs() < 1e-9, "{} and {}", width(both), width(europe));
        // Of letters that nobody has, the text has question marks, and nothing else is lost.
        assert_eq!(lost("\u{141}\u{f3}d\u{17a} \u{5d0}"), "\u{5d0}");
    }
}
