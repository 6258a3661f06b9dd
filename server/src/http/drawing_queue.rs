//! Which drawings are made now, and which wait.

use crate::config::DrawingsConfig;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::{sync::Arc, time::Duration};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// The drawings of a server: a few at once on threads of their own, so that tiles do not wait for them, and a few that wait.
#[derive(Debug)]
pub(super) struct DrawingQueue {
    /// For the drawings in work and those that wait.
    places: Arc<Semaphore>,
    running: Arc<Semaphore>,
    /// `None` if the system has no more threads: drawings are then made on the process's own.
    threads: Option<Arc<ThreadPool>>,
    max_time: Duration,
    max_triangles: usize,
}

/// A place in the queue.
pub(super) struct DrawingPlace {
    running: Arc<Semaphore>,
    place: OwnedSemaphorePermit,
}

/// The right to make a drawing now. It lasts until it is dropped.
pub(super) struct DrawingTurn {
    _place: OwnedSemaphorePermit,
    _running: OwnedSemaphorePermit,
}

impl DrawingQueue {
    /// `None` if no drawings are to be made.
    pub(super) fn new(config: &DrawingsConfig) -> Option<Self> {
        if config.at_once == 0 {
            return None;
        }
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        let threads =
            ThreadPoolBuilder::new().num_threads(cores.div_ceil(2)).thread_name(|k| format!("draw-{k}")).build();
        Some(Self {
            places: Arc::new(Semaphore::new(config.at_once.saturating_add(config.waiting).min(Semaphore::MAX_PERMITS))),
            running: Arc::new(Semaphore::new(config.at_once.min(Semaphore::MAX_PERMITS))),
            threads: threads.ok().map(Arc::new),
            max_time: Duration::from_secs(config.secs),
            max_triangles: config.triangles,
        })
    }

    /// A place in the queue; `None` if it is full.
    pub(super) fn enter(&self) -> Option<DrawingPlace> {
        let place = Arc::clone(&self.places).try_acquire_owned().ok()?;
        Some(DrawingPlace { running: Arc::clone(&self.running), place })
    }

    pub(super) fn threads(&self) -> Option<Arc<ThreadPool>> {
        self.threads.clone()
    }

    pub(super) fn max_time(&self) -> Duration {
        self.max_time
    }

    pub(super) fn max_triangles(&self) -> usize {
        self.max_triangles
    }
}

impl DrawingPlace {
    /// Waits until fewer drawings than the limit are in work; `None` if the server ends.
    pub(super) async fn turn(self) -> Option<DrawingTurn> {
        let running = self.running.acquire_owned().await.ok()?;
        Some(DrawingTurn { _place: self.place, _running: running })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt;

    fn queue(at_once: usize, waiting: usize) -> Option<DrawingQueue> {
        DrawingQueue::new(&DrawingsConfig { at_once, waiting, secs: 1, triangles: 1000 })
    }

    #[tokio::test]
    async fn a_full_queue_lets_nobody_in() {
        assert!(queue(0, 9).is_none());
        let queue = queue(1, 1).unwrap();
        let turn = queue.enter().unwrap().turn().await.unwrap();
        let waiting = queue.enter().unwrap();
        assert!(queue.enter().is_none());
        assert!(waiting.turn().now_or_never().is_none(), "one at once");
        // The one that waited has left.
        let waiting = queue.enter().unwrap();
        drop(turn);
        assert!(waiting.turn().await.is_some());
        assert!(queue.enter().is_some());
    }
}
