//! Progress of one connection, and the timeouts that close it.

use super::client_usage::{ClientUsage, client_network};
use super::stream_progress::{MIN_TAKEN_BYTES, StreamProgress};
use slab::Slab;
use std::net::IpAddr;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::task::Waker;
use std::time::Duration;

/// Time limit of a connection over the limit: it is there for one request, which is rejected unless it is for health.
const OVER_LIMIT_TIMEOUT: Duration = Duration::from_secs(2);

/// What one connection is doing and since when. Times are milliseconds of `clock_ms`; 0 means "not running".
#[derive(Debug)]
pub(super) struct ConnectionState {
    pub(super) ip: Option<IpAddr>,
    client: Option<Arc<ClientUsage>>,
    pub(super) is_over_limit: bool,
    /// Shared by the worker's connections. The worker advances it a few times per second, so that reading the time needs no
    /// system call.
    clock_ms: Arc<AtomicU64>,
    timeouts: ClientTimeouts,
    requests_in_progress: AtomicU32,
    /// A request came by HTTP/2, whose peers also send frames between requests.
    is_multiplexed: AtomicBool,
    /// HTTP/2 streams with a request.
    streams: Mutex<Slab<Arc<StreamProgress>>>,
    /// When the last request ended.
    idle_since_ms: AtomicU64,
    /// When the first byte of the next request arrived; for the first request, when the connection was accepted.
    first_byte_ms: AtomicU64,
    /// Since when bytes wait that the client does not take, and how many it has taken since.
    stalled_since_ms: AtomicU64,
    taken_bytes: AtomicU64,
    timeout_kind: OnceLock<&'static str>,
    is_shutting_down: AtomicBool,
    waker: OnceLock<Waker>,
}

/// Time limits of a client's actions.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClientTimeouts {
    pub(super) header: Duration,
    pub(super) idle: Duration,
    pub(super) write: Duration,
}

impl ConnectionState {
    /// `over_limit`: there are too many connections, and every request on this one is rejected.
    pub(super) fn new(
        ip: Option<IpAddr>,
        client: Option<Arc<ClientUsage>>,
        over_limit: bool,
        clock_ms: Arc<AtomicU64>,
        mut timeouts: ClientTimeouts,
    ) -> Self {
        let now_ms = clock_ms.load(Relaxed);
        if over_limit {
            timeouts.header = timeouts.header.min(OVER_LIMIT_TIMEOUT);
            timeouts.idle = timeouts.idle.min(OVER_LIMIT_TIMEOUT);
            timeouts.write = timeouts.write.min(OVER_LIMIT_TIMEOUT);
        }
        Self {
            ip,
            client,
            is_over_limit: over_limit,
            clock_ms,
            timeouts,
            requests_in_progress: AtomicU32::new(0),
            is_multiplexed: AtomicBool::new(false),
            streams: Mutex::default(),
            idle_since_ms: AtomicU64::new(0),
            first_byte_ms: AtomicU64::new(now_ms),
            stalled_since_ms: AtomicU64::new(0),
            taken_bytes: AtomicU64::new(0),
            timeout_kind: OnceLock::new(),
            is_shutting_down: AtomicBool::new(false),
            waker: OnceLock::new(),
        }
    }

    /// What the client uses of the limits, if its address is known.
    pub(super) fn client(&self) -> Option<&ClientUsage> {
        self.client.as_deref()
    }

