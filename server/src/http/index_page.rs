//! The HTML page at `/`: the cities with their sources, and the command that opens them. It contains no scripts.

use super::{
    access_control::Credentials,
    page_request::page_request,
    problem::Problem,
    representation::{REVALIDATE, REVALIDATE_PRIVATE, Representation, etag_of},
    request_host::request_host,
    response::NO_REFERRER,
    state::AppState,
};
use crate::{share_link, store::CityStore};
use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, HeaderValue, Method, Uri, header},
    response::Response,
};
use bytes::Bytes;
use insula_protocol::{manifest::Attribution, route::CITIES};
use std::{fmt::Write, ops::Bound};

/// A page ends early at this size.
const PAGE_BYTES: usize = 1 << 20;
const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:46rem;margin:3rem auto;padding:0 1rem;\
    color:#222;background:#fff}h1{font-weight:600}section{border-top:1px solid #ccc;padding:.5rem 0 1rem}\
    code{background:#f0f0f0;padding:.15rem .35rem;border-radius:3px;overflow-wrap:anywhere}\
    dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1rem}dt{color:#666}dd{margin:0}\
    @media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}code{background:#2a2a2a}a{color:#8bf}}";

/// `/`: the cities that the request may see, in pages.
pub(super) async fn index(
    State(state): State<AppState>,
    method: Method,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let page = page_request(uri.query().unwrap_or_default())?;
    let catalog = state.catalog();
    let (access, credentials) = (catalog.access(), Credentials::new(&headers, &uri));
    let has_token = access.has_token(credentials);
    let shared = access.shared(credentials).filter(|_| !has_token);
    let is_shared = |name: &str| shared.as_ref().is_some_and(|grant| grant.city == name);
    let start = page.after.map_or(Bound::Unbounded, Bound::Excluded);
    let cities = catalog.store().cities_from(start).filter(|city| {
        let name = city.manifest().name.as_str();
        has_token || access.is_public(name) || is_shared(name)
    });
    let origin = displayed_origin(&state, &uri, &headers);
    let mut html = html_start(&origin);
    let mut cities = cities.peekable();
    if cities.peek().is_none() {
        html.push_str("<p>This server has no public city.</p>");
    }
    let mut shown = 0;
    while let Some(city) = cities.next_if(|_| shown < page.limit.get() && html.len() < PAGE_BYTES) {
        let name = &city.manifest().name;
        push_section(&mut html, city, &origin, if is_shared(name) { share_query(&uri) } else { None });
        shown += 1;
        if cities.peek().is_some() && (shown == page.limit.get() || html.len() >= PAGE_BYTES) {
            let _ = write!(html, "<p><a href=\"/?limit={}&amp;after={name}\">More cities</a></p>", page.limit);
        }
    }
    Ok(respond(html, !has_token && shared.is_none(), &method, &headers))
}

/// The page of one city that a share link opens.
pub(super) fn shared_city(
    state: &AppState,
    city: &CityStore,
    method: &Method,
    uri: &Uri,
    headers: &HeaderMap,
) -> Response {
    let origin = displayed_origin(state, uri, headers);
    let mut html = html_start(&origin);
    push_section(&mut html, city, &origin, share_query(uri));
    respond(html, false, method, headers)
}

fn respond(mut html: String, is_public: bool, method: &Method, headers: &HeaderMap) -> Response {
    html.push_str("</body></html>\n");
    let representation = Representation {
        etag: etag_of(html.as_bytes()),
        body: Bytes::from(html),
        content_type: HeaderValue::from_static("text/html; charset=utf-8"),
        cache_control: if is_public { REVALIDATE } else { REVALIDATE_PRIVATE },
        encoding: None,
        vary: None,
    };
    let mut response = representation.respond(method, headers).map(Body::from);
    let policy = HeaderValue::from_static("default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'");
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, policy);
    response.headers_mut().insert(header::REFERRER_POLICY, NO_REFERRER);
    response
}

/// Scheme and host of the request; a placeholder for a host that has not the form of one.
fn displayed_origin(state: &AppState, uri: &Uri, headers: &HeaderMap) -> String {
    let host = request_host(uri, headers).unwrap_or_default();
    let is_allowed = |b: u8| b.is_ascii_alphanumeric() || b".:-[]_".contains(&b);
    let host = if !host.is_empty() && host.bytes().all(is_allowed) { host } else { "HOST" };
    format!("{}://{host}", state.scheme())
}

/// The share link of the request as a query. It has been verified, so that it can stand in HTML.
fn share_query(uri: &Uri) -> Option<String> {
    uri.query().and_then(share_link::from_query).map(|link| format!("?{}={link}", share_link::PARAMETER))
}

fn html_start(origin: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>Insula</title>\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style></head><body><h1>Insula</h1>\
         <p>Whole cities, streamed. Open one with <code>insula view {origin}{CITIES}/NAME</code>; \
         programs start from <a href=\"{CITIES}\">{CITIES}</a>.</p>",
    )
}

fn push_section(out: &mut String, city: &CityStore, origin: &str, share_query: Option<String>) {
    let manifest = city.manifest();
    let url = insula_protocol::route::manifest(&manifest.name) + &share_query.unwrap_or_default();
    let nodes: u64 = manifest.counts.nodes_per_level.iter().sum();
    let [[x0, y0, _], [x1, y1, _]] = manifest.bounds;
    let megabytes = city.file_bytes() as f64 / 1e6;
    let _ = write!(
        out,
        "<section><h2>{}</h2><p><code>insula view {origin}{url}</code></p><dl>\
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
