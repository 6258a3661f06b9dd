//! The objects of a work store that steps wrote, told from those of others.
//!
//! The object `insula-work` marks a store. Before a step writes an object, it writes a record of what the object will be to `list/NAME`: a
//! line [`RECORD`], then a line for each part, with its length and its BLAKE3 hash. If an object is there that is replaced, its lines follow
//! after an empty one: a step that is killed may leave either. Only what is recorded and unchanged is ever removed or replaced.

use super::layout::FOLDERS;
use super::work::{PartPiece, WorkStore};
use insula_archive::owned::FileMark;
use insula_archive::places::WORK_FILE;
use std::io;
use std::path::Path;

/// Content of the marker.
const MARKER: &[u8] = b"Insula keeps results of `bake --work` here, and removes those that are listed in `list`.\n";
/// Folder of what was written.
const LIST: &str = "list";
/// Begins the names of the city's objects.
const CITY: &str = "city/";
/// First line of a record.
const RECORD: &str = "an object of a bake";
/// A record of the parts of an archive is shorter.
const MAX_RECORD_BYTES: u64 = 4 << 20;
/// Objects are read in pieces to be compared.
const PIECE_BYTES: u64 = 8 << 20;

/// A work store of which only own objects are replaced and removed.
#[derive(Clone, Copy)]
pub(super) struct OwnedStore<'a>(&'a dyn WorkStore);

/// What a removal did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Removal {
    Removed,
    /// There is no such object.
    Missing,
    /// No step wrote it as it is, so it stays.
    Kept,
}

/// The parts of an object. One that was begun in parts has none yet.
type Parts = Vec<FileMark>;

fn length_of(parts: &[FileMark]) -> u64 {
    parts.iter().map(|mark| mark.bytes).fold(0, u64::saturating_add)
}

fn record_name(name: &str) -> String {
    format!("{LIST}/{name}")
}

fn refused(name: &str, what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::AlreadyExists, format!("{name}: {what}"))
}

impl<'a> OwnedStore<'a> {
    pub(super) fn new(store: &'a dyn WorkStore) -> Self {
        Self(store)
    }

    /// Whether the store is marked as that of a bake. Fails if it does not answer.
    pub(super) fn is_marked(self) -> io::Result<bool> {
        Ok(match self.0.size(WORK_FILE)? {
            Some(size) if size == MARKER.len() as u64 => self.0.range(WORK_FILE, 0, size)? == MARKER,
            _ => false,
        })
    }

    /// Marks the store as that of a bake. Fails if it is not, and has objects where steps write theirs.
    pub(super) fn mark(self, job: &str) -> io::Result<()> {
        if self.is_marked()? {
            return Ok(());
        }
        const FOREIGN: &str = "no bake wrote it; give an empty --work, or move it away";
        for name in [WORK_FILE, job] {
            match self.0.size(name) {
                Ok(None) => {}
                Err(error) if error.kind() != io::ErrorKind::InvalidInput => return Err(error),
                _ => return Err(refused(name, FOREIGN)),
            }
        }
        for folder in FOLDERS.into_iter().chain([LIST]) {
            if let Some(name) = self.0.list(folder)?.first() {
                return Err(refused(name, FOREIGN));
            }
        }
        self.0.put(WORK_FILE, MARKER.to_vec())
    }

    /// Removes the marker.
    pub(super) fn unmark(self) -> io::Result<()> {
        self.0.remove(WORK_FILE)
    }

    /// What an object may be: its parts as they were written, and perhaps those of the one before. `None` if no step wrote it.
    fn record(self, name: &str) -> io::Result<Option<Vec<Parts>>> {
        let name = record_name(name);
        let Some(size) = self.0.size(&name)?.filter(|size| *size <= MAX_RECORD_BYTES) else { return Ok(None) };
        let text = String::from_utf8(self.0.range(&name, 0, size)?).unwrap_or_default();
        let Some(lines) = text.strip_prefix(RECORD).and_then(|lines| lines.strip_prefix('\n')) else { return Ok(None) };
        Ok(lines.split("\n\n").map(|parts| parts.lines().map(FileMark::parse).collect()).collect())
    }

    /// Whether a step wrote an object of this name. Fails if the store does not answer.
    pub(super) fn has_record(self, name: &str) -> io::Result<bool> {
        Ok(self.record(name)?.is_some())
    }

