//! Lists of records in memory, or in a scratch file of pages of which a few are in memory.
//!
//! A country has tens of millions of objects. The steps that see all of them keep what they know of each in such files, and read
//! them in order or nearly so.

use crate::error::ScratchError;
use insula_protocol::codec::bincode;
use lru::LruCache;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Records of a page.
const PAGE_RECORDS: usize = 512;
/// Pages of a list that are in memory.
// Evaluated by the compiler.
const PAGES: NonZeroUsize = NonZeroUsize::new(16).unwrap();

/// Where records are kept: in memory, or in files of a folder that have no name and vanish when they are closed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordScratch(Option<PathBuf>);

impl RecordScratch {
    /// In files of an existing folder.
    pub fn in_folder(folder: &Path) -> Self {
        Self(Some(folder.to_owned()))
    }

    /// The folder; `None` in memory.
    pub fn folder(&self) -> Option<&Path> {
        self.0.as_deref()
    }
}

/// Records by number.
#[derive(Debug)]
pub enum RecordList<T> {
    Memory(Vec<T>),
    File(Mutex<RecordPages<T>>),
}

/// Records in a file.
#[derive(Debug)]
pub struct RecordPages<T> {
    folder: PathBuf,
    /// Created with the first page that does not fit into memory.
    file: Option<File>,
    /// Start and length of each page in the file; `None` for one that is only in memory.
    places: Vec<Option<(u64, u32)>>,
    end: u64,
    loaded: LruCache<usize, LoadedPage<T>>,
    length: usize,
    /// The first error of [`RecordList::push`], kept until the next reading.
    failed: Option<ScratchError>,
}

/// A page in memory.
#[derive(Debug)]
struct LoadedPage<T> {
    records: Arc<Vec<T>>,
    /// Whether the file does not have it so.
    is_changed: bool,
}

impl<T> Default for RecordList<T> {
    fn default() -> Self {
        Self::Memory(Vec::new())
    }
}

impl<T> From<Vec<T>> for RecordList<T> {
    fn from(records: Vec<T>) -> Self {
        Self::Memory(records)
    }
}

impl<T> RecordList<T> {
    /// An empty list.
    pub fn new(scratch: &RecordScratch) -> Self {
        match scratch.folder() {
            None => Self::default(),
            Some(folder) => Self::File(Mutex::new(RecordPages {
                folder: folder.to_owned(),
                file: None,
                places: Vec::new(),
                end: 0,
                loaded: LruCache::new(PAGES),
                length: 0,
                failed: None,
            })),
        }
    }

    /// Where its records are.
    pub fn scratch(&self) -> RecordScratch {
        match self {
            Self::Memory(_) => RecordScratch::default(),
            Self::File(pages) => RecordScratch(Some(lock(pages).folder.clone())),
        }
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        match self {
            Self::Memory(all) => all.len(),
            Self::File(pages) => lock(pages).length,
        }
    }

    /// Whether there are no records.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All records, if they are in memory; none otherwise.
    pub fn in_memory(&self) -> &[T] {
        match self {
            Self::Memory(all) => all,
            Self::File(_) => &[],
        }
    }

    /// As [`Self::in_memory`].
    pub fn into_memory(self) -> Vec<T> {
        match self {
            Self::Memory(all) => all,
            Self::File(_) => Vec::new(),
        }
    }
}

impl<T: Clone + Serialize + DeserializeOwned> RecordList<T> {
    /// Adds a record. An error of the file is returned by the next reading.
    pub fn push(&mut self, record: T) {
        match self {
            Self::Memory(all) => all.push(record),
            Self::File(pages) => pages.get_mut().unwrap_or_else(PoisonError::into_inner).push(record),
        }
    }

    /// A record. Fails if there is no such record, or if the file cannot be read or written.
    pub fn get(&self, number: usize) -> Result<T, ScratchError> {
        let found = match self {
            Self::Memory(all) => all.get(number).cloned(),
            Self::File(pages) => lock(pages).page(number / PAGE_RECORDS)?.get(number % PAGE_RECORDS).cloned(),
        };
        found.ok_or_else(missing)
    }

