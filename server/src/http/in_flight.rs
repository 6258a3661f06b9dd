//! Limits on the requests, and the bytes of their responses, that are in flight at once.

use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

/// Counts requests and response bytes in flight. Each successful `try_` call must be undone by [`Self::release`].
#[derive(Debug)]
pub(super) struct InFlightBudget {
    requests: AtomicUsize,
    bytes: AtomicUsize,
    max_requests: usize,
    max_bytes: usize,
}

impl InFlightBudget {
    pub(super) fn new(max_requests: usize, max_bytes: usize) -> Self {
        Self { requests: AtomicUsize::new(0), bytes: AtomicUsize::new(0), max_requests, max_bytes }
    }

    pub(super) fn requests(&self) -> usize {
        self.requests.load(Relaxed)
    }

    /// Adds a request. `false`: the limit is reached.
    pub(super) fn try_enter(&self) -> bool {
        try_add(&self.requests, 1, self.max_requests)
    }

    /// Adds bytes of a response. `false`: they would exceed the limit.
    pub(super) fn try_reserve(&self, bytes: usize) -> bool {
        try_add(&self.bytes, bytes, self.max_bytes)
    }

    /// Removes bytes that [`Self::try_reserve`] added.
    pub(super) fn unreserve(&self, bytes: usize) {
        self.bytes.fetch_sub(bytes, Relaxed);
    }

    /// Removes a request and the bytes that were reserved for it.
    pub(super) fn release(&self, bytes: usize) {
        self.requests.fetch_sub(1, Relaxed);
        self.bytes.fetch_sub(bytes, Relaxed);
    }
}

fn try_add(counter: &AtomicUsize, amount: usize, max: usize) -> bool {
    let fits = counter.fetch_add(amount, Relaxed).saturating_add(amount) <= max;
    if !fits {
        counter.fetch_sub(amount, Relaxed);
    }
    fits
}
