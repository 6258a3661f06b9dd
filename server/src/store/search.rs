//! The search index of an opened city, on disk or in an object store.
//!
//! The file is found with the city, so that it is of the city's version even if the folder is replaced; an object has the tag that it
//! had then. It is read by a search, and stays in memory as long as someone holds it. It is read, not mapped: if a mapped file is
//! truncated, the next access ends the process.

use super::requests::RemoteObject;
use insula_archive::RangeSource as _;
use insula_archive::block_cache::BlockObject;
use insula_archive::city::{MAX_SEARCH_BYTES, SEARCH_FILE};
use insula_archive::file_source::FileSource;
use insula_objects::search::SearchIndex;
use insula_protocol::manifest::CityMarks;
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};
use tokio::runtime::Handle;

/// Bytes of one read. Of an object store, each must arrive within a third of the timeout.
const PART_BYTES: u64 = 4 << 20;

/// An index that could not be opened is tried again after this time: each attempt reads the whole file.
const RETRY_INTERVAL: Duration = Duration::from_secs(60);

/// An index in memory. Cheap to clone.
pub type CityIndex = Arc<SearchIndex<Vec<u8>>>;

/// Why a city cannot be searched.
#[derive(Debug, Clone, thiserror::Error)]
pub enum SearchFileError {
    #[error("{place}: the city has no search index: bake it again, or copy all files of its folder")]
    None { place: String },
    #[error("{place}/{SEARCH_FILE}: cannot be read: {reason}; check the disk or the store, and the permissions")]
    Unreadable { place: String, reason: String },
    #[error("{place}/{SEARCH_FILE}: {reason}; bake the city again, or copy it again from an intact source")]
    Damaged { place: String, reason: String },
}

/// A city's file `search.index`.
#[derive(Debug)]
pub(super) struct SearchFile {
    place: String,
    content: Mutex<SearchContent>,
}

#[derive(Debug)]
struct SearchContent {
    source: SearchSource,
    /// The index, if someone holds it.
    opened: Weak<SearchIndex<Vec<u8>>>,
    /// The last failure and its time.
    failed: Option<(Instant, SearchFileError)>,
}

#[derive(Debug)]
enum SearchSource {
    File(FileSource),
    /// With the runtime that reads it.
    Remote(RemoteObject, Handle),
}

impl SearchFile {
    /// An object of a city in a store, unread.
    pub(super) fn remote(url: &str, object: RemoteObject, runtime: Handle) -> Self {
        Self::new(url.to_owned(), SearchSource::Remote(object, runtime))
    }

    fn new(place: String, source: SearchSource) -> Self {
        Self { place, content: Mutex::new(SearchContent { source, opened: Weak::new(), failed: None }) }
    }

    /// Opens the file in a city's folder, unread; `None` if there is none. Fails if it cannot be opened or is no regular file.
    pub(super) fn open(folder: &Path) -> io::Result<Option<Self>> {
        let file = match FileSource::open(&folder.join(SEARCH_FILE)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            file => file?,
        };
        Ok(Some(Self::new(folder.display().to_string(), SearchSource::File(file))))
    }

    /// The index. It is read unless someone holds it; other calls wait for that. Not to be called on a thread of an asynchronous runtime. Fails if it
    /// cannot be read, is damaged, too large, or of another bake than the manifest with these marks.
    pub(super) fn index(&self, marks: Option<CityMarks>) -> Result<CityIndex, SearchFileError> {
        let mut content = self.content.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(index) = content.opened.upgrade() {
            return Ok(index);
        }
        if let Some((_, error)) = content.failed.as_ref().filter(|(time, _)| time.elapsed() < RETRY_INTERVAL) {
            return Err(error.clone());
        }
        match self.read(&content.source, marks) {
            Ok(index) => {
                let index = Arc::new(index);
                content.opened = Arc::downgrade(&index);
                Ok(index)
            }
            Err(error) => {
                content.failed = Some((Instant::now(), error.clone()));
                Err(error)
            }
        }
    }

    fn read(&self, source: &SearchSource, marks: Option<CityMarks>) -> Result<SearchIndex<Vec<u8>>, SearchFileError> {
        let unreadable = |reason: String| SearchFileError::Unreadable { place: self.place.clone(), reason };
        let damaged = |reason: String| SearchFileError::Damaged { place: self.place.clone(), reason };
        let length = source.length();
        if length > MAX_SEARCH_BYTES {
            return Err(damaged(format!("it has {length} bytes, the limit is {MAX_SEARCH_BYTES}")));
        }
        let bytes = source.read(length).map_err(unreadable)?;
        SearchIndex::of_city(bytes, marks).map_err(|error| damaged(error.to_string()))
    }
}

impl SearchSource {
    fn length(&self) -> u64 {
        match self {
            Self::File(file) => file.length().unwrap_or_default(),
            Self::Remote(object, _) => object.length(),
        }
    }

    /// All of its `length` bytes. Fails with the reason.
    fn read(&self, length: u64) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::with_capacity(length as usize);
        for start in (0..length).step_by(PART_BYTES as usize) {
            let range = start..length.min(start + PART_BYTES);
            let part = match self {
                Self::File(file) => file.read(range).ready(),
                Self::Remote(object, runtime) => runtime.block_on(object.fetch(range)),
            };
            bytes.extend_from_slice(&part.map_err(|error| error.to_string())?);
        }
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::search::SearchIndexBuilder;

    #[test]
    fn index_is_read_once_from_the_file_that_was_opened() {
        let folder = tempfile::tempdir().unwrap();
        assert!(SearchFile::open(folder.path()).unwrap().is_none());
        let mut builder = SearchIndexBuilder::new();
        builder.add("Oude Kerk", 7);
        let path = folder.path().join(SEARCH_FILE);
        std::fs::write(&path, builder.finish().unwrap()).unwrap();
        let file = SearchFile::open(folder.path()).unwrap().unwrap();
        std::fs::rename(&path, folder.path().join("replaced")).unwrap();
        let index = file.index(None).unwrap();
        assert_eq!(index.search("kerk", 1)[0].object, 7);
        assert!(Arc::ptr_eq(&index, &file.index(None).unwrap()));
    }

    #[test]
    fn an_index_of_another_bake_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(SEARCH_FILE), SearchIndexBuilder::new().finish().unwrap()).unwrap();
        let open = |marks| SearchFile::open(folder.path()).unwrap().unwrap().index(marks);
        let checksum = open(None).unwrap().checksum();
        open(Some(CityMarks { search_index: Some(checksum) })).unwrap();
        for search_index in [None, Some(!checksum)] {
            let error = open(Some(CityMarks { search_index })).unwrap_err().to_string();
            assert!(error.contains(SEARCH_FILE) && error.contains("another bake"), "{error}");
        }
    }

    #[test]
    fn damaged_and_large_files_are_refused_and_not_read_again_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(SEARCH_FILE);
        std::fs::write(&path, b"INSXnonsense").unwrap();
        let file = SearchFile::open(folder.path()).unwrap().unwrap();
        assert!(matches!(file.index(None), Err(SearchFileError::Damaged { .. })));
        std::fs::write(&path, SearchIndexBuilder::new().finish().unwrap()).unwrap();
        assert!(file.index(None).is_err());
        std::fs::File::create(&path).unwrap().set_len(MAX_SEARCH_BYTES + 1).unwrap();
        let error = SearchFile::open(folder.path()).unwrap().unwrap().index(None).unwrap_err();
        assert!(error.to_string().contains("the limit is"), "{error}");
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(SearchFile::open(folder.path()).is_err());
    }
}
