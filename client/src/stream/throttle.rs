//! A slower network than there is.
//!
//! In: megabits a second, a round trip. Out: waits. Next: `fetch` waits.

use std::time::Duration;
use tokio::{
    sync::Mutex,
    time::{Instant, sleep, sleep_until},
};

/// All requests share one line.
#[derive(Debug)]
pub struct Throttle {
    bytes_per_sec: Option<f64>,
    rtt: Duration,
    line_free_at: Mutex<Option<Instant>>,
}

impl Throttle {
    /// `mbit` a second (none: as fast as it goes) and `rtt` before each answer.
    pub fn new(mbit: Option<f64>, rtt: Duration) -> Self {
        Self { bytes_per_sec: mbit.map(|m| m * 125_000.0), rtt, line_free_at: Mutex::new(None) }
    }

    /// Before a request's first byte.
    pub async fn round_trip(&self) {
        sleep(self.rtt).await;
    }

    /// After `bytes` came in: until the line would have carried them.
    pub async fn carry(&self, bytes: usize) {
        let Some(bytes_per_sec) = self.bytes_per_sec else { return };
        let until = {
            let mut line_free_at = self.line_free_at.lock().await;
            let now = Instant::now();
            let start = line_free_at.map_or(now, |at| at.max(now));
            let until = start + Duration::from_secs_f64(bytes as f64 / bytes_per_sec);
            *line_free_at = Some(until);
            until
        };
        sleep_until(until).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn two_requests_share_the_line() {
        let throttle = Throttle::new(Some(8.0), Duration::ZERO);
        let start = Instant::now();
        tokio::join!(throttle.carry(50_000), throttle.carry(50_000));
        let took = start.elapsed().as_secs_f64();
        assert!((0.095..0.5).contains(&took), "{took}");
    }
}
