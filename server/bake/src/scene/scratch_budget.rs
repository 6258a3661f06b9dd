//! The limit of the scratch scene on disk.
//!
//! A small source can ask for any amount: instances of a template, packed images, and triangles that cover thousands of
//! blocks, each of which gets a copy.

use crate::error::BakeError;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of scratch files that may still be written. Clones share them.
#[derive(Debug, Clone)]
pub(crate) struct ScratchBudget {
    limit_bytes: u64,
    used_bytes: Arc<AtomicU64>,
}

impl ScratchBudget {
    pub(crate) fn new(limit_bytes: u64) -> Self {
        Self { limit_bytes, used_bytes: Arc::default() }
    }

    /// Counts bytes before they are written. Fails if they exceed the limit.
    pub(crate) fn spend(&self, bytes: usize) -> Result<(), BakeError> {
        let before = self.used_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
        if before.saturating_add(bytes as u64) > self.limit_bytes {
            return Err(BakeError::ScratchLimit { limit_mib: self.limit_bytes >> 20 });
        }
        Ok(())
    }
}
