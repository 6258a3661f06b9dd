//! The state of one tile, and the only function that changes it.
//!
//! In: [`TileEvent`]. Out: [`TileState`]. Next: `tree` keeps one a tile, `select` reads them.
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
//!     |                                  +------------------> Bad   (for good: its parent stays)
//! ```

use std::time::Duration;

/// Damaged answers after which a tile counts as bad.
pub const DAMAGE_LIMIT: u8 = 3;
const FIRST_RETRY_DELAY: Duration = Duration::from_millis(100);
const MAX_RETRY_DELAY: Duration = Duration::from_secs(2);
/// Longest wait that a server's Retry-After is believed.
pub const MAX_RETRY_AFTER: Duration = Duration::from_secs(60);

/// Where a tile is on its way from the server to the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TileState {
    /// Not here, not asked for.
    #[default]
    Unknown,
    /// Asked for, no request yet.
    Queued,
    /// A request (or its decoding) is under way.
    Loading,
    /// Decoded, not yet in the cache.
    Decoded,
    /// In the cache (for subtrees: in the tree).
    Resident,
    /// A request went wrong; another may start at `retry_at`.
    Failed {
        /// Failures in a row.
        attempts: u8,
        /// Not before.
        retry_at: Duration,
    },
    /// Given up: it does not exist, or stays damaged.
    Bad,
}

/// What happens to a tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TileEvent {
    /// The selection wants it.
    Want {
        /// The time.
        now: Duration,
    },
    /// A request starts.
    Start,
    /// Its bytes came and decode.
    Arrive,
    /// It is in the cache.
    Upload,
    /// No longer wanted, no room, or evicted.
    Drop,
    /// The request failed: network, or a server that is busy or ill.
    Fail {
        /// The time.
        now: Duration,
        /// The server's wish.
        retry_after: Option<Duration>,
        /// 0 to 1: spreads the waits of many tiles and many clients.
        jitter: f64,
    },
    /// Bytes came that do not decode.
    Damage {
        /// The time.
        now: Duration,
        /// 0 to 1.
        jitter: f64,
    },
    /// The server says that there is no such tile.
    Refuse,
}

/// A tile's state and its record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TileRecord {
    state: TileState,
    attempts: u8,
    damaged: u8,
}

impl TileRecord {
    /// Where it is.
    pub fn state(&self) -> TileState {
        self.state
    }

    /// Whether it can be drawn (or, for a subtree, descended).
    pub fn is_resident(&self) -> bool {
        self.state == TileState::Resident
    }

    /// Whether there is no point in asking for it.
    pub fn is_bad(&self) -> bool {
        self.state == TileState::Bad
    }

    /// Applies `event`; `false` (and no change) if it means nothing in this state. Nothing else changes a tile.
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
            (S::Loading, TileEvent::Fail { now, retry_after, jitter }) => self.failed(now, retry_after, jitter),
            (S::Loading, TileEvent::Damage { now, jitter }) => {
                self.damaged += 1;
                if self.damaged >= DAMAGE_LIMIT { S::Bad } else { self.failed(now, None, jitter) }
            }
            (S::Loading, TileEvent::Refuse) => S::Bad,
            _ => return false,
        };
        self.state = next;
        true
    }

    fn failed(&mut self, now: Duration, retry_after: Option<Duration>, jitter: f64) -> TileState {
        self.attempts = self.attempts.saturating_add(1);
        let wait = retry_after.map_or_else(|| retry_delay(self.attempts, jitter), |wait| wait.min(MAX_RETRY_AFTER));
        TileState::Failed { attempts: self.attempts, retry_at: now + wait }
    }
}

/// How long to wait after the `attempts`th failure in a row: doubling from 100 ms to 2 s, less up to half by `jitter`.
pub fn retry_delay(attempts: u8, jitter: f64) -> Duration {
    let full = FIRST_RETRY_DELAY.saturating_mul(1 << attempts.saturating_sub(1).min(10)).min(MAX_RETRY_DELAY);
    full.mul_f64(1.0 - 0.5 * jitter.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_straight_way() {
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
    fn failures_wait_longer_and_longer_but_never_give_up() {
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
    fn damage_is_bad_at_the_third_time_and_retry_after_is_obeyed() {
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
        let mut tile = TileRecord::default();
        tile.apply(TileEvent::Want { now });
        tile.apply(TileEvent::Start);
        tile.apply(TileEvent::Fail { now, retry_after: Some(Duration::from_secs(7)), jitter: 0.9 });
        assert_eq!(tile.state(), TileState::Failed { attempts: 1, retry_at: now + Duration::from_secs(7) });
    }
}
