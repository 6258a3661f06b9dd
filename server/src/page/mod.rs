//! The HTML pages for people, which the server sends and `publish` writes, and the files of the browser viewer in them.
//!
//! All text of cities is escaped. Pages have no inline scripts, and no style but one with a hash in the policy.

mod assets;
mod city_page;
mod list_page;
mod texts;

use crate::config::SiteConfig;
use crate::store::CityStore;
pub(crate) use assets::media_type;
pub use assets::{ViewerAssets, ViewerFile};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
pub(crate) use city_page::city_page;
use insula_archive::file::read_limited;
use insula_protocol::Manifest;
use insula_protocol::manifest::Attribution;
use list_page::STYLE;
pub(crate) use list_page::{CityInList, CityListPage};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::{fs, io};
pub(crate) use texts::{Languages, SiteTexts};

/// Says how to get the viewer, on the pages of a server that was built without it.
pub(crate) const NO_VIEWER: &str =
    "This server was built without the viewer for browsers. Its operator gets both with: just dist";
/// Name of a site that has no other.
pub(crate) const SITE_TITLE: &str = "Insula";
/// File of the viewer that must lie above all pages that it keeps.
pub(crate) const SERVICE_WORKER_FILE: &str = "service-worker.js";

/// A city as pages describe it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CityFacts<'a> {
    pub(crate) manifest: &'a Manifest,
    /// Size of all archives.
    pub(crate) file_bytes: u64,
}

impl<'a> CityFacts<'a> {
    pub(crate) fn of(city: &'a CityStore) -> Self {
        Self { manifest: city.manifest(), file_bytes: city.file_bytes() }
    }
}

/// What a city's page refers to. Addresses are absolute, or relative to the page.
#[derive(Debug, Clone, Default)]
pub(crate) struct CityLinks {
    /// Where the viewer finds the city: `src` of `<insula-city>`.
    pub(crate) source: String,
    /// The site's root: empty, or with a slash at the end. The viewer's files lie below it.
    pub(crate) root: String,
    /// The bake's picture, if there is one.
    pub(crate) thumbnail: Option<String>,
    /// Full address of the page, if it is known and no secret.
    pub(crate) canonical: Option<String>,
    /// The same of the picture.
    pub(crate) preview: Option<String>,
    /// The page that lists the cities, if there are others.
    pub(crate) list: Option<String>,
    /// Address of the city for `insula view`.
    pub(crate) view_address: Option<String>,
    /// Whether search engines may list the page.
    pub(crate) is_public: bool,
    /// Names of the rules by which the server computes hours of sun for the page; empty if it makes no analyses.
    pub(crate) rules: Vec<&'static str>,
    /// Whether there are proposals for the city.
    pub(crate) has_proposals: bool,
    /// The versions of the city in time, itself among them; empty if there is no other.
    pub(crate) versions: Vec<CityVersion>,
    /// Content-Security-Policy, if no header can have it.
    pub(crate) meta_policy: Option<String>,
}

/// Adds the description of a city after its title.
fn push_about(out: &mut String, city: CityFacts<'_>, links: &CityLinks, texts: &SiteTexts) {
    let (manifest, names) = (city.manifest, &texts.facts);
    let size = format!("{}, {}", texts.size(&manifest.counts), texts.megabytes(city.file_bytes));
    let system = manifest.crs.as_deref().unwrap_or(&names.local_metres);
    let facts = [
        (&names.extent, escape_html(&texts.extent_in_metres(extent_m(city)))),
        (&names.size, escape_html(&size)),
        (&names.reference_system, escape_html(system)),
    ];
    let sources = manifest.attribution.iter().map(|source| (&names.source, credit(source)));
    out.push_str("<dl>");
    for (name, html) in facts.into_iter().chain(sources) {
        let _ = write!(out, "<dt>{}</dt><dd>{html}</dd>", escape_html(name));
    }
    out.push_str("</dl>");
    if let Some(address) = &links.view_address {
        let _ = write!(out, "<p><code>insula view {}</code></p>", escape_html(address));
    }
}

/// A sentence about a city for search engines, previews of links and catalogues.
pub(crate) fn description(city: CityFacts<'_>) -> String {
    let manifest = city.manifest;
    let [width, depth] = extent_m(city).map(|side| side / 1000.0);
    let mut text =
        format!("{} in three dimensions: {width:.1} km x {depth:.1} km, {}.", manifest.title, manifest.counts.words());
    for source in &manifest.attribution {
        let _ = write!(text, " {}", source.text);
        if let Some(licence) = &source.licence {
            let _ = write!(text, " ({licence})");
        }
        text.push('.');
    }
    text
}

