//! Request rate limit per client address: a token bucket each. Off by default.

use super::client_usage::client_network;
use super::problem::Problem;
use axum::http::{HeaderValue, StatusCode, header};
use lru::LruCache;
use std::net::IpAddr;
use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Number of buckets; the least recently used one is dropped first.
const MAX_CLIENTS: NonZeroUsize = NonZeroUsize::new(65_536).unwrap();

/// The buckets of all clients.
#[derive(Debug)]
pub(super) struct RateLimiter {
    /// Requests per second; 0 for no limit.
    refill_per_sec: f64,
    burst: f64,
    buckets: Mutex<LruCache<IpAddr, TokenBucket>>,
}

#[derive(Debug, Clone, Copy)]
struct TokenBucket {
    tokens: f64,
    refilled_at: Instant,
}

impl RateLimiter {
    pub(super) fn new(refill_per_sec: f64, burst: u32) -> Self {
        let buckets = Mutex::new(LruCache::new(MAX_CLIENTS));
        Self { refill_per_sec, burst: f64::from(burst), buckets }
    }

    /// Counts a request. Fails with 429 if the client's bucket is empty.
    pub(super) fn admit(&self, ip: IpAddr) -> Result<(), Problem> {
        if self.refill_per_sec <= 0.0 { Ok(()) } else { self.admit_at(ip, Instant::now()) }
    }

    fn admit_at(&self, ip: IpAddr, now: Instant) -> Result<(), Problem> {
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        let full = TokenBucket { tokens: self.burst, refilled_at: now };
        let bucket = buckets.get_or_insert_mut(client_network(ip), || full);
        let elapsed_secs = now.saturating_duration_since(bucket.refilled_at).as_secs_f64();
        let refilled = bucket.tokens + elapsed_secs * self.refill_per_sec;
        *bucket = TokenBucket { tokens: refilled.min(self.burst), refilled_at: now };
        if bucket.tokens >= 1.0 {
            bucket.tokens -= 1.0;
            return Ok(());
        }
        let wait_secs = ((1.0 - bucket.tokens) / self.refill_per_sec).ceil().clamp(1.0, 3600.0) as u64;
        let detail = "too many requests from this address: retry later";
        Err(Problem::new(StatusCode::TOO_MANY_REQUESTS, detail).with(header::RETRY_AFTER, HeaderValue::from(wait_secs)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn admits_a_burst_and_then_the_refill_rate() {
        let limiter = RateLimiter::new(2.0, 3);
        let ip = |text: &str| text.parse::<IpAddr>().unwrap();
        let (one, start) = (ip("192.0.2.1"), Instant::now());
        let admitted = |ip, millis| limiter.admit_at(ip, start + Duration::from_millis(millis)).is_ok();
        assert_eq!([0; 4].map(|at| admitted(one, at)), [true, true, true, false]);
        assert!(admitted(ip("192.0.2.2"), 0), "each client has its own bucket");
        assert!(!admitted(one, 400) && admitted(one, 500) && !admitted(one, 501));
        assert!(!admitted(one, 0), "time that runs backwards refills nothing");
        assert!([5000; 3].iter().all(|at| admitted(one, *at)) && !admitted(one, 5000), "never more than a burst");
        let [a, b, c] = ["2001:db8::1", "2001:db8::2", "2001:db8:0:1::1"].map(ip);
        assert!((0..3).all(|_| admitted(a, 0)) && !admitted(b, 0) && admitted(c, 0), "a /64 network is one client");
        assert!((0..100).all(|_| RateLimiter::new(0.0, 1).admit(one).is_ok()));
    }
}
