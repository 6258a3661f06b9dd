//! State that all requests share.

use super::{
    access_control::AccessControl, catalog::Catalog, in_flight::InFlightBudget, metrics::HttpMetrics,
    rate_limit::RateLimiter,
};
use crate::{
    config::{LimitsConfig, LogRequests, ServeConfig},
    store::Store,
};
use arc_swap::{ArcSwap, Guard};
use axum::http::HeaderValue;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    },
    time::{SystemTime, UNIX_EPOCH},
};

/// Cities, metrics and limits of one server. Cheap to clone.
#[derive(Debug, Clone)]
pub struct AppState(Arc<SharedState>);

#[derive(Debug)]
struct SharedState {
    catalog: ArcSwap<Catalog>,
    metrics: HttpMetrics,
    rate_limiter: RateLimiter,
    in_flight: InFlightBudget,
    limits: LimitsConfig,
    logged_requests: LogRequests,
    is_draining: AtomicBool,
    /// First part of request ids. Differs between starts, so that the ids of two servers differ.
    start_id: u32,
    next_request: AtomicU64,
}

impl AppState {
    /// State for public cities. Private ones need the tokens that [`HttpServer`](super::HttpServer) reads.
    pub fn new(store: Store, config: &ServeConfig) -> Self {
        Self::with_access(store, config, AccessControl::default())
    }

    pub(super) fn with_access(store: Store, config: &ServeConfig, access: AccessControl) -> Self {
        let store_metrics = store.metrics().cloned();
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let state = Self(Arc::new(SharedState {
            catalog: ArcSwap::from_pointee(Catalog::new(store, access)),
            metrics: HttpMetrics::new(store_metrics.as_ref()),
            rate_limiter: RateLimiter::new(config.limits.client_rate, config.limits.client_burst),
            in_flight: InFlightBudget::new(config.limits.in_flight, config.limits.in_flight_bytes),
            limits: config.limits.clone(),
            logged_requests: config.log.requests,
            is_draining: AtomicBool::new(false),
            start_id: (since_epoch.as_millis() as u32) ^ std::process::id().rotate_left(16),
            next_request: AtomicU64::new(0),
        }));
        state.metrics().set_cities(state.catalog().store());
        state
    }

    /// Replaces cities and access rules for new requests. Requests in progress keep the old ones.
    pub(super) fn replace(&self, store: Store, access: AccessControl) {
        self.0.metrics.set_cities(&store);
        self.0.catalog.store(Arc::new(Catalog::new(store, access)));
    }

    /// Makes `/readyz` fail, so that a load balancer sends its requests elsewhere.
    pub fn start_draining(&self) {
        self.0.is_draining.store(true, Relaxed);
    }

    /// Whether there are cities and the server is not draining.
    pub fn is_ready(&self) -> bool {
        self.catalog().store().cities().len() > 0 && !self.0.is_draining.load(Relaxed)
    }

    /// The current cities. A guard keeps them open after a replacement.
    pub fn catalog(&self) -> Guard<Arc<Catalog>> {
        self.0.catalog.load()
    }

    pub(super) fn metrics(&self) -> &HttpMetrics {
        &self.0.metrics
    }

    pub(super) fn rate_limiter(&self) -> &RateLimiter {
        &self.0.rate_limiter
    }

    pub(super) fn in_flight(&self) -> &InFlightBudget {
        &self.0.in_flight
    }

    pub(super) fn limits(&self) -> &LimitsConfig {
        &self.0.limits
    }

    /// Whether requests that end with this status code are logged.
    pub(super) fn must_log(&self, code: u16) -> bool {
        match self.0.logged_requests {
            LogRequests::None => false,
            LogRequests::Errors => code >= 500,
            LogRequests::All => true,
        }
    }

    /// A new request id: 24 hexadecimal digits.
    pub(super) fn new_request_id(&self) -> HeaderValue {
        const DIGITS: &[u8; 16] = b"0123456789abcdef";
        let number = self.0.next_request.fetch_add(1, Relaxed);
        let id = u128::from(self.0.start_id) << 64 | u128::from(number);
        let mut text = [0; 24];
        for (at, digit) in text.iter_mut().rev().enumerate() {
            *digit = DIGITS[(id >> (4 * at)) as usize & 15];
        }
        HeaderValue::from_bytes(&text).unwrap_or(HeaderValue::from_static("none"))
    }
}
