//! Counts requests from their first header to the last byte of their answer, and turns away what is too much.
//!
//! In: a request. Out: the handler's response, or 503 with `Retry-After`. Next: `metrics`.
//!
//! A request stays in flight until its body has been handed to the connection, so a [`Guard`] travels inside the body.

use super::{AppState, Problem, metrics::Route};
use axum::{
    body::{Body, Bytes, HttpBody},
    extract::{MatchedPath, Request, State},
    middleware::Next,
    response::{IntoResponse, Response},
};
use http_body::{Frame, SizeHint};
use std::{
    pin::Pin,
    task::{Context, Poll, ready},
    time::Instant,
};
use tokio::sync::OwnedSemaphorePermit;

/// Middleware: counts every request.
pub(super) async fn count(State(app): State<AppState>, request: Request, next: Next) -> Response {
    let pattern = request.extensions().get::<MatchedPath>().map(MatchedPath::as_str);
    let mut guard = Guard::new(app, Route::of_pattern(pattern));
    let response = next.run(request).await;
    guard.code = response.status().as_u16();
    response.map(|inner| Body::new(Guarded { inner, guard }))
}

/// Middleware: at most so many requests for cities at once.
pub(super) async fn limit(State(app): State<AppState>, request: Request, next: Next) -> Response {
    match app.permits().try_acquire_owned() {
        Ok(permit) => next.run(request).await.map(|inner| Body::new(Guarded { inner, guard: permit })),
        Err(_) => Problem::unavailable("too many requests at once: ask again in a second").into_response(),
    }
}

/// Counts its request when it is dropped, however that comes about.
struct Guard {
    app: AppState,
    route: Route,
    started: Instant,
    code: u16,
    bytes: u64,
}

impl Guard {
    fn new(app: AppState, route: Route) -> Self {
        app.metrics().started();
        Self { app, route, started: Instant::now(), code: 0, bytes: 0 }
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.app.metrics().finished(self.route, self.code, self.bytes, self.started.elapsed());
    }
}

/// What a body keeps until it has been sent.
trait Kept: Send + Unpin + 'static {
    fn sent(&mut self, _bytes: usize) {}
}

impl Kept for Guard {
    fn sent(&mut self, bytes: usize) {
        self.bytes += bytes as u64;
    }
}

impl Kept for OwnedSemaphorePermit {}

struct Guarded<K> {
    inner: Body,
    guard: K,
}

impl<K: Kept> HttpBody for Guarded<K> {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = ready!(Pin::new(&mut self.inner).poll_frame(context));
        if let Some(Ok(frame)) = &frame {
            self.guard.sent(frame.data_ref().map_or(0, Bytes::len));
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.inner.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.inner.size_hint()
    }
}
