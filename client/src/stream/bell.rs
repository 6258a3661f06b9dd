//! Who waits for arrivals is told of them.
//!
//! In: rings, from any thread. Out: an end of the waiting. Next: `session`.

use std::{
    sync::{Condvar, Mutex, PoisonError},
    time::Duration,
};

/// A bell that goes on ringing until somebody hears it.
#[derive(Debug, Default)]
pub struct Bell {
    rings: Mutex<bool>,
    heard: Condvar,
}

impl Bell {
    /// Ends the waiting, or the next one.
    pub fn ring(&self) {
        *self.rings.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.heard.notify_one();
    }

    /// Waits until it rings, or rang since the last time; at most for `timeout`.
    pub fn wait(&self, timeout: Duration) {
        let rings = self.rings.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.heard.wait_timeout_while(rings, timeout, |rings| !*rings);
        *waited.unwrap_or_else(PoisonError::into_inner).0 = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{sync::Arc, time::Instant};

    #[test]
    fn a_ring_is_heard_once_even_if_nobody_waits_yet() {
        let bell = Arc::new(Bell::default());
        bell.ring();
        let long = Duration::from_secs(60);
        let begin = Instant::now();
        bell.wait(long);
        let other = bell.clone();
        let ringer = std::thread::spawn(move || other.ring());
        bell.wait(long);
        ringer.join().unwrap();
        assert!(begin.elapsed() < long);
        bell.wait(Duration::from_millis(1));
    }
}
