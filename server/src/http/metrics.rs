//! Counters of the server as OpenMetrics text.
//!
//! Routes and status codes are fixed sets, so that clients cannot create labels. Each server has its own registry.

use crate::store::StoreMetrics;
use insula_archive::ReadError;
use insula_archive::resident_directories::directory_bytes;
use insula_protocol::route::RouteTemplate;
use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::Registry;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// Status codes as labels. 0 is a request that ended without a response, 999 any other code.
const CODES: [u16; 18] = [0, 200, 204, 206, 304, 400, 401, 404, 405, 410, 412, 416, 421, 429, 431, 500, 503, 999];
/// Upper bounds of the histogram's buckets, in seconds.
const BUCKETS_SECS: [f64; 13] = [5e-5, 1e-4, 2.5e-4, 5e-4, 1e-3, 2.5e-3, 5e-3, 1e-2, 2.5e-2, 0.1, 0.5, 2.5, 10.0];

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RequestLabels {
    route: &'static str,
    code: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RouteLabels {
    route: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct KindLabels {
    kind: &'static str,
}

/// The metrics of one route, created by its first request. So routes and codes that never occur are not exported.
#[derive(Debug)]
struct RouteMetrics {
    codes: [OnceLock<Counter>; CODES.len()],
    bytes: Counter,
    seconds: Histogram,
}

/// All metrics of one server.
#[derive(Debug)]
pub(super) struct HttpMetrics {
    registry: Registry,
    requests: Family<RequestLabels, Counter>,
    bytes: Family<RouteLabels, Counter>,
    seconds: Family<RouteLabels, Histogram>,
    /// By the discriminant of [`RouteTemplate`].
    routes: [OnceLock<RouteMetrics>; RouteTemplate::ALL.len()],
    in_flight: Gauge,
    connections: Gauge,
    connections_over: Counter,
    connections_refused: Counter,
    timeouts: Family<KindLabels, Counter>,
    read_failures: Family<KindLabels, Counter>,
    reloads: Family<KindLabels, Counter>,
    log_suppressed: Family<KindLabels, Counter>,
    cities: Gauge,
    failed_cities: Gauge,
    older_versions: Gauge,
    cached_bytes: Family<KindLabels, Gauge>,
    cache_limit: Gauge,
    drawing_parts: Family<KindLabels, Counter>,
    encoding: Mutex<()>,
}

/// Numbers that are read when the metrics are requested.
#[derive(Debug, Clone, Copy)]
pub(super) struct CurrentCounts {
    pub(super) in_flight: usize,
    /// Cities and older versions that the request may see.
    pub(super) cities: usize,
    /// Cities and folders that cannot be opened, whose names are not known.
    pub(super) failed_cities: usize,
    pub(super) older_versions: usize,
    /// Of search indexes and made files.
    pub(super) computed_bytes: u64,
}

impl HttpMetrics {
    /// Metrics of a server, together with those of the remote stores that it reads from.
    ///
    /// `cache_bytes` is the limit of all caches.
    pub(super) fn new(stores: Option<&StoreMetrics>, cache_bytes: usize) -> Self {
        let mut metrics = Self {
            registry: Registry::with_prefix("insula"),
            requests: Family::default(),
            bytes: Family::default(),
            seconds: Family::new_with_constructor(|| Histogram::new(BUCKETS_SECS)),
            routes: [const { OnceLock::new() }; RouteTemplate::ALL.len()],
            in_flight: Gauge::default(),
            connections: Gauge::default(),
            connections_over: Counter::default(),
            connections_refused: Counter::default(),
            timeouts: Family::default(),
            read_failures: Family::default(),
            reloads: Family::default(),
            log_suppressed: Family::default(),
            cities: Gauge::default(),
            failed_cities: Gauge::default(),
            older_versions: Gauge::default(),
            cached_bytes: Family::default(),
            cache_limit: Gauge::default(),
            drawing_parts: Family::default(),
            encoding: Mutex::default(),
        };
        metrics.register();
        metrics.cache_limit.set(cache_bytes as i64);
        if let Some(stores) = stores {
            stores.register(&mut metrics.registry);
        }
        metrics
    }

    fn register(&mut self) {
        let to = &mut self.registry;
        to.register("requests", "Requests by route and status code", self.requests.clone());
        to.register("response_bytes", "Bytes of response bodies by route", self.bytes.clone());
        let help = "Time from a request to the end of its response's body";
        to.register("request_seconds", help, self.seconds.clone());
        to.register("requests_in_flight", "Requests in flight", self.in_flight.clone());
        to.register("connections", "Open connections", self.connections.clone());
        let help = "Connections over the limit, rejected with 503";
        to.register("connections_over_limit", help, self.connections_over.clone());
        let help = "Connections closed at once, because their client has its share of those over the limit";
        to.register("connections_refused", help, self.connections_refused.clone());
        let help = "Connections and HTTP/2 streams closed because of a slow client, by the timeout that expired";
        to.register("client_timeouts", help, self.timeouts.clone());
        let help = "Tiles that could not be served, by cause";
        to.register("tile_failures", help, self.read_failures.clone());
        to.register("reloads", "Changes of cities, certificate and tokens, by outcome", self.reloads.clone());
        let help = "Messages that were not logged because there were too many of their kind";
        to.register("log_suppressed", help, self.log_suppressed.clone());
        to.register("cities", "Open cities", self.cities.clone());
        let help = "Cities and folders that could not be opened at the last check";
        to.register("cities_failed", help, self.failed_cities.clone());
        let help = "Bytes in caches: tiles, directories of archives, and what was computed (search indexes, files of tilesets, sorted parts)";
        to.register("cached_bytes", help, self.cached_bytes.clone());
        to.register("cache_limit_bytes", "Bytes that all caches may have together", self.cache_limit.clone());
        let help = "Parts of cities for drawings: read and sorted, or kept of earlier drawings";
        to.register("drawing_parts", help, self.drawing_parts.clone());
        to.register("older_versions", "Replaced versions that are still served", self.older_versions.clone());
    }

    /// Bytes of all tile caches.
    pub(super) fn cached_tiles(&self) -> Gauge {
        self.cached_bytes.get_or_create_owned(&KindLabels { kind: "tiles" })
    }

    /// Counts a request. `code` is 0 if the client left before a response; `bytes` is the part of the body that was sent.
    pub(super) fn request_ended(&self, route: RouteTemplate, code: u16, bytes: u64, elapsed: Duration) {
        let name = route.label();
        let route_metrics = self.routes[route as usize].get_or_init(|| RouteMetrics {
            codes: [const { OnceLock::new() }; CODES.len()],
            bytes: self.bytes.get_or_create_owned(&RouteLabels { route: name }),
            seconds: self.seconds.get_or_create_owned(&RouteLabels { route: name }),
        });
        let at = CODES.iter().position(|known| *known == code).unwrap_or(CODES.len() - 1);
        let count = route_metrics.codes[at].get_or_init(|| {
            let code = match CODES[at] {
                0 => "aborted".to_owned(),
                999 => "other".to_owned(),
                code => code.to_string(),
            };
            self.requests.get_or_create_owned(&RequestLabels { route: name, code })
        });
        count.inc();
        route_metrics.bytes.inc_by(bytes);
        route_metrics.seconds.observe(elapsed.as_secs_f64());
    }

    pub(super) fn connection_opened(&self, over_limit: bool) {
        self.connections.inc();
        self.connections_over.inc_by(u64::from(over_limit));
    }

    /// Counts a closed connection. `timeout_kind` is the timeout that closed it, if one did.
    pub(super) fn connection_closed(&self, timeout_kind: Option<&'static str>) {
        self.connections.dec();
        if let Some(kind) = timeout_kind {
            self.timeouts.get_or_create(&KindLabels { kind }).inc();
        }
    }

    /// Counts HTTP/2 streams that were reset because their clients took too little of the response.
    pub(super) fn streams_reset(&self, count: usize) {
        if count > 0 {
            self.timeouts.get_or_create(&KindLabels { kind: "stream" }).inc_by(count as u64);
        }
    }

    /// Counts a connection that was closed unserved: its client has its share of those over the limit as well.
    pub(super) fn connection_refused(&self) {
        self.connections_refused.inc();
    }

    /// Counts a message that was not logged because there were too many of its kind.
    pub(super) fn log_suppressed(&self, kind: &'static str) {
        self.log_suppressed.get_or_create(&KindLabels { kind }).inc();
    }

    /// Counts a tile that could not be served.
    pub(super) fn read_failed(&self, error: &ReadError) {
        let kind = match error {
            ReadError::Damaged(_) => "damaged",
            ReadError::Replaced => "replaced",
            _ => "unreadable",
        };
        self.read_failures.get_or_create(&KindLabels { kind }).inc();
    }

    /// Counts a reload that changed something or failed.
    pub(super) fn reloaded(&self, outcome: &'static str) {
        self.reloads.get_or_create(&KindLabels { kind: outcome }).inc();
    }

    /// Counts a drawing by whether its part of the city was kept of an earlier one.
    #[cfg(feature = "bake")]
    pub(super) fn drawing_part(&self, is_kept: bool) {
        let kind = if is_kept { "kept" } else { "read" };
        self.drawing_parts.get_or_create(&KindLabels { kind }).inc();
    }

    /// All metrics as OpenMetrics text.
    pub(super) fn to_open_metrics(&self, now: CurrentCounts) -> String {
        // Two requests may see different cities.
        let _exclusive = self.encoding.lock().unwrap_or_else(PoisonError::into_inner);
        self.in_flight.set(now.in_flight as i64);
        self.cities.set(now.cities as i64);
        self.failed_cities.set(now.failed_cities as i64);
        self.older_versions.set(now.older_versions as i64);
        self.cached_bytes.get_or_create(&KindLabels { kind: "computed" }).set(now.computed_bytes as i64);
        self.cached_bytes.get_or_create(&KindLabels { kind: "directories" }).set(directory_bytes() as i64);
        let mut out = String::new();
        // Writing to a `String` cannot fail.
        let _ = encode(&mut out, &self.registry);
        out
    }
}
