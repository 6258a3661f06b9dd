//! The routes of all addresses.

use super::{
    city_page, filter, group, health, index_page, manifest,
    problem::{NO_ROUTE, Problem},
    search,
    thread_state::ThreadState,
    tile, viewer_files,
};
use axum::{
    Router,
    http::{HeaderValue, StatusCode, header},
    routing::{MethodRouter, get},
};
use insula_protocol::route::RouteTemplate;

pub(super) const ALLOWED_METHODS: HeaderValue = HeaderValue::from_static("GET,HEAD,OPTIONS");

/// The router of all addresses.
pub(super) fn router(state: ThreadState) -> Router {
    let with_route = |router: Router<ThreadState>, template: RouteTemplate| match template.pattern() {
        Some(pattern) => router.route(pattern, handler(template)),
        None => router,
    };
    RouteTemplate::ALL
        .into_iter()
        .fold(Router::new(), with_route)
        .fallback(not_found)
        .method_not_allowed_fallback(method_not_allowed)
        .with_state(state)
}

fn handler(template: RouteTemplate) -> MethodRouter<ThreadState> {
    match template {
        RouteTemplate::Index => get(index_page::index),
        RouteTemplate::OpenApi => get(manifest::openapi),
        RouteTemplate::Health => get(health::alive),
        RouteTemplate::Readiness => get(health::ready),
        RouteTemplate::Metrics => get(health::metrics),
        RouteTemplate::Cities => get(manifest::list_cities),
        RouteTemplate::Manifest => get(manifest::manifest),
        RouteTemplate::Subtrees
        | RouteTemplate::BlockMaps
        | RouteTemplate::Meshes
        | RouteTemplate::Objects
        | RouteTemplate::Visibility => get(tile::tile),
        RouteTemplate::CityPage => get(city_page::city_page),
        RouteTemplate::Thumbnail => get(city_page::thumbnail),
        RouteTemplate::Asset => get(viewer_files::asset),
        RouteTemplate::ServiceWorker => get(viewer_files::service_worker),
        RouteTemplate::Search => get(search::search),
        RouteTemplate::Filter => get(filter::filter),
        RouteTemplate::Groups => get(group::group),
        #[cfg(feature = "bake")]
        RouteTemplate::Draw => axum::routing::post(super::draw::draw).fallback(super::draw::other_method),
        #[cfg(not(feature = "bake"))]
        RouteTemplate::Draw => get(not_found),
        #[cfg(feature = "bake")]
        RouteTemplate::Tileset | RouteTemplate::TilesetFile => get(super::tileset::tileset_file),
        #[cfg(not(feature = "bake"))]
        RouteTemplate::Tileset | RouteTemplate::TilesetFile => get(not_found),
        RouteTemplate::Other => get(not_found),
    }
}

async fn not_found() -> Problem {
    NO_ROUTE
}

async fn method_not_allowed() -> Problem {
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "only GET, HEAD and OPTIONS are supported")
        .with(header::ALLOW, ALLOWED_METHODS)
}
