//! The texts of pages without scripts, in the languages of the viewer: the part `site` of its files `language-CODE.json`.

use super::ViewerAssets;
use insula_protocol::manifest::CityCounts;
use serde::Deserialize;
use std::sync::LazyLock;

const ENGLISH: &str = include_str!("../../../client/web/page/language-en.json");
/// Languages of an `Accept-Language` that are looked at.
const MOST_WANTED: usize = 32;

/// The texts of pages in one language. Places for values are names in braces, a place for a number is `#`.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SiteTexts {
    /// The language's tag, as for `lang`, and its direction of writing.
    #[serde(skip)]
    pub(super) language: String,
    #[serde(skip)]
    pub(super) direction: String,
    decimal: String,
    kilometres: String,
    objects: NumberText,
    buildings: NumberText,
    pub(crate) more: String,
    pub(crate) none: String,
    pub(super) details: String,
    /// Of what only programs and their authors need.
    pub(super) programs: String,
    pub(super) facts: FactNames,
    pub(crate) not_found: String,
    pub(crate) not_found_hint: String,
    pub(crate) private: String,
    pub(crate) private_hint: String,
    pub(crate) cities: String,
    pub(super) imprint: String,
}

/// What the facts of a city are called.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct FactNames {
    pub(super) extent: String,
    pub(super) size: String,
    pub(super) reference_system: String,
    pub(super) local_metres: String,
    pub(super) source: String,
}

/// A text for one, and one for any other number.
#[derive(Debug, Clone, Default, Deserialize)]
struct NumberText {
    one: Option<String>,
    other: String,
}

#[derive(Deserialize)]
struct LanguageFile {
    language: String,
    direction: String,
    site: SiteTexts,
}

impl SiteTexts {
    /// The texts of pages that have no others.
    pub(super) fn english() -> &'static Self {
        static TEXTS: LazyLock<SiteTexts> = LazyLock::new(|| SiteTexts::parse(ENGLISH.as_bytes()).unwrap_or_default());
        &TEXTS
    }

    /// The texts of a file; `None` if it is none, or lacks one.
    fn parse(json: &[u8]) -> Option<Self> {
        let LanguageFile { language, direction, site } = serde_json::from_slice(json).ok()?;
        Some(Self { language, direction, ..site })
    }

    /// The size of a city in words, as [`CityCounts::words`] has it in English.
    pub(super) fn size(&self, counts: &CityCounts) -> String {
        let (text, count) = match counts.buildings {
            Some(buildings) if buildings > 0 => (&self.buildings, buildings),
            _ => (&self.objects, counts.objects),
        };
        let form = text.one.as_ref().filter(|_| count == 1).unwrap_or(&text.other);
        form.replace('#', &grouped(count))
    }

    /// Sides of a city in words.
    pub(super) fn extent(&self, [width_m, depth_m]: [f64; 2]) -> String {
        let [width, depth] = [width_m, depth_m].map(|side_m| self.kilometres_of(side_m));
        self.kilometres.replace("{width}", &width).replace("{depth}", &depth)
    }

    /// Sides of a city in whole metres.
    pub(super) fn extent_in_metres(&self, sides_m: [f64; 2]) -> String {
        let [width, depth] = sides_m.map(|side_m| grouped(side_m.round() as u64));
        format!("{width} m × {depth} m")
    }

    /// Millions of bytes.
    pub(super) fn megabytes(&self, bytes: u64) -> String {
        format!("{:.1} MB", bytes as f64 / 1e6).replace('.', &self.decimal)
    }

    fn kilometres_of(&self, side_m: f64) -> String {
        let km = side_m / 1000.0;
        if km >= 9.95 { grouped(km.round() as u64) } else { format!("{km:.1}").replace('.', &self.decimal) }
    }
}

/// A number with narrow spaces between thousands, which is right in all languages.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && digits.len() > 4 && (digits.len() - at).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(digit);
    }
    out
}

