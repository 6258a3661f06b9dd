//! What people get at addresses that no page has: the page that was meant, or one that says what is wrong. Programs get the problem.

use super::accept::accepts;
use super::page_response::{relative, relative_root};
use super::problem::{NO_ROUTE, Problem};
use super::response::NO_REFERRER;
use super::state::AppState;
use crate::page::{self, CityListPage, escape_html};
use axum::body::Body;
use axum::extract::State;
use axum::http::request::Parts;
use axum::http::{HeaderValue, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use insula_protocol::name::is_name;
use insula_protocol::route;

/// Longest path for which another one is looked for.
const MAX_PATH_BYTES: usize = 512;

/// All addresses without a route.
pub(super) async fn not_found(State(state): State<AppState>, parts: Parts) -> Response {
    if parts.method == Method::GET || parts.method == Method::HEAD {
        return respond(&state, NO_ROUTE, &parts);
    }
    NO_ROUTE.into_response()
}

/// The response to a request for a page that cannot be shown.
pub(super) fn respond(state: &AppState, problem: Problem, request: &Parts) -> Response {
    if accepts(&request.headers, "text/html") <= 0.0 {
        return problem.into_response();
    }
    let prefix = state.public_url.as_ref().map(|url| url.prefix());
    // Whether that page exists, and may be seen, only its own response says.
    match meant_path(request.uri.path(), prefix.unwrap_or_default()) {
        Some(path) => redirect(&request.uri, &path, prefix),
        None => explain(state, &problem, request),
    }
}

/// The path of the page that was meant by another path: one with a slash too many, a wrong capital, or the name of a file.
fn meant_path(path: &str, prefix: &str) -> Option<String> {
    if path.len() > MAX_PATH_BYTES {
        return None;
    }
    let lower = path.to_ascii_lowercase();
    let mut parts: Vec<&str> = lower.split('/').filter(|part| !part.is_empty()).collect();
    if parts.last() == Some(&"index.html") {
        parts.pop();
    }
    let meant = match parts[..] {
        [] | ["cities"] => "/".to_owned(),
        ["cities", name] if is_name(name) => route::city_page(name),
        // The path of the proxy without the slash at its end.
        _ if !prefix.is_empty() && path == prefix => "/".to_owned(),
        _ => return None,
    };
    (meant != path).then_some(meant)
}

/// Redirects to a path of this server, wherever a proxy has it.
fn redirect(uri: &Uri, path: &str, prefix: Option<&str>) -> Response {
    let address = match prefix {
        Some(prefix) => format!("{prefix}{path}"),
        None => relative(&relative_root(uri), path),
    };
    let query = uri.query().map(|query| format!("?{query}")).unwrap_or_default();
    let mut response = StatusCode::PERMANENT_REDIRECT.into_response();
    let headers = response.headers_mut();
    headers.extend(HeaderValue::try_from(address + &query).map(|address| (header::LOCATION, address)));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(header::REFERRER_POLICY, NO_REFERRER);
    response
}

/// The problem as a page with a link to the list of cities.
fn explain(state: &AppState, problem: &Problem, request: &Parts) -> Response {
    let texts = state.texts(&request.headers);
    let (title, hint) = match problem.status {
        StatusCode::UNAUTHORIZED => (&texts.private, &texts.private_hint),
        _ => (&texts.not_found, &texts.not_found_hint),
    };
    let root = relative_root(&request.uri);
    let mut page = CityListPage::new(&state.brand, texts, None, None);
    page.push_paragraph(&format!("<strong>{}</strong>", escape_html(title)));
    page.push_paragraph(&escape_html(hint));
    page.push_paragraph(&format!("<a href=\"{}\">{}</a>", relative(&root, "/"), escape_html(&texts.cities)));
    let html = page.finish();
    let mut response = problem.clone().respond().map(|_| Body::from(html));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(page::list_policy()));
    headers.insert(header::REFERRER_POLICY, NO_REFERRER);
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_that_mean_a_page_are_known() {
        for (path, meant) in [
            ("/cities/Delft", Some("/cities/delft")),
            ("/cities/delft/", Some("/cities/delft")),
            ("//cities//delft//index.html", Some("/cities/delft")),
            ("/Cities", Some("/")),
            ("/index.html", Some("/")),
            ("//", Some("/")),
            ("/maps", Some("/")),
            ("/", None),
            ("/cities/delft", None),
            ("/cities/%ff", None),
            ("/cities/delft/city.json", None),
            ("/cities/../delft", None),
            ("/v1/cities/Delft", None),
            ("/maps/x", None),
        ] {
            assert_eq!(meant_path(path, "/maps").as_deref(), meant, "{path}");
        }
        assert_eq!(meant_path("/maps", ""), None);
        assert_eq!(meant_path(&format!("/{}", "/".repeat(MAX_PATH_BYTES)), ""), None);
    }
}
