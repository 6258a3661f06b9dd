//! A file as a source of ranges.

use crate::limits::MAX_READ_BYTES;
use crate::open_files::OpenFile;
use crate::{RangeRead, RangeSource, ReadError};
use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// A regular file.
///
/// It is read, not mapped: if a mapped file is truncated, the next access ends the process, and bytes that were checked in a
/// mapping may change before they are sent. Not all of them are open at the same time: see [`crate::open_files`].
#[derive(Debug)]
pub struct FileSource(OpenFile);

impl FileSource {
    /// Opens a regular file; see [`crate::file::open_regular`].
    pub fn open(path: &Path) -> io::Result<Self> {
        OpenFile::open(path).map(Self)
    }
}

impl RangeSource for FileSource {
    fn length(&self) -> Option<u64> {
        Some(self.0.length())
    }

    fn read(&self, range: Range<u64>) -> RangeRead {
        let end = range.end.min(self.0.length());
        if range.start > end || end - range.start > MAX_READ_BYTES {
            return RangeRead::Ready(Err(ReadError::Failed("the range lies outside the file".into())));
        }
        let mut bytes = vec![0; (end - range.start) as usize];
        let read = |file: Arc<File>| read_exact_at(&file, &mut bytes, range.start).map_err(ReadError::from);
        RangeRead::Ready(self.0.handle().and_then(read).map(|()| bytes.into()))
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
