//! Regular files of this machine.

pub use crate::open_files::open_regular;
use crate::{RangeRead, RangeSource, ReadError, limits::MAX_READ_BYTES, open_files::OpenFile};
use std::{
    fs::File,
    io::{self, Read},
    ops::Range,
    path::Path,
    sync::Arc,
};

/// The bytes of a regular file of at most `limit` bytes. Fails as [`open_regular`], with `FileTooLarge` for a longer file, or if it
/// cannot be read.
pub fn read_limited(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    let too_large = || io::Error::new(io::ErrorKind::FileTooLarge, format!("larger than {limit} bytes"));
    let file = open_regular(path)?;
    if file.metadata()?.len() > limit {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit { Err(too_large()) } else { Ok(bytes) }
}

/// The text of a regular file of at most `limit` bytes. Fails as [`read_limited`], or with `InvalidData` if it is not UTF-8.
pub fn read_text(path: &Path, limit: u64) -> io::Result<String> {
    let text = String::from_utf8(read_limited(path, limit)?);
    text.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error.utf8_error()))
}

/// A regular file.
///
/// It is read, not mapped: if a mapped file is truncated, the next access ends the process, and bytes that were checked in a
/// mapping may change before they are sent. Not all of them are open at the same time: see [`crate::open_files`].
#[derive(Debug)]
pub struct FileSource(OpenFile);

impl FileSource {
    /// Opens a regular file; see [`open_regular`].
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn reads_ranges_up_to_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, b"0123456789").unwrap();
        let source = FileSource::open(&path).unwrap();
        let read = |range| source.read(range).ready();
        assert_eq!(source.length(), Some(10));
        assert_eq!(read(2..5).unwrap(), &b"234"[..]);
        assert_eq!(read(8..99).unwrap(), &b"89"[..]);
        assert_eq!(read(10..10).unwrap(), &b""[..]);
        assert!(read(11..12).is_err());
        fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(4).unwrap();
        assert!(read(2..6).is_err(), "the file was truncated after it was opened");
    }

    #[cfg(unix)]
    #[test]
    fn refuses_what_is_no_regular_file_without_blocking() {
        let folder = tempfile::tempdir().unwrap();
        let fifo = folder.path().join("fifo");
        assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&fifo, &link).unwrap();
        for path in [&fifo, &link, folder.path(), Path::new("/dev/null")] {
            assert_eq!(FileSource::open(path).unwrap_err().kind(), io::ErrorKind::InvalidInput, "{}", path.display());
            assert_eq!(read_limited(path, 9).unwrap_err().kind(), io::ErrorKind::InvalidInput, "{}", path.display());
        }
    }

    #[test]
    fn files_over_a_limit_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, b"0123456789").unwrap();
        assert_eq!(read_text(&path, 10).unwrap(), "0123456789");
        assert_eq!(read_limited(&path, 9).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
        fs::write(&path, b"\xff").unwrap();
        assert_eq!(read_text(&path, 10).unwrap_err().kind(), io::ErrorKind::InvalidData);
    }
}
