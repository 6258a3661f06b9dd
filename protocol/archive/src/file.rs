//! Regular files of this machine.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// Opens a regular file for reading. Fails for pipes, devices and folders, without waiting for the other end of a pipe.
pub fn open_regular(path: &Path) -> io::Result<File> {
    let check = |about: fs::Metadata| {
        let error = || io::Error::new(io::ErrorKind::InvalidInput, "not a regular file");
        if about.is_file() { Ok(()) } else { Err(error()) }
    };
    check(fs::metadata(path)?)?;
    let file = File::open(path)?;
    check(file.metadata()?)?;
    Ok(file)
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RangeSource;
    use crate::file_source::FileSource;

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
