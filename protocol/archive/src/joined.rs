//! An archive of a release of a city: its own file, and behind it the archive of the city with which it shares tiles.
//!
//! The directories of such an archive name the tiles of both by one range of positions, so all that reads archives reads it.

use crate::ReadError;
use crate::directory::HEADER_BYTES;
use crate::mark::MARK_AT;
use crate::source::{BoxFuture, RangeRead, RangeSource, SharedSource};
use bytes::Bytes;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Position at which the other archive begins, however long the file itself is.
pub const SHARED_AT: u64 = 1 << 40;

/// A file, and the archive whose bytes follow at [`SHARED_AT`].
#[derive(Debug)]
struct JoinedSource {
    own: SharedSource,
    shared: SharedSource,
    /// The mark of the version that the other archive must have ([`crate::mark`]).
    mark: [u8; 8],
    is_checked: Arc<AtomicBool>,
}

/// The source of an archive that shares tiles with others: their sources and marks, the nearest first.
pub fn joined(own: SharedSource, shared: &mut dyn Iterator<Item = (SharedSource, [u8; 8])>) -> SharedSource {
    let Some((next, mark)) = shared.next() else { return own };
    Arc::new(JoinedSource { own, shared: joined(next, shared), mark, is_checked: Arc::default() })
}

/// Fails if the first bytes of an archive have another mark.
pub(crate) fn check_mark(head: Result<Bytes, ReadError>, mark: [u8; 8]) -> Result<(), ReadError> {
    if head?.get(MARK_AT) == Some(&mark[..]) { Ok(()) } else { Err(ReadError::Replaced) }
}

impl RangeSource for JoinedSource {
    fn length(&self) -> Option<u64> {
        SHARED_AT.checked_add(self.shared.length()?)
    }

    fn own_bytes(&self) -> Option<u64> {
        self.own.own_bytes()
    }

    fn read(&self, range: Range<u64>) -> RangeRead {
        let Some(start) = range.start.checked_sub(SHARED_AT) else {
            return match range.end <= SHARED_AT {
                true => self.own.read(range),
                false => RangeRead::Ready(Err(ReadError::Damaged("a tile is in two files".into()))),
            };
        };
        let (range, mark) = (start..range.end.saturating_sub(SHARED_AT), self.mark);
        if self.is_checked.load(Ordering::Relaxed) {
            return self.shared.read(range);
        }
        match self.shared.read(0..HEADER_BYTES) {
            RangeRead::Ready(head) => match check_mark(head, mark) {
                Ok(()) => {
                    self.is_checked.store(true, Ordering::Relaxed);
                    self.shared.read(range)
                }
                Err(error) => RangeRead::Ready(Err(error)),
            },
            RangeRead::Pending(head) => {
                let (shared, is_checked) = (self.shared.clone(), Arc::clone(&self.is_checked));
                RangeRead::Pending(Box::pin(async move {
                    check_mark(head.await, mark)?;
                    is_checked.store(true, Ordering::Relaxed);
                    shared.read(range).bytes().await
                }))
            }
        }
    }

    fn invalidate(&self, range: Range<u64>) -> BoxFuture<'_, ()> {
        match range.start.checked_sub(SHARED_AT) {
            Some(start) => self.shared.invalidate(start..range.end.saturating_sub(SHARED_AT)),
            None => self.own.invalidate(range),
        }
    }
}

#[cfg(test)]
#[cfg(feature = "fs")]
mod tests;
