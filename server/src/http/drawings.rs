//! Threads and limits of drawings.

use crate::config::DrawingsConfig;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;

/// How drawings are made.
#[derive(Debug)]
pub(super) struct Drawings {
    /// Half of the cores, so that tiles do not wait. `None` if the system has no more threads: the process's own are used then.
    pub(super) threads: Option<Arc<ThreadPool>>,
    pub(super) max_triangles: usize,
}

impl Drawings {
    /// `None` if no drawings are to be made.
    pub(super) fn new(config: &DrawingsConfig) -> Option<Self> {
        if config.at_once == 0 {
            return None;
        }
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        let threads =
            ThreadPoolBuilder::new().num_threads(cores.div_ceil(2)).thread_name(|k| format!("draw-{k}")).build();
        Some(Self { threads: threads.ok().map(Arc::new), max_triangles: config.triangles })
    }
}
