//! The HTML page at `/`: the cities with their sources, and the command that opens them. It contains no scripts.

use super::{
    representation::{REVALIDATE, REVALIDATE_PRIVATE, Representation, etag_of},
    state::AppState,
};
use crate::store::CityStore;
use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, Method, header},
    response::{IntoResponse, Response},
};
use bytes::Bytes;
use insula_protocol::{manifest::Attribution, route::CITIES};
use std::{fmt::Write, sync::Arc};

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:46rem;margin:3rem auto;padding:0 1rem;\
    color:#222;background:#fff}h1{font-weight:600}section{border-top:1px solid #ccc;padding:.5rem 0 1rem}\
    code{background:#f0f0f0;padding:.15rem .35rem;border-radius:3px;overflow-wrap:anywhere}\
    dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1rem}dt{color:#666}dd{margin:0}\
    @media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}code{background:#2a2a2a}a{color:#8bf}}";

/// `/`
pub(super) async fn index(State(state): State<AppState>, method: Method, headers: HeaderMap) -> Response {
    let catalog = state.catalog();
    let access = catalog.access();
    let has_token = access.has_token(&headers);
    let cities = catalog.store().cities().filter(|city| has_token || !access.is_private(&city.manifest().name));
    let html = render(cities, displayed_host(&headers));
    let representation = Representation {
        etag: etag_of(html.as_bytes()),
        body: Bytes::from(html),
        content_type: HeaderValue::from_static("text/html; charset=utf-8"),
        cache_control: if has_token { REVALIDATE_PRIVATE } else { REVALIDATE },
        encoding: None,
        vary: None,
    };
    let mut response = representation.respond(&method, &headers).into_response();
    let policy = HeaderValue::from_static("default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'");
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, policy);
    response
}

/// The request's `Host` if it has the form of one, else a placeholder.
fn displayed_host(headers: &HeaderMap) -> &str {
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let is_allowed = |b: u8| b.is_ascii_alphanumeric() || b".:-[]_".contains(&b);
    if !host.is_empty() && host.bytes().all(is_allowed) { host } else { "HOST" }
}

fn render<'a>(cities: impl Iterator<Item = &'a Arc<CityStore>>, host: &str) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>Insula</title>\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style></head><body><h1>Insula</h1>\
         <p>Whole cities, streamed. Open one with <code>insula view http://{host}{CITIES}/NAME</code>; \
         programs start from <a href=\"{CITIES}\">{CITIES}</a>.</p>",
    );
    let mut is_empty = true;
    for city in cities {
        push_section(&mut out, city, host);
        is_empty = false;
    }
    if is_empty {
        out.push_str("<p>This server has no public city.</p>");
    }
    out.push_str("</body></html>\n");
    out
}

fn push_section(out: &mut String, city: &CityStore, host: &str) {
    let manifest = city.manifest();
    let url = insula_protocol::route::manifest(&manifest.name);
    let nodes: u64 = manifest.counts.nodes_per_level.iter().sum();
    let [[x0, y0, _], [x1, y1, _]] = manifest.bounds;
    let megabytes = city.file_bytes() as f64 / 1e6;
    let _ = write!(
        out,
        "<section><h2>{}</h2><p><code>insula view http://{host}{url}</code></p><dl>\
         <dt>Manifest</dt><dd><a href=\"{url}\">{url}</a></dd>\
         <dt>Extent</dt><dd>{:.0} m x {:.0} m, columns of {} m</dd>\
         <dt>Size</dt><dd>{} objects, {nodes} nodes, {megabytes:.1} MB</dd><dt>Reference system</dt><dd>{}</dd>",
        escape_html(&manifest.title),
        x1 - x0,
        y1 - y0,
        manifest.cell_m,
        manifest.counts.objects,
        escape_html(manifest.crs.as_deref().unwrap_or("local metres")),
    );
    for source in &manifest.attribution {
        let _ = write!(out, "<dt>Source</dt><dd>{}</dd>", credit(source));
    }
    out.push_str("</dl></section>");
}

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

fn escape_html(text: &str) -> String {
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
