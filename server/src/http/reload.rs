//! Background thread that replaces cities, certificate, tokens and keys when their files change.
//!
//! Everything here runs apart from the thread that accepts connections. Tokens and keys are read first, and are read also while
//! a check of the cities takes long: a token that was removed must not live as long as a disk is slow.

use super::access_control::AccessControl;
use super::city_documents::CityDocuments;
use super::hung_disk::{RunningChecks, TimedReads};
use super::state::AppState;
use super::tls::TlsIdentity;
use crate::config::ServeConfig;
use crate::store::{RetentionPolicy, StoreReload};
use std::collections::BTreeSet;
use std::future::pending;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{Notify, oneshot};
use tokio::task::spawn_blocking;
use tokio::time::sleep;

/// Shortest time between two checks of remote cities: each one costs a request, while checking a folder is cheap.
const REMOTE_INTERVAL: Duration = Duration::from_secs(10);
/// A check of the cities that takes longer is reported. It goes on.
const SLOW_CHECK: Duration = Duration::from_secs(60);
/// Another check starts beside one that takes longer: its file system may never respond.
const HUNG_CHECK: Duration = Duration::from_secs(300);
/// Tokens, keys and certificates are small files.
const MAX_READ_TIME: Duration = Duration::from_secs(20);

/// Error of a read that takes longer than [`MAX_READ_TIME`].
const NO_RESPONSE: &str = "the file system does not respond";

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
    checks: RunningChecks<CityCheckResult>,
    /// The newest check was reported as slow.
    is_reported: bool,
    /// Checks were requested while one was running.
    is_requested_again: bool,
    certificate_reads: TimedReads,
    access_reads: TimedReads,
}

/// What a check found, and the documents of its cities unless they are the current ones.
struct CityCheckResult {
    is_requested: bool,
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
        let known_failures = state.catalog().store().failures().cloned().collect();
        Self {
            state,
            tls,
            config,
            reload_signal,
            known_failures,
            known_access_faults: Vec::new(),
            remote_checked_at: Instant::now(),
            checks: RunningChecks::new(HUNG_CHECK),
            is_reported: false,
            is_requested_again: false,
            certificate_reads: TimedReads::new(MAX_READ_TIME),
            access_reads: TimedReads::new(MAX_READ_TIME),
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
            let is_requested = tokio::select! {
                () = interval => false,
                () = self.reload_signal.notified() => true,
                result = self.checks.next() => {
                    self.finish_check(result);
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
        let fault = match self.certificate_reads.run(move || tls.reload(&config)).await {
            Some(Ok(())) => return,
            Some(Err(error)) => error.to_string(),
            None => NO_RESPONSE.to_owned(),
        };
        tracing::error!(error = fault, "cannot use the new certificate: the old one stays in use");
        self.state.metrics.reloaded("failed");
    }

    /// Replaces tokens and keys. What their files do not list any more is gone, even if the files cannot be read, or not in
    /// time.
    async fn reload_access(&mut self) {
        let config = self.config.access.clone();
        let closed = AccessControl::closed(&config);
        let read = self.access_reads.run(move || AccessControl::load(&config)).await;
        let (access, faults) = read.unwrap_or_else(|| (closed, vec![NO_RESPONSE.to_owned()]));
        if faults != self.known_access_faults {
            for fault in &faults {
                tracing::error!(fault, "part of the tokens and keys cannot be used: what is not listed opens nothing");
                self.state.metrics.reloaded("failed");
            }
            self.known_access_faults = faults;
        }
        self.state.replace_access(access);
    }

    fn start_check(&mut self, is_requested: bool) {
        if !self.is_reported && self.checks.running_for().is_some_and(|time| time > SLOW_CHECK) {
            self.is_reported = true;
            tracing::error!("a check of the cities takes very long: the versions that are served stay");
            self.state.metrics.reloaded("failed");
        }
        if !self.checks.can_start() {
            self.is_requested_again |= is_requested;
            return;
        }
        let include_remote = is_requested || self.remote_checked_at.elapsed() >= REMOTE_INTERVAL;
        if include_remote {
            self.remote_checked_at = Instant::now();
        }
        let reload = &self.config.reload;
        let retention = RetentionPolicy { time: Duration::from_secs(reload.keep_secs), versions: reload.keep_versions };
        let check = check_cities(self.state.clone(), retention, include_remote);
        self.checks.start(async move { CityCheckResult { is_requested, ..check.await } });
        self.is_reported = false;
    }

    /// Uses the result of a check; `None` if it panicked.
    fn finish_check(&mut self, result: Option<CityCheckResult>) {
        let Some(CityCheckResult { is_requested, found, documents }) = result else {
            tracing::error!("a check of the cities failed: the versions that are served stay");
            self.state.metrics.reloaded("failed");
            return;
        };
        self.report(&found);
        if is_requested || found.must_replace() {
            let documents = documents.unwrap_or_else(|| self.state.catalog().documents.clone());
            self.state.replace_cities(found.store, documents);
        }
    }

    fn report(&mut self, found: &StoreReload) {
        for name in &found.changed {
            let version = found.store.city(name).map(|city| city.manifest().version.as_str());
            tracing::info!(city = name, version = version.unwrap_or("removed"), "city replaced");
            self.state.metrics.reloaded("replaced");
        }
        let failures: BTreeSet<String> = found.store.failures().cloned().collect();
        report_failures(&self.state, failures.difference(&self.known_failures));
        self.known_failures = failures;
    }
}

/// Logs and counts cities and folders that cannot be opened.
pub(super) fn report_failures<'a>(state: &AppState, failures: impl IntoIterator<Item = &'a String>) {
    for failure in failures {
        tracing::error!(failure, "cannot open a city: an open version stays in use, and each check tries again");
        state.metrics.reloaded("failed");
    }
}

/// Looks for changes and encodes the documents of changed cities.
async fn check_cities(state: AppState, retention: RetentionPolicy, include_remote: bool) -> CityCheckResult {
    let catalog = Arc::clone(&state.catalog());
    let found = catalog.store().reload(retention, include_remote).await;
    if found.changed.is_empty() {
        return CityCheckResult { is_requested: false, found, documents: None };
    }
    let store = found.store.clone();
    // Which cities are private is configured, and does not change with tokens and keys.
    let encode = move || CityDocuments::new(&store, &catalog.access, Some(&catalog.documents));
    let documents = spawn_blocking(encode).await.ok().map(Arc::new);
    CityCheckResult { is_requested: false, found, documents }
}
