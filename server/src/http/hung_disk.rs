//! Limits for reads of files while a disk or a network file system does not respond.
//!
//! A thread that waits for such a file system cannot be stopped. It is left alone, and others do its work later; but only so many
//! may be left, or each check would add one.

use std::future::{Future, pending};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Semaphore;
use tokio::task::{AbortHandle, JoinSet, spawn_blocking};
use tokio::time::timeout;

/// Most reads, and most checks, that run at the same time because earlier ones do not end.
const MAX_RUNNING: usize = 4;

/// Reads of some files, one at a time except for those that do not end.
pub(super) struct TimedReads {
    limit: Duration,
    permits: Arc<Semaphore>,
}

impl TimedReads {
    /// Reads end within `limit`, or are left alone.
    pub(super) fn new(limit: Duration) -> Self {
        Self { limit, permits: Arc::new(Semaphore::new(MAX_RUNNING)) }
    }

    /// Runs `read` on a thread. `None` if it takes too long, or if too many others still run.
    pub(super) async fn run<T: Send + 'static>(&self, read: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        let permit = self.permits.clone().try_acquire_owned().ok()?;
        let task = spawn_blocking(move || {
            let result = read();
            drop(permit);
            result
        });
        // A task fails only if it panics, or is cancelled at the end of the process.
        timeout(self.limit, task).await.ok()?.ok()
    }
}

/// Checks that run: the newest, and earlier ones that have not ended. Only results newer than those used before count.
pub(super) struct RunningChecks<T> {
    /// A check that takes longer may be overtaken by another.
    patience: Duration,
    tasks: JoinSet<(u64, T)>,
    newest: Option<AbortHandle>,
    started: Instant,
    count: u64,
    /// Number of the last check whose result was used.
    used: u64,
}

impl<T: Send + 'static> RunningChecks<T> {
    pub(super) fn new(patience: Duration) -> Self {
        Self { patience, tasks: JoinSet::new(), newest: None, started: Instant::now(), count: 0, used: 0 }
    }

    /// How long the newest check has run; `None` if it has ended.
    pub(super) fn running_for(&self) -> Option<Duration> {
        self.newest.as_ref().filter(|newest| !newest.is_finished()).map(|_| self.started.elapsed())
    }

    /// Whether another check may start.
    pub(super) fn can_start(&self) -> bool {
        self.running_for().is_none_or(|time| time >= self.patience) && self.tasks.len() < MAX_RUNNING
    }

    pub(super) fn start(&mut self, check: impl Future<Output = T> + Send + 'static) {
        self.count += 1;
        let number = self.count;
        self.started = Instant::now();
        self.newest = Some(self.tasks.spawn(async move { (number, check.await) }));
    }

    /// The next result; `None` if the check panicked. Waits for ever if no check runs.
    pub(super) async fn next(&mut self) -> Option<T> {
        loop {
            match self.tasks.join_next().await {
                None => pending().await,
                Some(Err(_)) => return None,
                Some(Ok((number, _))) if number < self.used => {}
                Some(Ok((number, result))) => {
                    self.used = number;
                    return Some(result);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt;
    use std::sync::atomic::AtomicBool;
    use std::sync::atomic::Ordering::Relaxed;
    use std::sync::mpsc::{Receiver, sync_channel};

    const LONG: Duration = Duration::from_secs(600);

    fn wait_for(end: &Receiver<()>) -> &'static str {
        let _ = end.recv();
        "late"
    }

    #[tokio::test]
    async fn reads_that_hang_are_left_alone_up_to_a_number() {
        let reads = TimedReads::new(LONG);
        // What has not ended when it is asked for is left alone.
        let impatient = TimedReads { limit: Duration::ZERO, permits: reads.permits.clone() };
        let mut ends = Vec::new();
        for _ in 0..MAX_RUNNING {
            assert_eq!(reads.run(|| "read").await, Some("read"));
            let (end, ended) = sync_channel(0);
            ends.push(end);
            assert_eq!(impatient.run(move || wait_for(&ended)).await, None);
        }
        let has_run = Arc::new(AtomicBool::new(false));
        let runs = has_run.clone();
        assert_eq!(reads.run(move || runs.store(true, Relaxed)).await, None);
        assert!(!has_run.load(Relaxed), "too many threads");
        drop(ends.pop());
        while reads.permits.available_permits() == 0 {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        assert_eq!(reads.run(|| "read").await, Some("read"), "the file system responds again");
    }

    #[tokio::test]
    async fn a_check_that_hangs_is_overtaken_and_its_late_result_is_not_used() {
        let mut checks = RunningChecks::new(LONG);
        let mut ends = Vec::new();
        for _ in 1..MAX_RUNNING {
            checks.patience = Duration::ZERO;
            assert!(checks.can_start(), "the one before takes too long");
            checks.patience = LONG;
            let (end, ended) = sync_channel(0);
            ends.push(end);
            checks.start(async move { spawn_blocking(move || wait_for(&ended)).await.unwrap_or("") });
            assert!(!checks.can_start() && checks.running_for().is_some(), "one at a time");
            assert!(checks.next().now_or_never().is_none());
        }
        checks.patience = Duration::ZERO;
        for _ in 0..3 {
            assert!(checks.can_start());
            checks.start(async { "found" });
            assert_eq!(checks.next().await, Some("found"));
        }
        checks.start(pending());
        assert!(!checks.can_start(), "only so many are left alone");
        ends.clear();
        while checks.tasks.len() > 1 {
            assert!(timeout(Duration::from_millis(1), checks.next()).await.is_err(), "the others ended too late");
        }
        assert!(checks.can_start());
    }
}
