//! Handles one request: the checks in their order, then the router.

use super::client_usage::client_network;
use super::connection_state::ConnectionState;
use super::health::ForOperators;
use super::problem::{NO_ROUTE, Problem};
use super::request_guard::{RequestGuard, RequestLogEntry};
use super::request_host::{check_host, client_address};
use super::response::{NO_REFERRER, POST_METHODS, with_cors};
use super::response_body::{GuardedBody, PlainBody, ResponseBody};
use super::router::{ALLOWED_METHODS, router};
use super::state::AppState;
use super::thread_state::ThreadState;
use super::tile::RequestedTile;
use super::tile_cache::TileCache;
use super::work_queues::{RequestClient, WorkKind};
use axum::body::Body;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Request, Response, StatusCode, Uri, Version, header};
use axum::{Extension, Router};
use insula_protocol::route::RouteTemplate;
use std::convert::Infallible;
use std::future::Future;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use tower::{Layer, Service};

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Longest request id that is taken from a client.
const MAX_ID_BYTES: usize = 64;

const ALLOWED_HEADERS: HeaderValue =
    HeaderValue::from_static("accept,content-type,range,if-match,if-none-match,if-range,authorization,x-request-id");

/// The server without its port. Cheap to clone.
#[derive(Debug, Clone)]
pub struct HttpService(Arc<ServiceShared>);

#[derive(Debug)]
struct ServiceShared {
    state: AppState,
    routes: CachedTiles<Router>,
    served: ServedRoutes,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ServedRoutes {
    All,
    /// `/metrics` has moved to the listener for operators.
    WithoutMetrics,
    /// Health and metrics only.
    Operational,
}

impl ServedRoutes {
    fn includes(self, route: RouteTemplate) -> bool {
        match self {
            Self::All => true,
            Self::WithoutMetrics => route != RouteTemplate::Metrics,
            Self::Operational => route.is_operational(),
        }
    }
}

/// A response that is ready, or a future of one.
#[allow(clippy::large_enum_variant, reason = "`Ready` is the common case, and boxing it would cost an allocation")]
pub(super) enum ResponseFuture {
    Ready(Option<Response<GuardedBody>>),
    Pending(Pin<Box<dyn Future<Output = Response<GuardedBody>> + Send>>),
}

impl Future for ResponseFuture {
    type Output = Result<Response<GuardedBody>, Infallible>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        match &mut *self {
            Self::Ready(response) => response.take().map_or(Poll::Pending, |response| Poll::Ready(Ok(response))),
            Self::Pending(response) => response.as_mut().poll(context).map(Ok),
        }
    }
}

impl HttpService {
    /// A service of all routes with one tile cache of the configured size.
    pub fn new(state: AppState) -> Self {
        let max_bytes = state.limits.tile_bytes;
        Self::with_routes(state, ServedRoutes::All, max_bytes)
    }

    fn with_routes(state: AppState, served: ServedRoutes, tile_cache_bytes: usize) -> Self {
        let shared = ThreadState {
            app: state.clone(),
            tiles: Arc::new(TileCache::new(tile_cache_bytes, state.metrics.cached_tiles())),
        };
        let mut router = router(shared.clone());
        if served == ServedRoutes::Operational {
            router = router.layer(Extension(ForOperators));
        }
        Self(Arc::new(ServiceShared { state, routes: CachedTilesLayer(shared).layer(router), served }))
    }

    pub(super) fn without_metrics(&self) -> Self {
        Self::with_routes(self.0.state.clone(), ServedRoutes::WithoutMetrics, self.state().limits.tile_bytes)
    }

    /// A service of health and metrics only, for operators.
    pub(super) fn for_operators(&self) -> Self {
        Self::with_routes(self.0.state.clone(), ServedRoutes::Operational, 0)
    }

    /// State that all requests share.
    pub fn state(&self) -> &AppState {
        &self.0.state
    }

    /// The service of one of several threads, with a tile cache of its own: its share of the configured size.
    pub(super) fn for_thread(&self, threads: usize) -> Self {
        let tile_cache_bytes = self.state().limits.tile_bytes / threads.max(1);
        Self::with_routes(self.0.state.clone(), self.0.served, tile_cache_bytes)
    }

