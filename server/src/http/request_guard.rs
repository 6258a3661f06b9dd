//! What a request holds until its response is sent: its place in the limits, its metrics and its log entry.

use super::{connection_state::ConnectionState, state::AppState};
use axum::{
    body::{Body, Bytes, HttpBody},
    http::{HeaderValue, Method, Uri},
};
use http_body::{Frame, SizeHint};
use http_body_util::Full;
use insula_protocol::route::RouteTemplate;
use std::{
    pin::Pin,
    sync::Arc,
    task::{Context, Poll, ready},
    time::Instant,
};

/// Resources of one request. Dropping it releases them and records the request, however it ended.
pub(super) struct RequestGuard {
    state: AppState,
    connection: Option<Arc<ConnectionState>>,
    started: Instant,
    route: RouteTemplate,
    /// Status code; 0 while there is no response.
    code: u16,
    sent_bytes: u64,
    /// Bytes in the in-flight budget; `None` if the request is not part of it.
    reserved_bytes: Option<usize>,
    log_entry: Option<Box<RequestLogEntry>>,
}

/// The parts of a request that the log names.
pub(super) struct RequestLogEntry {
    pub(super) id: HeaderValue,
    pub(super) method: Method,
    pub(super) uri: Uri,
}

impl RequestGuard {
    pub(super) fn new(state: &AppState, connection: Option<&Arc<ConnectionState>>, route: RouteTemplate) -> Self {
        if let Some(connection) = connection {
            connection.request_started();
        }
        Self {
            state: state.clone(),
            connection: connection.cloned(),
            started: Instant::now(),
            route,
            code: 0,
            sent_bytes: 0,
            reserved_bytes: None,
            log_entry: None,
        }
    }

    /// Sets the status code. Returns whether such a request is logged.
    pub(super) fn set_code(&mut self, code: u16) -> bool {
        self.code = code;
        self.state.must_log(code)
    }

    pub(super) fn set_log_entry(&mut self, entry: RequestLogEntry) {
        self.log_entry = Some(Box::new(entry));
    }

    /// Adds the request to the in-flight budget. `false`: the budget is exhausted.
    pub(super) fn try_enter(&mut self) -> bool {
        let entered = self.state.in_flight().try_enter();
        self.reserved_bytes = entered.then_some(0);
        entered
    }

    /// Reserves bytes of the response, if the request is part of the budget. `false`: the budget is exhausted.
    pub(super) fn try_reserve(&mut self, bytes: usize) -> bool {
        let Some(reserved_bytes) = &mut self.reserved_bytes else { return true };
        let fits = self.state.in_flight().try_reserve(bytes);
        *reserved_bytes += if fits { bytes } else { 0 };
        fits
    }
}

impl Drop for RequestGuard {
    fn drop(&mut self) {
        if let Some(bytes) = self.reserved_bytes {
            self.state.in_flight().release(bytes);
        }
        if let Some(connection) = &self.connection {
            connection.request_ended();
        }
        let elapsed = self.started.elapsed();
        self.state.metrics().request_ended(self.route, self.code, self.sent_bytes, elapsed);
        if let Some(entry) = &self.log_entry {
            let id = entry.id.to_str().unwrap_or_default();
            let (code, bytes, micros) = (self.code, self.sent_bytes, elapsed.as_micros() as u64);
            tracing::info!(id, method = %entry.method, path = entry.uri.path(), code, bytes, micros, "request");
        }
    }
}

/// A response body with its request's guard, which it drops when the connection has taken the last byte.
pub(super) struct GuardedBody {
    body: ResponseBody,
    guard: RequestGuard,
}

/// A body in memory, or one of the router's.
pub(super) enum ResponseBody {
    Full(Full<Bytes>),
    Routed(Body),
}

impl ResponseBody {
    pub(super) fn len(&self) -> usize {
        self.size_hint().lower() as usize
    }

    fn size_hint(&self) -> SizeHint {
        match self {
            Self::Full(body) => body.size_hint(),
            Self::Routed(body) => body.size_hint(),
        }
    }
}

impl GuardedBody {
    pub(super) fn new(body: ResponseBody, guard: RequestGuard) -> Self {
        Self { body, guard }
    }
}

impl HttpBody for GuardedBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = match &mut self.body {
            ResponseBody::Full(body) => {
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
        match &self.body {
            ResponseBody::Full(body) => body.is_end_stream(),
            ResponseBody::Routed(body) => body.is_end_stream(),
        }
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
