//! One request, from its headers to its answer: what is checked in which order.
//!
//! In: a request's head and whose it is. Out: an answer with its [`RequestGuard`]. Next: `tile`, or `router` for what is rare.

use super::{
    connection_state::ConnectionState,
    metrics::RouteLabel,
    problem::Problem,
    request_guard::{GuardedBody, RequestGuard, RequestLogEntry, ResponseBody},
    response::with_cors,
    router::router,
    state::AppState,
    tile::TileRequest,
    tile_address::TileAddress,
    tile_cache::TileCache,
};
use axum::{
    Router,
    body::Body,
    http::{
        HeaderMap, HeaderName, HeaderValue, Method, Request, Response, StatusCode, Uri, Version, header, request::Parts,
    },
};
use std::{
    convert::Infallible,
    future::Future,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
};
use tower::{Service, ServiceExt};

pub(super) const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
/// Longest request id that is taken over from a client.
const MAX_ID_BYTES: usize = 64;

const METHODS: HeaderValue = HeaderValue::from_static("GET,HEAD,OPTIONS");
const ASKED: HeaderValue = HeaderValue::from_static("accept,range,if-none-match,if-range,authorization,x-request-id");

/// The whole server but for its port; tests call it without one.
pub fn app(state: AppState) -> HttpService {
    let tiles = Arc::new(TileCache::new(state.limits().tile_bytes));
    HttpService(Arc::new(ServiceShared { router: router(state.clone()), state, tiles }))
}

/// Answers requests. Cheap to clone.
#[derive(Debug, Clone)]
pub struct HttpService(Arc<ServiceShared>);

#[derive(Debug)]
struct ServiceShared {
    state: AppState,
    router: Router,
    tiles: Arc<TileCache>,
}

/// An answer that is there, or on its way.
#[allow(clippy::large_enum_variant, reason = "the large one is the common one: a box for it would cost an allocation")]
pub(super) enum ResponseFuture {
    Now(Option<Response<GuardedBody>>),
    Later(Pin<Box<dyn Future<Output = Response<GuardedBody>> + Send>>),
}

impl Future for ResponseFuture {
    type Output = Result<Response<GuardedBody>, Infallible>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        match &mut *self {
            Self::Now(response) => response.take().map_or(Poll::Pending, |response| Poll::Ready(Ok(response))),
            Self::Later(response) => response.as_mut().poll(context).map(Ok),
        }
    }
}

impl HttpService {
    /// What all requests share.
    pub fn state(&self) -> &AppState {
        &self.0.state
    }

    fn tiles(&self) -> &TileCache {
        &self.0.tiles
    }

    /// The same for one of several threads, with tiles of its own at hand.
    pub(super) fn for_thread(&self, threads: usize) -> Self {
        let tiles = Arc::new(TileCache::new(self.state().limits().tile_bytes / threads.max(1)));
        Self(Arc::new(ServiceShared { state: self.0.state.clone(), router: self.0.router.clone(), tiles }))
    }

    /// The answer to a request, whose body nobody reads.
    pub(super) fn answer(&self, client: Option<&Arc<ConnectionState>>, parts: Parts) -> ResponseFuture {
        let route = RouteLabel::of_path(parts.uri.path());
        let over = client.is_some_and(|client| client.over());
        let of = PendingRequest {
            guard: RequestGuard::new(self.state(), client, route),
            id: request_id(self.state(), &parts.headers),
            method: parts.method.clone(),
            uri: parts.uri.clone(),
            // What follows a body that nobody reads is no request.
            closing: (over || has_body(&parts.headers)) && parts.version != Version::HTTP_2,
        };
        self.routed(client, route, parts, of)
    }

    fn routed(
        &self,
        client: Option<&Arc<ConnectionState>>,
        route: RouteLabel,
        parts: Parts,
        mut of: PendingRequest,
    ) -> ResponseFuture {
        if let Err(problem) = self.admit(client, route, &parts) {
            return of.now(Err(problem));
        }
        if parts.method == Method::OPTIONS {
            return of.now(Ok(preflight()));
        }
        // Health and metrics are answered however full the house is.
        if route.is_of_cities() && !of.guard.enter() {
            return of.now(Err(busy()));
        }
        let app = self.clone();
        let is_read = parts.method == Method::GET || parts.method == Method::HEAD;
        match TileAddress::parse(parts.uri.path()).filter(|_| is_read) {
            None => ResponseFuture::Later(Box::pin(async move {
                let Ok(response) = app.0.router.clone().oneshot(Request::from_parts(parts, Body::empty())).await;
                of.answer(Ok(response.map(ResponseBody::Routed)))
            })),
            Some(address) => match address.and_then(|address| TileRequest::find(self.state(), address, &parts.headers))
            {
                Err(problem) => of.now(Err(problem)),
                Ok(wanted) => match wanted.at_hand(self.tiles(), &parts) {
                    Some(answer) => of.now(Ok(answer.map(ResponseBody::Whole))),
                    None => ResponseFuture::Later(Box::pin(async move {
                        let answer = wanted.read(app.state(), app.tiles(), &parts.method, &parts.headers).await;
                        of.answer(answer.map(|answer| answer.map(ResponseBody::Whole)))
                    })),
                },
            },
        }
    }