    /// Names of all objects that steps wrote, in ascending order. Fails if the store does not answer.
    pub(super) fn recorded(self) -> io::Result<Vec<String>> {
        let own = format!("{LIST}/");
        Ok(self.0.list(LIST)?.iter().filter_map(|name| name.strip_prefix(&own)).map(str::to_owned).collect())
    }

    /// Records what an object will be. Fails if there is one of that name that no step wrote.
    fn claim(self, name: &str, marks: &[FileMark]) -> io::Result<()> {
        let (size, record) = (self.0.size(name)?, self.record(name)?);
        let mut known = record.unwrap_or_default();
        let is_known = !known.is_empty();
        let may_replace = match size {
            Some(size) => is_known && self.is_one_of(name, size, known.iter().map(Vec::as_slice).chain([marks]))?,
            None => true,
        };
        if !may_replace {
            return Err(refused(name, "no step of a bake wrote it, so it is not replaced; move it away"));
        }
        if known.first().is_some_and(|first| first == marks) {
            return Ok(());
        }
        known.retain(|parts| size == Some(length_of(parts)) && parts != marks);
        known.truncate(1);
        known.insert(0, marks.to_vec());
        let lines = |parts: &Parts| parts.iter().map(|mark| mark.to_text() + "\n").collect::<String>();
        let text = known.iter().map(lines).collect::<Vec<_>>().join("\n");
        self.0.put(&record_name(name), format!("{RECORD}\n{text}").into_bytes())
    }

