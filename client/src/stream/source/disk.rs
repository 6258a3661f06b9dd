//! What was fetched, kept on disk for the next time: `--disk-cache-mib`.
//!
//! In: another [`Source`]. Out: the same tiles, from the user's cache folder if they are there. Next: `decode`.
//!
//! A file a tile, named after city and version, with a BLAKE3 checksum before its bytes: what a full or a dying disk left
//! half is fetched again. Only tiles that decode are kept. The oldest go when the folder's bytes are spent; a file's time
//! says when it was last of use, also to other runs of this program. Whatever goes wrong here costs a fetch, never a picture.

use super::{Pending, Source};
use crate::error::{ClientError, Result};
use bytes::Bytes;
use insula_protocol::{Manifest, route::Layer};
use insula_viewer::{decode::MAX_TILE_BYTES, scene::TileKey};
use lru::LruCache;
use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, MutexGuard,
        atomic::{AtomicU64, Ordering},
    },
    time::SystemTime,
};

const SUM_BYTES: usize = 32;
/// Most files that are kept, however small.
const FILES: usize = 1 << 20;

/// The folder, shared by all cities that are opened.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    limit_bytes: u64,
    /// Names of files and their bytes, the oldest first.
    kept: Mutex<Kept>,
    serial: AtomicU64,
}

#[derive(Debug)]
struct Kept {
    files: LruCache<String, u64>,
    bytes: u64,
}

impl Folder {
    /// Opens (or makes) a folder of at most `limit_bytes`.
    pub fn open(path: &Path, limit_bytes: u64) -> io::Result<Self> {
        fs::create_dir_all(path)?;
        let mut found = Vec::new();
        for entry in fs::read_dir(path)?.flatten().take(FILES) {
            let (Ok(about), Ok(name)) = (entry.metadata(), entry.file_name().into_string()) else { continue };
            if name.starts_with(TEMPORARY) {
                let _ = fs::remove_file(entry.path());
            } else if about.is_file() {
                found.push((about.modified().unwrap_or(SystemTime::UNIX_EPOCH), name, about.len()));
            }
        }
        found.sort();
        let mut kept = Kept { files: LruCache::unbounded(), bytes: 0 };
        for (_, name, bytes) in found {
            kept.bytes += bytes;
            kept.files.put(name, bytes);
        }
        let folder = Self { path: path.to_owned(), limit_bytes, kept: Mutex::new(kept), serial: AtomicU64::new(0) };
        folder.shrink(&mut folder.kept());
        Ok(folder)
    }

    /// The folder of this program's user.
    pub fn of_user(limit_bytes: u64) -> Result<Self> {
        let folders = directories::ProjectDirs::from("", "", "insula")
            .ok_or_else(|| ClientError::Failed("there is no home folder to keep tiles in: set HOME".into()))?;
        let path = folders.cache_dir().join("tiles");
        Self::open(&path, limit_bytes).map_err(ClientError::file(&path))
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Whether there is something of that name.
    pub fn has(&self, name: &str) -> bool {
        self.kept().files.contains(name)
    }

    /// Bytes that are kept.
    pub fn bytes(&self) -> u64 {
        self.kept().bytes
    }

    /// What was kept under `name`; `None` if nothing is, or it is damaged.
    pub fn read(&self, name: &str) -> Option<Bytes> {
        let length = *self.kept().files.get(name)?;
        let path = self.path.join(name);
        let file = (length as usize <= MAX_TILE_BYTES + SUM_BYTES).then(|| fs::read(&path)).and_then(Result::ok);
        let good = file.filter(|file| {
            let sum = file.first_chunk::<SUM_BYTES>();
            sum.is_some_and(|sum| *blake3::hash(&file[SUM_BYTES..]).as_bytes() == *sum)
        });
        match good {
            Some(file) => {
                if let Ok(open) = fs::File::options().write(true).open(&path) {
                    let _ = open.set_modified(SystemTime::now());
                }
                Some(Bytes::from(file).slice(SUM_BYTES..))
            }
            None => {
                self.remove(name);
                None
            }
        }
    }

    /// Keeps `bytes` under `name`, if there is room once the oldest have gone.
    pub fn write(&self, name: &str, bytes: &[u8]) {
        let length = (bytes.len() + SUM_BYTES) as u64;
        if length > self.limit_bytes || bytes.len() > MAX_TILE_BYTES || self.has(name) {
            return;
        }
        let serial = self.serial.fetch_add(1, Ordering::Relaxed);
        let temporary = self.path.join(format!("{TEMPORARY}{}-{serial}", std::process::id()));
        let sum = blake3::hash(bytes);
        let whole = [sum.as_bytes(), bytes].concat();
        // Written aside and renamed: another run of this program never sees half of it.
        let written = fs::write(&temporary, whole).and_then(|()| fs::rename(&temporary, self.path.join(name)));
        if let Err(error) = written {
            tracing::debug!("the disk cache keeps nothing: {error}");
            let _ = fs::remove_file(&temporary);
            return;
        }
        let mut kept = self.kept();
        kept.bytes += length;
        if let Some(before) = kept.files.put(name.to_owned(), length) {
            kept.bytes -= before;
        }
        self.shrink(&mut kept);
    }

    /// Keeps `bytes` in place of what was kept under `name`.
    pub fn replace(&self, name: &str, bytes: &[u8]) {
        self.remove(name);
        self.write(name, bytes);
    }

    fn remove(&self, name: &str) {
        let mut kept = self.kept();
        if let Some(bytes) = kept.files.pop(name) {
            kept.bytes -= bytes;
        }
        let _ = fs::remove_file(self.path.join(name));
    }

    fn shrink(&self, kept: &mut Kept) {
        while kept.bytes > self.limit_bytes || kept.files.len() > FILES {
            let Some((name, bytes)) = kept.files.pop_lru() else { return };
            kept.bytes -= bytes;
            let _ = fs::remove_file(self.path.join(name));
        }
    }
}

const TEMPORARY: &str = "new-";

/// A city with a folder before it.
pub struct Disk {
    inner: Arc<dyn Source>,
    folder: Arc<Folder>,
    prefix: String,
}

impl Disk {
    /// Tiles of the city of `manifest` from `inner`, unless they are in `folder`.
    pub fn new(inner: Arc<dyn Source>, folder: Arc<Folder>, manifest: &Manifest) -> Self {
        Self { inner, folder, prefix: format!("{}-{}", manifest.name, manifest.version) }
    }