/// Width and depth in metres.
fn extent_m(city: CityFacts<'_>) -> [f64; 2] {
    let [low, high] = city.manifest.bounds;
    [high[0] - low[0], high[1] - low[1]]
}

/// Text that can stand in elements and in quoted attributes.
pub(crate) fn escape_html(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

/// A source's text with its link and licence.
fn credit(source: &Attribution) -> String {
    let mut text = escape_html(&source.text);
    // Other schemes, such as javascript:, must not become links.
    if let Some(url) = source.url.as_deref().filter(|url| url.starts_with("https://") || url.starts_with("http://")) {
        text = format!("<a href=\"{}\" rel=\"noopener noreferrer\">{text}</a>", escape_html(url));
    }
    if let Some(licence) = &source.licence {
        let _ = write!(text, " ({})", escape_html(licence));
    }
    text
}

/// JSON that can stand in a `<script>` element: nothing in it ends the element.
fn script_json(json: &str) -> String {
    json.replace('<', "\\u003c")
}

/// A version of a city.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CityVersion {
    /// As in `2024-01-31`.
    pub(crate) date: String,
    /// Address of its page.
    pub(crate) page: String,
}

/// The versions of a city among all cities, the earliest first; empty if there is no other. `page` gives the address of the page of a city
/// by its name.
pub(crate) fn versions_of<'a>(
    city: &Manifest,
    all: impl Iterator<Item = &'a Manifest>,
    page: impl Fn(&str) -> String,
) -> Vec<CityVersion> {
    let Some(own) = &city.release else { return Vec::new() };
    let version = |other: &Manifest| {
        let release = other.release.as_ref().filter(|release| release.of == own.of)?;
        Some(CityVersion { date: release.date.clone(), page: page(&other.name) })
    };
    let mut versions: Vec<CityVersion> = all.filter_map(version).collect();
    versions.sort();
    if versions.len() > 1 { versions } else { Vec::new() }
}

/// The versions as the page's script reads them: the day and the address of each. Neither has a blank.
fn versions_text(versions: &[CityVersion]) -> String {
    let words = versions.iter().flat_map(|version| [version.date.as_str(), version.page.as_str()]);
    words.collect::<Vec<_>>().join(" ")
}

/// A page can be shown in frames of other sites, as a map is.
const FRAMES_RULE: &str = "; frame-ancestors *";
const VIEWER_RULES: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; \
    img-src 'self' blob: data:; connect-src 'self'; worker-src 'self'; manifest-src 'self'; \
    base-uri 'none'; form-action 'none'; require-trusted-types-for 'script'; trusted-types insula";

/// The policy of pages with the viewer: only files of this host, and WebAssembly.
pub(crate) fn viewer_policy() -> &'static str {
    static POLICY: LazyLock<String> = LazyLock::new(|| VIEWER_RULES.to_owned() + FRAMES_RULE);
    &POLICY
}

/// The policy of lists: no scripts, and the one style that they have.
pub(crate) fn list_policy() -> &'static str {
    static POLICY: LazyLock<String> = LazyLock::new(|| {
        let hash = STANDARD.encode(Sha256::digest(STYLE.as_bytes()));
        format!(
            "default-src 'none'; style-src 'sha256-{hash}'; img-src 'self' data:; manifest-src 'self'; base-uri 'none'; \
             form-action 'none'{FRAMES_RULE}"
        )
    });
    &POLICY
}

/// A policy for a `<meta>` element, where browsers complain about a rule for frames.
pub(crate) fn meta_policy(policy: &str) -> String {
    policy.strip_suffix(FRAMES_RULE).unwrap_or(policy).to_owned()
}

/// Largest logo in bytes: it is part of each page.
const MAX_LOGO_BYTES: u64 = 48 << 10;

/// A site's looks, ready for pages.
#[derive(Debug, Clone, Default)]
pub(crate) struct Brand {
    site: SiteConfig,
    /// The logo as a `data:` address.
    logo: Option<String>,
    /// The folders of proposals, by city.
    proposals: BTreeMap<String, PathBuf>,
}

impl Brand {
    /// Reads the logo, and looks which cities have proposals: a folder that cannot be read is a warning. Fails if the logo cannot be read, is
    /// too large, or is no picture.
    pub(crate) fn load(site: &SiteConfig) -> io::Result<Self> {
        let read = |path: &std::path::PathBuf| {
            let bytes = read_limited(path, MAX_LOGO_BYTES)?;
            let media = media_of(&bytes).ok_or_else(|| io::Error::other("not an SVG, PNG, JPEG or WebP file"))?;
            Ok::<_, io::Error>(format!("data:{media};base64,{}", STANDARD.encode(&bytes)))
        };
        let logo = site.logo.as_ref().map(read).transpose()?;
        let proposals = site.proposals.as_deref().map(folders_in).transpose().unwrap_or_else(|error| {
            let folder = site.proposals.as_deref().unwrap_or(Path::new("")).display();
            tracing::warn!(%folder, %error, "cannot read the folder of site.proposals: no page shows proposals");
            None
        });
        Ok(Self { logo, site: site.clone(), proposals: proposals.unwrap_or_default() })
    }

