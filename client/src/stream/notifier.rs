//! Wakes the thread that waits for arrivals.

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// A flag that one thread waits for. A notification without a waiting thread ends the next wait.
#[derive(Debug, Default)]
pub struct Notifier {
    is_notified: Mutex<bool>,
    condition: Condvar,
}

impl Notifier {
    /// Ends the current wait, or the next one.
    pub fn notify(&self) {
        *self.is_notified.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.condition.notify_one();
    }

    /// Waits for a notification, at most for `timeout`.
    pub fn wait(&self, timeout: Duration) {
        let guard = self.is_notified.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.condition.wait_timeout_while(guard, timeout, |is_notified| !*is_notified);
        *waited.unwrap_or_else(PoisonError::into_inner).0 = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::time::Instant;

    #[test]
    fn a_notification_ends_one_wait_even_if_it_comes_first() {
        let notifier = Arc::new(Notifier::default());
        notifier.notify();
        let long = Duration::from_secs(60);
        let begin = Instant::now();
        notifier.wait(long);
        let other = notifier.clone();
        let thread = std::thread::spawn(move || other.notify());
        notifier.wait(long);
        thread.join().unwrap();
        assert!(begin.elapsed() < long);
        notifier.wait(Duration::from_millis(1));
    }
}
