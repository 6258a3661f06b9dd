//! A baked city that is being served, and how to tell that its files were replaced.

use super::error::StoreError;
use insula_archive::{BakedCity, city::MANIFEST_FILE};
use insula_protocol::route::Layer;
use std::{
    fs, io,
    ops::Deref,
    path::Path,
    sync::atomic::{AtomicU64, Ordering},
    time::SystemTime,
};

/// How often opening a folder is repeated because it was replaced meanwhile.
const ATTEMPTS: usize = 5;

static SERIALS: AtomicU64 = AtomicU64::new(0);

/// An opened city. Its methods are those of [`BakedCity`].
#[derive(Debug)]
pub struct CityStore {
    serial: u64,
    stamp: CityStamp,
    city: BakedCity,
}

/// Tells a city's files from those that replace them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum CityStamp {
    /// Of the manifest, the two archives that all cities have, and that of meshes.
    Files([Option<FileStamp>; 4]),
    /// Hash of the manifest.
    Remote(blake3::Hash),
}

/// Device, inode, length, modification time.
type FileStamp = (u64, u64, u64, Option<SystemTime>);

impl CityStore {
    /// Opens a folder. All files are of one version, even if the folder is being replaced.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        for _ in 0..ATTEMPTS {
            let stamp = CityStamp::of(folder)?;
            let city = BakedCity::open(folder);
            if CityStamp::of(folder)? == stamp {
                return Ok(Self::new(stamp, city?));
            }
        }
        Err(StoreError::Changing { place: folder.display().to_string() })
    }

    pub(super) fn new(stamp: CityStamp, city: BakedCity) -> Self {
        Self { serial: SERIALS.fetch_add(1, Ordering::Relaxed), stamp, city }
    }

    /// Differs between all cities that this process has opened.
    pub fn serial(&self) -> u64 {
        self.serial
    }

    pub(super) fn stamp(&self) -> &CityStamp {
        &self.stamp
    }
}

impl Deref for CityStore {
    type Target = BakedCity;

    fn deref(&self) -> &BakedCity {
        &self.city
    }
}

impl CityStamp {
    /// Fails if a file is missing or cannot be examined.
    pub(super) fn of(folder: &Path) -> Result<Self, StoreError> {
        let stamp = |name: &str| {
            let path = folder.join(name);
            let about = fs::metadata(&path).map_err(|source| StoreError::Io { path, source })?;
            let (device, inode) = identity(&about);
            Ok(Some((device, inode, about.len(), about.modified().ok())))
        };
        let meshes = match stamp(Layer::Meshes.file_name()) {
            Err(StoreError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => None,
            found => found?,
        };
        let [subtrees, blockmaps] = [Layer::Subtrees, Layer::BlockMaps].map(|kind| stamp(kind.file_name()));
        Ok(Self::Files([stamp(MANIFEST_FILE)?, subtrees?, blockmaps?, meshes]))
    }
}

#[cfg(unix)]
fn identity(about: &fs::Metadata) -> (u64, u64) {
    use std::os::unix::fs::MetadataExt;
    (about.dev(), about.ino())
}

#[cfg(not(unix))]
fn identity(_about: &fs::Metadata) -> (u64, u64) {
    (0, 0)
}
