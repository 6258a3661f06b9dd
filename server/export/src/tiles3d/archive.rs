//! 3D Tiles archives (3TZ 1.3, Maxar): a ZIP file with stored entries, and an index of them as its last entry.

use crate::glb::ExportError;
use md5::{Digest, Md5};
use std::io::{self, Seek, Write};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// Name of the index.
pub(super) const INDEX: &str = "@3dtilesIndex1@";
/// Bytes of a local file header without the name (ZIP 6.3.10, section 4.3.7).
const LOCAL_HEADER_BYTES: u64 = 30;

/// Writes an archive entry by entry.
pub(super) struct ArchiveWriter<W: Write + Seek> {
    zip: ZipWriter<W>,
    /// MD5 of each name, and where the entry's local header is.
    index: Vec<([u8; 16], u64)>,
    end: u64,
    name: String,
}

impl<W: Write + Seek> ArchiveWriter<W> {
    /// `name`: of the archive, for errors.
    pub(super) fn new(out: W, name: String) -> Self {
        Self { zip: ZipWriter::new(out), index: Vec::new(), end: 0, name }
    }

    /// Adds a file.
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