    /// Responds to a request. `body` is read for drawings and analyses only.
    pub(super) fn respond(
        &self,
        connection: Option<&Arc<ConnectionState>>,
        mut parts: Parts,
        body: impl FnOnce() -> Body,
    ) -> ResponseFuture {
        let mut route = RouteTemplate::of_path(parts.uri.path());
        if let (RouteTemplate::Other, Some(url)) = (route, &self.state().public_url)
            && let Some(uri) = without_prefix(&parts.uri, url.prefix())
        {
            // A proxy may leave its path in the address.
            route = RouteTemplate::of_path(uri.path());
            parts.uri = uri;
        }
        let over_limit = connection.filter(|connection| connection.is_over_limit);
        if let Some(connection) = over_limit {
            connection.start_shutdown();
        }
        let is_stream = parts.version == Version::HTTP_2;
        let mut pending = PendingRequest {
            guard: Box::new(RequestGuard::new(self.state(), connection, route, is_stream)),
            id: request_id(self.state(), &parts.headers),
            method: parts.method.clone(),
            uri: parts.uri.clone(),
            allows_any_origin: self.state().allows_any_origin && !route.is_operational(),
            // What follows an unread body cannot be parsed as a request.
            must_close: (over_limit.is_some() || has_body(&parts.headers)) && !is_stream,
        };
        let client = connection.and_then(|connection| connection.ip);
        let client = client.map(|ip| client_address(ip, &self.state().proxies, &parts.headers));
        if let Err(problem) = self.admit(connection, client, route, &parts) {
            return pending.ready(Err(problem));
        }
        if let Some(ip) = client.filter(|_| WorkKind::of_route(route).is_some()) {
            parts.extensions.insert(RequestClient(client_network(ip)));
        }
        if parts.method == Method::OPTIONS {
            let response = preflight(pending.allows_any_origin, self.state().takes_body(route));
            return pending.ready(Ok(response));
        }
        // Counts the request among those in flight.
        if !route.is_operational() && !pending.guard.try_enter() {
            return pending.ready(Err(too_busy()));
        }
        let body = if self.state().takes_body(route) { body() } else { Body::empty() };
        match self.0.routes.clone().call(Request::from_parts(parts, body)) {
            CachedTilesFuture::Ready(response) => ResponseFuture::Ready(response.map(|it| pending.finish(Ok(it)))),
            routed => ResponseFuture::Pending(Box::pin(async move {
                let Ok(response) = routed.await;
                pending.finish(Ok(response))
            })),
        }
    }

    /// Checks that precede routing. Fails with 503, 431, 400, 421, 429 or 404.
    fn admit(
        &self,
        connection: Option<&Arc<ConnectionState>>,
        client: Option<IpAddr>,
        route: RouteTemplate,
        parts: &Parts,
    ) -> Result<(), Problem> {
        // An orchestrator would restart a server that is merely busy.
        if connection.is_some_and(|connection| connection.is_over_limit) && !route.is_operational() {
            return Err(Problem::unavailable("too many connections: retry in a second"));
        }
        if parts.headers.len() > self.state().limits.headers {
            return Err(Problem::new(StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE, "the request has too many headers"));
        }
        if has_body(&parts.headers) && !(parts.method == Method::POST && self.state().takes_body(route)) {
            return Err(Problem::bad_request("requests must not have a body"));
        }
        check_host(connection, parts, &self.state().hosts)?;
        match client {
            Some(ip) if !route.is_operational() => self.state().rate_limiter.admit(ip)?,
            _ => {}
        }
        if self.0.served.includes(route) { Ok(()) } else { Err(NO_ROUTE) }
    }
}

/// What is kept of a request until its response exists.
struct PendingRequest {
    guard: Box<RequestGuard>,
    id: HeaderValue,
    method: Method,
    uri: Uri,
    allows_any_origin: bool,
    /// The connection ends with this response.
    must_close: bool,
}

impl PendingRequest {
    fn ready(self, result: Result<Response<ResponseBody>, Problem>) -> ResponseFuture {
        ResponseFuture::Ready(Some(self.finish(result)))
    }

    fn finish(mut self, result: Result<Response<ResponseBody>, Problem>) -> Response<GuardedBody> {
        let mut response = match result {
            Ok(response) if self.guard.try_reserve(response.body().len()) => response,
            Ok(_) => too_busy().respond().map(ResponseBody::Full),
            Err(problem) => problem.respond().map(ResponseBody::Full),
        };
        let code = response.status().as_u16();
        let headers = response.headers_mut();
        if self.allows_any_origin && !headers.contains_key(header::ACCESS_CONTROL_ALLOW_ORIGIN) {
            *headers = with_cors(std::mem::take(headers));
        }
        if self.uri.query().is_some() {
            headers.insert(header::REFERRER_POLICY, NO_REFERRER);
        }
        if self.must_close {
            headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
        }
        if self.guard.set_code(code) {
            self.guard.set_log_entry(RequestLogEntry {
                id: self.id.clone(),
                method: self.method,
                path: self.uri.path().to_owned(),
            });
        }
        headers.insert(REQUEST_ID, self.id);
        response.map(|body| GuardedBody::new(body, self.guard))
    }
}

