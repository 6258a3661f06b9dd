//! The routes of all addresses.

use super::problem::Problem;
use super::state::AppState;
use super::thread_state::ThreadState;
use super::{city_page, filter, group, health, index_page, manifest, search, tile, wrong_address};
use axum::Router;
use axum::extract::State;
use axum::http::request::Parts;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::Response;
use axum::routing::{MethodRouter, get};
use insula_protocol::route::{Route, RouteTemplate};

pub(super) const ALLOWED_METHODS: HeaderValue = HeaderValue::from_static("GET,HEAD,OPTIONS");

pub(super) fn router(state: ThreadState) -> Router {
    let with_route = |router: Router<ThreadState>, template: RouteTemplate| match template.pattern() {
        Some(pattern) => router.route(pattern, handler(template)),
        None => router,
    };
    RouteTemplate::ALL
        .into_iter()
        .fold(Router::new(), with_route)
        .fallback(wrong_address::not_found)
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
        RouteTemplate::Asset => get(asset),
        RouteTemplate::ServiceWorker => get(service_worker),
        RouteTemplate::Search => get(search::search),
        RouteTemplate::Filter => get(filter::filter),
        RouteTemplate::Groups => get(group::group),
        #[cfg(feature = "bake")]
        RouteTemplate::Draw => axum::routing::post(super::draw::draw).fallback(super::posted::other_method),
        #[cfg(feature = "bake")]
        RouteTemplate::Analyse => axum::routing::post(super::analyse::analyse).fallback(super::posted::other_method),
        #[cfg(feature = "bake")]
        RouteTemplate::Proposals => get(super::proposals::proposals),
        #[cfg(not(feature = "bake"))]
        RouteTemplate::Draw | RouteTemplate::Analyse | RouteTemplate::Proposals => get(wrong_address::not_found),
        #[cfg(feature = "bake")]
        RouteTemplate::Tileset | RouteTemplate::TilesetFile => get(super::tileset::tileset_file),
        #[cfg(not(feature = "bake"))]
        RouteTemplate::Tileset | RouteTemplate::TilesetFile => get(wrong_address::not_found),
        RouteTemplate::Other => get(wrong_address::not_found),
    }
}

async fn method_not_allowed() -> Problem {
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "only GET, HEAD and OPTIONS are supported")
        .with(header::ALLOW, ALLOWED_METHODS)
}

const NO_FILE: Problem = Problem::not_found("the viewer of this server has no such file: load the page again");
/// The service worker fetches from its own host, and runs no other script.
const WORKER_POLICY: HeaderValue = HeaderValue::from_static("default-src 'none'; connect-src 'self'");

/// `/assets/{hash}/{file}`. Fails with 404 for files of another version.
async fn asset(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let Ok(Route::Asset { hash, file }) = Route::parse(parts.uri.path()) else { return Err(NO_FILE) };
    let content = state.viewer.as_ref().and_then(|viewer| viewer.file(hash, file)).ok_or(NO_FILE)?;
    Ok(content.response_to(&parts))
}

