//! A simulated slow network, for measurements (`fly --bandwidth --rtt --loss`).

use super::jitter::jitter;
use std::time::Duration;
use tokio::sync::Mutex;
use tokio::time::{Instant, sleep, sleep_until};

/// A link with limited bandwidth, shared by all requests.
#[derive(Debug)]
pub struct SimulatedLink {
    bytes_per_sec: Option<f64>,
    rtt: Duration,
    /// Share of responses that break off, 0 to 1.
    loss: f64,
    /// When the bytes received so far will have passed the link.
    free_at: Mutex<Option<Instant>>,
}

impl SimulatedLink {
    /// A link of `mbit` megabits per second (`None`: unlimited) that delays each response by `rtt` and breaks off a share of
    /// `loss` of the responses, 0 to 1.
    pub fn new(mbit: Option<f64>, rtt: Duration, loss: f64) -> Self {
        Self { bytes_per_sec: mbit.map(|m| m * 125_000.0), rtt, loss, free_at: Mutex::new(None) }
    }

    /// Decides at random whether the next response breaks off.
    pub fn loses(&self) -> bool {
        self.loss > 0.0 && jitter() < self.loss
    }

    /// Waits for the round trip of a request.
    pub async fn round_trip(&self) {
        sleep(self.rtt).await;
    }

    /// Waits until `bytes` more bytes have passed the link.
    pub async fn carry(&self, bytes: usize) {
        let Some(bytes_per_sec) = self.bytes_per_sec else { return };
        let until = {
            let mut free_at = self.free_at.lock().await;
            let now = Instant::now();
            let start = free_at.map_or(now, |at| at.max(now));
            let until = start + Duration::from_secs_f64(bytes as f64 / bytes_per_sec);
            *free_at = Some(until);
            until
        };
        sleep_until(until).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn two_requests_share_the_bandwidth() {
        let link = SimulatedLink::new(Some(8.0), Duration::ZERO, 0.0);
        let start = Instant::now();
        tokio::join!(link.carry(50_000), link.carry(50_000));
        let secs = start.elapsed().as_secs_f64();
        // Without sharing, both would take half of it.
        assert!(secs >= 0.095, "{secs}");
    }
}
