//! Files of a ZIP archive, read without unpacking it: `.zip`, and the archives of tilesets (`.3tz`) and scene layers (`.slpk`).

use super::file_names::{self, key};
use super::input::{LocalFile, SourceFiles};
use super::random_file::copy_up_to;
use crate::error::InputError;
use flate2::read::DeflateDecoder;
use std::cell::{OnceCell, RefCell};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use zip::{CompressionMethod, ZipArchive};

/// An archive with more entries is refused: each is in memory.
const MAX_ENTRIES: usize = 4_000_000;
/// An archive may unpack to this many bytes, and to this many times its own size: texts that repeat shrink to a hundredth.
const MIN_UNPACKED_BYTES: u64 = 1 << 30;
const MAX_RATIO: u64 = 1000;
/// Least bytes between the beginning of an entry and its packed bytes, besides its name.
const ENTRY_HEADER_BYTES: u64 = 30;
/// An entry that is copied to disk may have this many unpacked bytes.
const MAX_COPY_BYTES: u64 = 8 << 30;

/// Whether the file's name is that of an archive that is read.
pub fn is_archive(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    [".zip", ".3tz", ".slpk", ".shz"].iter().any(|extension| name.ends_with(extension))
}

/// The entries of an archive by their normalised names. Names that lead out of the archive are left out, so that no name in
/// a city file reaches them; nothing is ever written under an entry's name.
pub struct ZipFiles {
    path: PathBuf,
    archive: RefCell<ZipArchive<BufReader<File>>>,
    /// Index of each entry.
    entries: BTreeMap<String, usize>,
    /// Names as bytes, and indices, of the entries whose names are in an unknown code page.
    foreign: Vec<(Vec<u8>, usize)>,
    /// Entries by the keys of all names that they may have, made when a name is not found.
    by_key: OnceCell<HashMap<String, usize>>,
    /// Entries whose names lead out of the archive.
    pub refused: Vec<String>,
}

impl ZipFiles {
    /// Reads the directory of an archive. Fails if the file is no archive or is damaged, if entries overlap, or if it unpacks
    /// to far more bytes than it has.
    pub fn new(path: &Path) -> Result<Self, InputError> {
        let label = path.display().to_string();
        let file = File::open(path).map_err(|cause| InputError::io(&label, cause))?;
        let damaged = |what: String| InputError::damaged(&label, "archive", what);
        let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|error| damaged(error.to_string()))?;
        if archive.len() > MAX_ENTRIES {
            let what = "its number of entries".to_owned();
            return Err(InputError::TooLarge { path: label, what, limit: MAX_ENTRIES as u64 });
        }
        check_sizes(&mut archive, &label)?;
        let (mut entries, mut refused, mut foreign) = (BTreeMap::new(), Vec::new(), Vec::new());
        for index in 0..archive.len() {
            let mut name = match archive.name_for_index(index) {
                Some(Ok(name)) => name.into_owned(),
                Some(Err(_)) => String::from(char::REPLACEMENT_CHARACTER),
                None => continue,
            };
            if !name.is_ascii()
                && let Ok(entry) = archive.by_index_raw(index)
            {
                // The library decodes names without the UTF-8 mark as code page 437.
                let raw = entry.name_raw();
                name = file_names::guess(raw).unwrap_or(name);
                if std::str::from_utf8(raw).is_err() {
                    foreign.push((raw.to_vec(), index));
                }
            }
            match normalise(&name) {
                Some(normal) if !name.ends_with('/') => {
                    entries.entry(normal).or_insert(index);
                }
                Some(_) => {}
                None => refused.push(name),
            }
        }
        let (archive, by_key) = (RefCell::new(archive), OnceCell::new());
        Ok(Self { path: path.to_owned(), archive, entries, foreign, by_key, refused })
    }

    /// Names of all entries, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    fn index_of(&self, name: &str) -> io::Result<usize> {
        let Some(name) = normalise(name) else {
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, "it lies outside of the archive"));
        };
        let found = self.entries.get(&name).or_else(|| self.by_key().get(&key(&name)));
        found.copied().ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    /// Of several entries with one key, the first by name counts.
    fn by_key(&self) -> &HashMap<String, usize> {
        self.by_key.get_or_init(|| {
            let mut by_key = HashMap::new();
            for (name, index) in &self.entries {
                by_key.entry(key(name)).or_insert(*index);
            }
            for (raw, index) in &self.foreign {
                for name in file_names::candidates(raw).filter_map(|name| normalise(&name)) {
                    by_key.entry(key(&name)).or_insert(*index);
                }
            }
            by_key
        })
    }
}