    /// Which timeout has expired, as a metric label.
    pub(super) fn timeout_kind(&self) -> Option<&'static str> {
        self.timeout_kind.get().copied()
    }

    /// Stores the waker of the connection's task. A task keeps one waker, so only the first call has an effect.
    pub(super) fn set_waker(&self, waker: &Waker) {
        if self.waker.get().is_none() {
            let _ = self.waker.set(waker.clone());
        }
    }

    /// Asks the connection to close after the requests in progress.
    pub(super) fn start_shutdown(&self) {
        self.is_shutting_down.store(true, Relaxed);
        if let Some(waker) = self.waker.get() {
            waker.wake_by_ref();
        }
    }

    pub(super) fn is_shutting_down(&self) -> bool {
        self.is_shutting_down.load(Relaxed)
    }

    pub(super) fn now_ms(&self) -> u64 {
        self.clock_ms.load(Relaxed)
    }

    pub(super) fn request_started(&self) {
        self.requests_in_progress.fetch_add(1, Relaxed);
        self.first_byte_ms.store(0, Relaxed);
    }

    /// Watches the stream of an HTTP/2 request until [`Self::stream_ended`]. Must be called where hyper calls the service.
    pub(super) fn stream_started(&self) -> (usize, Arc<StreamProgress>) {
        self.is_multiplexed.store(true, Relaxed);
        let stream = StreamProgress::for_request(self.ip.map(client_network));
        (self.streams().insert(stream.clone()), stream)
    }

    pub(super) fn stream_ended(&self, key: usize) {
        self.streams().try_remove(key);
    }

    fn streams(&self) -> MutexGuard<'_, Slab<Arc<StreamProgress>>> {
        self.streams.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Resets HTTP/2 streams whose client takes too little of the response. Returns their number.
    pub(super) fn reset_stalled_streams(&self) -> usize {
        let now_ms = self.now_ms();
        // The network is slow then, and no single stream is to blame.
        let is_stalled = self.stalled_since_ms.load(Relaxed) != 0;
        // Not reset under the lock, which the end of a stream takes.
        let stalled: Vec<_> = {
            let streams = self.streams();
            if is_stalled {
                streams.iter().filter(|(_, stream)| stream.has_response()).for_each(|(_, s)| s.restart(now_ms));
            }
            let stalled = streams.iter().filter(|(_, stream)| stream.has_stalled(now_ms, self.timeouts.write));
            stalled.map(|(_, stream)| stream.clone()).collect()
        };
        let reset = stalled.iter().filter(|stream| stream.reset()).count();
        if reset < stalled.len() {
            let _ = self.timeout_kind.set("stream");
        }
        reset
    }

    pub(super) fn request_ended(&self) {
        if self.requests_in_progress.fetch_sub(1, Relaxed) == 1 {
            self.idle_since_ms.store(self.now_ms(), Relaxed);
        }
    }

    pub(super) fn bytes_received(&self) {
        if self.requests_in_progress.load(Relaxed) == 0 && self.first_byte_ms.load(Relaxed) == 0 {
            self.first_byte_ms.store(self.now_ms(), Relaxed);
        }
    }

    /// Records a write of `offered` bytes, of which `taken` were written; `None` if the socket accepts none now.
    pub(super) fn bytes_sent(&self, taken: Option<usize>, offered: usize) {
        match taken {
            Some(taken) if taken == offered => self.end_stall(),
            Some(taken) => {
                let taken = taken as u64;
                if self.taken_bytes.fetch_add(taken, Relaxed) + taken >= MIN_TAKEN_BYTES {
                    self.restart_stall();
                }
            }
            None if self.stalled_since_ms.load(Relaxed) == 0 => self.restart_stall(),
            None => {}
        }
    }

    fn end_stall(&self) {
        let was_stalled = self.stalled_since_ms.swap(0, Relaxed) != 0;
        if was_stalled && self.first_byte_ms.load(Relaxed) != 0 {
            // The next request could not be read during the stall, so its time starts now.
            self.first_byte_ms.store(self.now_ms(), Relaxed);
        }
    }

    fn restart_stall(&self) {
        self.taken_bytes.store(0, Relaxed);
        self.stalled_since_ms.store(self.now_ms(), Relaxed);
    }

    /// Whether a timeout has expired; the first one is kept for [`Self::timeout_kind`].
    pub(super) fn has_timed_out(&self) -> bool {
        let ClientTimeouts { header, idle, write } = self.timeouts;
        let now_ms = self.now_ms();
        let expired = |since_ms: u64, limit: Duration| {
            since_ms != 0 && now_ms.saturating_sub(since_ms) > limit.as_millis() as u64
        };
        let stalled_since_ms = self.stalled_since_ms.load(Relaxed);
        let is_waiting = self.requests_in_progress.load(Relaxed) == 0 && stalled_since_ms == 0;
        let kind = if self.timeout_kind.get().is_some() {
            return true;
        } else if expired(stalled_since_ms, write) {
            "reading"
        } else if is_waiting && !self.is_multiplexed.load(Relaxed) && expired(self.first_byte_ms.load(Relaxed), header)
        {
            "headers"
        } else if is_waiting && expired(self.idle_since_ms.load(Relaxed), idle) {
            "idle"
        } else {
            return false;
        };
        let _ = self.timeout_kind.set(kind);
        true
    }
}
