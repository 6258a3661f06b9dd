//! What the server knows of one connection, and whether its client is too slow.

use std::{
    net::IpAddr,
    sync::{
        Arc, OnceLock,
        atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed},
    },
    task::Waker,
    time::Duration,
};

/// A client that takes fewer bytes than this in `limits.write_secs`, while more wait for it, is too slow.
const LEAST_TAKEN_BYTES: u64 = 16 << 10;

/// What is known of a connection. Times are the clock's milliseconds; 0 is never.
#[derive(Debug)]
pub(super) struct ConnectionState {
    ip: Option<IpAddr>,
    over: bool,
    /// The thread's, which `worker` sets a few times a second: who looks often need not ask the system.
    clock: Arc<AtomicU64>,
    patience: ClientTimeouts,
    /// Requests in work.
    busy: AtomicU32,
    several: AtomicBool,
    /// When the last request was done; that of a new connection never was.
    idle_since: AtomicU64,
    /// When the first byte after that came.
    first_byte: AtomicU64,
    /// Since when bytes wait that the client does not take, and how many it took since.
    stalled_since: AtomicU64,
    taken_bytes: AtomicU64,
    slow: OnceLock<&'static str>,
    finishing: AtomicBool,
    waker: OnceLock<Waker>,
}

/// How long a client may take.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClientTimeouts {
    pub(super) header: Duration,
    pub(super) idle: Duration,
    pub(super) write: Duration,
}

impl ConnectionState {
    /// `over`: the connection is one too many, and each request on it is told so.
    pub(super) fn new(ip: Option<IpAddr>, over: bool, clock: Arc<AtomicU64>, patience: ClientTimeouts) -> Self {
        let now = clock.load(Relaxed);
        Self {
            ip,
            over,
            clock,
            patience,
            busy: AtomicU32::new(0),
            several: AtomicBool::new(false),
            idle_since: AtomicU64::new(0),
            first_byte: AtomicU64::new(now),
            stalled_since: AtomicU64::new(0),
            taken_bytes: AtomicU64::new(0),
            slow: OnceLock::new(),
            finishing: AtomicBool::new(false),
            waker: OnceLock::new(),
        }
    }

    pub(super) fn ip(&self) -> Option<IpAddr> {
        self.ip
    }

    pub(super) fn over(&self) -> bool {
        self.over
    }

    /// At what the client was too slow, if it was.
    pub(super) fn slow(&self) -> Option<&'static str> {
        self.slow.get().copied()
    }

    /// A task has one waker as long as it lives.
    pub(super) fn set_waker(&self, waker: &Waker) {
        if self.waker.get().is_none() {
            let _ = self.waker.set(waker.clone());
        }
    }

    /// The request in work is the last one.
    pub(super) fn finish(&self) {
        self.finishing.store(true, Relaxed);
        if let Some(waker) = self.waker.get() {
            waker.wake_by_ref();
        }
    }

    pub(super) fn is_finishing(&self) -> bool {
        self.finishing.load(Relaxed)
    }

    fn now(&self) -> u64 {
        self.clock.load(Relaxed)
    }

    /// A request has come.
    pub(super) fn begin(&self) {
        // Several at once: HTTP/2, whose connection speaks between requests too.
        if self.busy.fetch_add(1, Relaxed) > 0 {
            self.several.store(true, Relaxed);
        }
        self.first_byte.store(0, Relaxed);
    }

    /// It is done.
    pub(super) fn end(&self) {
        if self.busy.fetch_sub(1, Relaxed) == 1 {
            self.idle_since.store(self.now(), Relaxed);
        }
    }

    pub(super) fn read(&self) {
        if self.busy.load(Relaxed) == 0 && self.first_byte.load(Relaxed) == 0 {
            self.first_byte.store(self.now(), Relaxed);
        }
    }

    /// `taken` of `offered` bytes went out; `None`: none can.
    pub(super) fn wrote(&self, taken: Option<usize>, offered: usize) {
        match taken {
            Some(taken) if taken == offered => self.flow(),
            Some(taken) => {
                let taken = taken as u64;
                if self.taken_bytes.fetch_add(taken, Relaxed) + taken >= LEAST_TAKEN_BYTES {
                    self.stall();
                }
            }
            None if self.stalled_since.load(Relaxed) == 0 => self.stall(),
            None => {}
        }
    }

    fn flow(&self) {
        let stalled = self.stalled_since.swap(0, Relaxed) != 0;
        if stalled && self.first_byte.load(Relaxed) != 0 {
            // What came meanwhile could not be read: its time begins now.
            self.first_byte.store(self.now(), Relaxed);
        }
    }

    fn stall(&self) {
        self.taken_bytes.store(0, Relaxed);
        self.stalled_since.store(self.now(), Relaxed);
    }

    /// Whether the client has been too slow, and at what.
    pub(super) fn is_too_slow(&self) -> bool {
        let ClientTimeouts { header, idle, write } = self.patience;
        let now = self.now();
        let past = |since: u64, limit: Duration| since != 0 && now.saturating_sub(since) > limit.as_millis() as u64;
        let quiet = self.busy.load(Relaxed) == 0 && self.stalled_since.load(Relaxed) == 0;
        let kind = if past(self.stalled_since.load(Relaxed), write) {
            "reading"
        } else if quiet && !self.several.load(Relaxed) && past(self.first_byte.load(Relaxed), header) {
            "headers"
        } else if quiet && past(self.idle_since.load(Relaxed), idle) {
            "idle"
        } else {
            return false;
        };
        // It is said once.
        let _ = self.slow.set(kind);
        true
    }
}
