//! 3D Tiles archives (3TZ 1.3, Maxar): a ZIP file with stored entries, and an index of them as its last entry.

use crate::glb::ExportError;
use md5::{Digest, Md5};
use std::io::{self, Seek, SeekFrom, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

pub(super) const INDEX: &str = "@3dtilesIndex1@";
/// Bytes of a local file header without the name (ZIP 6.3.10, section 4.3.7).
const LOCAL_HEADER_BYTES: u64 = 30;

/// Writes an archive entry by entry.
pub(super) struct ArchiveWriter<W: Write + Seek> {
    zip: ZipWriter<UntilFailure<W>>,
    /// MD5 of each name, and where the entry's local header is.
    index: Vec<([u8; 16], u64)>,
    end: u64,
    name: String,
}

impl<W: Write + Seek> ArchiveWriter<W> {
    /// `name`: of the archive, for errors.
    pub(super) fn new(out: W, name: String) -> Self {
        Self {
            zip: ZipWriter::new(UntilFailure { out, has_failed: false, position: 0 }),
            index: Vec::new(),
            end: 0,
            name,
        }
    }

    pub(super) fn add(&mut self, name: &str, bytes: &[u8]) -> Result<(), ExportError> {
        self.index.push((Md5::digest(name).into(), self.end));
        self.end += LOCAL_HEADER_BYTES + name.len() as u64 + bytes.len() as u64;
        self.store(name, bytes).map_err(ExportError::writing(self.name.clone()))
    }

    fn store(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        // Entries have no time, so that the same tiles give the same archive.
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(zip::DateTime::default());
        self.zip.start_file(name, options)?;
        self.zip.write_all(bytes)
    }

    /// Writes the index, sorted by its hashes as two little-endian numbers, and the directory.
    pub(super) fn finish(mut self) -> Result<(), ExportError> {
        let number =
            |hash: &[u8; 16], at: usize| hash[at..at + 8].iter().rev().fold(0u64, |n, byte| n << 8 | u64::from(*byte));
        self.index.sort_by_key(|(hash, _)| (number(hash, 0), number(hash, 8)));
        let entry = |(hash, offset): &([u8; 16], u64)| [&hash[..], &offset.to_le_bytes()].concat();
        let bytes: Vec<u8> = self.index.iter().flat_map(entry).collect();
        let stored = self.store(INDEX, &bytes);
        let finished = stored.and_then(|()| Ok(self.zip.finish()?)).and_then(|mut out| out.flush());
        finished.map_err(ExportError::writing(self.name))
    }
}

/// Writes until it fails, and then only as if: an archive that is given up is ended when it is dropped, and would print that it cannot be.
struct UntilFailure<W> {
    out: W,
    has_failed: bool,
    /// Where the next byte goes.
    position: u64,
}

impl<W> UntilFailure<W> {
    fn run<T>(&mut self, as_if: T, run: impl FnOnce(&mut W) -> io::Result<T>) -> io::Result<T> {
        if self.has_failed {
            return Ok(as_if);
        }
        run(&mut self.out).inspect_err(|error| self.has_failed = error.kind() != io::ErrorKind::Interrupted)
    }
}

impl<W: Write> Write for UntilFailure<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.run(bytes.len(), |out| out.write(bytes))?;
        self.position += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.run((), Write::flush)
    }
}

impl<W: Seek> Seek for UntilFailure<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let as_if = match to {
            SeekFrom::Start(position) => position,
            SeekFrom::Current(offset) | SeekFrom::End(offset) => self.position.saturating_add_signed(offset),
        };
        self.position = self.run(as_if, |out| out.seek(to))?;
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;
    use std::io::Cursor;

    /// A disk of 100 bytes, which counts what comes when it is full.
    struct SmallDisk<'a>(Cursor<Vec<u8>>, &'a Cell<u32>);

    impl Write for SmallDisk<'_> {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.0.position() + bytes.len() as u64 > 100 {
                self.1.set(self.1.get() + 1);
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.0.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for SmallDisk<'_> {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    #[test]
    fn an_archive_on_a_full_disk_fails_once() {
        let failures = Cell::new(0);
        let mut archive = ArchiveWriter::new(SmallDisk(Cursor::default(), &failures), "a.3tz".into());
        let error = archive.add("tileset.json", &[b' '; 200]).unwrap_err();
        assert!(error.to_string().contains("a.3tz"), "{error}");
        // What the library does when it is dropped, where it prints an error.
        assert!(archive.zip.finish().is_ok());
        assert_eq!(failures.get(), 1);
    }
}
