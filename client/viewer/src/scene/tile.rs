//! The state of one tile, and the only function that changes it.
//!
//! ```text
//!            Want          Start           Arrive           Upload
//!  Unknown ---------> Queued ------> Loading -------> Decoded -------> Resident
//!     ^  ^              ^ |            | | |             |                |
//!     |  +--------------|-+   Drop     | | |   Drop      |      Drop      |
//!     |    (no longer   |  <-----------+ | |  <----------+  <-------------+
//!     |      wanted)    |                | |      (no room)      (evicted)
//!     |                 | Want           | | Fail, Damage (fewer than 3)
//!     |                 | (retry_at      | +------------------> Failed {attempts, retry_at}
//!     |                 |  has passed)   |                         |
//!     |                 +----------------|-------------------------+
//!     |                                  | Refuse, third Damage
//!     |                                  +------------------> Bad   (its parent is drawn)
//!     |   Recheck                                              |
//!     +--------------------------------------------------------+
//! ```

use std::time::Duration;

/// Number of damaged responses after which a tile is bad.
const DAMAGE_LIMIT: u8 = 3;
const FIRST_RETRY_DELAY: Duration = Duration::from_millis(100);
const MAX_RETRY_DELAY: Duration = Duration::from_secs(2);
/// Longest delay that is accepted from a server's `Retry-After`.
pub const MAX_RETRY_AFTER: Duration = Duration::from_secs(30);

/// Where a tile is on its way from the server to the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TileState {
    /// Neither resident nor wanted.
    #[default]
    Unknown,
    /// Wanted; no request has started.
    Queued,
    /// Being fetched or decoded.
    Loading,
    /// Decoded, but not yet in the cache.
    Decoded,
    /// In the cache; for a subtree, in the scene tree.
    Resident,
    /// A request failed. Another one may start at `retry_at`.
    Failed {
        /// Failures in a row.
        attempts: u8,
        retry_at: Duration,
    },
    /// Given up: the tile does not exist, or was damaged repeatedly. Only a recheck ends this.
    Bad,
}

/// What happens to a tile. Times are durations since the session's start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TileEvent {
    /// A selection requests it.
    Want { now: Duration },
    /// A request starts.
    Start,
    /// It was fetched and decoded.
    Arrive,
    /// It was written to the cache.
    Upload,
    /// It is no longer wanted, does not fit into the cache, or was evicted.
    Drop,
    /// The request failed: a network error, or a server that is overloaded or failing.
    Fail {
        now: Duration,
        /// Delay that the server asks for.
        retry_after: Option<Duration>,
        /// Random number in 0..1, which spreads the retries of many tiles and many clients.
        jitter: f64,
    },
    /// The response does not decode.
    Damage {
        now: Duration,
        /// Random number in 0..1.
        jitter: f64,
    },
    /// The server has no such tile.
    Refuse,
    /// A bad tile may be requested once more: the damage may have been that of a cache on the way.
    Recheck,
}

/// A tile's state, and its failures so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TileRecord {
    state: TileState,
    attempts: u8,
    damaged: u8,
}

impl TileRecord {
    /// The present state.
    pub fn state(&self) -> TileState {
        self.state
    }

    /// Whether the tile can be drawn or, for a subtree, descended.
    pub fn is_resident(&self) -> bool {
        self.state == TileState::Resident
    }

    /// Whether a request would be pointless.
    pub fn is_bad(&self) -> bool {
        self.state == TileState::Bad
    }

    /// Applies an event. Returns `false`, and changes nothing, if the event has no meaning in the present state.
    pub fn apply(&mut self, event: TileEvent) -> bool {
        use TileState as S;
        let next = match (self.state, event) {
            (S::Unknown, TileEvent::Want { .. }) => S::Queued,
            (S::Failed { retry_at, .. }, TileEvent::Want { now }) if now >= retry_at => S::Queued,
            (S::Queued, TileEvent::Start) => S::Loading,
            (S::Loading, TileEvent::Arrive) => S::Decoded,
            (S::Decoded, TileEvent::Upload) => {
                *self = Self::default();
                S::Resident
            }
            (S::Queued | S::Loading | S::Decoded | S::Resident, TileEvent::Drop) => S::Unknown,
            (S::Loading, TileEvent::Fail { now, retry_after, jitter }) => self.record_failure(now, retry_after, jitter),
            (S::Loading, TileEvent::Damage { now, jitter }) => {
                self.damaged = self.damaged.saturating_add(1);
                if self.damaged >= DAMAGE_LIMIT { S::Bad } else { self.record_failure(now, None, jitter) }
            }
            (S::Loading, TileEvent::Refuse) => S::Bad,
            (S::Bad, TileEvent::Recheck) => S::Unknown,
            _ => return false,
        };
        self.state = next;
        true
    }

