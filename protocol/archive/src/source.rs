//! Byte ranges of a file, an object in a bucket, or a file behind a web server.

use crate::ReadError;
use bytes::Bytes;
/// A boxed future. It is `Send` except in WebAssembly, where values of JavaScript are not.
#[cfg(not(target_arch = "wasm32"))]
pub use futures_util::future::BoxFuture;
#[cfg(target_arch = "wasm32")]
pub use futures_util::future::LocalBoxFuture as BoxFuture;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::Arc;

/// A source that several readers share, also between threads except in WebAssembly.
#[cfg(not(target_arch = "wasm32"))]
pub type SharedSource = Arc<dyn RangeSource + Send + Sync>;
/// A source that several readers share.
#[cfg(target_arch = "wasm32")]
pub type SharedSource = Arc<dyn RangeSource>;

/// Something whose byte ranges can be read.
///
/// A source reads one version of its object: if the length or the version of a response differs from the first response, the
/// read fails with [`ReadError::Replaced`].
pub trait RangeSource: Debug {
    /// Length in bytes. `None` until a response contains it.
    fn length(&self) -> Option<u64>;

    /// The same of the file alone, without an archive that follows it ([`crate::joined`]).
    fn own_bytes(&self) -> Option<u64> {
        self.length()
    }

    /// Reads a range. The result is shorter than the range only where the object ends.
    fn read(&self, range: Range<u64>) -> RangeRead;

    /// Drops what is cached of a range, because its bytes are damaged.
    fn invalidate(&self, _range: Range<u64>) -> BoxFuture<'_, ()> {
        Box::pin(std::future::ready(()))
    }
}

/// The result of a read, or a future that gives it.
pub enum RangeRead {
    /// Files answer at once, which saves the allocation of a future.
    Ready(Result<Bytes, ReadError>),
    /// The bytes have to be fetched.
    Pending(BoxFuture<'static, Result<Bytes, ReadError>>),
}

impl RangeRead {
    /// Waits for the bytes if necessary.
    pub async fn bytes(self) -> Result<Bytes, ReadError> {
        match self {
            Self::Ready(bytes) => bytes,
            Self::Pending(bytes) => bytes.await,
        }
    }

    /// The bytes of a source that answers at once. Fails for all others.
    pub fn ready(self) -> Result<Bytes, ReadError> {
        match self {
            Self::Ready(bytes) => bytes,
            Self::Pending(_) => Err(ReadError::Failed("the archive is not a local file".into())),
        }
    }
}

/// Reads a range that must lie inside the object.
pub(crate) async fn read_exactly(source: &SharedSource, range: Range<u64>) -> Result<Bytes, ReadError> {
    let bytes = source.read(range.clone()).bytes().await?;
    if bytes.len() as u64 == range.end - range.start {
        Ok(bytes)
    } else {
        Err(ReadError::Failed("the archive ends before its tiles do".into()))
    }
}