/// The address below a prefix, which has no slash at its end; `None` if it is not below it.
fn without_prefix(uri: &Uri, prefix: &str) -> Option<Uri> {
    let rest = uri.path_and_query()?.as_str().strip_prefix(prefix).filter(|_| !prefix.is_empty())?;
    let mut parts = uri.clone().into_parts();
    parts.path_and_query = Some(rest.parse().ok().filter(|_| rest.starts_with('/'))?);
    Uri::from_parts(parts).ok()
}

fn too_busy() -> Problem {
    Problem::unavailable("too many requests at once: retry in a second")
}

/// Whether the headers announce a body. Only drawings and analyses take one, and an unread body could be mistaken for the next request.
fn has_body(headers: &HeaderMap) -> bool {
    let length = headers.get(header::CONTENT_LENGTH).is_some_and(|length| length != "0");
    length || headers.contains_key(header::TRANSFER_ENCODING)
}

fn preflight(allows_any_origin: bool, takes_body: bool) -> Response<ResponseBody> {
    let mut response = Response::new(ResponseBody::Full(Default::default()));
    *response.status_mut() = StatusCode::NO_CONTENT;
    let headers = response.headers_mut();
    let methods = if takes_body { POST_METHODS } else { ALLOWED_METHODS };
    headers.insert(header::ALLOW, methods.clone());
    if allows_any_origin {
        headers.insert(header::ACCESS_CONTROL_ALLOW_METHODS, methods);
        headers.insert(header::ACCESS_CONTROL_ALLOW_HEADERS, ALLOWED_HEADERS);
        headers.insert(header::ACCESS_CONTROL_MAX_AGE, HeaderValue::from_static("86400"));
    }
    response
}

/// The client's id if it is short and visible ASCII, so that its log and ours can be joined; else a new one.
fn request_id(state: &AppState, headers: &HeaderMap) -> HeaderValue {
    let is_usable =
        |id: &&HeaderValue| (1..=MAX_ID_BYTES).contains(&id.len()) && id.as_bytes().iter().all(u8::is_ascii_graphic);
    headers.get(REQUEST_ID).filter(is_usable).cloned().unwrap_or_else(|| state.new_request_id())
}

impl Service<Request<Body>> for HttpService {
    type Response = axum::response::Response;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Infallible>> + Send>>;

    fn poll_ready(&mut self, _context: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let service = self.clone();
        let (parts, body) = request.into_parts();
        let response = service.respond(None, parts, || body);
        Box::pin(async move { response.await.map(|response| response.map(|body| Body::new(PlainBody(body)))) })
    }
}

// A layer around the router that responds with tiles in memory.
//
// The router's own way, with a match, parameters, extensions, and futures and bodies in boxes, takes 1.7 us more of the 8.1 us of
// such a request: without this layer, the server answers 1.00 times as many requests per second as nginx instead of 1.14 times
// (docs/measurements.md). All other requests, those for tiles that must be read included, go on to the router.

/// Makes [`CachedTiles`] of a router.
#[derive(Debug, Clone)]
pub(super) struct CachedTilesLayer(pub(super) ThreadState);

impl<S> Layer<S> for CachedTilesLayer {
    type Service = CachedTiles<S>;

    fn layer(&self, router: S) -> CachedTiles<S> {
        CachedTiles { state: self.0.clone(), router }
    }
}

/// Responds with tiles that are cached; asks the router for everything else.
#[derive(Debug, Clone)]
pub(super) struct CachedTiles<S> {
    state: ThreadState,
    router: S,
}

/// A response that is ready, or that of the router.
pub(super) enum CachedTilesFuture<F> {
    Ready(Option<Response<ResponseBody>>),
    Routed(F),
}

impl<S> Service<Request<Body>> for CachedTiles<S>
where
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible>,
    S::Future: Unpin,
{
    type Response = Response<ResponseBody>;
    type Error = Infallible;
    type Future = CachedTilesFuture<S::Future>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        self.router.poll_ready(context)
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let ThreadState { app, tiles } = &self.state;
        let (parts, body) = request.into_parts();
        let is_read = parts.method == Method::GET || parts.method == Method::HEAD;
        let cached = |tile: RequestedTile| tile.cached_response(tiles, &parts);
        if let Some(response) = RequestedTile::of_request(app, &parts).ok().filter(|_| is_read).and_then(cached) {
            return CachedTilesFuture::Ready(Some(response.map(ResponseBody::Full)));
        }
        CachedTilesFuture::Routed(self.router.call(Request::from_parts(parts, body)))
    }
}

impl<F> Future for CachedTilesFuture<F>
where
    F: Future<Output = Result<Response<Body>, Infallible>> + Unpin,
{
    type Output = Result<Response<ResponseBody>, Infallible>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        match &mut *self {
            Self::Ready(response) => response.take().map_or(Poll::Pending, |response| Poll::Ready(Ok(response))),
            Self::Routed(response) => {
                Pin::new(response).poll(context).map_ok(|response| response.map(ResponseBody::Routed))
            }
        }
    }
}
