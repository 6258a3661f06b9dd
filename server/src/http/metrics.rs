//! StoreMetrics of what the server does.
//!
//! In: one [`HttpMetrics::finished`] per request. Out: OpenMetrics text. Next: `/metrics`.
//!
//! Routes and codes are fixed tables, so that no client can invent a label; each server has a registry of its own.

use crate::store::{Store, StoreMetrics};
use insula_archive::ReadError;
use prometheus_client::{
    encoding::{EncodeLabelSet, text::encode},
    metrics::{counter::Counter, family::Family, gauge::Gauge, histogram::Histogram},
    registry::Registry,
};
use std::{sync::OnceLock, time::Duration};

/// Routes as labels; the last is for everything else.
const ROUTES: [&str; 11] = [
    "subtrees",
    "blockmaps",
    "meshes",
    "manifest",
    "cities",
    "index",
    "openapi",
    "healthz",
    "readyz",
    "metrics",
    "other",
];
/// Those that answer however full the house is.
const HOUSE_ROUTES: [&str; 3] = ["healthz", "readyz", "metrics"];
/// Codes as labels; 0 is a request that ended without an answer, the last is for everything else.
const CODES: [u16; 15] = [0, 200, 204, 206, 304, 400, 401, 404, 405, 416, 429, 431, 500, 503, 999];
/// Upper ends of the histogram's buckets in seconds.
const BUCKETS_SECS: [f64; 13] = [5e-5, 1e-4, 2.5e-4, 5e-4, 1e-3, 2.5e-3, 5e-3, 1e-2, 2.5e-2, 0.1, 0.5, 2.5, 10.0];

/// Which of [`ROUTES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RouteLabel(usize);

impl RouteLabel {
    /// By the shape of the address alone.
    pub(super) fn of_path(path: &str) -> Self {
        let mut parts = path.strip_prefix('/').unwrap_or(path).split('/');
        let word = match (parts.next(), parts.next(), parts.next(), parts.next(), parts.next()) {
            (Some("v1"), Some("cities"), Some(_), Some(_), Some(layer)) if ROUTES[..3].contains(&layer) => layer,
            (Some("v1"), Some("cities"), Some(_), None, None) => "manifest",
            (Some("v1"), Some("cities"), None, None, None) => "cities",
            (Some("v1"), Some("openapi.json"), None, None, None) => "openapi",
            (Some(""), None, None, None, None) => "index",
            (Some(word), None, None, None, None) if HOUSE_ROUTES.contains(&word) => word,
            _ => "other",
        };
        Self(ROUTES.iter().position(|route| *route == word).unwrap_or(ROUTES.len() - 1))
    }

    /// Whether it may be turned away when there is too much to do.
    pub(super) fn is_of_cities(self) -> bool {
        !HOUSE_ROUTES.contains(&ROUTES[self.0])
    }
}

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

/// What is counted of one route; made at its first request, so that what never happened is left out.
#[derive(Debug)]
struct RouteMetrics {
    codes: [OnceLock<Counter>; CODES.len()],
    bytes: Counter,
    seconds: Histogram,
}

/// All counters of one server.
#[derive(Debug)]
pub(super) struct HttpMetrics {
    registry: Registry,
    requests: Family<RequestLabels, Counter>,
    bytes: Family<RouteLabels, Counter>,
    seconds: Family<RouteLabels, Histogram>,
    routes: [OnceLock<RouteMetrics>; ROUTES.len()],
    in_flight: Gauge,
    connections: Gauge,
    connections_over: Counter,
    timeouts: Family<KindLabels, Counter>,
    read_failures: Family<KindLabels, Counter>,
    reloads: Family<KindLabels, Counter>,
    cities: Gauge,
    older_versions: Gauge,
}

