//! State that all requests share.

use super::access_control::AccessControl;
use super::catalog::Catalog;
use super::city_documents::CityDocuments;
use super::computed_cache::ComputedCache;
use super::content_encoding::EncodedContent;
use super::fair_queue::FairQueue;
use super::in_flight::InFlightBudget;
use super::log_limit::LogLimit;
use super::metrics::HttpMetrics;
use super::rate_limit::RateLimiter;
use super::representation::{IMMUTABLE, REVALIDATE};
use super::work_queues::{WorkKind, WorkQueues};
use crate::config::{
    AnalysesConfig, CorsPolicy, DrawingsConfig, LimitsConfig, LogRequests, Network, PublicUrl, ServeConfig, SiteConfig,
};
use crate::page::{Brand, Languages, SERVICE_WORKER_FILE, SiteTexts, ViewerAssets, ViewerFile, media_type};
use crate::store::Store;
use arc_swap::{ArcSwap, Guard};
use axum::http::{HeaderMap, HeaderValue, header};
use insula_protocol::route::RouteTemplate;
use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::{SystemTime, UNIX_EPOCH};

/// Cities, metrics and limits of one server. Cheap to clone.
#[derive(Debug, Clone)]
pub struct AppState(Arc<SharedState>);

/// What one server keeps.
#[derive(Debug)]
pub struct SharedState {
    catalog: ArcSwap<Catalog>,
    /// The browser viewer; `None` if the program was built without it.
    pub(super) viewer: Option<ViewerContent>,
    languages: Languages,
    /// What the office has set of its pages.
    pub(super) brand: Brand,
    /// The address at which people reach the server, if it was configured.
    pub(super) public_url: Option<PublicUrl>,
    pub(super) metrics: HttpMetrics,
    pub(super) rate_limiter: RateLimiter,
    pub(super) in_flight: InFlightBudget,
    pub(super) limits: LimitsConfig,
    pub(super) drawings: DrawingsConfig,
    pub(super) analyses: AnalysesConfig,
    queues: WorkQueues,
    /// Search indexes and made files.
    pub(super) computed: ComputedCache,
    /// Proxies whose word for the address of a client counts.
    pub(super) proxies: Vec<Network>,
    logged_requests: LogRequests,
    log_limits: [LogLimit; 3],
    /// `https` or `http`.
    pub(super) scheme: &'static str,
    /// Whether pages of any origin may read responses.
    pub(super) allows_any_origin: bool,
    /// The hosts that requests may name; empty for any.
    pub(super) hosts: Vec<String>,
    is_draining: AtomicBool,
    /// First part of request ids. Differs between starts, so that the ids of two servers differ.
    start_id: u32,
    next_request: AtomicU64,
}

/// Messages that clients can cause, which are therefore limited.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MessageKind {
    FailedRequest,
    TileFailure,
    FailedAccept,
}

impl MessageKind {
    const fn label(self) -> &'static str {
        match self {
            Self::FailedRequest => "request",
            Self::TileFailure => "tile",
            Self::FailedAccept => "accept",
        }
    }
}

impl Deref for AppState {
    type Target = SharedState;

    fn deref(&self) -> &SharedState {
        &self.0
    }
}

impl AppState {
    /// State for public cities. Private ones need the tokens that [`HttpServer`](super::HttpServer) reads.
    pub fn new(store: Store, config: &ServeConfig) -> Self {
        Self::with_viewer(store, config, ViewerAssets::embedded())
    }

    /// As [`Self::new`], with another browser viewer than that of the program, or with none. Pages show no logo, which
    /// [`HttpServer`](super::HttpServer) reads.
    pub fn with_viewer(store: Store, config: &ServeConfig, viewer: Option<ViewerAssets>) -> Self {
        let brand = Brand::load(&SiteConfig { logo: None, ..config.site.clone() }).unwrap_or_default();
        Self::with_access(store, config, AccessControl::default(), viewer, brand)
    }

    pub(super) fn with_access(
        store: Store,
        config: &ServeConfig,
        access: AccessControl,
        viewer: Option<ViewerAssets>,
        brand: Brand,
    ) -> Self {
        let store_metrics = store.metrics().cloned();
        let computed_bytes = config.computed_bytes(store_metrics.is_some());
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self(Arc::new(SharedState {
            catalog: ArcSwap::from_pointee(Catalog::new(store, access)),
            languages: Languages::of(viewer.as_ref()),
            viewer: viewer.map(ViewerContent::new),
            brand,
            public_url: config.public_url.clone(),
            metrics: HttpMetrics::new(store_metrics.as_ref(), config.limits.cache_bytes),
            rate_limiter: RateLimiter::new(config.limits.client_rate, config.limits.client_burst),
            in_flight: InFlightBudget::new(config.limits.in_flight, config.limits.in_flight_bytes),
            limits: config.limits.clone(),
            drawings: config.drawings.clone(),
            analyses: config.analyses.clone(),
            queues: WorkQueues::new(config),
            computed: ComputedCache::new(computed_bytes),
            proxies: config.access.proxies.clone(),
            logged_requests: config.log.requests,
            log_limits: Default::default(),
            scheme: if config.tls.certificate.is_some() { "https" } else { "http" },
            allows_any_origin: config.access.cors == CorsPolicy::Any,
            hosts: config.access.hosts.clone(),
            is_draining: AtomicBool::new(false),
            start_id: (since_epoch.as_millis() as u32) ^ std::process::id().rotate_left(16),
            next_request: AtomicU64::new(0),
        }))
    }

