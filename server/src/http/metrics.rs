//! Counters of what the server does.
//!
//! In: one [`Metrics::finished`] per request. Out: Prometheus text. Next: `/metrics`.
//!
//! Routes, codes and buckets are fixed tables of atomics: no lock on the way of a tile, no label that a client can invent,
//! and no global recorder that two servers in one process would share.

use crate::store::Store;
use std::{
    fmt::Write,
    sync::atomic::{AtomicI64, AtomicU64, Ordering::Relaxed},
    time::Duration,
};

/// Routes as labels; the last is for everything else.
const ROUTES: [&str; 10] =
    ["index", "cities", "manifest", "subtrees", "blockmaps", "meshes", "healthz", "readyz", "metrics", "other"];
/// Codes as labels; 0 is a request that ended without an answer, the last is for everything else.
const CODES: [u16; 10] = [0, 200, 206, 304, 400, 404, 405, 416, 503, 999];
/// Upper ends of the histogram's buckets in microseconds.
const BUCKETS_MICROS: [u64; 10] = [50, 100, 250, 500, 1000, 5000, 25_000, 100_000, 1_000_000, 10_000_000];

/// Which of [`ROUTES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Route(usize);

impl Route {
    /// By the router's pattern, never by the address itself.
    pub(super) fn of_pattern(pattern: Option<&str>) -> Self {
        let word = match pattern {
            Some("/") => "index",
            Some("/v1/cities") => "cities",
            Some("/v1/cities/{city}") => "manifest",
            Some(pattern) => pattern.split('/').find(|part| ROUTES.contains(part)).unwrap_or("other"),
            None => "other",
        };
        // `cities` is a part of every tile's pattern.
        let layer = ["subtrees", "blockmaps", "meshes"]
            .into_iter()
            .find(|layer| pattern.is_some_and(|pattern| pattern.split('/').any(|part| part == *layer)));
        let word = layer.unwrap_or(word);
        Self(ROUTES.iter().position(|route| *route == word).unwrap_or(ROUTES.len() - 1))
    }
}

#[derive(Debug, Default)]
struct OfRoute {
    requests: [AtomicU64; CODES.len()],
    bytes: AtomicU64,
    buckets: [AtomicU64; BUCKETS_MICROS.len()],
    micros: AtomicU64,
}

/// All counters of one server.
#[derive(Debug, Default)]
pub(super) struct Metrics {
    routes: [OfRoute; ROUTES.len()],
    in_flight: AtomicI64,
}

impl Metrics {
    /// A request has come.
    pub(super) fn started(&self) {
        self.in_flight.fetch_add(1, Relaxed);
    }

    /// It has been answered with `bytes` of body, or has gone away (code 0).
    pub(super) fn finished(&self, route: Route, code: u16, bytes: u64, taken: Duration) {
        self.in_flight.fetch_sub(1, Relaxed);
        let Some(of_route) = self.routes.get(route.0) else { return };
        let at = CODES.iter().position(|known| *known == code).unwrap_or(CODES.len() - 1);
        of_route.requests[at].fetch_add(1, Relaxed);
        of_route.bytes.fetch_add(bytes, Relaxed);
        let micros = taken.as_micros().min(u128::from(u64::MAX)) as u64;
        of_route.micros.fetch_add(micros, Relaxed);
        if let Some(bucket) = BUCKETS_MICROS.iter().position(|end| micros <= *end) {
            of_route.buckets[bucket].fetch_add(1, Relaxed);
        }
    }

    /// Everything as Prometheus text; what never happened is left out.
    pub(super) fn text(&self, store: &Store) -> String {
        let mut out = String::new();
        family(&mut out, "insula_requests_total", "counter", "Requests by route and status code.");
        for (route, of_route) in self.used() {
            for (code, count) in CODES.iter().zip(&of_route.requests).filter(|(_, count)| count.load(Relaxed) > 0) {
                let code = match code {
                    0 => "aborted".to_owned(),
                    999 => "other".to_owned(),
                    code => code.to_string(),
                };
                let count = count.load(Relaxed);
                let _ = writeln!(out, "insula_requests_total{{route=\"{route}\",code=\"{code}\"}} {count}");
            }
        }
        family(&mut out, "insula_response_bytes_total", "counter", "Bytes of response bodies by route.");
        for (route, of_route) in self.used() {
            let bytes = of_route.bytes.load(Relaxed);
            let _ = writeln!(out, "insula_response_bytes_total{{route=\"{route}\"}} {bytes}");
        }
        self.histogram(&mut out);
        family(&mut out, "insula_requests_in_flight", "gauge", "Requests being answered now.");
        let _ = writeln!(out, "insula_requests_in_flight {}", self.in_flight.load(Relaxed));
        family(&mut out, "insula_cities", "gauge", "Cities that are open.");
        let _ = writeln!(out, "insula_cities {}", store.cities().len());
        out
    }

    fn histogram(&self, out: &mut String) {
        let name = "insula_request_seconds";
        family(out, name, "histogram", "Time from a request to the end of its answer's body.");
        for (route, of_route) in self.used() {
            let mut below = 0;
            for (end, bucket) in BUCKETS_MICROS.iter().zip(&of_route.buckets) {
                below += bucket.load(Relaxed);
                let end_secs = *end as f64 / 1e6;
                let _ = writeln!(out, "{name}_bucket{{route=\"{route}\",le=\"{end_secs}\"}} {below}");
            }
            let count = of_route.count();
            let _ = writeln!(out, "{name}_bucket{{route=\"{route}\",le=\"+Inf\"}} {count}");
            let _ = writeln!(out, "{name}_sum{{route=\"{route}\"}} {}", of_route.micros.load(Relaxed) as f64 / 1e6);
            let _ = writeln!(out, "{name}_count{{route=\"{route}\"}} {count}");
        }
    }

    fn used(&self) -> impl Iterator<Item = (&'static str, &OfRoute)> {
        ROUTES.into_iter().zip(&self.routes).filter(|(_, of_route)| of_route.count() > 0)
    }
}

impl OfRoute {
    fn count(&self) -> u64 {
        self.requests.iter().map(|count| count.load(Relaxed)).sum()
    }
}

fn family(out: &mut String, name: &str, kind: &str, help: &str) {
    let _ = writeln!(out, "# HELP {name} {help}\n# TYPE {name} {kind}");
}
