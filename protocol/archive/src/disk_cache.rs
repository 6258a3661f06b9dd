//! A bounded folder of cached bytes.
//!
//! A file holds a BLAKE3 checksum and then the bytes under one key. It is written under another name and renamed, and its
//! modification time is that of its last use. So the cache survives restarts, several processes may share it, and a full or
//! failing disk costs a fetch but gives no wrong byte. The files that were used longest ago are removed first.

use crate::file::open_regular;
use crate::limits::MAX_READ_BYTES;
use crate::places::{kept_folder, kept_folder_above};
use bytes::Bytes;
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

const CHECKSUM_BYTES: usize = 32;
const MAX_KEY_BYTES: usize = 200;
const HASH_DIGITS: usize = 32;
/// Longest file, however large the cache is.
const MAX_FILE_BYTES: u64 = MAX_READ_BYTES + CHECKSUM_BYTES as u64;
/// Most files, however small.
const MAX_FILES: usize = 1 << 20;
/// Age from which an unfinished file was left by an interrupted process.
const STALE: Duration = Duration::from_secs(600);
const UNFINISHED: &str = ".part";

/// A bounded folder of bytes by key. Keys are 1 to 200 of `a-z`, `0-9`, `_` and `-`; the file of a key is `KEY.EXTENSION`.
/// Files of other names are never touched. Only those whose key has a word of 32 hexadecimal digits are counted, and removed when there are
/// too many: others may be somebody else's.
#[derive(Debug)]
pub struct DiskCache {
    folder: PathBuf,
    extension: &'static str,
    max_bytes: u64,
    index: Mutex<CacheIndex>,
    /// Held by the one thread that removes files.
    shrinking: Mutex<()>,
    /// Tells apart the unfinished files of this process.
    serial: AtomicU64,
}

/// What is known of the folder. Other processes may have added and removed files since.
#[derive(Debug, Default)]
struct CacheIndex {
    /// Lengths by key.
    files: HashMap<String, u64>,
    /// Bytes that may be written before the folder is looked at again.
    bytes_to_scan: u64,
}

struct CachedFile {
    used: SystemTime,
    key: String,
    length: u64,
}

