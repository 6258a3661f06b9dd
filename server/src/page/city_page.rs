//! The page of one city with the viewer.
//!
//! Its text is complete without scripts. The viewer takes the manifest from the page, and its files are named in the head, so
//! that the browser fetches all of them at once.

use super::texts::SiteTexts;
use super::{
    Brand, CityFacts, CityLinks, SERVICE_WORKER_FILE, ViewerAssets, description, escape_html, push_about, script_json,
    versions_text,
};
use insula_protocol::route::THUMBNAIL_PX;
use std::fmt::Write;

/// The application's script, and the module that all wait for: it is the largest.
const ENTRY: &str = "app.js";
const MODULE: &str = "insula_web_bg.wasm";
/// The scripts of workers, which the browser learns of late.
const WORKERS: [&str; 4] = ["engine.js", "insula_web.js", "helper.js", "insula_web_meshes.js"];

pub(crate) fn city_page(city: CityFacts<'_>, links: &CityLinks, assets: &ViewerAssets, brand: &Brand) -> String {
    let title = escape_html(&city.manifest.title);
    let mut out = String::from("<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">");
    if let Some(policy) = &links.meta_policy {
        // Before anything that it is about.
        let _ = write!(out, "<meta http-equiv=\"Content-Security-Policy\" content=\"{}\">", escape_html(policy));
        out.push_str("<meta name=\"referrer\" content=\"no-referrer\">");
    }
    let _ = write!(
        out,
        "<title>{title} - {}</title>\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1, viewport-fit=cover\">\
         <meta name=\"color-scheme\" content=\"light dark\">",
        escape_html(brand.title())
    );
    brand.push_meta(&mut out);
    let languages: Vec<&str> = assets.languages().map(|(code, _)| code).collect();
    if !languages.is_empty() {
        let _ = write!(out, "<meta name=\"insula-languages\" content=\"{}\">", languages.join(" "));
    }
    if !links.rules.is_empty() {
        let _ = write!(out, "<meta name=\"insula-analyses\" content=\"{}\">", links.rules.join(" "));
    }
    if links.has_proposals {
        out.push_str("<meta name=\"insula-proposals\" content=\"yes\">");
    }
    if !links.versions.is_empty() {
        let text = escape_html(&versions_text(&links.versions));
        let _ = write!(out, "<meta name=\"insula-versions\" content=\"{text}\">");
    }
    push_previews(&mut out, city, links, brand.title());
    push_assets(&mut out, &links.root, assets);
    let source = escape_html(&links.source);
    let start = brand.start_of(&city.manifest.name).map(|camera| format!(" camera=\"{}\"", escape_html(camera)));
    let start = start.unwrap_or_default();
    let _ = write!(
        out,
        "</head><body><main id=\"insula-app\"><insula-city src=\"{source}\"{start} full></insula-city>
         <noscript><p>The view in three dimensions needs JavaScript.</p>"
    );
    if let Some(thumbnail) = &links.thumbnail {
        let _ = write!(out, "<p><img src=\"{}\" alt=\"{title} from above\"></p>", escape_html(thumbnail));
    }
    let _ = write!(out, "</noscript><section id=\"insula-about\"><h1>{title}</h1>");
    push_about(&mut out, city, links, SiteTexts::english());
    if let Some(list) = &links.list {
        let _ = write!(out, "<p><a rel=\"up\" href=\"{}\">All cities</a></p>", escape_html(list));
    }
    let json = serde_json::to_string(city.manifest).unwrap_or_default();
    let _ = writeln!(
        out,
        "</section></main><script type=\"application/json\" id=\"insula-manifest\">{}</script></body></html>",
        script_json(&json)
    );
    out
}

/// Adds what search engines and previews of links read.
fn push_previews(out: &mut String, city: CityFacts<'_>, links: &CityLinks, site: &str) {
    let description = description(city);
    let mut meta = |kind: &str, name: &str, content: &str| {
        let _ = write!(out, "<meta {kind}=\"{name}\" content=\"{}\">", escape_html(content));
    };
    meta("name", "description", &description);
    meta("property", "og:type", "website");
    meta("property", "og:site_name", site);
    meta("property", "og:title", &city.manifest.title);
    meta("property", "og:description", &description);
    if let Some(preview) = &links.preview {
        meta("property", "og:image", preview);
        let [width, height] = THUMBNAIL_PX.map(|side| side.to_string());
        meta("property", "og:image:width", &width);
        meta("property", "og:image:height", &height);
        meta("property", "og:image:alt", &format!("{} from above", city.manifest.title));
        meta("name", "twitter:card", "summary_large_image");
    }
    if !links.is_public {
        meta("name", "robots", "noindex");
    }
    if let Some(address) = &links.canonical {
        meta("property", "og:url", address);
        let _ = write!(out, "<link rel=\"canonical\" href=\"{}\">", escape_html(address));
    }
}

/// Adds the viewer's files, in the order in which they are needed.
fn push_assets(out: &mut String, root: &str, assets: &ViewerAssets) {
    let folder = escape_html(&assets.folder(root));
    if assets.has(MODULE) {
        let _ = write!(out, "<link rel=\"preload\" as=\"fetch\" crossorigin href=\"{folder}{MODULE}\">");
    }
    let _ = write!(
        out,
        "<link rel=\"stylesheet\" href=\"{folder}style.css\"><script type=\"module\" src=\"{folder}{ENTRY}\"></script>"
    );
    for name in WORKERS.into_iter().filter(|name| assets.has(name)) {
        let _ = write!(out, "<link rel=\"modulepreload\" href=\"{folder}{name}\">");
    }
    for (name, relation) in
        [("icon.svg", "icon"), ("icon-192.png", "apple-touch-icon"), ("manifest.webmanifest", "manifest")]
    {
        if assets.has(name) {
            let _ = write!(out, "<link rel=\"{relation}\" href=\"{folder}{name}\">");
        }
    }
    if assets.has(SERVICE_WORKER_FILE) {
        let address = escape_html(root) + SERVICE_WORKER_FILE;
        let _ = write!(out, "<meta name=\"insula-service-worker\" content=\"{address}\">");
    }
}
