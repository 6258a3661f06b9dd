//! The threads and limits of drawings.

use crate::config::DrawingsConfig;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// How drawings are made.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drawings {
    /// Threads of one drawing. All that are made at once have half of the cores, so that tiles do not wait, and at least one thread each.
    threads: usize,
    pub(super) max_triangles: usize,
}

impl Drawings {
    /// `None` if no drawings are to be made.
    pub(super) fn new(config: &DrawingsConfig) -> Option<Self> {
        if config.at_once == 0 {
            return None;
        }
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        Some(Self { threads: cores.div_ceil(2).div_ceil(config.at_once), max_triangles: config.triangles })
    }

    /// The threads of a drawing, which it shares with no other: a short one would wait for a long one. `None` if the system has no
    /// more threads.
    pub(super) fn pool(self) -> Option<ThreadPool> {
        ThreadPoolBuilder::new().num_threads(self.threads).thread_name(|k| format!("draw-{k}")).build().ok()
    }
}