    /// Changes a record. Fails as [`Self::get`].
    pub fn update(&mut self, number: usize, change: impl FnOnce(&mut T)) -> Result<(), ScratchError> {
        match self {
            Self::Memory(all) => change(all.get_mut(number).ok_or_else(missing)?),
            Self::File(pages) => {
                let pages = pages.get_mut().unwrap_or_else(PoisonError::into_inner);
                pages.page(number / PAGE_RECORDS)?;
                let page = pages.loaded.get_mut(&(number / PAGE_RECORDS)).ok_or_else(missing)?;
                let records = Arc::make_mut(&mut page.records);
                change(records.get_mut(number % PAGE_RECORDS).ok_or_else(missing)?);
                page.is_changed = true;
            }
        }
        Ok(())
    }

    /// Calls `visit` for all records of a range with their numbers, in order. Fails as [`Self::get`], or with the first error of `visit`.
    pub fn for_range<E: From<ScratchError>>(
        &self,
        range: std::ops::Range<usize>,
        mut visit: impl FnMut(usize, &T) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Self::Memory(all) = self {
            let some = all.get(range.clone()).ok_or_else(missing)?;
            return range.zip(some).try_for_each(|(number, record)| visit(number, record));
        }
        let mut number = range.start;
        while number < range.end {
            let Self::File(pages) = self else { break };
            // The lock is free while records are visited.
            let page = lock(pages).page(number / PAGE_RECORDS)?;
            for record in page.get(number % PAGE_RECORDS..).ok_or_else(missing)? {
                if number < range.end {
                    visit(number, record)?;
                    number += 1;
                }
            }
            if page.len() < PAGE_RECORDS && number < range.end {
                return Err(missing().into());
            }
        }
        Ok(())
    }

    /// As [`Self::for_range`], for all records.
    pub fn try_for_each<E: From<ScratchError>>(&self, visit: impl FnMut(usize, &T) -> Result<(), E>) -> Result<(), E> {
        self.for_range(0..self.len(), visit)
    }

    /// Calls `visit` for all records, in order. Those for which it returns a record become that one. Fails as [`Self::get`], or with
    /// the first error of `visit`.
    pub fn replace_each<E: From<ScratchError>>(
        &mut self,
        mut visit: impl FnMut(usize, &T) -> Result<Option<T>, E>,
    ) -> Result<(), E> {
        for number in 0..self.len() {
            let changed = match self {
                Self::Memory(all) => visit(number, &all[number])?,
                Self::File(_) => visit(number, &self.get(number)?)?,
            };
            if let Some(changed) = changed {
                self.update(number, |record| *record = changed)?;
            }
        }
        Ok(())
    }

    /// A reader that asks for the same record only once in a row.
    pub fn cursor(&self) -> RecordCursor<'_, T> {
        RecordCursor { list: self, last: None }
    }
}

/// Reads a list nearly in order.
pub struct RecordCursor<'a, T> {
    list: &'a RecordList<T>,
    last: Option<(usize, T)>,
}

impl<T: Clone + Serialize + DeserializeOwned> RecordCursor<'_, T> {
    /// As [`RecordList::get`].
    pub fn get(&mut self, number: usize) -> Result<&T, ScratchError> {
        if let RecordList::Memory(all) = self.list {
            return all.get(number).ok_or_else(missing);
        }
        if self.last.as_ref().is_none_or(|(last, _)| *last != number) {
            self.last = Some((number, self.list.get(number)?));
        }
        self.last.as_ref().map(|(_, record)| record).ok_or_else(missing)
    }
}

fn lock<T>(pages: &Mutex<RecordPages<T>>) -> MutexGuard<'_, RecordPages<T>> {
    // What a panicking reader leaves behind are whole pages.
    pages.lock().unwrap_or_else(PoisonError::into_inner)
}

fn missing() -> ScratchError {
    ScratchError::Damaged
}

impl<T: Clone + Serialize + DeserializeOwned> RecordPages<T> {
    fn push(&mut self, record: T) {
        let page = self.length / PAGE_RECORDS;
        if page == self.places.len() {
            self.places.push(None);
            let records = Arc::new(Vec::with_capacity(PAGE_RECORDS));
            let inserted = self.insert(page, LoadedPage { records, is_changed: true });
            self.keep(inserted);
        } else if let Err(error) = self.page(page) {
            self.keep(Err(error));
        }
        if let Some(page) = self.loaded.get_mut(&page) {
            Arc::make_mut(&mut page.records).push(record);
            page.is_changed = true;
        }
        self.length += 1;
    }

    fn keep(&mut self, result: Result<(), ScratchError>) {
        if let Err(error) = result {
            self.failed.get_or_insert(error);
        }
    }