    /// Whether an object that is to be replaced has one of these contents. Those of the city and short ones, which people may have changed,
    /// are read. Of others the length tells: reading them would take as long as writing them.
    fn is_one_of<'p>(
        self,
        name: &str,
        size: u64,
        mut contents: impl Iterator<Item = &'p [FileMark]>,
    ) -> io::Result<bool> {
        if name.starts_with(CITY) || size <= PIECE_BYTES {
            return contents.try_fold(false, |is_found, parts| Ok(is_found || self.has_parts(name, size, parts)?));
        }
        Ok(contents.any(|parts| size == length_of(parts)))
    }

    /// Whether an object is as a step wrote it. It is read.
    fn is_unchanged(self, name: &str, size: u64) -> io::Result<bool> {
        for parts in self.record(name)?.unwrap_or_default() {
            if self.has_parts(name, size, &parts)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn has_parts(self, name: &str, size: u64, parts: &[FileMark]) -> io::Result<bool> {
        let mut start = 0_u64;
        if parts.is_empty() || length_of(parts) != size {
            return Ok(false);
        }
        for mark in parts {
            let Some(end) = start.checked_add(mark.bytes).filter(|end| *end <= size) else { return Ok(false) };
            let mut hash = blake3::Hasher::new();
            while start < end {
                let length = (end - start).min(PIECE_BYTES);
                hash.update(&self.0.range(name, start, length)?);
                start += length;
            }
            if hash.finalize() != mark.hash {
                return Ok(false);
            }
        }
        Ok(start == size)
    }

    /// Removes an object if a step wrote it as it is. Fails if the store does not answer.
    pub(super) fn remove(self, name: &str) -> io::Result<Removal> {
        // A link or a folder has no size.
        let size = match self.0.size(name) {
            Err(error) if error.kind() == io::ErrorKind::InvalidInput => return Ok(Removal::Kept),
            size => size?,
        };
        let removal = match size {
            None => Removal::Missing,
            Some(size) if !self.is_unchanged(name, size)? => return Ok(Removal::Kept),
            Some(_) => {
                self.0.remove(name)?;
                Removal::Removed
            }
        };
        if self.has_record(name)? {
            self.0.remove(&record_name(name))?;
        }
        Ok(removal)
    }

    /// Removes the empty folders of removed objects and their records.
    pub(super) fn remove_folders(self, names: &[String]) {
        let records = names.iter().map(|name| record_name(name));
        self.0.remove_folders(&names.iter().cloned().chain(records).collect::<Vec<_>>());
    }

    pub(super) fn address(self) -> String {
        self.0.address()
    }

    pub(super) fn size(self, name: &str) -> io::Result<Option<u64>> {
        self.0.size(name)
    }

    pub(super) fn range(self, name: &str, start: u64, length: u64) -> io::Result<Vec<u8>> {
        self.0.range(name, start, length)
    }

    pub(super) fn fetch(self, name: &str, to: &Path) -> io::Result<()> {
        self.0.fetch(name, to)
    }

    pub(super) fn list(self, folder: &str) -> io::Result<Vec<String>> {
        self.0.list(folder)
    }

    /// Writes an object. Fails as [`WorkStore::put`], or if one of that name is not a step's.
    pub(super) fn put(self, name: &str, bytes: Vec<u8>) -> io::Result<()> {
        self.claim(name, &[FileMark::of(&bytes)])?;
        self.0.put(name, bytes)
    }

    /// Copies a file to an object. Fails as [`Self::put`], or if the file cannot be read.
    pub(super) fn put_file(self, name: &str, from: &Path) -> io::Result<()> {
        self.claim(name, &[FileMark::of_file(from)?])?;
        self.0.put_file(name, from)
    }

    /// As [`WorkStore::begin_parts`]. Fails if an object of that name is not a step's.
    pub(super) fn begin_parts(self, name: &str, size: u64) -> io::Result<String> {
        if !self.has_record(name)? {
            // Nothing has no parts, so whatever gets the name meanwhile stays.
            self.claim(name, &[])?;
        }
        self.0.begin_parts(name, size)
    }

    /// Writes a part that is made of given bytes and of sections of other objects, and returns a receipt with its mark. Fails as
    /// [`WorkStore::put_part`], and with an error that names the object if one is missing or shorter.
    pub(super) fn put_pieces(
        self,
        name: &str,
        ticket: &str,
        number: u32,
        start: u64,
        pieces: Vec<PartPiece>,
    ) -> io::Result<String> {
        let mut bytes = Vec::new();
        for piece in pieces {
            match piece {
                PartPiece::Given(given) => bytes.extend(given),
                PartPiece::Stored { object, start, length } => {
                    let in_object = |cause: io::Error| io::Error::new(cause.kind(), format!("{object}: {cause}"));
                    bytes.extend(self.0.range(&object, start, length).map_err(in_object)?);
                }
            }
        }
        let mark = FileMark::of(&bytes).to_text();
        Ok(format!("{mark} {}", self.0.put_part(name, ticket, number, start, bytes)?))
    }

    /// Completes an object with the receipts of [`Self::put_pieces`] in their order. Fails as [`WorkStore::finish_parts`].
    pub(super) fn finish_parts(self, name: &str, ticket: &str, receipts: &[String]) -> io::Result<()> {
        let split = |receipt: &String| {
            let (mark, receipt) = receipt.match_indices(' ').nth(1).map(|(at, _)| receipt.split_at(at))?;
            Some((FileMark::parse(mark)?, receipt.get(1..)?.to_owned()))
        };
        let damaged = || io::Error::new(io::ErrorKind::InvalidData, "a receipt is damaged");
        let parts: Vec<_> = receipts.iter().map(split).collect::<Option<_>>().ok_or_else(damaged)?;
        let (marks, receipts): (Vec<FileMark>, Vec<String>) = parts.into_iter().unzip();
        self.claim(name, &marks)?;
        self.0.finish_parts(name, ticket, receipts)
    }

    pub(super) fn abort_parts(self, name: &str, ticket: &str) -> io::Result<()> {
        self.0.abort_parts(name, ticket)
    }

    pub(super) fn begun_parts(self) -> io::Result<Vec<(String, String)>> {
        self.0.begun_parts()
    }
}

#[cfg(test)]
mod tests {
    use super::super::work::WorkFolder;
    use super::*;
    use insula_test_support::folder::TestFolder;
    use std::fs;

    #[test]
    fn a_file_that_was_changed_is_not_replaced() {
        let folder = TestFolder::new("owned-files");
        let objects = WorkFolder::new(&folder.path);
        let store = OwnedStore::new(&objects);
        for name in ["city/a", "scan/0/a"] {
            let path = folder.path.join(name);
            store.put(name, b"first".to_vec()).unwrap();
            store.put(name, b"other".to_vec()).unwrap();
            // Of the same length.
            fs::write(&path, "mine!").unwrap();
            let refused = store.put(name, b"third".to_vec()).unwrap_err().to_string();
            assert!(refused.contains(name) && fs::read(&path).unwrap() == b"mine!", "{refused}");
            // A killed step leaves the earlier object in place.
            fs::write(&path, "first").unwrap();
            store.put(name, b"third".to_vec()).unwrap();
            assert_eq!(fs::read(&path).unwrap(), b"third");
        }
    }
}
