//! The page at `/`: the cities with their sources, and the command that opens them; of a single city, the city's page.

use super::access_control::{CityAccess, Credentials};
use super::city_page::{links, respond_with_city};
use super::fair_queue::{Shed, StopFlag};
use super::page_request::page_request;
use super::page_response::{displayed_origin, relative, respond, share_query};
use super::problem::Problem;
use super::state::AppState;
use super::work_queues::{RequestClient, WorkKind};
use crate::page::{self, CityFacts, CityInList, CityListPage, NO_VIEWER, escape_html};
use crate::store::CityStore;
use axum::extract::State;
use axum::http::HeaderValue;
use axum::http::request::Parts;
use axum::response::Response;
use insula_protocol::route::{self, CITIES};
use std::ops::Bound;
use std::sync::Arc;

/// `/`: the cities that the request may see, in pages. Fails with 400 for an invalid `limit` or `after`, and with 503 if there is no time.
pub(super) async fn index(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let (asked, client) = (state.clone(), RequestClient::of(&parts));
    let work = move |_: &StopFlag| page_of(&asked, &parts);
    state.work(WorkKind::Lists).run(client, work).await.map_err(Shed::problem)?
}

fn page_of(state: &AppState, parts: &Parts) -> Result<Response, Problem> {
    let request = page_request(parts.uri.query().unwrap_or_default())?;
    let catalog = state.catalog();
    let (access, credentials) = (&catalog.access, Credentials::of(parts));
    let has_token = access.has_token(credentials);
    let shared = catalog.shared(credentials).filter(|_| !has_token);
    let is_shared = |name: &str| shared.as_ref().is_some_and(|grant| grant.city == name);
    let start = request.after.map_or(Bound::Unbounded, Bound::Excluded);
    let is_visible = |city: &&Arc<CityStore>| {
        let name = city.manifest().name.as_str();
        has_token || access.is_public(name) || is_shared(name)
    };
    let is_public_page = !has_token && shared.is_none();
    let mut cities = catalog.store().cities_from(start).filter(is_visible).peekable();
    // A browser cannot send a token with the requests of the viewer.
    if state.viewer.is_some() && request.after.is_none() && !has_token {
        let mut first = catalog.store().cities().filter(is_visible);
        if let (Some(city), None) = (first.next(), first.next()) {
            let name = &city.manifest().name;
            let access = shared.as_ref().filter(|grant| grant.city == *name).map(|grant| CityAccess::Link(grant.scope));
            return Ok(respond_with_city(state, city, access.unwrap_or(CityAccess::Public), parts));
        }
    }
    let icon = state.viewer.as_ref().map(|viewer| viewer.assets.folder("") + "icon.svg");
    let texts = state.texts(&parts.headers);
    let mut page = CityListPage::new(&state.brand, texts, icon.as_deref(), None);
    if state.viewer.is_none() {
        page.push_paragraph(NO_VIEWER);
    }
    if cities.peek().is_none() {
        page.push_paragraph(&escape_html(&texts.none));
    }
    let mut shown = 0;
    while let Some(city) = cities.next_if(|_| shown < request.limit.get() && !page.is_full()) {
        let name = &city.manifest().name;
        let links = links(state, city, !is_shared(name), parts);
        let query = if is_shared(name) { share_query(&parts.uri) } else { None }.unwrap_or_default();
        let city_page = state.viewer.as_ref().map(|_| relative("", &route::city_page(name)) + &query);
        page.push_city(&CityInList { facts: CityFacts::of(city), page: city_page, links });
        shown += 1;
        if cities.peek().is_some() && (shown == request.limit.get() || page.is_full()) {
            let limit = request.limit;
            page.push_paragraph(&format!(
                "<a href=\"./?limit={limit}&amp;after={name}\">{}</a>",
                escape_html(&texts.more)
            ));
        }
    }
    let origin = displayed_origin(state, parts);
    page.push_for_programs(&format!(
        "<code>insula view {origin}{CITIES}/NAME</code>, <a href=\"{}\">{CITIES}</a>",
        relative("", CITIES)
    ));
    let vary = Some(HeaderValue::from_static("accept-language"));
    Ok(respond(page.finish(), page::list_policy(), is_public_page, vary, parts))
}
