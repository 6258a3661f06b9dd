//! What a page says about a city, without the viewer: extent, size, sources, and the command that opens it.

use super::html::{credit, escape_html};
use super::texts::SiteTexts;
use super::{CityFacts, CityLinks};
use std::fmt::Write;

/// Adds the description of a city after its title.
pub(super) fn push_about(out: &mut String, city: CityFacts<'_>, links: &CityLinks, texts: &SiteTexts) {
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
pub(super) fn extent_m(city: CityFacts<'_>) -> [f64; 2] {
    let [low, high] = city.manifest.bounds;
    [high[0] - low[0], high[1] - low[1]]
}
