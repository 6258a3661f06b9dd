//! Background task that replaces cities, certificate and tokens when their files change.

use super::{access_control::AccessControl, state::AppState, tls::TlsIdentity};
use crate::{
    config::ServeConfig,
    store::{RetentionPolicy, StoreReload},
};
use std::{
    collections::BTreeSet,
    future::pending,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{sync::Notify, time::sleep};

/// Shortest time between two checks of remote cities: each one costs a request, while checking a folder is cheap.
const REMOTE_INTERVAL: Duration = Duration::from_secs(10);

/// Checks for changes at an interval and on request, as long as the server runs.
pub(super) struct ReloadTask {
    state: AppState,
    tls: Option<Arc<TlsIdentity>>,
    config: ServeConfig,
    /// Requests a check at once.
    reload_signal: Arc<Notify>,
    /// Errors of the last check, so that each is logged once.
    known_failures: BTreeSet<String>,
    remote_checked_at: Instant,
}

impl ReloadTask {
    pub(super) fn new(
        state: AppState,
        tls: Option<Arc<TlsIdentity>>,
        config: ServeConfig,
        reload_signal: Arc<Notify>,
    ) -> Self {
        let remote_checked_at = Instant::now();
        Self { state, tls, config, reload_signal, known_failures: BTreeSet::new(), remote_checked_at }
    }

    pub(super) async fn run(mut self) {
        loop {
            let interval = async {
                match self.config.reload.watch_secs {
                    0 => pending().await,
                    secs => sleep(Duration::from_secs(secs)).await,
                }
            };
            let is_requested = tokio::select! {
                () = interval => false,
                () = self.reload_signal.notified() => true,
            };
            if is_requested {
                tracing::info!("checking for new cities, certificate and tokens");
                self.known_failures.clear();
                self.reload_certificate();
            }
            self.reload_cities(is_requested).await;
        }
    }

    fn reload_certificate(&self) {
        let Some(tls) = &self.tls else { return };
        if let Err(error) = tls.reload(&self.config.tls) {
            tracing::error!(%error, "cannot use the new certificate: the old one stays in use");
            self.state.metrics().reloaded("failed");
        }
    }

    async fn reload_cities(&mut self, is_requested: bool) {
        let reload = &self.config.reload;
        let retention = RetentionPolicy { time: Duration::from_secs(reload.keep_secs), versions: reload.keep_versions };
        let store = self.state.catalog().store().clone();
        let include_remote = is_requested || self.remote_checked_at.elapsed() >= REMOTE_INTERVAL;
        if include_remote {
            self.remote_checked_at = Instant::now();
        }
        let found = store.reload(retention, include_remote).await;
        self.report(&found);
        if !is_requested && found.changed.is_empty() && found.closed == 0 {
            return;
        }
        match AccessControl::load(&self.config.access) {
            Ok(access) => self.state.replace(found.store, access),
            Err(error) => {
                tracing::error!(%error, "cannot read the tokens: cities and tokens are not replaced");
                self.state.metrics().reloaded("failed");
            }
        }
    }

    fn report(&mut self, found: &StoreReload) {
        for name in &found.changed {
            let version = found.store.city(name).map(|city| city.manifest().version.as_str());
            tracing::info!(city = name, version = version.unwrap_or("removed"), "city replaced");
            self.state.metrics().reloaded("replaced");
        }
        let failures: BTreeSet<String> = found.failures.iter().map(ToString::to_string).collect();
        for failure in failures.difference(&self.known_failures) {
            tracing::error!(failure, "cannot open a city: its current version stays in use");
            self.state.metrics().reloaded("failed");
        }
        self.known_failures = failures;
    }
}
