//! Routes other than tiles, which [`HttpService`](super::HttpService) serves itself.

use super::{health, index_page, manifest, problem::Problem, state::AppState};
use axum::{
    Router,
    http::{HeaderValue, StatusCode, header},
    routing::{MethodRouter, get},
};
use insula_protocol::route::RouteTemplate;

pub(super) const ALLOWED_METHODS: HeaderValue = HeaderValue::from_static("GET,HEAD,OPTIONS");

/// The router of everything but tiles.
pub(super) fn router(state: AppState) -> Router {
    let with_route = |router: Router<AppState>, template: RouteTemplate| match template.pattern() {
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

fn handler(template: RouteTemplate) -> MethodRouter<AppState> {
    match template {
        RouteTemplate::Index => get(index_page::index),
        RouteTemplate::OpenApi => get(manifest::openapi),
        RouteTemplate::Health => get(health::alive),
        RouteTemplate::Readiness => get(health::ready),
        RouteTemplate::Metrics => get(health::metrics),
        RouteTemplate::Cities => get(manifest::list_cities),
        RouteTemplate::Manifest => get(manifest::manifest),
        // The service handles GET and HEAD requests for tiles. These routes make other methods 405 instead of 404.
        RouteTemplate::Subtrees | RouteTemplate::BlockMaps | RouteTemplate::Meshes | RouteTemplate::Other => {
            get(not_found)
        }
    }
}

/// The response to requests for addresses that do not exist.
pub(super) const NO_ROUTE: Problem =
    Problem::not_found("there is nothing at this path; the cities are listed at /v1/cities");

async fn not_found() -> Problem {
    NO_ROUTE
}

async fn method_not_allowed() -> Problem {
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "only GET, HEAD and OPTIONS are supported")
        .with(header::ALLOW, ALLOWED_METHODS)
}
