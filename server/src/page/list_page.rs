//! The page that lists cities, and pages that say what is wrong with an address. They have no scripts.

use super::texts::SiteTexts;
use super::{Brand, CityFacts, CityLinks, credit, escape_html, extent_m, push_about};
use std::fmt::Write;

/// A page ends early at this size.
const PAGE_BYTES: usize = 1 << 20;

/// The style of lists, which is part of the page: a list needs no other file.
pub(super) const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:84rem;margin:2rem auto;padding:0 1rem;\
    color:#222;background:#fff;overflow-wrap:anywhere}h1{font-weight:600}h2{font-size:1.25rem;margin:.6rem 0 .1rem}a{color:#0b57a4}\
    main{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,24rem),1fr));gap:2rem;align-items:start}\
    main img{display:block;width:100%;height:auto;aspect-ratio:16/9;object-fit:cover;border-radius:10px;background:#ccd5dc}\
    h1 .logo{block-size:2.5rem;inline-size:auto;vertical-align:middle;margin-inline-end:.75rem}p{margin:.3rem 0}.sources,details{font-size:.875rem;color:#555}summary{cursor:pointer;padding:.3rem 0}\
    code{background:#f0f0f0;padding:.15rem .35rem;border-radius:3px}\
    dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1rem}dt{color:#666}dd{margin:0}\
    @media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}code{background:#2a2a2a}a{color:#8bf}\
    .sources,details,dt{color:#aaa}main img{background:#333}}";

/// A page that lists cities, in the making.
#[derive(Debug)]
pub(crate) struct CityListPage<'a> {
    out: String,
    texts: &'a SiteTexts,
    is_list_open: bool,
    /// The last paragraph, as HTML.
    imprint: String,
}

#[derive(Debug)]
pub(crate) struct CityInList<'a> {
    pub(crate) facts: CityFacts<'a>,
    /// Address of the city's page; `None` without the viewer.
    pub(crate) page: Option<String>,
    pub(crate) links: CityLinks,
}

impl<'a> CityListPage<'a> {
    /// An empty list. `icon` is the address of the viewer's icon; `meta_policy` is for pages without headers.
    pub(crate) fn new(brand: &Brand, texts: &'a SiteTexts, icon: Option<&str>, meta_policy: Option<&str>) -> Self {
        let title = escape_html(brand.title());
        let mut out = format!(
            "<!doctype html><html lang=\"{}\" dir=\"{}\"><head><meta charset=\"utf-8\">",
            escape_html(&texts.language),
            escape_html(&texts.direction)
        );
        if let Some(policy) = meta_policy {
            let _ = write!(out, "<meta http-equiv=\"Content-Security-Policy\" content=\"{}\">", escape_html(policy));
        }
        let _ = write!(
            out,
            "<title>{title}</title><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <meta name=\"color-scheme\" content=\"light dark\">"
        );
        if let Some(icon) = icon {
            let _ = write!(out, "<link rel=\"icon\" href=\"{}\">", escape_html(icon));
        }
        let _ = write!(out, "<style>{STYLE}</style></head><body><h1>");
        if let Some(logo) = brand.logo() {
            let _ = write!(out, "<img class=\"logo\" src=\"{}\" alt=\"\">", escape_html(logo));
        }
        let _ = write!(out, "{title}</h1>");
        let imprint = brand.imprint().map(|address| {
            let (address, words) = (escape_html(address), escape_html(&texts.imprint));
            format!("<p><a href=\"{address}\" rel=\"noopener noreferrer\">{words}</a></p>")
        });
        Self { imprint: imprint.unwrap_or_default(), out, texts, is_list_open: false }
    }

    pub(crate) fn push_paragraph(&mut self, html: &str) {
        self.set_list_open(false);
        let _ = write!(self.out, "<p>{html}</p>");
    }

    /// Adds a paragraph of HTML about all cities that is for programs and their authors.
    pub(crate) fn push_for_programs(&mut self, html: &str) {
        self.set_list_open(false);
        let summary = escape_html(&self.texts.programs);
        let _ = write!(self.out, "<details><summary>{summary}</summary><p>{html}</p></details>");
    }

    pub(crate) fn push_city(&mut self, city: &CityInList<'_>) {
        self.set_list_open(true);
        let (texts, manifest) = (self.texts, city.facts.manifest);
        let title = escape_html(&manifest.title);
        let (link, end) = match &city.page {
            Some(page) => (format!("<a href=\"{}\">", escape_html(page)), "</a>"),
            None => (String::new(), ""),
        };
        self.out.push_str("<article>");
        if let Some(thumbnail) = &city.links.thumbnail {
            // The title beside it names the city, and is the same link.
            let hidden = link.replace("<a ", "<a tabindex=\"-1\" aria-hidden=\"true\" ");
            let address = escape_html(thumbnail);
            let _ = write!(
                self.out,
                "{hidden}<img src=\"{address}\" alt=\"\" width=\"640\" height=\"360\" loading=\"lazy\">{end}"
            );
        }
        let extent = texts.extent(extent_m(city.facts));
        let size = texts.size(&manifest.counts);
        let date = manifest.release.as_ref().map(|release| escape_html(&release.date) + " \u{b7} ").unwrap_or_default();
        let _ = write!(self.out, "<h2>{link}{title}{end}</h2><p>{date}{extent} \u{b7} {size}</p>");
        if !manifest.attribution.is_empty() {
            let sources: Vec<_> = manifest.attribution.iter().map(credit).collect();
            let _ = write!(self.out, "<p class=\"sources\">{}</p>", sources.join("; "));
        }
        // Read without the card around them, all summaries would be the same.
        let details = escape_html(&texts.details);
        let _ = write!(self.out, "<details><summary aria-label=\"{details}: {title}\">{details}</summary>");
        push_about(&mut self.out, city.facts, &city.links, texts);
        self.out.push_str("</details></article>");
    }

    fn set_list_open(&mut self, is_open: bool) {
        if self.is_list_open != is_open {
            self.out.push_str(if is_open { "<main>" } else { "</main>" });
            self.is_list_open = is_open;
        }
    }

    /// Whether no more cities should be added.
    pub(crate) fn is_full(&self) -> bool {
        self.out.len() >= PAGE_BYTES
    }

    pub(crate) fn finish(mut self) -> String {
        self.set_list_open(false);
        self.out.push_str(&self.imprint);
        self.out.push_str("</body></html>\n");
        self.out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::small_city::empty_manifest;

    #[test]
    fn a_card_names_its_details_and_has_no_words_of_the_format() {
        let manifest = insula_protocol::Manifest { title: "A \"B\"".to_owned(), ..empty_manifest(0) };
        let texts = SiteTexts::english();
        let mut page = CityListPage::new(&Brand::default(), texts, None, None);
        let facts = CityFacts { manifest: &manifest, file_bytes: 1_500_000 };
        page.push_city(&CityInList { facts, page: None, links: CityLinks::default() });
        page.push_for_programs("<code>insula view</code>");
        let html = page.finish();
        assert!(html.contains("<summary aria-label=\"Details: A &quot;B&quot;\">Details</summary>"), "{html}");
        assert!(html.contains("1.5 MB") && html.contains("<summary>For programs</summary>"), "{html}");
        for word in ["nodes", "columns of", "Manifest"] {
            assert!(!html.contains(word), "{word}: {html}");
        }
    }
}
