//! Files of a ZIP archive, read without unpacking it: `.zip`, and the archives of tilesets (`.3tz`) and scene layers (`.slpk`).

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use flate2::read::DeflateDecoder;
use zip::{CompressionMethod, ZipArchive};

use super::files::copy_to_disk;
use super::input::{LocalFile, SourceFiles};
use crate::error::InputError;

/// An archive with more entries is refused: each is in memory.
const MAX_ENTRIES: usize = 4_000_000;
/// An entry that is copied to disk may have this many unpacked bytes.
const MAX_COPY_BYTES: u64 = 8 << 30;

/// Whether the file's name is that of an archive that is read.
pub(super) fn is_archive(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    [".zip", ".3tz", ".slpk"].iter().any(|extension| name.ends_with(extension))
}

/// The entries of an archive by their normalised names. Names that lead out of the archive are left out, so that no name in
/// a city file reaches them; nothing is ever written under an entry's name.
pub(super) struct ZipFiles {
    path: PathBuf,
    archive: RefCell<ZipArchive<BufReader<File>>>,
    /// Index of each entry.
    entries: BTreeMap<String, usize>,
    /// Entries whose names lead out of the archive.
    pub(super) refused: Vec<String>,
}

impl ZipFiles {
    /// Reads the directory of an archive. Fails if the file is no archive or is damaged.
    pub(super) fn new(path: &Path) -> Result<Self, InputError> {
        let label = path.display().to_string();
        let file = File::open(path).map_err(|cause| InputError::io(&label, cause))?;
        let damaged = |what: String| InputError::damaged(&label, "archive", what);
        let archive = ZipArchive::new(BufReader::new(file)).map_err(|error| damaged(error.to_string()))?;
        if archive.len() > MAX_ENTRIES {
            let what = "its number of entries".to_owned();
            return Err(InputError::TooLarge { path: label, what, limit: MAX_ENTRIES as u64 });
        }
        let (mut entries, mut refused) = (BTreeMap::new(), Vec::new());
        for index in 0..archive.len() {
            let Some(name) = archive.name_for_index(index).and_then(Result::ok).map(String::from) else { continue };
            match normalise(&name) {
                Some(normal) if !name.ends_with('/') => {
                    entries.entry(normal).or_insert(index);
                }
                Some(_) => {}
                None => refused.push(name),
            }
        }
        Ok(Self { path: path.to_owned(), archive: RefCell::new(archive), entries, refused })
    }

    /// Names of all entries, sorted.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    fn index_of(&self, name: &str) -> io::Result<usize> {
        let Some(name) = normalise(name) else {
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, "it lies outside of the archive"));
        };
        self.entries.get(&name).copied().ok_or_else(|| io::ErrorKind::NotFound.into())
    }
}

/// A name with `/` and without `.` and `..`; `None` if it leads out of the archive.
fn normalise(name: &str) -> Option<String> {
    let name = name.replace('\\', "/");
    if name.starts_with('/') || name.as_bytes().get(1) == Some(&b':') {
        return None;
    }
    let mut parts: Vec<&str> = Vec::new();
    for part in name.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop()?;
            }
            part => parts.push(part),
        }
    }
    Some(parts.join("/"))
}

impl SourceFiles for ZipFiles {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        let index = self.index_of(name)?;
        let invalid = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
        let (start, packed, unpacked, method) = {
            let mut archive = self.archive.borrow_mut();
            let entry = archive.by_index_raw(index).map_err(io::Error::other)?;
            if entry.encrypted() {
                return Err(invalid("the archive is encrypted; unpack it and give the folder"));
            }
            let start = entry.data_start().ok_or_else(|| invalid("the archive's directory is damaged"))?;
            (start, entry.compressed_size(), entry.size(), entry.compression())
        };
        // A handle of its own, because several entries are open at a time.
        let mut file = File::open(&self.path)?;
        file.seek(SeekFrom::Start(start))?;
        let packed = BufReader::new(file).take(packed);
        match method {
            CompressionMethod::Stored => Ok(Box::new(packed)),
            CompressionMethod::Deflated => Ok(Box::new(DeflateDecoder::new(packed).take(unpacked))),
            CompressionMethod::Zstd => Ok(Box::new(zstd::Decoder::with_buffer(packed)?.take(unpacked))),
            method => Err(invalid(&format!("it is packed by {method}, which is not read; pack it again by Deflate"))),
        }
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        let index = self.index_of(name)?;
        Ok(self.archive.borrow_mut().by_index_raw(index).map_err(io::Error::other)?.size())
    }

    fn on_disk(&self, name: &str) -> io::Result<LocalFile> {
        copy_to_disk(&mut self.open(name)?.take(MAX_COPY_BYTES))
    }

    fn location(&self) -> String {
        format!("{}#", self.path.display())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;
    use std::io::Write;
    use zip::{ZipWriter, write::SimpleFileOptions};

    fn archive(folder: &TestFolder, entries: &[(&str, &[u8], CompressionMethod)]) -> PathBuf {
        let path = folder.path.join("a.zip");
        let mut writer = ZipWriter::new(File::create(&path).unwrap());
        for (name, bytes, method) in entries {
            writer.start_file(*name, SimpleFileOptions::default().compression_method(*method)).unwrap();
            writer.write_all(bytes).unwrap();
        }
        writer.finish().unwrap();
        path
    }

    #[test]
    fn entries_are_read_and_names_outside_refused() {
        let folder = TestFolder::new("zip");
        let zeros = vec![0; 100_000];
        let path = archive(
            &folder,
            &[
                ("udx/a.gml", &zeros, CompressionMethod::Deflated),
                ("b.json", b"b", CompressionMethod::Stored),
                ("z.bin", b"packed", CompressionMethod::Zstd),
                ("../evil.json", b"x", CompressionMethod::Stored),
                ("/etc/evil.json", b"x", CompressionMethod::Stored),
            ],
        );
        let files = ZipFiles::new(&path).unwrap();
        assert_eq!(files.names().collect::<Vec<_>>(), ["b.json", "udx/a.gml", "z.bin"]);
        assert_eq!(files.refused.len(), 2);
        let read = |name: &str| {
            let mut bytes = Vec::new();
            files.open(name)?.read_to_end(&mut bytes).map(|_| bytes)
        };
        assert_eq!(read("udx/../udx/a.gml").unwrap(), zeros);
        assert_eq!(read("./b.json").unwrap(), b"b");
        assert_eq!(read("z.bin").unwrap(), b"packed");
        assert_eq!(read("../evil.json").unwrap_err().kind(), io::ErrorKind::PermissionDenied);
        assert_eq!(read("none").unwrap_err().kind(), io::ErrorKind::NotFound);
        let copy = files.on_disk("b.json").unwrap();
        assert_eq!(std::fs::read(&copy.path).unwrap(), b"b");
        let path_of_copy = copy.path.clone();
        drop(copy);
        assert!(!path_of_copy.exists());
    }

    #[test]
    fn a_damaged_archive_is_an_error_at_every_length() {
        let folder = TestFolder::new("zip-damaged");
        let path = archive(&folder, &[("a.json", b"some text some text", CompressionMethod::Deflated)]);
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(ZipFiles::new(&path).is_err(), "{length}");
        }
    }
}
