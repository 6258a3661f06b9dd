//! A slower network than there is.
//!
//! In: megabits a second, a round trip, a share of losses. Out: waits, and broken answers. Next: `fetch` waits.

use super::jitter;
use std::time::Duration;
use tokio::{
    sync::Mutex,
    time::{Instant, sleep, sleep_until},
};

/// All requests share one line.
#[derive(Debug)]
pub struct Link {
    bytes_per_sec: Option<f64>,
    rtt: Duration,
    /// Share of answers that break off.
    loss: f64,
    line_free_at: Mutex<Option<Instant>>,
}

impl Link {
    /// `mbit` a second (none: as fast as it goes), `rtt` before each answer, and a share of `loss` of answers that break off.
    pub fn new(mbit: Option<f64>, rtt: Duration, loss: f64) -> Self {
        Self { bytes_per_sec: mbit.map(|m| m * 125_000.0), rtt, loss, line_free_at: Mutex::new(None) }
    }

    /// Whether the next answer breaks off.
    pub fn loses(&self) -> bool {
        self.loss > 0.0 && jitter() < self.loss
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
        let link = Link::new(Some(8.0), Duration::ZERO, 0.0);
        let start = Instant::now();
        tokio::join!(link.carry(50_000), link.carry(50_000));
        let took = start.elapsed().as_secs_f64();
        assert!((0.095..0.5).contains(&took), "{took}");
    }
}
