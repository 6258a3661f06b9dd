//! Work of requests that takes long, on threads of its own: a few at once, and no client waits for ever.

use std::time::Duration;
use tokio::{sync::Semaphore, task::spawn_blocking, time::timeout};

/// Runs `work` once `running` has a permit, which it holds to its end. `None` if waiting and work take longer than `max_time`, or if the
/// work panics. A thread that takes too long cannot be stopped: it keeps its permit.
pub(super) async fn run<T: Send + 'static>(
    running: &'static Semaphore,
    max_time: Duration,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let task = async {
        let permit = running.acquire().await.ok()?;
        let worked = spawn_blocking(move || {
            let result = work();
            drop(permit);
            result
        });
        worked.await.ok()
    };
    timeout(max_time, task).await.ok()?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn work_that_panics_fails_alone() {
        static RUNNING: Semaphore = Semaphore::const_new(2);
        let limit = Duration::from_secs(600);
        assert_eq!(run(&RUNNING, limit, || panic!("a fault")).await, None::<()>);
        assert_eq!(run(&RUNNING, limit, || 1).await, Some(1));
        assert_eq!(RUNNING.available_permits(), 2);
    }

    #[tokio::test]
    async fn work_without_a_permit_ends_at_its_limit() {
        static RUNNING: Semaphore = Semaphore::const_new(0);
        assert_eq!(run(&RUNNING, Duration::from_millis(1), || 1).await, None);
    }
}