    fn record_failure(&mut self, now: Duration, retry_after: Option<Duration>, jitter: f64) -> TileState {
        self.attempts = self.attempts.saturating_add(1);
        TileState::Failed { attempts: self.attempts, retry_at: now + retry_delay(self.attempts, retry_after, jitter) }
    }
}

/// Delay before a retry after `attempts` failures in a row: `retry_after` if the server sent that, up to [`MAX_RETRY_AFTER`].
/// Otherwise, it doubles from 100 ms to 2 s, and is reduced by up to half of it by `jitter` (0 to 1).
pub fn retry_delay(attempts: u8, retry_after: Option<Duration>, jitter: f64) -> Duration {
    if let Some(delay) = retry_after {
        return delay.min(MAX_RETRY_AFTER);
    }
    let full = FIRST_RETRY_DELAY.saturating_mul(1 << attempts.saturating_sub(1).min(10)).min(MAX_RETRY_DELAY);
    full.mul_f64(1.0 - 0.5 * jitter.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_all_states_in_order() {
        let now = Duration::from_secs(100);
        let mut tile = TileRecord::default();
        for event in [TileEvent::Want { now }, TileEvent::Start, TileEvent::Arrive, TileEvent::Upload] {
            assert!(tile.apply(event), "{event:?}");
        }
        assert!(tile.is_resident());
        assert!(!tile.apply(TileEvent::Arrive));
        assert!(tile.apply(TileEvent::Drop));
        assert_eq!(tile.state(), TileState::Unknown);
    }

    #[test]
    fn retry_delays_grow_and_retries_never_end() {
        let mut now = Duration::from_secs(100);
        let mut tile = TileRecord::default();
        let mut last = Duration::ZERO;
        for attempt in 1..40u8 {
            assert!(tile.apply(TileEvent::Want { now }) && tile.apply(TileEvent::Start));
            tile.apply(TileEvent::Fail { now, retry_after: None, jitter: 0.0 });
            let TileState::Failed { attempts, retry_at } = tile.state() else { panic!("{tile:?}") };
            assert_eq!(attempts, attempt);
            assert!(!tile.apply(TileEvent::Want { now }), "too early");
            assert!(retry_at - now >= last && retry_at - now <= MAX_RETRY_DELAY);
            last = retry_at - now;
            now = retry_at;
        }
    }

    #[test]
    fn third_damage_ends_requests_and_retry_after_is_obeyed() {
        let mut now = Duration::from_secs(100);
        let mut tile = TileRecord::default();
        for time in 1..=DAMAGE_LIMIT {
            tile.apply(TileEvent::Want { now });
            tile.apply(TileEvent::Start);
            tile.apply(TileEvent::Damage { now, jitter: 0.3 });
            assert_eq!(tile.is_bad(), time == DAMAGE_LIMIT);
            now += MAX_RETRY_DELAY;
        }
        assert!(!tile.apply(TileEvent::Want { now }));
        // After a recheck, one more damaged response is enough.
        for event in [TileEvent::Recheck, TileEvent::Want { now }, TileEvent::Start] {
            assert!(tile.apply(event), "{event:?}");
        }
        tile.apply(TileEvent::Damage { now, jitter: 0.3 });
        assert!(tile.is_bad());
        let mut tile = TileRecord::default();
        tile.apply(TileEvent::Want { now });
        tile.apply(TileEvent::Start);
        tile.apply(TileEvent::Fail { now, retry_after: Some(Duration::from_secs(7)), jitter: 0.9 });
        assert_eq!(tile.state(), TileState::Failed { attempts: 1, retry_at: now + Duration::from_secs(7) });
    }
}
