//! Limits the messages of one kind, so that clients cannot flood the log.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Messages of one kind that are logged per [`WINDOW`].
const MAX_MESSAGES: u32 = 10;
const WINDOW: Duration = Duration::from_secs(1);

/// The messages of one kind.
#[derive(Debug, Default)]
pub(super) struct LogLimit(Mutex<Option<LogWindow>>);

#[derive(Debug)]
struct LogWindow {
    started: Instant,
    messages: u32,
    suppressed: u64,
}

impl LogLimit {
    /// Counts a message of `kind`. `false`: it must not be logged. The first one after others were suppressed logs their number.
    pub(super) fn admit(&self, kind: &'static str) -> bool {
        match self.admit_at(Instant::now()) {
            Some(0) => true,
            Some(suppressed) => {
                tracing::warn!(kind, suppressed, "too many messages of this kind: some were not logged");
                true
            }
            None => false,
        }
    }

    /// The number of messages that were suppressed before this one; `None` if this one is.
    fn admit_at(&self, now: Instant) -> Option<u64> {
        let mut window = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &mut *window {
            Some(window) if now.saturating_duration_since(window.started) < WINDOW => {
                if window.messages >= MAX_MESSAGES {
                    window.suppressed += 1;
                    return None;
                }
                window.messages += 1;
                Some(0)
            }
            ended => {
                let suppressed = ended.as_ref().map_or(0, |window| window.suppressed);
                *ended = Some(LogWindow { started: now, messages: 1, suppressed: 0 });
                Some(suppressed)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_cut_and_counted() {
        let (limit, start) = (LogLimit::default(), Instant::now());
        let admitted = |millis| limit.admit_at(start + Duration::from_millis(millis));
        assert!((0..u64::from(MAX_MESSAGES)).all(|at| admitted(at) == Some(0)));
        assert!((0..90).all(|at| admitted(at).is_none()));
        assert_eq!((admitted(1000), admitted(1001)), (Some(90), Some(0)));
    }
}
