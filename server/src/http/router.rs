//! Addresses and what surrounds them, outermost layer first.
//!
//! In: an [`AppState`]. Out: a router; tests call it without a port. Next: `listen` puts it on one.

use super::{
    AppState,
    error::{no_method, no_route},
    health, in_flight, manifest, page, tile,
};
use axum::{
    Router,
    extract::Request,
    http::{HeaderName, Method, header},
    middleware,
    routing::get,
};
use insula_protocol::route::{CITIES, Layer};
use std::time::Duration;
use tower::ServiceBuilder;
use tower_http::{
    cors::{Any, CorsLayer},
    request_id::{MakeRequestUuid, PropagateRequestIdLayer, RequestId, SetRequestIdLayer},
    trace::{DefaultOnFailure, DefaultOnResponse, TraceLayer},
};
use tracing::Level;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// The whole server but for its port.
pub fn app(state: AppState) -> Router {
    let mut cities = Router::new()
        .route("/", get(page::index))
        .route(CITIES, get(manifest::cities))
        .route(&format!("{CITIES}/{{city}}"), get(manifest::manifest))
        .route(&format!("{CITIES}/{{city}}/{{version}}/meshes/{{level}}/{{x}}/{{y}}/{{lod}}"), get(tile::mesh));
    for layer in Layer::ALL {
        let pattern = format!("{CITIES}/{{city}}/{{version}}/{}/{{level}}/{{x}}/{{y}}", layer.word());
        let handler = move |app, path, method, headers| tile::tile(layer, app, path, method, headers);
        cities = cities.route(&pattern, get(handler));
    }
    // Health and metrics are answered however full the house is.
    let cities = cities.layer(middleware::from_fn_with_state(state.clone(), in_flight::limit));
    let layers = ServiceBuilder::new()
        .layer(SetRequestIdLayer::new(REQUEST_ID, MakeRequestUuid))
        .layer(
            TraceLayer::new_for_http()
                .make_span_with(span)
                .on_response(DefaultOnResponse::new().level(Level::DEBUG))
                .on_failure(DefaultOnFailure::new().level(Level::WARN)),
        )
        .layer(PropagateRequestIdLayer::new(REQUEST_ID))
        .layer(middleware::from_fn_with_state(state.clone(), in_flight::count))
        .layer(cors());
    cities
        .route("/healthz", get(health::alive))
        .route("/readyz", get(health::ready))
        .route("/metrics", get(health::metrics))
        .fallback(no_route)
        .method_not_allowed_fallback(no_method)
        .layer(layers)
        .with_state(state)
}

fn span(request: &Request) -> tracing::Span {
    let id = request.extensions().get::<RequestId>().and_then(|id| id.header_value().to_str().ok()).unwrap_or_default();
    tracing::info_span!("request", id, method = %request.method(), path = request.uri().path())
}

/// Any page may read the cities: they are public, and no request carries credentials.
fn cors() -> CorsLayer {
    CorsLayer::new()
        .allow_origin(Any)
        .allow_methods([Method::GET, Method::HEAD])
        .allow_headers([header::ACCEPT, header::RANGE, header::IF_NONE_MATCH, header::IF_RANGE])
        .expose_headers([
            header::ETAG,
            header::CONTENT_LENGTH,
            header::CONTENT_RANGE,
            header::ACCEPT_RANGES,
            header::RETRY_AFTER,
            REQUEST_ID,
        ])
        .max_age(Duration::from_secs(86_400))
}