impl HttpMetrics {
    /// With what stores count, if there are any.
    pub(super) fn new(stores: Option<&StoreMetrics>) -> Self {
        let mut metrics = Self {
            registry: Registry::with_prefix("insula"),
            requests: Family::default(),
            bytes: Family::default(),
            seconds: Family::new_with_constructor(|| Histogram::new(BUCKETS_SECS)),
            routes: [const { OnceLock::new() }; ROUTES.len()],
            in_flight: Gauge::default(),
            connections: Gauge::default(),
            connections_over: Counter::default(),
            timeouts: Family::default(),
            read_failures: Family::default(),
            reloads: Family::default(),
            cities: Gauge::default(),
            older_versions: Gauge::default(),
        };
        metrics.register();
        if let Some(counters) = stores {
            counters.register(&mut metrics.registry);
        }
        metrics
    }

    fn register(&mut self) {
        let to = &mut self.registry;
        to.register("requests", "Requests by route and status code", self.requests.clone());
        to.register("response_bytes", "Bytes of response bodies by route", self.bytes.clone());
        let about = "Time from a request to the end of its answer's body";
        to.register("request_seconds", about, self.seconds.clone());
        to.register("requests_in_flight", "Requests being answered now", self.in_flight.clone());
        to.register("connections", "Open connections", self.connections.clone());
        let about = "Connections over the limit, told 503";
        to.register("connections_over_limit", about, self.connections_over.clone());
        let about = "Connections closed because the client was too slow, by what it was slow at";
        to.register("client_timeouts", about, self.timeouts.clone());
        let about = "Tiles that could not be served, by kind";
        to.register("tile_failures", about, self.read_failures.clone());
        to.register("reloads", "Looks at the cities that found something, by outcome", self.reloads.clone());
        to.register("cities", "Cities that are open", self.cities.clone());
        to.register("older_versions", "Replaced versions that are still served", self.older_versions.clone());
    }

    /// It has been answered with `bytes` of body, or has gone away (code 0).
    pub(super) fn finished(&self, route: RouteLabel, code: u16, bytes: u64, taken: Duration) {
        let Some(&name) = ROUTES.get(route.0) else { return };
        let cells = self.routes[route.0].get_or_init(|| RouteMetrics {
            codes: [const { OnceLock::new() }; CODES.len()],
            bytes: self.bytes.get_or_create_owned(&RouteLabels { route: name }),
            seconds: self.seconds.get_or_create_owned(&RouteLabels { route: name }),
        });
        let at = CODES.iter().position(|known| *known == code).unwrap_or(CODES.len() - 1);
        let count = cells.codes[at].get_or_init(|| {
            let code = match CODES[at] {
                0 => "aborted".to_owned(),
                999 => "other".to_owned(),
                code => code.to_string(),
            };
            self.requests.get_or_create_owned(&RequestLabels { route: name, code })
        });
        count.inc();
        cells.bytes.inc_by(bytes);
        cells.seconds.observe(taken.as_secs_f64());
    }

    /// A connection is there.
    pub(super) fn connected(&self, over: bool) {
        self.connections.inc();
        self.connections_over.inc_by(u64::from(over));
    }

    /// It has gone; `slow` says at what it was too slow, if it was.
    pub(super) fn disconnected(&self, slow: Option<&'static str>) {
        self.connections.dec();
        if let Some(kind) = slow {
            self.timeouts.get_or_create(&KindLabels { kind }).inc();
        }
    }

    /// A tile could not be served.
    pub(super) fn read_failed(&self, error: &ReadError) {
        let kind = match error {
            ReadError::Damaged(_) => "damaged",
            ReadError::Replaced => "replaced",
            _ => "unreadable",
        };
        self.read_failures.get_or_create(&KindLabels { kind }).inc();
    }

    /// A look at the cities found a change, or failed.
    pub(super) fn reloaded(&self, outcome: &'static str) {
        self.reloads.get_or_create(&KindLabels { kind: outcome }).inc();
    }

    /// These cities are served now.
    pub(super) fn cities(&self, store: &Store) {
        self.cities.set(store.cities().len() as i64);
        self.older_versions.set(store.older_versions() as i64);
    }

    /// Everything as text.
    pub(super) fn text(&self, in_flight: usize) -> String {
        self.in_flight.set(in_flight as i64);
        let mut out = String::new();
        // A string takes everything.
        let _ = encode(&mut out, &self.registry);
        out
    }
}
