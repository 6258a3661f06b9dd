//! The HTML pages for people, which the server sends and `publish` writes, and the files of the browser viewer in them.
//!
//! All text of cities is escaped. Pages have no inline scripts, and no style but one with a hash in the policy.

mod about;
mod assets;
mod brand;
mod city_page;
mod html;
mod list_page;
mod policy;
mod texts;
mod versions;

use crate::store::CityStore;
pub(crate) use about::description;
pub(crate) use assets::media_type;
pub use assets::{ViewerAssets, ViewerFile};
pub(crate) use brand::Brand;
pub(crate) use city_page::city_page;
pub(crate) use html::escape_html;
use insula_protocol::Manifest;
pub(crate) use list_page::{CityInList, CityListPage};
pub(crate) use policy::{list_policy, meta_policy, viewer_policy};
pub(crate) use texts::{Languages, SiteTexts};
pub(crate) use versions::{CityVersion, versions_of};

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
