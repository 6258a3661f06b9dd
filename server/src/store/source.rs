//! Where an archive's bytes come from: the one trait of all stores.
//!
//! In: a range of bytes. Out: those bytes, now or later. Next: `archive` reads directories and tiles through it.

use bytes::Bytes;
use std::{
    fmt::Debug,
    fs::File,
    future::Future,
    io,
    ops::Range,
    pin::{Pin, pin},
    task::{Context, Poll, Waker},
};

/// Most bytes that one read may ask for; taken before memory is.
const MAX_READ_BYTES: u64 = 1 << 30;

/// A file, an object in a bucket, a file behind a web server.
pub trait Source: Debug + Send + Sync {
    /// Its length in bytes when it was opened.
    fn file_bytes(&self) -> u64;

    /// The bytes of a range. Errors: the store fails, or the file is shorter than it was.
    fn read(&self, range: Range<u64>) -> Read;

    /// What was read there fails its checksum: whatever is kept of it shall be fetched again.
    fn forget(&self, _range: Range<u64>) -> Pin<Box<dyn Future<Output = ()> + Send + '_>> {
        Box::pin(std::future::ready(()))
    }
}

/// Bytes that are at hand, or on their way.
pub enum Read {
    /// Files answer at once, without an allocation for a future.
    Now(Result<Bytes, ReadError>),
    /// What has to be fetched.
    Later(Pin<Box<dyn Future<Output = Result<Bytes, ReadError>> + Send>>),
}

/// Why bytes of an archive cannot be had. Its text is for the host's log, never for a client.
#[derive(Debug, Clone, thiserror::Error)]
pub enum ReadError {
    /// The operating system or the store says no; asking again may help.
    #[error("cannot read: {0}")]
    Failed(String),
    /// What is there is not what was written: its checksum is wrong.
    #[error("damaged: {0}")]
    Damaged(String),
    /// The object is another one now.
    #[error("it was replaced since it was opened")]
    Replaced,
}

impl From<io::Error> for ReadError {
    fn from(error: io::Error) -> Self {
        Self::Failed(error.to_string())
    }
}

impl Read {
    /// Waits for them, if need be.
    pub async fn bytes(self) -> Result<Bytes, ReadError> {
        match self {
            Self::Now(bytes) => bytes,
            Self::Later(bytes) => bytes.await,
        }
    }
}

/// The result of a future that waits for nothing, as all of files do.
pub(super) fn at_once<T>(future: impl Future<Output = T>) -> Option<T> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

/// A file of this machine.
///
/// It is read, not mapped: a map of a file that is cut short under it ends the process at the next touch, and bytes that were
/// checked in a map may be others when they are sent. What a read returned is ours.
#[derive(Debug)]
pub(super) struct FileSource {
    file: File,
    file_bytes: u64,
}

impl FileSource {
    pub(super) fn new(file: File) -> io::Result<Self> {
        let file_bytes = file.metadata()?.len();
        Ok(Self { file, file_bytes })
    }
}

impl Source for FileSource {
    fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    fn read(&self, range: Range<u64>) -> Read {
        let length = range.end.saturating_sub(range.start);
        if length > MAX_READ_BYTES || range.end > self.file_bytes {
            return Read::Now(Err(ReadError::Failed("the range lies outside of the file".into())));
        }
        let mut bytes = vec![0; length as usize];
        Read::Now(read_exact_at(&self.file, &mut bytes, range.start).map(|()| bytes.into()).map_err(ReadError::from))
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            read => {
                bytes = &mut bytes[read..];
                offset += read as u64;
            }
        }
    }
    Ok(())
}
