//! What a request holds until its response is sent: its place in the limits, its metrics and its log entry.

use super::connection_state::ConnectionState;
use super::in_flight::InFlightBudget;
use super::state::AppState;
use super::stream_progress::StreamProgress;
use axum::http::{HeaderValue, Method};
use insula_protocol::route::RouteTemplate;
use std::sync::Arc;
use std::time::Instant;

/// Resources of one request. Dropping it releases them and records the request, however it ended.
pub(super) struct RequestGuard {
    state: AppState,
    connection: Option<Arc<ConnectionState>>,
    /// Of a request by HTTP/2: its stream, and the key of the stream in its connection.
    stream: Option<(usize, Arc<StreamProgress>)>,
    started: Instant,
    route: RouteTemplate,
    /// Status code; 0 while there is no response.
    code: u16,
    sent_bytes: u64,
    /// Bytes in the in-flight budget; `None` if the request is not part of it.
    reserved_bytes: Option<usize>,
    log_entry: Option<Box<RequestLogEntry>>,
}

/// The parts of a request that the log names. The query is none of them: it may hold a share link.
pub(super) struct RequestLogEntry {
    pub(super) id: HeaderValue,
    pub(super) method: Method,
    pub(super) path: String,
}

impl RequestGuard {
    /// `is_stream`: the request came by HTTP/2. Must be called where hyper calls the service.
    pub(super) fn new(
        state: &AppState,
        connection: Option<&Arc<ConnectionState>>,
        route: RouteTemplate,
        is_stream: bool,
    ) -> Self {
        if let Some(connection) = connection {
            connection.request_started();
        }
        Self {
            state: state.clone(),
            connection: connection.cloned(),
            stream: connection.filter(|_| is_stream).map(|connection| connection.stream_started()),
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

    /// Adds the request to the budgets in flight, of all clients and of this one. `false`: one of them is exhausted.
    pub(super) fn try_enter(&mut self) -> bool {
        let all = &self.state.in_flight;
        let entered = all.try_enter();
        if entered && !self.client_budget().is_none_or(InFlightBudget::try_enter) {
            all.release(0);
            return false;
        }
        self.reserved_bytes = entered.then_some(0);
        entered
    }

    /// Reserves bytes of the response, if the request is part of the budgets. `false`: one of them is exhausted.
    pub(super) fn try_reserve(&mut self, bytes: usize) -> bool {
        let Some(reserved_bytes) = self.reserved_bytes else { return true };
        let all = &self.state.in_flight;
        if !all.try_reserve(bytes) {
            return false;
        }
        if !self.client_budget().is_none_or(|client| client.try_reserve(bytes)) {
            all.unreserve(bytes);
            return false;
        }
        self.reserved_bytes = Some(reserved_bytes + bytes);
        true
    }

    fn client_budget(&self) -> Option<&InFlightBudget> {
        Some(&self.connection.as_ref()?.client()?.in_flight)
    }

    /// Starts the deadline of the response.
    pub(super) fn response_started(&self) {
        if let (Some((_, stream)), Some(connection)) = (&self.stream, &self.connection) {
            stream.restart(connection.now_ms());
        }
    }

    /// Counts bytes of the response that were passed to the connection.
    pub(super) fn bytes_sent(&mut self, bytes: usize) {
        self.sent_bytes += bytes as u64;
    }

    /// How far the client has taken the response, if it came by HTTP/2.
    pub(super) fn stream(&self) -> Option<&Arc<StreamProgress>> {
        self.stream.as_ref().map(|(_, stream)| stream)
    }
}

impl Drop for RequestGuard {
    fn drop(&mut self) {
        if let Some(bytes) = self.reserved_bytes {
            self.state.in_flight.release(bytes);
            if let Some(client) = self.client_budget() {
                client.release(bytes);
            }
        }
        if let Some(connection) = &self.connection {
            connection.request_ended();
            if let Some((key, _)) = self.stream {
                connection.stream_ended(key);
            }
        }
        let elapsed = self.started.elapsed();
        self.state.metrics.request_ended(self.route, self.code, self.sent_bytes, elapsed);
        if let Some(entry) = &self.log_entry {
            let id = entry.id.to_str().unwrap_or_default();
            let (code, bytes, micros) = (self.code, self.sent_bytes, elapsed.as_micros() as u64);
            tracing::info!(id, method = %entry.method, path = entry.path, code, bytes, micros, "request");
        }
    }
}
