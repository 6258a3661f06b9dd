//! How much of an input is fetched at most.

use insula_protocol::route::without_secrets;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Most bytes, and longest time, of all files of an input: a server that makes tiles as they are asked for has no end.
pub(crate) const MAX_INPUT_BYTES: u64 = 256 << 30;
const MAX_INPUT_TIME: Duration = Duration::from_secs(24 * 60 * 60);

/// What has been fetched of an input.
#[derive(Debug)]
pub(crate) struct InputBudget {
    bytes: AtomicU64,
    start: Instant,
}

impl InputBudget {
    /// Time counts from now on.
    pub(crate) fn start() -> Self {
        Self { bytes: AtomicU64::new(0), start: Instant::now() }
    }

    /// Fails if nothing more may be fetched, with the address of the input or of its file.
    pub(crate) fn check(&self, address: &str) -> io::Result<()> {
        let what = if self.bytes.load(Ordering::Relaxed) >= MAX_INPUT_BYTES {
            format!("more than {MAX_INPUT_BYTES} bytes in all")
        } else if self.start.elapsed() > MAX_INPUT_TIME {
            format!("longer than {} s in all", MAX_INPUT_TIME.as_secs())
        } else {
            return Ok(());
        };
        Err(io::Error::other(format!("{}: {what}", without_secrets(address))))
    }

    pub(crate) fn spend(&self, bytes: u64) {
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
    }
}