/// `/service-worker.js`
async fn service_worker(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let content = state.viewer.as_ref().and_then(|viewer| viewer.service_worker()).ok_or(NO_FILE)?;
    let mut response = content.response_to(&parts);
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, WORKER_POLICY);
    Ok(response)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ServeConfig;
    use crate::http::work_queues::WorkKind;
    use crate::http::{AppState, HttpService};
    use crate::store::Store;
    use axum::body::Body;
    use axum::http::Request;
    use insula_test_support::small_city::{self, VERSION};
    use tower::ServiceExt as _;

    /// A request for something that exists at each route, and is not in memory; `None` where there is no such route.
    fn example(route: RouteTemplate) -> Option<Request<Body>> {
        use RouteTemplate as R;
        let of_version = |rest: &str| format!("/v1/cities/two/{VERSION}/{rest}");
        let path = match route {
            R::Subtrees => of_version("subtrees/0/0/0"),
            R::BlockMaps => of_version("blockmaps/1/1/1"),
            R::Meshes => of_version("meshes/1/1/1/0"),
            R::Objects => of_version("objects/schema"),
            R::Visibility => of_version("visibility/0/0/0"),
            R::Search => of_version("search?q=kerk"),
            R::Filter => of_version("filter?expr=height+%3E+1"),
            R::Groups => of_version("groups/blockmaps/1/0/0/4/0"),
            R::Draw => "/v1/cities/two/draw".to_owned(),
            R::Analyse => "/v1/cities/two/analyse".to_owned(),
            R::Proposals => "/v1/cities/two/proposals.json".to_owned(),
            R::Tileset => "/v1/cities/two/3dtiles/tileset.json".to_owned(),
            R::TilesetFile => format!("/v1/cities/two/3dtiles/{VERSION}/subtrees/0/0/0.subtree"),
            R::Manifest => "/v1/cities/two".to_owned(),
            // The usual page is in memory.
            R::Cities => "/v1/cities?limit=5".to_owned(),
            R::Index => "/".to_owned(),
            R::OpenApi => "/v1/openapi.json".to_owned(),
            R::Health => "/healthz".to_owned(),
            R::Readiness => "/readyz".to_owned(),
            R::Metrics => "/metrics".to_owned(),
            R::CityPage => "/cities/two".to_owned(),
            R::Thumbnail => "/cities/two/thumbnail.jpg".to_owned(),
            R::Asset => "/assets/0123456789abcdef/a.js".to_owned(),
            R::ServiceWorker => "/service-worker.js".to_owned(),
            R::Other => return None,
        };
        assert_eq!(RouteTemplate::of_path(path.split('?').next().unwrap()), route);
        let body = match route {
            R::Draw => Some(r#"{"format":"svg"}"#),
            R::Analyse => Some(r#"{"kind":"sky","bbox_metres":[85000,446000,85100,446100]}"#),
            _ => None,
        };
        let request = Request::builder().uri(path).method(if body.is_some() { "POST" } else { "GET" });
        let request = request.header(header::CONTENT_TYPE, "application/json");
        Some(request.body(body.map_or_else(Body::empty, Body::from)).unwrap())
    }

    /// With queues that give up all work, exactly the routes that compute are 503: none computes past its queue.
    #[cfg(feature = "bake")]
    #[tokio::test]
    async fn all_routes_that_compute_wait_in_a_queue() {
        let folder = small_city::temporary_city_with_meshes();
        let index = insula_objects::search::SearchIndexBuilder::new().finish().unwrap();
        std::fs::write(folder.path().join(insula_archive::city::SEARCH_FILE), index).unwrap();
        let mut config = ServeConfig::default();
        (config.drawings.at_once, config.analyses.at_once) = (1, 1);
        let open = || Store::open(&[folder.path()]).unwrap();
        let [closed, running] = [AppState::with_closed_queues(open(), &config), AppState::new(open(), &config)];
        for route in RouteTemplate::ALL {
            let ask = async |state: &AppState| {
                let response = HttpService::new(state.clone()).oneshot(example(route)?).await.unwrap();
                Some((response.status(), response.headers().contains_key(header::RETRY_AFTER)))
            };
            let Some(of_closed) = ask(&closed).await else { continue };
            let is_shed = of_closed == (StatusCode::SERVICE_UNAVAILABLE, true);
            assert_eq!(is_shed, WorkKind::of_route(route).is_some(), "{route:?}: {of_closed:?}");
            let status = ask(&running).await.unwrap().0;
            assert_ne!(status, StatusCode::SERVICE_UNAVAILABLE, "{route:?}");
        }
    }

    /// Threads for work are taken by the queue alone, and by what clients do not cause.
    #[test]
    fn no_route_takes_a_thread_past_the_queues() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/http");
        let mut takers: Vec<String> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| std::fs::read_to_string(path).unwrap().contains(concat!("spawn_", "blocking(")))
            .map(|path| path.file_name().unwrap().to_str().unwrap().to_owned())
            .collect();
        takers.sort();
        assert_eq!(takers, ["city_page.rs", "fair_queue.rs", "hung_disk.rs", "reload.rs"]);
    }
}
