//! How many requests a client may make (off unless configured).
//!
//! In: a client's address. Out: yes, or 429 with the seconds to wait. Next: `app`.
//!
//! A token bucket an address; of IPv6 the first 64 bits, since one client has as many addresses below them as it likes.

use super::problem::Problem;
use axum::http::{HeaderValue, StatusCode, header};
use lru::LruCache;
use std::{
    net::{IpAddr, Ipv6Addr},
    num::NonZeroUsize,
    sync::{Mutex, PoisonError},
    time::Instant,
};

/// Clients that are remembered; the one not seen for longest is forgotten first.
const MAX_CLIENTS: NonZeroUsize = NonZeroUsize::new(65_536).unwrap();

/// All clients' buckets.
#[derive(Debug)]
pub(super) struct RateLimiter {
    per_sec: f64,
    burst: f64,
    buckets: Mutex<LruCache<IpAddr, TokenBucket>>,
}

#[derive(Debug, Clone, Copy)]
struct TokenBucket {
    left: f64,
    at: Instant,
}

impl RateLimiter {
    /// `per_sec` of 0 is no limit.
    pub(super) fn new(per_sec: f64, burst: u32) -> Self {
        // The memory for all of them is taken as they come.
        let buckets = Mutex::new(LruCache::new(MAX_CLIENTS));
        Self { per_sec, burst: f64::from(burst), buckets }
    }

    /// Counts a request. Errors: 429.
    pub(super) fn admit(&self, ip: IpAddr) -> Result<(), Problem> {
        if self.per_sec <= 0.0 { Ok(()) } else { self.admit_at(ip, Instant::now()) }
    }

    fn admit_at(&self, ip: IpAddr, now: Instant) -> Result<(), Problem> {
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        let bucket = buckets.get_or_insert_mut(network(ip), || TokenBucket { left: self.burst, at: now });
        let refilled = bucket.left + now.saturating_duration_since(bucket.at).as_secs_f64() * self.per_sec;
        *bucket = TokenBucket { left: refilled.min(self.burst), at: now };
        if bucket.left >= 1.0 {
            bucket.left -= 1.0;
            return Ok(());
        }
        let wait_secs = ((1.0 - bucket.left) / self.per_sec).ceil().clamp(1.0, 3600.0) as u64;
        let detail = "too many requests from this address: ask again later";
        Err(Problem::new(StatusCode::TOO_MANY_REQUESTS, detail).with(header::RETRY_AFTER, HeaderValue::from(wait_secs)))
    }
}

fn network(ip: IpAddr) -> IpAddr {
    match ip.to_canonical() {
        IpAddr::V6(ip) => {
            let [a, b, c, d, ..] = ip.segments();
            IpAddr::V6(Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0))
        }
        v4 => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_burst_and_then_the_rate() {
        let rate = RateLimiter::new(2.0, 3);
        let ip = |text: &str| text.parse::<IpAddr>().unwrap();
        let (one, start) = (ip("192.0.2.1"), Instant::now());
        let admitted = |ip, millis| rate.admit_at(ip, start + Duration::from_millis(millis)).is_ok();
        assert_eq!([0; 4].map(|at| admitted(one, at)), [true, true, true, false]);
        assert!(admitted(ip("192.0.2.2"), 0), "another client has its own");
        assert!(!admitted(one, 400) && admitted(one, 500) && !admitted(one, 501));
        assert!(!admitted(one, 0), "time that goes back gives nothing");
        assert!([5000; 3].iter().all(|at| admitted(one, *at)) && !admitted(one, 5000), "never more than a burst");
        let [a, b, c] = ["2001:db8::1", "2001:db8::2", "2001:db8:0:1::1"].map(ip);
        assert!((0..3).all(|_| admitted(a, 0)) && !admitted(b, 0) && admitted(c, 0), "64 bits are one client");
        assert!((0..100).all(|_| RateLimiter::new(0.0, 1).admit(one).is_ok()));
    }
}