impl DiskCache {
    /// Opens or creates a cache of at most `max_bytes`. Fails if the folder cannot be created or read, or if it is one that the programs
    /// keep for other things.
    pub fn open(folder: &Path, extension: &'static str, max_bytes: u64) -> io::Result<Self> {
        let above = || kept_folder_above(folder).map(|(_, kind)| kind);
        if let Some(kind) = kept_folder(folder).or_else(above) {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("it is, or lies in, {kind}")));
        }
        fs::create_dir_all(folder)?;
        let cache = Self {
            folder: folder.to_owned(),
            extension,
            max_bytes,
            index: Mutex::default(),
            shrinking: Mutex::default(),
            serial: AtomicU64::new(0),
        };
        cache.shrink()?;
        Ok(cache)
    }

    fn index(&self) -> MutexGuard<'_, CacheIndex> {
        self.index.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn path(&self, key: &str) -> io::Result<PathBuf> {
        let invalid = || io::Error::new(io::ErrorKind::InvalidInput, "not a key of the disk cache");
        if is_key(key) { Ok(self.folder.join(format!("{key}.{}", self.extension))) } else { Err(invalid()) }
    }

    /// Whether `key` is cached as far as is known. Does not access the disk.
    pub fn contains(&self, key: &str) -> bool {
        self.index().files.contains_key(key)
    }

    /// Bytes of all files that are known.
    pub fn bytes(&self) -> u64 {
        self.index().files.values().sum()
    }

    /// The bytes under `key`. `None` if there are none, or they cannot be read. A damaged file is removed.
    pub fn read(&self, key: &str) -> Option<Bytes> {
        let path = self.path(key).ok()?;
        let mut whole = Vec::new();
        if open_regular(&path).and_then(|file| file.take(self.max_file_bytes()).read_to_end(&mut whole)).is_err() {
            self.index().files.remove(key);
            return None;
        }
        let is_intact = |(sum, bytes): (&[u8], &[u8])| blake3::hash(bytes).as_bytes() == sum;
        if !whole.split_at_checked(CHECKSUM_BYTES).is_some_and(is_intact) {
            self.remove(key);
            return None;
        }
        self.index().files.entry(key.to_owned()).or_insert(whole.len() as u64);
        if let Ok(file) = File::options().write(true).open(&path) {
            let _ = file.set_modified(SystemTime::now());
        }
        Some(Bytes::from(whole).slice(CHECKSUM_BYTES..))
    }

    fn max_file_bytes(&self) -> u64 {
        self.max_bytes.min(MAX_FILE_BYTES)
    }

    /// Stores `bytes` under `key`, unless the key is cached or the bytes are more than a file or the whole cache may have.
    pub fn write(&self, key: &str, bytes: &[u8]) -> io::Result<()> {
        let (path, length) = (self.path(key)?, (CHECKSUM_BYTES + bytes.len()) as u64);
        if length > self.max_file_bytes() || self.contains(key) {
            return Ok(());
        }
        let serial = self.serial.fetch_add(1, Ordering::Relaxed);
        let unfinished = path.with_extension(format!("{}.{}-{serial}{UNFINISHED}", self.extension, std::process::id()));
        // One that exists is another process's, also in a container, where each has the same number.
        let file = File::create_new(&unfinished)?;
        write_all(file, bytes).and_then(|()| fs::rename(&unfinished, &path)).inspect_err(|_| {
            let _ = fs::remove_file(&unfinished);
        })?;
        let must_scan = {
            let mut index = self.index();
            index.files.insert(key.to_owned(), length);
            index.bytes_to_scan = index.bytes_to_scan.saturating_sub(length);
            index.bytes_to_scan == 0 || index.files.len() > MAX_FILES
        };
        if must_scan { self.shrink() } else { Ok(()) }
    }

    /// Stores `bytes` instead of what is cached under `key`.
    pub fn replace(&self, key: &str, bytes: &[u8]) -> io::Result<()> {
        self.remove(key);
        self.write(key, bytes)
    }

    /// Removes the bytes under `key`.
    pub fn remove(&self, key: &str) {
        self.index().files.remove(key);
        let _ = self.path(key).and_then(fs::remove_file);
    }

    /// Looks at the folder, and removes the files used longest ago if there are too many bytes, until a tenth is free.
    fn shrink(&self) -> io::Result<()> {
        let Ok(_guard) = self.shrinking.try_lock() else { return Ok(()) };
        let mut files = self.scan()?;
        let mut bytes: u64 = files.iter().map(|file| file.length).sum();
        let reserve = self.max_bytes / 10;
        if bytes > self.max_bytes || files.len() > MAX_FILES {
            files.sort_by_key(|file| std::cmp::Reverse(file.used));
            while bytes > self.max_bytes - reserve || files.len() > MAX_FILES - MAX_FILES / 10 {
                let Some(oldest) = files.pop() else { break };
                bytes -= oldest.length;
                let _ = self.path(&oldest.key).and_then(fs::remove_file);
            }
        }
        // A tenth at most, because other processes write too.
        let bytes_to_scan = (self.max_bytes - bytes).min(reserve).max(1);
        let files = files.into_iter().map(|file| (file.key, file.length)).collect();
        *self.index() = CacheIndex { files, bytes_to_scan };
        Ok(())
    }

    /// The files of this cache. Removes what interrupted writes left.
    fn scan(&self) -> io::Result<Vec<CachedFile>> {
        let mut files = Vec::new();
        for entry in fs::read_dir(&self.folder)?.flatten() {
            let (Ok(about), Ok(name)) = (entry.metadata(), entry.file_name().into_string()) else { continue };
            let Some((key, rest)) = name.split_once('.').filter(|(key, _)| is_own(key)) else { continue };
            let Some(rest) = rest.strip_prefix(self.extension).filter(|_| about.is_file()) else { continue };
            let used = about.modified().unwrap_or(SystemTime::UNIX_EPOCH);
            if rest.is_empty() {
                files.push(CachedFile { used, key: key.to_owned(), length: about.len() });
            } else if rest.starts_with('.') && rest.ends_with(UNFINISHED) && used.elapsed().is_ok_and(|age| age > STALE)
            {
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(files)
    }
}

fn is_key(key: &str) -> bool {
    (1..=MAX_KEY_BYTES).contains(&key.len())
        && key.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_' || b == b'-')
}

/// Whether a key is certainly one of a program: it has a hash.
fn is_own(key: &str) -> bool {
    let is_hash =
        |word: &str| word.len() >= HASH_DIGITS && word.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    is_key(key) && key.split('-').any(is_hash)
}

/// The system's own modification times are coarser than the order of uses.
fn write_all(mut file: File, bytes: &[u8]) -> io::Result<()> {
    file.write_all(blake3::hash(bytes).as_bytes())?;
    file.write_all(bytes)?;
    file.set_modified(SystemTime::now())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(name: &str) -> String {
        format!("{name}-{}", "0".repeat(HASH_DIGITS))
    }

    fn cache(folder: &Path, max_bytes: u64) -> DiskCache {
        DiskCache::open(folder, "tile", max_bytes).unwrap()
    }

    fn bytes_on_disk(folder: &Path) -> u64 {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len()).sum()
    }

    #[test]
    fn stays_within_its_bytes_and_evicts_least_recently_used_first() {
        let folder = tempfile::tempdir().unwrap();
        let cache = cache(folder.path(), 10 * 132);
        for number in 0..30u8 {
            cache.write(&key(&format!("k{number:x}")), &[number; 100]).unwrap();
            assert_eq!(cache.read(&key("k0")).unwrap(), &[0; 100][..], "it is in use");
            assert!(bytes_on_disk(folder.path()) <= 10 * 132 && cache.bytes() == bytes_on_disk(folder.path()));
        }
        let [old, new] = ["k5", "k1d"].map(key);
        assert!(cache.read(&old).is_none() && !cache.contains(&old) && cache.contains(&new));
        cache.write("huge", &[0; 2000]).unwrap();
        assert!(!cache.contains("huge"));
    }

    #[test]
    fn survives_restarts_and_leaves_foreign_files_alone() {
        let folder = tempfile::tempdir().unwrap();
        let first = cache(folder.path(), 1000);
        let [a, b] = ["a", "b"].map(key);
        first.write(&a, b"a").unwrap();
        first.write(&b, b"b").unwrap();
        first.replace(&b, b"other").unwrap();
        drop(first);
        let foreign =
            ["notes.txt", "a", "A.tile", "a.tiles", "x.part", ".tile", "a.block", "roof.tile", "my-2024.tile"];
        for name in foreign {
            fs::write(folder.path().join(name), [0; 2000]).unwrap();
        }
        fs::create_dir(folder.path().join("folder.tile")).unwrap();
        let [stale, fresh] = [format!("{a}.tile.7-0.part"), format!("{b}.tile.7-1.part")];
        for (name, age_secs) in [(&stale, 3600), (&fresh, 0)] {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age_secs)).unwrap();
        }
        let again = cache(folder.path(), 1000);
        assert_eq!(again.read(&a).unwrap(), &b"a"[..]);
        assert_eq!(again.read(&b).unwrap(), &b"other"[..]);
        assert!(!folder.path().join(stale).exists(), "left by an interrupted process");
        assert!(folder.path().join(fresh).exists(), "another process may be writing it");
        assert!(foreign.iter().all(|name| folder.path().join(name).exists()));
        drop(again);
        let smaller = cache(folder.path(), 50);
        assert!(smaller.bytes() <= 50 && smaller.contains(&b), "the bound may be lowered");
        assert!(foreign.iter().all(|name| folder.path().join(name).exists()));
        assert!(DiskCache::open(&folder.path().join("folder.tile"), "tile", 50).is_ok());
        fs::write(folder.path().join("folder.tile").join(crate::places::WORK_FILE), "").unwrap();
        for kept in ["folder.tile", "folder.tile/new"] {
            assert!(DiskCache::open(&folder.path().join(kept), "tile", 50).is_err(), "{kept}");
        }
    }

    #[test]
    fn an_unfinished_file_of_another_process_of_this_number_stays() {
        let folder = tempfile::tempdir().unwrap();
        let cache = cache(folder.path(), 1000);
        let other = folder.path().join(format!("a.tile.{}-0{UNFINISHED}", std::process::id()));
        fs::write(&other, "half").unwrap();
        assert!(cache.write("a", b"a").is_err());
        assert_eq!(fs::read_to_string(&other).unwrap(), "half");
        cache.write("a", b"a").unwrap();
        assert_eq!(cache.read("a").unwrap(), &b"a"[..]);
    }

    #[test]
    fn removes_damaged_files() {
        let folder = tempfile::tempdir().unwrap();
        let cache = cache(folder.path(), 10_000);
        let path = folder.path().join("a.tile");
        for damage in [&b""[..], b"short", &[1; 132], &[2; 20_000]] {
            cache.write("a", &[7; 100]).unwrap();
            assert_eq!(cache.read("a").unwrap(), &[7; 100][..]);
            fs::write(&path, damage).unwrap();
            assert!(cache.read("a").is_none() && !path.exists() && !cache.contains("a"));
        }
        for at in [0, 31, 32, 131] {
            cache.write("a", &[7; 100]).unwrap();
            let mut bytes = fs::read(&path).unwrap();
            bytes[at] ^= 1;
            fs::write(&path, bytes).unwrap();
            assert!(cache.read("a").is_none() && !path.exists());
        }
        assert_eq!(cache.bytes(), 0);
    }

    #[test]
    fn files_of_any_length_are_read_within_a_limit() {
        let folder = tempfile::tempdir().unwrap();
        let cache = cache(folder.path(), 1 << 50);
        let path = folder.path().join("a.tile");
        cache.write("a", b"a").unwrap();
        // A terabyte that takes no room on the disk.
        File::options().write(true).open(&path).unwrap().set_len(1 << 40).unwrap();
        assert!(cache.read("a").is_none() && !path.exists());
        cache.write("b", &vec![0; MAX_READ_BYTES as usize + 1]).unwrap();
        assert!(!cache.contains("b"));
    }

    #[test]
    fn processes_share_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = [0, 1].map(|_| cache(folder.path(), 2000));
        a.write("x", b"from a").unwrap();
        assert_eq!(b.read("x").unwrap(), &b"from a"[..]);
        b.remove("x");
        assert!(a.read("x").is_none() && !a.contains("x"));
        for number in 0..40 {
            let cache = if number % 2 == 0 { &a } else { &b };
            cache.write(&key(&format!("k{number}")), &[1; 100]).unwrap();
            assert!(bytes_on_disk(folder.path()) <= 2000 + 2 * 200, "each looks again after a tenth");
        }
    }

    #[test]
    fn works_without_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let cache = cache(folder.path(), 1000);
        cache.write("a", b"a").unwrap();
        fs::remove_dir_all(folder.path()).unwrap();
        assert!(cache.read("a").is_none() && cache.write("b", b"b").is_err());
    }

    #[test]
    fn keys_cannot_leave_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let cache = cache(&folder.path().join("in"), 1000);
        for key in ["", "../a", "a/b", "a.b", "A", &"a".repeat(201)] {
            assert!(cache.write(key, b"x").is_err() && cache.read(key).is_none());
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
