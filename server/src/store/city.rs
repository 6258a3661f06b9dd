//! One city's folder.
//!
//! In: a folder, or where its files lie in a store. Out: [`CityStore`]: its manifest and its archives. Next: `Store` holds several.

use super::{
    Archive, ArchiveError, MANIFEST_FILE, StoreError,
    source::{Read, ReadError},
};
use bytes::Bytes;
use insula_protocol::{
    Manifest, TileId,
    codec::bincode,
    route::Layer,
    tile::{self, Kind, TileReader},
};
use std::{
    fs::{self, File},
    io::{self, Read as _},
    ops::Range,
    path::Path,
    sync::atomic::{AtomicU64, Ordering},
    time::SystemTime,
};

/// Times that a city is opened anew because it was replaced meanwhile.
const ATTEMPTS: usize = 5;

static SERIALS: AtomicU64 = AtomicU64::new(0);

/// A city whose manifest and directories have been checked.
#[derive(Debug)]
pub struct CityStore {
    serial: u64,
    place: String,
    stamp: Stamp,
    manifest: Manifest,
    subtrees: Archive,
    blockmaps: Archive,
}

/// What tells a city's files from those that replace them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Stamp {
    /// Of each file: device, inode, length, time of change.
    Files([(u64, u64, u64, Option<SystemTime>); 3]),
    /// Of the manifest's text.
    Remote(blake3::Hash),
}

impl CityStore {
    /// Opens a folder with `city.json` and an archive for each [`Layer`]: all of one version, even if it is being replaced.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let place = folder.display().to_string();
        for _ in 0..ATTEMPTS {
            let stamp = Stamp::of(folder)?;
            let manifest = read_manifest(&folder.join(MANIFEST_FILE))?;
            let archives = Layer::ALL.map(|layer| Archive::open(&folder.join(layer.file_name())));
            if Stamp::of(folder)? != stamp {
                continue;
            }
            let [subtrees, blockmaps] = archives;
            return Self::new(place, stamp, manifest, subtrees?, blockmaps?);
        }
        Err(StoreError::Changing { place })
    }

    pub(super) fn new(
        place: String,
        stamp: Stamp,
        manifest: Manifest,
        subtrees: Archive,
        blockmaps: Archive,
    ) -> Result<Self, StoreError> {
        let serial = SERIALS.fetch_add(1, Ordering::Relaxed);
        let city = Self { serial, place, stamp, manifest, subtrees, blockmaps };
        for layer in Layer::ALL {
            if city.archive(layer).deepest() > city.manifest.depth {
                let source = ArchiveError::Directory("it has levels that city.json does not know");
                return Err(StoreError::Archive { place: city.path_of(layer.file_name()), source });
            }
        }
        if city.manifest.tile_version != tile::VERSION {
            let found = city.manifest.tile_version;
            let reason = format!("its tiles are of version {found}, this program serves {}", tile::VERSION);
            return Err(StoreError::Manifest { place: city.path_of(MANIFEST_FILE), reason });
        }
        Ok(city)
    }

    fn path_of(&self, file: &str) -> String {
        format!("{}/{file}", self.place)
    }

    /// What a client must know first.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Where it was opened; for messages to the host, never for clients.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Differs between all that this process has opened.
    pub fn serial(&self) -> u64 {
        self.serial
    }

    pub(super) fn stamp(&self) -> &Stamp {
        &self.stamp
    }

    /// The archive of a layer.
    pub fn archive(&self, layer: Layer) -> &Archive {
        match layer {
            Layer::Subtrees => &self.subtrees,
            Layer::BlockMaps => &self.blockmaps,
        }
    }

    /// A tile's bytes from a file, unchecked.
    pub fn tile(&self, layer: Layer, id: TileId) -> Result<Option<Bytes>, ReadError> {
        self.archive(layer).tile(id)
    }

    /// A tile's bytes, wherever they are, every checksum in them right. `None` if there is no such tile.
    ///
    /// What is wrong is read once more, past all caches, before it is called damaged.
    pub async fn checked_tile(&self, layer: Layer, id: TileId) -> Result<Option<Bytes>, ReadError> {
        let archive = self.archive(layer);
        let Some(place) = archive.find(id) else { return Ok(None) };
        match check(layer, read(archive, &place).await?) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(_) => {
                archive.forget(place.clone()).await;
                check(layer, read(archive, &place).await?).map(Some)
            }
        }
    }

    /// Size of all archives.
    pub fn file_bytes(&self) -> u64 {
        Layer::ALL.into_iter().map(|layer| self.archive(layer).file_bytes()).sum()
    }
}

async fn read(archive: &Archive, place: &Range<u64>) -> Result<Bytes, ReadError> {
    match archive.read(place.clone()) {
        Read::Now(bytes) => bytes,
        Read::Later(bytes) => bytes.await,
    }
}

/// A tile's frame covers every byte of it with a checksum.
fn check(layer: Layer, bytes: Bytes) -> Result<Bytes, ReadError> {
    let kind = match layer {
        Layer::Subtrees => Kind::Subtree,
        Layer::BlockMaps => Kind::BlockMap,
    };
    match TileReader::new(&bytes, kind) {
        Ok(_) => Ok(bytes),
        Err(error) => Err(ReadError::Damaged(error.to_string())),
    }
}

impl Stamp {
    /// Errors: a file is missing or cannot be looked at.
    pub(super) fn of(folder: &Path) -> Result<Self, StoreError> {
        let look = |name: &str| {
            let path = folder.join(name);
            let about = fs::metadata(&path).map_err(|source| StoreError::Io { path, source })?;
            let (device, inode) = identity(&about);
            Ok((device, inode, about.len(), about.modified().ok()))
        };
        Ok(Self::Files([look(MANIFEST_FILE)?, look(Layer::Subtrees.file_name())?, look(Layer::BlockMaps.file_name())?]))
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

fn read_manifest(path: &Path) -> Result<Manifest, StoreError> {
    let unreadable = |source: io::Error| StoreError::Io { path: path.to_owned(), source };
    let mut text = Vec::new();
    let limit = bincode::LIMIT as u64;
    File::open(path).and_then(|file| file.take(limit + 1).read_to_end(&mut text)).map_err(unreadable)?;
    parse_manifest(&text).map_err(|reason| StoreError::Manifest { place: path.display().to_string(), reason })
}

pub(super) fn parse_manifest(text: &[u8]) -> Result<Manifest, String> {
    if text.len() > bincode::LIMIT {
        return Err(format!("a manifest is at most {} bytes", bincode::LIMIT));
    }
    let manifest: Manifest = serde_json::from_slice(text).map_err(|error| error.to_string())?;
    manifest.check()?;
    Ok(manifest)
}
