//! What a page says about a city, without the viewer: extent, size, sources, and the command that opens it.

use super::{
    CityFacts, CityLinks,
    html::{credit, escape_html},
};
use std::fmt::Write;

/// Adds the description of a city after its title.
pub(super) fn push_about(out: &mut String, city: CityFacts<'_>, links: &CityLinks) {
    let manifest = city.manifest;
    let nodes: u64 = manifest.counts.nodes_per_level.iter().sum();
    let [width, depth] = extent_m(city);
    if let Some(address) = &links.view_address {
        let _ = write!(out, "<p><code>insula view {}</code></p>", escape_html(address));
    }
    let url = escape_html(&links.manifest);
    let _ = write!(
        out,
        "<dl><dt>Manifest</dt><dd><a href=\"{url}\">{url}</a></dd>\
         <dt>Extent</dt><dd>{width:.0} m x {depth:.0} m, columns of {} m</dd>\
         <dt>Size</dt><dd>{}, {nodes} nodes, {:.1} MB</dd><dt>Reference system</dt><dd>{}</dd>",
        manifest.cell_m,
        manifest.counts.words(),
        city.file_bytes as f64 / 1e6,
        escape_html(manifest.crs.as_deref().unwrap_or("local metres")),
    );
    for source in &manifest.attribution {
        let _ = write!(out, "<dt>Source</dt><dd>{}</dd>", credit(source));
    }
    out.push_str("</dl>");
}

/// A sentence about a city for search engines and previews of links.
pub(super) fn description(city: CityFacts<'_>) -> String {
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