/// Fails if entries overlap, or if the archive unpacks to too many bytes: a small file could be read without end.
fn check_sizes(archive: &mut ZipArchive<BufReader<File>>, label: &str) -> Result<(), InputError> {
    let damaged = |what: String| InputError::damaged(label, "archive", what);
    let (mut unpacked, mut packed) = (0_u64, 0_u64);
    let mut ranges = Vec::with_capacity(archive.len());
    for index in 0..archive.len() {
        let entry = archive.by_index_raw(index).map_err(|error| damaged(error.to_string()))?;
        let (start, name) = (entry.header_start(), entry.name_raw().len() as u64);
        let end = start.saturating_add(ENTRY_HEADER_BYTES + name).saturating_add(entry.compressed_size());
        ranges.push((start, end));
        unpacked = unpacked.saturating_add(entry.size());
        packed = packed.saturating_add(end - start);
    }
    ranges.sort_unstable();
    if let Some(pair) = ranges.windows(2).find(|pair| pair[0].1 > pair[1].0) {
        return Err(damaged(format!("entries overlap at byte {}", pair[1].0)));
    }
    let limit = packed.saturating_mul(MAX_RATIO).max(MIN_UNPACKED_BYTES);
    if unpacked > limit {
        let what = format!("the {unpacked} bytes to which its {packed} bytes unpack");
        return Err(InputError::TooLarge { path: label.to_owned(), what, limit });
    }
    Ok(())
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
        copy_up_to(&mut self.open(name)?, MAX_COPY_BYTES)
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
    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

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

    #[test]
    fn entries_that_overlap_or_unpack_without_end_are_refused() {
        let folder = TestFolder::new("zip-overlap");
        let path = archive(
            &folder,
            &[("a.json", b"some text", CompressionMethod::Stored), ("b.json", b"text", CompressionMethod::Stored)],
        );
        let bytes = std::fs::read(&path).unwrap();
        let records: Vec<usize> = (0..bytes.len()).filter(|at| bytes[*at..].starts_with(b"PK\x01\x02")).collect();
        let refusal = |at: usize, number: u32| {
            let mut changed = bytes.clone();
            changed[at..at + 4].copy_from_slice(&number.to_le_bytes());
            std::fs::write(&path, changed).unwrap();
            ZipFiles::new(&path).err().unwrap().to_string()
        };
        // The place of the second entry, and the unpacked size of the first, in the directory.
        let same = refusal(records[1] + 42, 0);
        assert!(same.contains("entries overlap at byte 0"), "{same}");
        let large = refusal(records[0] + 24, u32::MAX - 1);
        assert!(large.contains("unpack exceeds the limit of 1073741824"), "{large}");
    }

    #[test]
    fn names_in_other_cases_forms_and_code_pages_are_found() {
        let folder = TestFolder::new("zip-names");
        // Names of the same length in place of those that the writer marks as ASCII.
        let path = archive(
            &folder,
            &[
                ("Appearance/UPPER.PNG", b"upper", CompressionMethod::Stored),
                ("tex/AAAAAA.jpg", b"tokyo", CompressionMethod::Stored),
                ("tex/BBBBBBB.jpg", b"house", CompressionMethod::Stored),
                ("tex/Ge\u{308}.jpg", b"form", CompressionMethod::Stored),
            ],
        );
        let mut bytes = std::fs::read(&path).unwrap();
        for (ascii, foreign) in [(&b"AAAAAA"[..], &b"\x95\x5c\x93\x8c\x8b\x9e"[..]), (b"BBBBBBB", b"Geb\xe4ude")] {
            while let Some(at) = bytes.windows(ascii.len()).position(|window| window == ascii) {
                bytes[at..at + ascii.len()].copy_from_slice(foreign);
            }
        }
        std::fs::write(&path, bytes).unwrap();
        let files = ZipFiles::new(&path).unwrap();
        let read = |name: &str| files.open(name).map(|reader| io::read_to_string(reader).unwrap());
        for (name, content) in [
            ("appearance/upper.png", "upper"),
            ("tex/表東京.jpg", "tokyo"),
            ("Tex/表東京.JPG", "tokyo"),
            ("tex/Gebäude.jpg", "house"),
            ("tex/Gë.jpg", "form"),
        ] {
            assert_eq!(read(name).unwrap(), content, "{name}");
        }
        assert_eq!(read("tex/other.jpg").unwrap_err().kind(), io::ErrorKind::NotFound);
        assert!(files.names().any(|name| name == "tex/表東京.jpg"), "{:?}", files.names().collect::<Vec<_>>());
    }
}
