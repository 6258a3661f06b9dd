//! What all requests share.
//!
//! In: an opened store and a limit. Out: [`AppState`], cheap to clone. Next: every handler.

use super::{manifest::Manifests, metrics::Metrics};
use crate::store::Store;
use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};
use tokio::sync::Semaphore;

/// The cities, their manifests as bytes, counters, and whether the server is on its way out.
#[derive(Debug, Clone)]
pub struct AppState(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    store: Store,
    manifests: Manifests,
    metrics: Metrics,
    permits: Arc<Semaphore>,
    draining: AtomicBool,
}

impl AppState {
    /// At most `max_in_flight` requests for cities are worked on at once; further ones are turned away with 503.
    pub fn new(store: Store, max_in_flight: usize) -> Self {
        Self(Arc::new(Inner {
            manifests: Manifests::new(&store),
            store,
            metrics: Metrics::default(),
            permits: Arc::new(Semaphore::new(max_in_flight.min(Semaphore::MAX_PERMITS))),
            draining: AtomicBool::new(false),
        }))
    }

    /// From now on `/readyz` says no, so that a load balancer sends its requests elsewhere.
    pub fn drain(&self) {
        self.0.draining.store(true, Ordering::Relaxed);
    }

    /// Whether requests should come here: there are cities, and it is not draining.
    pub fn is_ready(&self) -> bool {
        self.0.store.cities().len() > 0 && !self.0.draining.load(Ordering::Relaxed)
    }

    /// The opened cities.
    pub fn store(&self) -> &Store {
        &self.0.store
    }

    pub(super) fn manifests(&self) -> &Manifests {
        &self.0.manifests
    }

    pub(super) fn metrics(&self) -> &Metrics {
        &self.0.metrics
    }

    pub(super) fn permits(&self) -> Arc<Semaphore> {
        Arc::clone(&self.0.permits)
    }
}
