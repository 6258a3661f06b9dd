//! What all requests share.
//!
//! In: an opened store and a config. Out: [`AppState`], cheap to clone. Next: every handler.

use super::{access_control::AccessControl, catalog::Catalog, metrics::HttpMetrics, rate_limit::RateLimiter};
use crate::{
    config::{LimitsConfig, LogRequests, ServeConfig},
    store::Store,
};
use arc_swap::{ArcSwap, Guard};
use axum::http::HeaderValue;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed},
    },
    time::{SystemTime, UNIX_EPOCH},
};

/// The cities, their manifests as bytes, counters, bounds, and whether the server is on its way out.
#[derive(Debug, Clone)]
pub struct AppState(Arc<SharedState>);

#[derive(Debug)]
struct SharedState {
    catalog: ArcSwap<Catalog>,
    metrics: HttpMetrics,
    rate: RateLimiter,
    room: InFlightBudget,
    limits: LimitsConfig,
    log: LogRequests,
    draining: AtomicBool,
    /// Differs between starts, so that two servers' request ids do.
    start_id: u32,
    ids: AtomicU64,
}

impl AppState {
    /// For public cities; tokens are read by [`HttpServer`](super::HttpServer).
    pub fn new(store: Store, config: &ServeConfig) -> Self {
        Self::with_access(store, config, AccessControl::default())
    }

    pub(super) fn with_access(store: Store, config: &ServeConfig, access: AccessControl) -> Self {
        let counters = store.counters().cloned();
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let state = Self(Arc::new(SharedState {
            catalog: ArcSwap::from_pointee(Catalog::new(store, access)),
            metrics: HttpMetrics::new(counters.as_ref()),
            rate: RateLimiter::new(config.limits.client_rate, config.limits.client_burst),
            room: InFlightBudget::new(config.limits.in_flight, config.limits.in_flight_bytes),
            limits: config.limits.clone(),
            log: config.log.requests,
            draining: AtomicBool::new(false),
            start_id: (since.as_millis() as u32) ^ std::process::id().rotate_left(16),
            ids: AtomicU64::new(0),
        }));
        state.metrics().cities(state.catalog().store());
        state
    }

    /// From the next request on, these cities are served, to whom these rules let see them. Requests in work keep what they
    /// began with.
    pub(super) fn replace(&self, store: Store, access: AccessControl) {
        self.0.metrics.cities(&store);
        self.0.catalog.store(Arc::new(Catalog::new(store, access)));
    }

    /// From now on `/readyz` says no, so that a load balancer sends its requests elsewhere.
    pub fn drain(&self) {
        self.0.draining.store(true, Relaxed);
    }

    /// Whether requests should come here: there are cities, and it is not draining.
    pub fn is_ready(&self) -> bool {
        self.catalog().store().cities().len() > 0 && !self.0.draining.load(Relaxed)
    }

    /// The cities as they are at this moment.
    pub fn catalog(&self) -> Guard<Arc<Catalog>> {
        self.0.catalog.load()
    }

    pub(super) fn metrics(&self) -> &HttpMetrics {
        &self.0.metrics
    }

    pub(super) fn rate(&self) -> &RateLimiter {
        &self.0.rate
    }

    pub(super) fn room(&self) -> &InFlightBudget {
        &self.0.room
    }

    pub(super) fn limits(&self) -> &LimitsConfig {
        &self.0.limits
    }

    /// Whether an answer of this code has a line in the log.
    pub(super) fn logs(&self, code: u16) -> bool {
        match self.0.log {
            LogRequests::None => false,
            LogRequests::Errors => code >= 500,
            LogRequests::All => true,
        }
    }

    /// A request id that no other request has had.
    pub(super) fn new_id(&self) -> HeaderValue {
        const DIGITS: &[u8; 16] = b"0123456789abcdef";
        let number = self.0.ids.fetch_add(1, Relaxed);
        let whole = u128::from(self.0.start_id) << 64 | u128::from(number);
        let mut text = [0; 24];
        for (at, digit) in text.iter_mut().rev().enumerate() {
            *digit = DIGITS[(whole >> (4 * at)) as usize & 15];
        }
        HeaderValue::from_bytes(&text).unwrap_or(HeaderValue::from_static("none"))
    }
}

/// How many requests, and bytes of their answers, may be in flight.
#[derive(Debug)]
pub(super) struct InFlightBudget {
    requests: AtomicUsize,
    bytes: AtomicUsize,
    max_requests: usize,
    max_bytes: usize,
}

impl InFlightBudget {
    fn new(max_requests: usize, max_bytes: usize) -> Self {
        Self { requests: AtomicUsize::new(0), bytes: AtomicUsize::new(0), max_requests, max_bytes }
    }

    pub(super) fn enter(&self) -> bool {
        take(&self.requests, 1, self.max_requests)
    }

    /// Requests for cities in flight now.
    pub(super) fn requests(&self) -> usize {
        self.requests.load(Relaxed)
    }

    pub(super) fn hold(&self, bytes: usize) -> bool {
        take(&self.bytes, bytes, self.max_bytes)
    }

    pub(super) fn leave(&self, bytes: usize) {
        self.requests.fetch_sub(1, Relaxed);
        self.bytes.fetch_sub(bytes, Relaxed);
    }
}

fn take(counter: &AtomicUsize, amount: usize, most: usize) -> bool {
    let fits = counter.fetch_add(amount, Relaxed).saturating_add(amount) <= most;
    if !fits {
        counter.fetch_sub(amount, Relaxed);
    }
    fits
}
