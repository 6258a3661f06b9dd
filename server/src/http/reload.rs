//! Looks whether cities, certificate or tokens were replaced.
//!
//! In: a tick, or a signal. Out: a swapped catalog. Next: requests from then on.

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

/// Between looks at stores.
const FAR: Duration = Duration::from_secs(10);

pub(super) struct ReloadTask {
    state: AppState,
    tls: Option<Arc<TlsIdentity>>,
    config: ServeConfig,
    look: Arc<Notify>,
    /// What could not be opened at the last look, so that it is said once.
    failures: BTreeSet<String>,
    far_at: Instant,
}

impl ReloadTask {
    pub(super) fn new(state: AppState, tls: Option<Arc<TlsIdentity>>, config: ServeConfig, look: Arc<Notify>) -> Self {
        Self { state, tls, config, look, failures: BTreeSet::new(), far_at: Instant::now() }
    }

    pub(super) async fn run(mut self) {
        loop {
            let tick = async {
                match self.config.reload.watch_secs {
                    0 => pending().await,
                    secs => sleep(Duration::from_secs(secs)).await,
                }
            };
            let asked = tokio::select! {
                () = tick => false,
                () = self.look.notified() => true,
            };
            if asked {
                tracing::info!("looking for new cities, certificate and tokens");
                self.failures.clear();
                self.certificate();
            }
            self.cities(asked).await;
        }
    }

    fn certificate(&self) {
        let Some(tls) = &self.tls else { return };
        if let Err(error) = tls.reload(&self.config.tls) {
            tracing::error!(%error, "the new certificate cannot be used: the old one stays");
            self.state.metrics().reloaded("failed");
        }
    }

    async fn cities(&mut self, asked: bool) {
        let reload = &self.config.reload;
        let keep = RetentionPolicy { time: Duration::from_secs(reload.keep_secs), versions: reload.keep_versions };
        let store = self.state.catalog().store().clone();
        // A look at a folder costs nothing, one at a store a request.
        let far = asked || self.far_at.elapsed() >= FAR;
        if far {
            self.far_at = Instant::now();
        }
        let found = store.reload(keep, far).await;
        self.say(&found);
        if !asked && found.changed.is_empty() && found.closed == 0 {
            return;
        }
        let access = AccessControl::read(&self.config.access);
        match access {
            Ok(access) => self.state.replace(found.store, access),
            Err(error) => {
                tracing::error!(%error, "the tokens cannot be read: nothing is replaced");
                self.state.metrics().reloaded("failed");
            }
        }
    }

    fn say(&mut self, found: &StoreReload) {
        for name in &found.changed {
            let version = found.store.city(name).map(|city| city.manifest().version.as_str());
            tracing::info!(city = name, version = version.unwrap_or("gone"), "a city was replaced");
            self.state.metrics().reloaded("replaced");
        }
        let failures: BTreeSet<String> = found.failures.iter().map(ToString::to_string).collect();
        for failure in failures.difference(&self.failures) {
            tracing::error!(failure, "a city cannot be opened: what is served stays");
            self.state.metrics().reloaded("failed");
        }
        self.failures = failures;
    }
}