    /// Replaces cities for new requests. Requests in progress keep the old ones. `documents` are those of `store`.
    pub(super) fn replace_cities(&self, store: Store, documents: Arc<CityDocuments>) {
        self.0.catalog.rcu(|catalog| catalog.with_cities(store.clone(), documents.clone()));
    }

    /// Replaces tokens and keys for new requests, if they differ from the current ones.
    pub(super) fn replace_access(&self, access: AccessControl) {
        let catalog = self.0.catalog.load_full();
        if *catalog.access != access {
            self.0.catalog.store(Arc::new(catalog.with_access(access)));
        }
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

    /// The same for work that lasts.
    pub(super) fn catalog_now(&self) -> Arc<Catalog> {
        self.0.catalog.load_full()
    }

    /// The texts of pages in the best language for a request.
    pub(super) fn texts(&self, headers: &HeaderMap) -> &SiteTexts {
        let accepted = headers.get(header::ACCEPT_LANGUAGE).and_then(|value| value.to_str().ok());
        self.0.languages.best(accepted.unwrap_or_default())
    }

    /// The queue of a kind of work.
    pub(super) fn work(&self, kind: WorkKind) -> &FairQueue {
        self.0.queues.of(kind)
    }

    /// Makes all computing routes give up their work.
    #[cfg(test)]
    pub(super) fn with_closed_queues(store: Store, config: &ServeConfig) -> Self {
        let Self(state) = Self::new(store, config);
        let state = Arc::into_inner(state).map(|state| SharedState { queues: WorkQueues::closed(), ..state });
        Self(Arc::new(state.unwrap()))
    }

    /// Whether requests for such addresses have a body: drawings and analyses, if they are made for clients.
    pub(super) fn takes_body(&self, route: RouteTemplate) -> bool {
        let at_once = match route {
            RouteTemplate::Draw => self.0.drawings.at_once,
            RouteTemplate::Analyse => self.0.analyses.at_once,
            _ => 0,
        };
        cfg!(feature = "bake") && at_once > 0
    }

    /// Whether a request that ends with this status code is logged now.
    pub(super) fn must_log(&self, code: u16) -> bool {
        match self.0.logged_requests {
            LogRequests::None => false,
            LogRequests::Errors => code >= 500 && self.admits_message(MessageKind::FailedRequest),
            LogRequests::All => true,
        }
    }

    /// Whether a message of this kind is logged now. Counts the others.
    pub(super) fn admits_message(&self, kind: MessageKind) -> bool {
        let admitted = self.0.log_limits[kind as usize].admit(kind.label());
        if !admitted {
            self.0.metrics.log_suppressed(kind.label());
        }
        admitted
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

/// The viewer with its files ready to be sent.
#[derive(Debug)]
pub(super) struct ViewerContent {
    pub(super) assets: ViewerAssets,
    files: BTreeMap<String, EncodedContent>,
    service_worker: Option<EncodedContent>,
}

impl ViewerContent {
    pub(super) fn new(assets: ViewerAssets) -> Self {
        let content = |name: &str, file: &ViewerFile, cache_control| {
            let ViewerFile { plain, brotli, gzip } = file.clone();
            EncodedContent::compressed_before(plain, brotli, gzip, media_type(name), cache_control)
        };
        let files = assets.files().map(|(name, file)| (name.to_owned(), content(name, file, IMMUTABLE))).collect();
        let worker = assets.files().find(|(name, _)| *name == SERVICE_WORKER_FILE);
        let service_worker = worker.map(|(name, file)| content(name, file, REVALIDATE));
        Self { assets, files, service_worker }
    }

    /// A file of the version `hash`.
    pub(super) fn file(&self, hash: &str, name: &str) -> Option<&EncodedContent> {
        self.files.get(name).filter(|_| hash == self.assets.hash())
    }

    /// The script that keeps visited cities for offline use.
    pub(super) fn service_worker(&self) -> Option<&EncodedContent> {
        self.service_worker.as_ref()
    }
}