    fn admit(&self, client: Option<&Arc<ConnectionState>>, route: RouteLabel, parts: &Parts) -> Result<(), Problem> {
        if client.is_some_and(|client| client.over()) {
            return Err(Problem::unavailable("too many connections at once: ask again in a second"));
        }
        if parts.headers.len() > self.state().limits().headers {
            return Err(Problem::new(StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE, "the request has too many headers"));
        }
        if has_body(&parts.headers) {
            return Err(Problem::bad_request("requests have no body here"));
        }
        match client.and_then(|client| client.ip()) {
            Some(ip) if route.is_of_cities() => self.state().rate().admit(ip),
            _ => Ok(()),
        }
    }
}

/// What is kept of a request until its answer is there.
struct PendingRequest {
    guard: RequestGuard,
    id: HeaderValue,
    method: Method,
    uri: Uri,
    /// The connection ends with this answer.
    closing: bool,
}

impl PendingRequest {
    fn now(self, result: Result<Response<ResponseBody>, Problem>) -> ResponseFuture {
        ResponseFuture::Now(Some(self.answer(result)))
    }

    fn answer(mut self, result: Result<Response<ResponseBody>, Problem>) -> Response<GuardedBody> {
        let mut response = match result {
            Ok(response) if self.guard.hold(response.body().len()) => response,
            Ok(_) => problem(busy()),
            Err(why) => problem(why),
        };
        let status = response.status();
        let headers = response.headers_mut();
        if !headers.contains_key(header::ACCESS_CONTROL_ALLOW_ORIGIN) {
            *headers = with_cors(std::mem::take(headers));
        }
        if self.closing {
            headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
        }
        self.guard.code(status.as_u16());
        if self.guard.logs(status.as_u16()) {
            self.guard.log(RequestLogEntry { id: self.id.clone(), method: self.method, uri: self.uri });
        }
        headers.insert(REQUEST_ID, self.id);
        response.map(|inner| GuardedBody::new(inner, self.guard))
    }
}

fn busy() -> Problem {
    Problem::unavailable("too many requests at once: ask again in a second")
}

fn problem(problem: Problem) -> Response<ResponseBody> {
    problem.answer().map(ResponseBody::Whole)
}

/// Nobody here wants one, and what follows a request could be taken for another.
fn has_body(headers: &HeaderMap) -> bool {
    let length = headers.get(header::CONTENT_LENGTH).is_some_and(|length| length != "0");
    length || headers.contains_key(header::TRANSFER_ENCODING)
}

fn preflight() -> Response<ResponseBody> {
    let mut response = Response::new(ResponseBody::Whole(Default::default()));
    *response.status_mut() = StatusCode::NO_CONTENT;
    let headers = response.headers_mut();
    headers.insert(header::ALLOW, METHODS);
    headers.insert(header::ACCESS_CONTROL_ALLOW_METHODS, METHODS);
    headers.insert(header::ACCESS_CONTROL_ALLOW_HEADERS, ASKED);
    headers.insert(header::ACCESS_CONTROL_MAX_AGE, HeaderValue::from_static("86400"));
    response
}

/// The client's own, if it is short and visible, so that its logs and ours can be laid side by side; else a new one.
fn request_id(state: &AppState, headers: &HeaderMap) -> HeaderValue {
    let usable =
        |id: &&HeaderValue| (1..=MAX_ID_BYTES).contains(&id.len()) && id.as_bytes().iter().all(u8::is_ascii_graphic);
    headers.get(REQUEST_ID).filter(usable).cloned().unwrap_or_else(|| state.new_id())
}

impl Service<Request<Body>> for HttpService {
    type Response = axum::response::Response;
    type Error = Infallible;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Infallible>> + Send>>;

    fn poll_ready(&mut self, _context: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let app = self.clone();
        let answering = app.answer(None, request.into_parts().0);
        Box::pin(async move { answering.await.map(|response| response.map(Body::new)) })
    }
}