/// The languages of a viewer, of which the first is English.
#[derive(Debug, Clone)]
pub(crate) struct Languages(Vec<(String, SiteTexts)>);

impl Languages {
    /// The languages of a viewer. Without one, there is English only.
    pub(crate) fn of(viewer: Option<&ViewerAssets>) -> Self {
        let mut all = vec![("en".to_owned(), SiteTexts::english().clone())];
        let codes = viewer.into_iter().flat_map(ViewerAssets::languages);
        all.extend(codes.filter_map(|(code, file)| Some((code.to_owned(), SiteTexts::parse(&file.plain)?))));
        Self(all)
    }

    pub(crate) fn english(&self) -> &SiteTexts {
        &self.0[0].1
    }

    /// The best language for the value of an `Accept-Language`.
    pub(crate) fn best(&self, accepted: &str) -> &SiteTexts {
        let mut wanted: Vec<(f32, &str)> = accepted
            .split(',')
            .take(MOST_WANTED)
            .map(|item| {
                let (tag, rest) = item.split_once(';').unwrap_or((item, ""));
                let quality = rest.trim().strip_prefix("q=").map_or(1.0, |q| q.parse().unwrap_or(0.0));
                (quality, tag.trim().split('-').next().unwrap_or_default())
            })
            .collect();
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0));
        let known = |code: &str| self.0.iter().find(|(known, _)| known.eq_ignore_ascii_case(code));
        let found = wanted.iter().filter(|(quality, _)| *quality > 0.0).find_map(|(_, code)| known(code));
        found.map_or_else(|| self.english(), |(_, texts)| texts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::ViewerFile;

    fn languages() -> Languages {
        let german = ENGLISH.replace("\"en-GB\"", "\"de\"").replace("\"decimal\": \".\"", "\"decimal\": \",\"");
        let file = |name: &str, text: &str| {
            let plain = text.to_owned().into();
            (name.to_owned(), ViewerFile { plain, brotli: Default::default(), gzip: Default::default() })
        };
        let files =
            [file("language-de.json", &german), file("language-xx.json", "{}"), file("language-en.json", ENGLISH)];
        Languages::of(Some(&ViewerAssets::new("0", files)))
    }

    #[test]
    fn readers_get_the_best_language_that_there_is() {
        let languages = languages();
        for (accepted, language) in [
            ("", "en-GB"),
            ("de", "de"),
            ("de-CH,de;q=0.9,en;q=0.8", "de"),
            ("en;q=0.5, de", "de"),
            ("sv, xx, DE;q=0.1", "de"),
            ("de;q=0", "en-GB"),
            ("*, \u{fffd};;q=,,", "en-GB"),
            ("en-US,de", "en-GB"),
        ] {
            assert_eq!(languages.best(accepted).language, language, "{accepted}");
        }
    }

    #[test]
    fn sizes_are_words() {
        let languages = languages();
        let (english, german) = (languages.english(), languages.best("de"));
        assert_eq!(english.extent([1234.0, 9960.0]), "1.2 km × 10 km");
        assert_eq!(german.extent([1234.0, 31_400.0]), "1,2 km × 31 km");
        let of = |objects, buildings| CityCounts { objects, buildings, ..CityCounts::default() };
        assert_eq!(german.extent_in_metres([1234.4, 31_400.0]), "1234 m × 31\u{202f}400 m");
        assert_eq!([english, german].map(|texts| texts.megabytes(1_260_000)), ["1.3 MB", "1,3 MB"]);
        assert_eq!([english.size(&of(1, None)), english.size(&of(2300, Some(0)))], ["1 object", "2300 objects"]);
        assert_eq!(english.size(&of(9, Some(1_234_567))), "1\u{202f}234\u{202f}567 buildings");
        let counts = of(2231, Some(1116));
        assert_eq!(english.size(&counts), counts.words());
    }
}
