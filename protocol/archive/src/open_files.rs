//! Files that are read for as long as their city is open, with a bounded number of open handles.
//!
//! A thousand cities have more archives than a process may have open files. Beyond the limit, the file that was read longest ago is
//! closed, and opened again by the next read if it is still the same file. An open file stays readable after it was replaced; a closed one does
//! not, and its reads fail with [`ReadError::Replaced`].

use crate::ReadError;
use crate::file::open_regular;
use lru::LruCache;
use std::fs::{File, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

/// Open handles unless [`set_most_open_files`] says otherwise: a quarter of the usual limit of a process.
const DEFAULT_MOST: usize = 256;

static HANDLES: LazyLock<Mutex<Handles>> =
    LazyLock::new(|| Mutex::new(Handles { files: LruCache::unbounded(), most: DEFAULT_MOST }));
static NEXT_KEY: AtomicU64 = AtomicU64::new(0);

/// The open handles of the process, by [`OpenFile::key`].
struct Handles {
    files: LruCache<u64, Arc<File>>,
    most: usize,
}

/// Sets how many files of cities the process keeps open at most; at least one.
pub fn set_most_open_files(most: usize) {
    let mut handles = handles();
    handles.most = most.max(1);
    handles.close_beyond_limit();
}

fn handles() -> MutexGuard<'static, Handles> {
    HANDLES.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Handles {
    fn close_beyond_limit(&mut self) {
        while self.files.len() > self.most {
            self.files.pop_lru();
        }
    }
}

/// What tells a file from one that replaced it: device, inode, length and modification time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileIdentity((u64, u64), u64, Option<SystemTime>);

impl FileIdentity {
    /// The identity of the file that `about` describes.
    pub fn of(about: &Metadata) -> Self {
        Self(device_and_inode(about), about.len(), about.modified().ok())
    }
}

#[cfg(unix)]
fn device_and_inode(about: &Metadata) -> (u64, u64) {
    use std::os::unix::fs::MetadataExt;
    (about.dev(), about.ino())
}

#[cfg(not(unix))]
fn device_and_inode(_about: &Metadata) -> (u64, u64) {
    (0, 0)
}

/// A regular file in the version that it had when it was opened.
#[derive(Debug)]
pub(crate) struct OpenFile {
    key: u64,
    path: PathBuf,
    identity: FileIdentity,
    length: u64,
}

impl OpenFile {
    /// Fails as [`open_regular`].
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        let file = open_regular(path)?;
        let about = file.metadata()?;
        let key = NEXT_KEY.fetch_add(1, Relaxed);
        let opened = Self { key, path: path.to_owned(), identity: FileIdentity::of(&about), length: about.len() };
        opened.keep(Arc::new(file));
        Ok(opened)
    }

    /// Length in bytes when it was opened.
    pub(crate) fn length(&self) -> u64 {
        self.length
    }

    /// The open file. Fails if it was closed meanwhile, and was replaced or cannot be opened again.
    pub(crate) fn handle(&self) -> Result<Arc<File>, ReadError> {
        if let Some(file) = handles().files.get(&self.key) {
            return Ok(Arc::clone(file));
        }
        let file = open_regular(&self.path).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => ReadError::Replaced,
            _ => error.into(),
        })?;
        if FileIdentity::of(&file.metadata()?) != self.identity {
            return Err(ReadError::Replaced);
        }
        Ok(self.keep(Arc::new(file)))
    }

    fn keep(&self, file: Arc<File>) -> Arc<File> {
        let mut handles = handles();
        handles.files.put(self.key, Arc::clone(&file));
        handles.close_beyond_limit();
        file
    }
}

impl Drop for OpenFile {
    fn drop(&mut self) {
        handles().files.pop(&self.key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::read_limited;
    use std::io::Read;

    /// What a handle reads.
    fn read(file: &OpenFile) -> Result<String, ReadError> {
        let mut text = String::new();
        file.handle()?.as_ref().take(99).read_to_string(&mut text)?;
        Ok(text)
    }

    #[test]
    fn a_closed_file_is_opened_again_unless_it_was_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "old").unwrap();
        let file = OpenFile::open(&path).unwrap();
        // As if others had been read since.
        handles().files.pop(&file.key);
        assert_eq!(read(&file).unwrap(), "old");
        let next = folder.path().join("next");
        std::fs::write(&next, "new").unwrap();
        std::fs::rename(&next, &path).unwrap();
        assert!(file.handle().is_ok(), "it is open");
        handles().files.pop(&file.key);
        assert_eq!(read(&file).unwrap_err(), ReadError::Replaced);
        assert_eq!(read_limited(&path, 9).unwrap(), b"new");
        std::fs::remove_file(&path).unwrap();
        assert_eq!(read(&file).unwrap_err(), ReadError::Replaced);
        let key = file.key;
        drop(file);
        assert!(handles().files.peek(&key).is_none());
    }

    #[test]
    fn the_file_that_was_read_longest_ago_is_closed() {
        let mut handles = Handles { files: LruCache::unbounded(), most: 2 };
        let file = Arc::new(tempfile::tempfile().unwrap());
        for key in 0..3 {
            handles.files.put(key, Arc::clone(&file));
            handles.files.get(&0);
        }
        handles.close_beyond_limit();
        assert_eq!(handles.files.iter().map(|(key, _)| *key).collect::<Vec<_>>(), [0, 2]);
    }
}
