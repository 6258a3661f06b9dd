//! Deadlines of single HTTP/2 responses.
//!
//! A client may stop one stream by its flow control window while the connection looks healthy. Each response on HTTP/2 is
//! therefore watched by itself, and its stream is reset if the client takes too little of it.

use super::turns::InTurn;
use hyper::rt::Executor;
use std::cell::Cell;
use std::future::Future;
use std::net::IpAddr;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::task::AbortHandle;

/// While bytes wait for a client, it must take at least this many per `limits.write_secs`.
pub(super) const MIN_TAKEN_BYTES: u64 = 16 << 10;

/// How far a client has taken one response. Times are milliseconds of the worker's clock; 0 means "no response yet".
#[derive(Debug, Default)]
pub(super) struct StreamProgress {
    since_ms: AtomicU64,
    taken_bytes: AtomicU64,
    client: Option<IpAddr>,
    /// hyper's task for the stream.
    task: OnceLock<AbortHandle>,
}

thread_local! {
    /// The stream whose request was passed to the service last, until hyper spawns its task.
    static NEXT: Cell<Option<Arc<StreamProgress>>> = const { Cell::new(None) };
}

impl StreamProgress {
    /// `client` is the client's network. Must be called where hyper calls the service: the next task that it spawns is this stream's.
    pub(super) fn for_request(client: Option<IpAddr>) -> Arc<Self> {
        let stream = Arc::new(Self { client, ..Self::default() });
        NEXT.set(Some(stream.clone()));
        stream
    }

    /// Starts the deadline again.
    pub(super) fn restart(&self, now_ms: u64) {
        self.taken_bytes.store(0, Relaxed);
        self.since_ms.store(now_ms, Relaxed);
    }

    pub(super) fn has_response(&self) -> bool {
        self.since_ms.load(Relaxed) != 0
    }

    pub(super) fn bytes_taken(&self, bytes: usize) {
        self.taken_bytes.fetch_add(bytes as u64, Relaxed);
    }

    /// Whether the client took too little for `limit`. Enough bytes start the deadline again.
    pub(super) fn has_stalled(&self, now_ms: u64, limit: Duration) -> bool {
        if !self.has_response() {
            return false;
        }
        if self.taken_bytes.load(Relaxed) >= MIN_TAKEN_BYTES {
            self.restart(now_ms);
        }
        now_ms.saturating_sub(self.since_ms.load(Relaxed)) > limit.as_millis() as u64
    }

    /// Resets the stream. `false` if its task has ended, so that only the end of the connection frees what is left of it.
    pub(super) fn reset(&self) -> bool {
        let task = self.task.get().filter(|task| !task.is_finished());
        if let Some(task) = task {
            task.abort();
        }
        task.is_some()
    }
}

/// Spawns hyper's tasks for HTTP/2 streams, and notes each in its [`StreamProgress`].
#[derive(Debug, Clone, Copy)]
pub(super) struct StreamExecutor;

impl<F> Executor<F> for StreamExecutor
where
    F: Future + Send + 'static,
    F::Output: Send + 'static,
{
    fn execute(&self, future: F) {
        let stream = NEXT.take();
        let task = match stream.as_ref().and_then(|stream| stream.client) {
            Some(client) => tokio::spawn(InTurn::new(client, future)).abort_handle(),
            None => tokio::spawn(future).abort_handle(),
        };
        if let Some(stream) = stream {
            let _ = stream.task.set(task);
        }
    }
}
