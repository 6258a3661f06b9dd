//! The page of one city, `/cities/{city}`, and its picture.

use super::access_control::CityAccess;
use super::page_response::{displayed_origin, known_origin, relative, relative_root, respond, share_query};
use super::problem::Problem;
use super::representation::Representation;
use super::state::AppState;
use super::tile::find_city;
use super::wrong_address;
use crate::page::{self, CityFacts, CityInList, CityLinks, CityListPage, CityVersion, NO_VIEWER};
use crate::store::CityStore;
use axum::extract::State;
use axum::http::request::Parts;
use axum::http::{HeaderValue, Uri};
use axum::response::Response;
use insula_protocol::Manifest;
use insula_protocol::route::{self, Route, RouteTemplate};
use std::sync::Arc;
use tokio::task::spawn_blocking;

const NO_PICTURE: Problem = Problem::not_found("there is no picture of this city");

/// `/cities/{city}`. Without a required token, 401, and for an unknown city, 404: for people as a page.
pub(super) async fn city_page(State(state): State<AppState>, parts: Parts) -> Response {
    match find(&state, RouteTemplate::CityPage, &parts) {
        Ok((city, access)) => respond_with_city(&state, &city, access, &parts),
        Err(problem) => wrong_address::respond(&state, problem, &parts),
    }
}

/// `/cities/{city}/thumbnail.jpg`. Fails as [`city_page`], and with 404 if the city has no picture, or the share link is for a part
/// of the city.
pub(super) async fn thumbnail(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let (city, access) = find(&state, RouteTemplate::Thumbnail, &parts)?;
    if matches!(access, CityAccess::Link(scope) if scope.area_mm.is_some()) {
        return Err(NO_PICTURE);
    }
    let read = spawn_blocking(move || city.read_thumbnail()).await;
    let jpeg = read.ok().flatten().ok_or(NO_PICTURE)?;
    Ok(Representation::changing(jpeg, "image/jpeg", access.is_public()).response_to(&parts))
}

/// The city at the address of a page that the request may see.
fn find(state: &AppState, template: RouteTemplate, request: &Parts) -> Result<(Arc<CityStore>, CityAccess), Problem> {
    // Such a city cannot exist. Without a token, the response must be the one for private cities.
    let name = match Route::parse(request.uri.path()) {
        Ok(Route::CityPage { city } | Route::Thumbnail { city }) => city,
        _ => "",
    };
    find_city(state, template, name, request)
}

/// The page of a city that the request may see: with the viewer, if the server has it.
pub(super) fn respond_with_city(state: &AppState, city: &CityStore, access: CityAccess, request: &Parts) -> Response {
    let facts = CityFacts::of(city);
    let root = relative_root(&request.uri);
    let is_public = access.is_public();
    let links = CityLinks {
        list: Some(relative(&root, "/")),
        rules: rules(state, access),
        has_proposals: has_proposals(state, city, access),
        versions: versions(state, city, is_public, &request.uri),
        ..links(state, city, is_public, request)
    };
    let (html, policy) = match &state.viewer {
        Some(viewer) => (page::city_page(facts, &links, &viewer.assets, &state.brand), page::viewer_policy()),
        None => {
            let mut page = CityListPage::new(&state.brand, state.texts(&request.headers), None, None);
            page.push_city(&CityInList { facts, page: None, links });
            page.push_paragraph(NO_VIEWER);
            (page.finish(), page::list_policy())
        }
    };
    let vary = state.viewer.is_none().then_some(HeaderValue::from_static("accept-language"));
    respond(html, policy, is_public, vary, request)
}

/// The versions of the city that anybody may see, and itself, with the share link of the request if the city needs one.
fn versions(state: &AppState, city: &CityStore, is_public: bool, uri: &Uri) -> Vec<CityVersion> {
    let catalog = state.catalog();
    let (own, root) = (city.manifest(), relative_root(uri));
    let is_shown = |other: &&Manifest| other.name == own.name || catalog.access.is_public(&other.name);
    let query = if is_public { None } else { share_query(uri) }.unwrap_or_default();
    let page = |name: &str| {
        let address = relative(&root, &route::city_page(name));
        if name == own.name { address + &query } else { address }
    };
    let all = catalog.store().cities().map(|city| city.manifest()).filter(is_shown);
    page::versions_of(own, all, page)
}

/// Whether the page may show proposals.
fn has_proposals(state: &AppState, city: &CityStore, access: CityAccess) -> bool {
    let has_some = state.brand.proposals_of(&city.manifest().name).is_some();
    cfg!(feature = "bake") && has_some && access.admits_computed(RouteTemplate::Proposals)
}

/// The rules by which the page may let the server compute.
fn rules(state: &AppState, access: CityAccess) -> Vec<&'static str> {
    let is_offered = state.takes_body(RouteTemplate::Analyse) && access.admits_computed(RouteTemplate::Analyse);
    if is_offered { rule_names() } else { Vec::new() }
}

#[cfg(feature = "bake")]
fn rule_names() -> Vec<&'static str> {
    insula_analysis::rule::Rule::names().collect()
}

#[cfg(not(feature = "bake"))]
fn rule_names() -> Vec<&'static str> {
    Vec::new()
}

/// The addresses of a city, with the share link of the request if the city needs one.
pub(super) fn links(state: &AppState, city: &CityStore, is_public: bool, request: &Parts) -> CityLinks {
    let name = &city.manifest().name;
    let query = if is_public { None } else { share_query(&request.uri) }.unwrap_or_default();
    let root = relative_root(&request.uri);
    let manifest = route::manifest(name) + &query;
    let thumbnail = city.has_thumbnail.then(|| route::thumbnail(name) + &query);
    let origin = known_origin(state, request).filter(|_| is_public);
    CityLinks {
        source: relative(&root, &manifest),
        view_address: Some(displayed_origin(state, request) + &manifest),
        preview: thumbnail.as_ref().and_then(|path| Some(origin.clone()? + path)),
        thumbnail: thumbnail.map(|path| relative(&root, &path)),
        root,
        canonical: origin.map(|origin| origin + &route::city_page(name)),
        list: None,
        is_public,
        rules: Vec::new(),
        has_proposals: false,
        versions: Vec::new(),
        meta_policy: None,
    }
}