    fn name(&self, key: TileKey) -> String {
        let id = key.id;
        let tile = format!("{}-{}-{}-{}-{}", self.prefix, key.layer().word(), id.level(), id.x(), id.y());
        if key.layer() == Layer::Meshes { format!("{tile}-{}", key.lod) } else { tile }
    }
}

impl Source for Disk {
    fn tile(&self, key: TileKey) -> Pending<'_> {
        let (folder, name) = (self.folder.clone(), self.name(key));
        Box::pin(async move {
            // A broken-off read is a miss.
            let kept = tokio::task::spawn_blocking(move || folder.read(&name)).await;
            match kept.ok().flatten() {
                Some(bytes) => Ok(bytes),
                None => self.inner.tile(key).await,
            }
        })
    }

    fn is_near(&self, key: TileKey) -> bool {
        self.folder.has(&self.name(key))
    }

    fn keep(&self, key: TileKey, bytes: &Bytes) {
        self.folder.write(&self.name(key), bytes);
    }

    fn forget(&self, key: TileKey) {
        self.folder.remove(&self.name(key));
    }

    fn place(&self) -> &str {
        self.inner.place()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Temporary(PathBuf);

    impl Temporary {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("insula-disk-{name}-{}", std::process::id()));
            let _ = fs::remove_dir_all(&path);
            Self(path)
        }
    }

    impl Drop for Temporary {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn keeps_over_runs_and_stays_within_its_bytes() {
        let place = Temporary::new("keeps");
        let folder = Folder::open(&place.0, 900).unwrap();
        folder.write("a", &[7; 300]);
        folder.write("b", &[8; 300]);
        assert_eq!(folder.read("a").unwrap(), &[7; 300][..]);
        // The third does not fit beside the two: the one that was used longer ago goes.
        folder.write("c", &[9; 300]);
        assert!(folder.has("a") && !folder.has("b") && folder.has("c"));
        folder.write("huge", &[0; 2000]);
        assert!(!folder.has("huge") && folder.bytes() <= 900);
        drop(folder);
        fs::write(place.0.join("new-1-1"), "half").unwrap();
        let again = Folder::open(&place.0, 400).unwrap();
        assert!(again.bytes() <= 400 && again.bytes() > 0 && !place.0.join("new-1-1").exists());
    }

    #[test]
    fn what_is_damaged_is_gone() {
        let place = Temporary::new("damaged");
        let folder = Folder::open(&place.0, 10_000).unwrap();
        for (name, spoil) in [("flipped", 40usize), ("cut", 0)] {
            folder.write(name, &[1; 100]);
            let path = place.0.join(name);
            let mut bytes = fs::read(&path).unwrap();
            match spoil {
                0 => bytes.truncate(20),
                at => bytes[at] ^= 1,
            }
            fs::write(&path, bytes).unwrap();
            assert!(folder.read(name).is_none() && !path.exists() && !folder.has(name));
        }
        assert_eq!(folder.bytes(), 0);
    }
}
