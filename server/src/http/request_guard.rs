//! An answer on its way out, and what is counted until it is.
//!
//! In: a response and the request's [`RequestGuard`]. Out: a body that keeps the guard until it has been handed to the connection.
//! Next: hyper.

use super::{connection_state::ConnectionState, metrics::RouteLabel, state::AppState};
use axum::{
    body::{Body, Bytes, HttpBody},
    http::{HeaderValue, Method, Uri},
};
use http_body::{Frame, SizeHint};
use http_body_util::Full;
use std::{
    pin::Pin,
    sync::Arc,
    task::{Context, Poll, ready},
    time::Instant,
};

/// What one request holds; given back when this is dropped, however that comes about.
pub(super) struct RequestGuard {
    state: AppState,
    client: Option<Arc<ConnectionState>>,
    started: Instant,
    route: RouteLabel,
    code: u16,
    sent_bytes: u64,
    /// Counted as in flight, with so many bytes.
    held: Option<usize>,
    line: Option<Box<RequestLogEntry>>,
}

/// What the log says of a request.
pub(super) struct RequestLogEntry {
    pub(super) id: HeaderValue,
    pub(super) method: Method,
    pub(super) uri: Uri,
}

impl RequestGuard {
    pub(super) fn new(state: &AppState, client: Option<&Arc<ConnectionState>>, route: RouteLabel) -> Self {
        if let Some(client) = client {
            client.begin();
        }
        let (state, client) = (state.clone(), client.cloned());
        Self { state, client, started: Instant::now(), route, code: 0, sent_bytes: 0, held: None, line: None }
    }

    /// Whether an answer of this code has a line in the log.
    pub(super) fn logs(&self, code: u16) -> bool {
        self.state.logs(code)
    }

    /// Writes a line of the log at the end.
    pub(super) fn log(&mut self, line: RequestLogEntry) {
        self.line = Some(Box::new(line));
    }

    pub(super) fn code(&mut self, code: u16) {
        self.code = code;
    }

    /// Whether there is room for one request more.
    pub(super) fn enter(&mut self) -> bool {
        let entered = self.state.room().enter();
        self.held = entered.then_some(0);
        entered
    }

    /// Whether there is room for so many bytes of answer, if it has entered.
    pub(super) fn hold(&mut self, bytes: usize) -> bool {
        let Some(held) = &mut self.held else { return true };
        let fits = self.state.room().hold(bytes);
        *held += if fits { bytes } else { 0 };
        fits
    }
}

impl Drop for RequestGuard {
    fn drop(&mut self) {
        if let Some(bytes) = self.held {
            self.state.room().leave(bytes);
        }
        if let Some(client) = &self.client {
            client.end();
        }
        let taken = self.started.elapsed();
        self.state.metrics().finished(self.route, self.code, self.sent_bytes, taken);
        if let Some(line) = &self.line {
            let id = line.id.to_str().unwrap_or_default();
            let (code, bytes, micros) = (self.code, self.sent_bytes, taken.as_micros() as u64);
            tracing::info!(id, method = %line.method, path = line.uri.path(), code, bytes, micros, "request");
        }
    }
}

/// A body that keeps its request's [`RequestGuard`].
pub(super) struct GuardedBody {
    inner: ResponseBody,
    guard: RequestGuard,
}

pub(super) enum ResponseBody {
    Whole(Full<Bytes>),
    Routed(Body),
}

impl ResponseBody {
    pub(super) fn len(&self) -> usize {
        let hint = match self {
            Self::Whole(body) => body.size_hint(),
            Self::Routed(body) => body.size_hint(),
        };
        hint.lower() as usize
    }
}

impl GuardedBody {
    pub(super) fn new(inner: ResponseBody, guard: RequestGuard) -> Self {
        Self { inner, guard }
    }
}

impl HttpBody for GuardedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = match &mut self.inner {
            ResponseBody::Whole(body) => {
                ready!(Pin::new(body).poll_frame(context)).map(|frame| frame.map_err(|e| match e {}))
            }
            ResponseBody::Routed(body) => ready!(Pin::new(body).poll_frame(context)),
        };
        if let Some(Ok(frame)) = &frame {
            self.guard.sent_bytes += frame.data_ref().map_or(0, Bytes::len) as u64;
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        match &self.inner {
            ResponseBody::Whole(body) => body.is_end_stream(),
            ResponseBody::Routed(body) => body.is_end_stream(),
        }
    }

    fn size_hint(&self) -> SizeHint {
        match &self.inner {
            ResponseBody::Whole(body) => body.size_hint(),
            ResponseBody::Routed(body) => body.size_hint(),
        }
    }
}