    /// A page, which is in memory then.
    fn page(&mut self, number: usize) -> Result<Arc<Vec<T>>, ScratchError> {
        if let Some(error) = self.failed.take() {
            return Err(error);
        }
        if let Some(page) = self.loaded.get(&number) {
            return Ok(Arc::clone(&page.records));
        }
        let (start, length) = self.places.get(number).copied().flatten().ok_or_else(missing)?;
        let mut bytes = vec![0; length as usize];
        let file = self.file.as_mut().ok_or_else(missing)?;
        let read = file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(&mut bytes));
        read.map_err(|cause| ScratchError::io(&self.folder, "read", cause))?;
        let records = Arc::new(bincode::long_from_bytes(&bytes).map_err(|_| missing())?);
        self.insert(number, LoadedPage { records: Arc::clone(&records), is_changed: false })?;
        Ok(records)
    }

    /// Puts a page into memory, and writes the one that has to leave.
    fn insert(&mut self, number: usize, page: LoadedPage<T>) -> Result<(), ScratchError> {
        match self.loaded.push(number, page) {
            Some((old, page)) if old != number && page.is_changed => self.write(old, &page.records),
            _ => Ok(()),
        }
    }

    fn write(&mut self, number: usize, records: &Vec<T>) -> Result<(), ScratchError> {
        let bytes = bincode::to_bytes(records).map_err(|_| missing())?;
        let failed = |cause: io::Error| ScratchError::io(&self.folder, "written", cause);
        let file = match &mut self.file {
            Some(file) => file,
            None => self.file.insert(tempfile::tempfile_in(&self.folder).map_err(failed)?),
        };
        // In its old place, if it fits.
        let start = match self.places.get(number).copied().flatten() {
            Some((start, length)) if bytes.len() <= length as usize => start,
            _ => {
                self.end += bytes.len() as u64;
                self.end - bytes.len() as u64
            }
        };
        file.seek(SeekFrom::Start(start)).and_then(|_| file.write_all(&bytes)).map_err(failed)?;
        self.places[number] = Some((start, bytes.len() as u32));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::folder::TestFolder;
    use insula_test_support::rng::Rng;

    #[test]
    fn lists_in_files_are_as_those_in_memory() {
        let folder = TestFolder::new("record-list");
        let mut list = RecordList::new(&RecordScratch::in_folder(&folder.path));
        let mut expected: Vec<(u64, String)> = Vec::new();
        let mut rng = Rng::new(3);
        for number in 0..40_000_u64 {
            let record = (number, "x".repeat(number as usize % 7));
            list.push(record.clone());
            expected.push(record);
            if number % 3 == 0 {
                let changed = rng.below(expected.len());
                let text = "changed".repeat(rng.below(3));
                list.update(changed, |record| record.1.clone_from(&text)).unwrap();
                expected[changed].1 = text;
            }
        }
        list.replace_each(|i, record| Ok::<_, ScratchError>((i % 5 == 0).then(|| (record.0 + 1, record.1.clone()))))
            .unwrap();
        expected.iter_mut().step_by(5).for_each(|record| record.0 += 1);
        assert_eq!(list.len(), expected.len());
        let mut found = Vec::new();
        list.try_for_each(|i, record| {
            assert_eq!(i, found.len());
            found.push(record.clone());
            // Other records can be read meanwhile.
            assert_eq!(list.get(expected.len() - 1 - i)?, expected[expected.len() - 1 - i]);
            Ok::<_, ScratchError>(())
        })
        .unwrap();
        assert!(found == expected);
        let mut range = Vec::new();
        list.for_range(700..2100, |_, record| {
            range.push(record.clone());
            Ok::<_, ScratchError>(())
        })
        .unwrap();
        assert!(range == expected[700..2100]);
        assert!(
            list.get(expected.len()).is_err()
                && list.for_range(39_999..40_001, |_, _| Ok::<_, ScratchError>(())).is_err()
        );
        let mut cursor = list.cursor();
        assert_eq!(*cursor.get(9).unwrap(), expected[9]);
        assert_eq!(*cursor.get(9000).unwrap(), expected[9000]);
        assert!(list.in_memory().is_empty() && list.scratch() == RecordScratch::in_folder(&folder.path));
    }

    #[test]
    fn a_folder_that_is_gone_is_an_error_and_not_a_panic() {
        let scratch = RecordScratch::in_folder(Path::new("/no/such/folder"));
        let mut list = RecordList::new(&scratch);
        (0..100_000_u32).for_each(|i| list.push(i));
        assert!(matches!(list.get(99_999), Err(ScratchError::Io { .. })));
    }
}