    /// The folder of a city's proposals, if it has some.
    pub(crate) fn proposals_of(&self, city: &str) -> Option<&Path> {
        self.proposals.get(city).map(PathBuf::as_path)
    }

    pub(crate) fn title(&self) -> &str {
        if self.site.title.is_empty() { SITE_TITLE } else { &self.site.title }
    }

    /// The cities that have a first view.
    pub(crate) fn start_cities(&self) -> impl Iterator<Item = &str> {
        self.site.cities()
    }

    /// The camera with which the page of a city begins.
    fn start_of(&self, city: &str) -> Option<&str> {
        self.site.start_of(city)
    }

    fn logo(&self) -> Option<&str> {
        self.logo.as_deref()
    }

    fn imprint(&self) -> Option<&str> {
        Some(self.site.imprint.as_str()).filter(|imprint| !imprint.is_empty())
    }

    /// Adds what the viewer's page shows of it.
    fn push_meta(&self, out: &mut String) {
        let accent = Some(self.site.accent.as_str()).filter(|accent| !accent.is_empty());
        for (name, content) in [("logo", self.logo()), ("accent", accent), ("imprint", self.imprint())] {
            if let Some(content) = content {
                let _ = write!(out, "<meta name=\"insula-{name}\" content=\"{}\">", escape_html(content));
            }
        }
    }
}

fn folders_in(folder: &Path) -> io::Result<BTreeMap<String, PathBuf>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.path().is_dir() {
            found.insert(entry.file_name().to_string_lossy().into_owned(), entry.path());
        }
    }
    Ok(found)
}

/// The media type of a picture by its first bytes. Of SVG, browsers run no scripts in pictures.
fn media_of(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0x89, b'P', b'N', b'G', ..] => Some("image/png"),
        [0xff, 0xd8, 0xff, ..] => Some("image/jpeg"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some("image/webp"),
        _ => std::str::from_utf8(bytes).ok().filter(|text| text.contains("<svg")).map(|_| "image/svg+xml"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::release::Release;

    #[test]
    fn only_web_addresses_become_links() {
        let with_url = |url: &str| {
            credit(&Attribution { text: "<b>".into(), licence: Some("\"L\"".into()), url: Some(url.into()) })
        };
        assert!(with_url("https://x/\"onclick=").starts_with("<a href=\"https://x/&quot;onclick=\" rel"));
        assert_eq!(with_url("javascript:alert(1)"), "&lt;b&gt; (&quot;L&quot;)");
    }

    #[test]
    fn versions_are_those_of_one_city_by_their_days() {
        let city = |name: &str, of: &str, date: Option<&str>| {
            let release =
                |date: &str| Release { of: of.into(), date: date.into(), bake_origin: [0.0; 3], shared: Vec::new() };
            Manifest { name: name.into(), release: date.map(release), ..Manifest::default() }
        };
        let all = [
            city("b", "a", Some("2024-01-31")),
            city("a", "a", Some("2020-01-01")),
            city("c", "c", Some("2021-01-01")),
            city("d", "d", None),
        ];
        let of = |city: &Manifest| versions_text(&versions_of(city, all.iter(), |name| format!("../{name}")));
        assert_eq!(of(&all[0]), "2020-01-01 ../a 2024-01-31 ../b");
        assert_eq!([of(&all[2]), of(&all[3])], ["", ""]);
    }

    #[test]
    fn a_logo_is_a_small_picture() {
        let folder = tempfile::tempdir().unwrap();
        let load = |bytes: &[u8]| {
            let path = folder.path().join("logo");
            std::fs::write(&path, bytes).unwrap();
            Brand::load(&SiteConfig { logo: Some(path), ..SiteConfig::default() })
        };
        assert_eq!(load(b"<svg/>").unwrap().logo(), Some("data:image/svg+xml;base64,PHN2Zy8+"));
        assert!(load(b"\x89PNG\r\n").unwrap().logo().unwrap().starts_with("data:image/png;"));
        assert!(load(b"<html>").is_err() && load(&[b' '; MAX_LOGO_BYTES as usize + 1]).is_err());
        assert!(Brand::load(&SiteConfig::default()).unwrap().logo().is_none());
    }
}
