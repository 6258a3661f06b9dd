//! Threads of work that takes seconds.

use rayon::{ThreadPool, ThreadPoolBuilder};

/// The threads of a piece of work. All of a kind that run at once have half of the cores, so that tiles do not wait, and at least one thread
/// each.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorkThreads {
    threads: usize,
    name: &'static str,
}

impl WorkThreads {
    /// Of work of which so many pieces run at once.
    pub(super) fn new(at_once: usize, name: &'static str) -> Self {
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        Self { threads: cores.div_ceil(2).div_ceil(at_once.max(1)), name }
    }

    /// Works on threads that are shared with no other piece: a short one would wait for a long one.
    pub(super) fn install<T: Send>(self, work: impl FnOnce() -> T + Send) -> T {
        match self.pool() {
            Some(threads) => threads.install(work),
            // On the process's own.
            None => work(),
        }
    }

    /// `None` if the system has no more threads.
    fn pool(self) -> Option<ThreadPool> {
        let builder = ThreadPoolBuilder::new().num_threads(self.threads);
        builder.thread_name(move |k| format!("{}-{k}", self.name)).build().ok()
    }
}
