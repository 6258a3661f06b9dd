//! Background thread that replaces cities, certificate, tokens and keys when their files change.
//!
//! Everything here runs apart from the thread that accepts connections. Tokens and keys are read first, and are read also while
//! a check of the cities takes long: a token that was removed must not live as long as a disk is slow.

use super::{access_control::AccessControl, city_documents::CityDocuments, state::AppState, tls::TlsIdentity};
use crate::{
    config::ServeConfig,
    store::{RetentionPolicy, StoreReload},
};
use std::{
    collections::BTreeSet,
    future::pending,
    io,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{
    sync::{Notify, oneshot},
    task::{JoinHandle, spawn_blocking},
    time::sleep,
};

/// Shortest time between two checks of remote cities: each one costs a request, while checking a folder is cheap.
const REMOTE_INTERVAL: Duration = Duration::from_secs(10);
/// A check of the cities that takes longer is reported. It goes on, but no other one starts.
const SLOW_CHECK: Duration = Duration::from_secs(60);

/// Checks for changes at an interval and on request, as long as the server runs.
pub(super) struct ReloadTask {
    state: AppState,
    tls: Option<Arc<TlsIdentity>>,
    config: ServeConfig,
    /// Requests a check at once.
    reload_signal: Arc<Notify>,
    /// Errors of the last check, so that each is logged once.
    known_failures: BTreeSet<String>,
    known_access_faults: Vec<String>,
    remote_checked_at: Instant,
    check: Option<CityCheck>,
    /// Checks were requested while one was running.
    is_requested_again: bool,
}

/// A running check of the cities.
struct CityCheck {
    task: JoinHandle<CityCheckResult>,
    started: Instant,
    is_requested: bool,
    is_reported: bool,
}

/// What a check found, and the documents of its cities unless they are the current ones.
struct CityCheckResult {
    found: StoreReload,
    documents: Option<Arc<CityDocuments>>,
}

/// The running thread. It ends when this is dropped.
pub(super) struct ReloadThread {
    _stop: oneshot::Sender<()>,
}

impl ReloadTask {
    pub(super) fn new(
        state: AppState,
        tls: Option<Arc<TlsIdentity>>,
        config: ServeConfig,
        reload_signal: Arc<Notify>,
    ) -> Self {
        Self {
            state,
            tls,
            config,
            reload_signal,
            known_failures: BTreeSet::new(),
            known_access_faults: Vec::new(),
            remote_checked_at: Instant::now(),
            check: None,
            is_requested_again: false,
        }
    }

    /// Starts the thread. Fails if the system refuses it.
    pub(super) fn start(self) -> io::Result<ReloadThread> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (stop, stopped) = oneshot::channel();
        std::thread::Builder::new().name("insula-reload".into()).spawn(move || {
            runtime.block_on(async {
                tokio::select! {
                    () = self.run() => {}
                    _ = stopped => {}
                }
            });
            // A check may wait for a disk that does not respond.
            runtime.shutdown_background();
        })?;
        Ok(ReloadThread { _stop: stop })
    }

    async fn run(mut self) {
        loop {
            let interval = async {
                match self.config.reload.watch_secs {
                    0 => pending().await,
                    secs => sleep(Duration::from_secs(secs)).await,
                }
            };
            let finished = async {
                match &mut self.check {
                    Some(check) => (&mut check.task).await,
                    None => pending().await,
                }
            };
            let is_requested = tokio::select! {
                () = interval => false,
                () = self.reload_signal.notified() => true,
                result = finished => {
                    self.finish_check(result.ok());
                    if !std::mem::take(&mut self.is_requested_again) {
                        continue;
                    }
                    true
                }
            };
            if is_requested {
                tracing::info!("checking for new cities, certificate, tokens and keys");
                self.known_failures.clear();
                self.known_access_faults.clear();
                self.reload_certificate().await;
            }
            self.reload_access().await;
            self.start_check(is_requested);
        }
    }

    async fn reload_certificate(&self) {
        let (Some(tls), config) = (self.tls.clone(), self.config.tls.clone()) else { return };
        // The task fails only if it is cancelled at the end of the process.
        if let Ok(Err(error)) = spawn_blocking(move || tls.reload(&config)).await {
            tracing::error!(%error, "cannot use the new certificate: the old one stays in use");
            self.state.metrics().reloaded("failed");
        }
    }

    /// Replaces tokens and keys. What their files do not list any more is gone, even if the files cannot be read.
    async fn reload_access(&mut self) {
        let config = self.config.access.clone();
        let Ok((access, faults)) = spawn_blocking(move || AccessControl::load(&config)).await else { return };
        if faults != self.known_access_faults {
            for fault in &faults {
                tracing::error!(fault, "part of the tokens and keys cannot be used: what is not listed opens nothing");
                self.state.metrics().reloaded("failed");
            }
            self.known_access_faults = faults;
        }
        self.state.replace_access(access);
    }

    fn start_check(&mut self, is_requested: bool) {
        if let Some(check) = &mut self.check {
            self.is_requested_again |= is_requested;
            if check.started.elapsed() > SLOW_CHECK && !check.is_reported {
                check.is_reported = true;
                tracing::error!("a check of the cities takes very long: the versions that are served stay");
                self.state.metrics().reloaded("failed");
            }
            return;
        }
        let include_remote = is_requested || self.remote_checked_at.elapsed() >= REMOTE_INTERVAL;
        if include_remote {
            self.remote_checked_at = Instant::now();
        }
        let reload = &self.config.reload;
        let retention = RetentionPolicy { time: Duration::from_secs(reload.keep_secs), versions: reload.keep_versions };
        let task = tokio::spawn(check_cities(self.state.clone(), retention, include_remote));
        self.check = Some(CityCheck { task, started: Instant::now(), is_requested, is_reported: false });
    }

    /// Uses the result of a check; `None` if it panicked.
    fn finish_check(&mut self, result: Option<CityCheckResult>) {
        let is_requested = self.check.take().is_some_and(|check| check.is_requested);
        let Some(CityCheckResult { found, documents }) = result else {
            tracing::error!("a check of the cities failed: the versions that are served stay");
            self.state.metrics().reloaded("failed");
            return;
        };
        self.report(&found);
        if is_requested || found.must_replace() {
            let documents = documents.unwrap_or_else(|| self.state.catalog().documents().clone());
            self.state.replace_cities(found.store, documents);
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

/// Looks for changes and encodes the documents of changed cities.
async fn check_cities(state: AppState, retention: RetentionPolicy, include_remote: bool) -> CityCheckResult {
    let catalog = Arc::clone(&state.catalog());
    let found = catalog.store().reload(retention, include_remote).await;
    if found.changed.is_empty() {
        return CityCheckResult { found, documents: None };
    }
    let store = found.store.clone();
    // Which cities are private is configured, and does not change with tokens and keys.
    let encode = move || CityDocuments::new(&store, catalog.access(), Some(catalog.documents()));
    let documents = spawn_blocking(encode).await.ok().map(Arc::new);
    CityCheckResult { found, documents }
}
