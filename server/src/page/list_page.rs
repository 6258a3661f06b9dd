//! The page that lists cities. It has no scripts.

use super::{CityFacts, CityLinks, about::push_about, html::escape_html};
use std::fmt::Write;

/// A page ends early at this size.
const PAGE_BYTES: usize = 1 << 20;

/// The style of lists, which is part of the page: a list needs no other file.
pub(super) const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:46rem;margin:3rem auto;padding:0 1rem;\
    color:#222;background:#fff}h1{font-weight:600}section{border-top:1px solid #ccc;padding:.5rem 0 1rem}\
    code{background:#f0f0f0;padding:.15rem .35rem;border-radius:3px;overflow-wrap:anywhere}\
    dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1rem}dt{color:#666}dd{margin:0;overflow-wrap:anywhere}\
    img{float:inline-end;width:min(18rem,40%);aspect-ratio:16/9;object-fit:cover;margin:1rem 0 1rem 1rem;border-radius:4px}\
    @media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}code{background:#2a2a2a}a{color:#8bf}dt{color:#999}}";

/// A page that lists cities, in the making.
#[derive(Debug)]
pub(crate) struct CityListPage(String);

/// A city in a list.
#[derive(Debug)]
pub(crate) struct CityInList<'a> {
    pub(crate) facts: CityFacts<'a>,
    /// Address of the city's page; `None` without the viewer.
    pub(crate) page: Option<String>,
    pub(crate) links: CityLinks,
}

impl CityListPage {
    /// An empty list. `icon` is the address of the viewer's icon; `meta_policy` is for pages without headers.
    pub(crate) fn new(title: &str, icon: Option<&str>, meta_policy: Option<&str>) -> Self {
        let title = escape_html(title);
        let mut out = String::from("<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">");
        if let Some(policy) = meta_policy {
            let _ = write!(out, "<meta http-equiv=\"Content-Security-Policy\" content=\"{}\">", escape_html(policy));
        }
        let _ = write!(out, "<title>{title}</title><meta name=\"viewport\" content=\"width=device-width\">");
        if let Some(icon) = icon {
            let _ = write!(out, "<link rel=\"icon\" href=\"{}\">", escape_html(icon));
        }
        let _ = write!(out, "<style>{STYLE}</style></head><body><h1>{title}</h1>");
        Self(out)
    }

    /// Adds a paragraph of HTML.
    pub(crate) fn push_paragraph(&mut self, html: &str) {
        let _ = write!(self.0, "<p>{html}</p>");
    }

    /// Adds a city.
    pub(crate) fn push_city(&mut self, city: &CityInList<'_>) {
        let title = escape_html(&city.facts.manifest.title);
        self.0.push_str("<section>");
        if let Some(thumbnail) = &city.links.thumbnail {
            let _ = write!(self.0, "<img src=\"{}\" alt=\"\" loading=\"lazy\">", escape_html(thumbnail));
        }
        match &city.page {
            Some(page) => {
                let _ = write!(self.0, "<h2><a href=\"{}\">{title}</a></h2>", escape_html(page));
            }
            None => {
                let _ = write!(self.0, "<h2>{title}</h2>");
            }
        }
        push_about(&mut self.0, city.facts, &city.links);
        self.0.push_str("</section>");
    }

    /// Whether no more cities should be added.
    pub(crate) fn is_full(&self) -> bool {
        self.0.len() >= PAGE_BYTES
    }

    /// The complete page.
    pub(crate) fn finish(mut self) -> String {
        self.0.push_str("</body></html>\n");
        self.0
    }
}
