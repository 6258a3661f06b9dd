//! One city's folder.
//!
//! In: a folder, or where its files lie in a store. Out: [`CityStore`]: its manifest and its archives. Next: `Store` holds several.

use super::{
    archive::Archive,
    error::{ArchiveError, StoreError},
    source::{Read, ReadError},
};
use bytes::Bytes;
use insula_protocol::{
    Manifest, TileId,
    codec::bincode,
    mesh_tile::MAX_LODS,
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

/// The manifest's name in a city's folder.
pub const MANIFEST_FILE: &str = "city.json";
/// Times that a city is opened anew because it was replaced meanwhile.
const ATTEMPTS: usize = 5;

static SERIALS: AtomicU64 = AtomicU64::new(0);

/// A city whose manifest and directories have been checked.
#[derive(Debug)]
pub struct CityStore {
    serial: u64,
    place: String,
    stamp: CityStamp,
    manifest: Manifest,
    subtrees: Archive,
    blockmaps: Archive,
    meshes: Option<Archive>,
}

/// A city's archives, read.
pub(super) struct CityArchives {
    pub(super) subtrees: Archive,
    pub(super) blockmaps: Archive,
    pub(super) meshes: Option<Archive>,
}

/// What tells a city's files from those that replace them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum CityStamp {
    /// Of the manifest and each archive that is there.
    Files([Option<FileStamp>; 4]),
    /// Of the manifest's text.
    Remote(blake3::Hash),
}

/// Device, inode, length, time of change.
type FileStamp = (u64, u64, u64, Option<SystemTime>);

impl CityStore {
    /// Opens a folder with `city.json` and an archive for each [`Layer`] that it has: all of one version, even if it is being replaced.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let place = folder.display().to_string();
        for _ in 0..ATTEMPTS {
            let stamp = CityStamp::of(folder)?;
            let manifest = read_manifest(&folder.join(MANIFEST_FILE))?;
            let open = |layer: Layer| Archive::open(&folder.join(layer.file_name()));
            let (subtrees, blockmaps) = (open(Layer::Subtrees), open(Layer::BlockMaps));
            let meshes = stamp.has_meshes().then(|| open(Layer::Meshes));
            if CityStamp::of(folder)? != stamp {
                continue;
            }
            let archives = CityArchives { subtrees: subtrees?, blockmaps: blockmaps?, meshes: meshes.transpose()? };
            return Self::new(place, stamp, manifest, archives);
        }
        Err(StoreError::Changing { place })
    }

    pub(super) fn new(
        place: String,
        stamp: CityStamp,
        manifest: Manifest,
        CityArchives { subtrees, blockmaps, meshes }: CityArchives,
    ) -> Result<Self, StoreError> {
        let serial = SERIALS.fetch_add(1, Ordering::Relaxed);
        let city = Self { serial, place, stamp, manifest, subtrees, blockmaps, meshes };
        for (layer, archive) in city.archives() {
            let below = if layer == Layer::Meshes { MAX_LODS - 1 } else { 0 };
            if archive.deepest() > city.manifest.depth + below {
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
    pub fn location(&self) -> &str {
        &self.place
    }

    /// Differs between all that this process has opened.
    pub fn serial(&self) -> u64 {
        self.serial
    }

    pub(super) fn stamp(&self) -> &CityStamp {
        &self.stamp
    }

    /// The archive of a layer, if the city has it: all have V-BlockMaps and subtrees.
    pub fn archive(&self, layer: Layer) -> Option<&Archive> {
        match layer {
            Layer::Subtrees => Some(&self.subtrees),
            Layer::BlockMaps => Some(&self.blockmaps),
            Layer::Meshes => self.meshes.as_ref(),
        }
    }

    /// The archives that it has.
    pub fn archives(&self) -> impl Iterator<Item = (Layer, &Archive)> {
        Layer::ALL.into_iter().filter_map(|layer| Some((layer, self.archive(layer)?)))
    }

    /// Which nodes exist.
    pub fn subtrees(&self) -> &Archive {
        &self.subtrees
    }

    /// Their V-BlockMaps.
    pub fn blockmaps(&self) -> &Archive {
        &self.blockmaps
    }

    /// A tile's bytes from a file, unchecked. A mesh is named by its place ([`insula_protocol::mesh_tile::place`]).
    pub fn tile(&self, layer: Layer, id: TileId) -> Result<Option<Bytes>, ReadError> {
        self.archive(layer).map_or(Ok(None), |archive| archive.tile(id))
    }

    /// A tile's bytes, wherever they are, every checksum in them right. `None` if there is no such tile.
    ///
    /// What is wrong is read once more, past all caches, before it is called damaged.
    pub async fn checked_tile(&self, layer: Layer, id: TileId) -> Result<Option<Bytes>, ReadError> {
        let Some(archive) = self.archive(layer) else { return Ok(None) };
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
        self.archives().map(|(_, archive)| archive.file_bytes()).sum()
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
        Layer::Meshes => Kind::Mesh,
    };
    match TileReader::new(&bytes, kind) {
        Ok(_) => Ok(bytes),
        Err(error) => Err(ReadError::Damaged(error.to_string())),
    }
}

impl CityStamp {
    /// Errors: a file is missing or cannot be looked at.
    pub(super) fn of(folder: &Path) -> Result<Self, StoreError> {
        let look = |name: &str| {
            let path = folder.join(name);
            let about = fs::metadata(&path).map_err(|source| StoreError::Io { path, source })?;
            let (device, inode) = identity(&about);
            Ok(Some((device, inode, about.len(), about.modified().ok())))
        };
        let meshes = match look(Layer::Meshes.file_name()) {
            Err(StoreError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => None,
            found => found?,
        };
        let [subtrees, blockmaps] = [Layer::Subtrees, Layer::BlockMaps].map(|layer| look(layer.file_name()));
        Ok(Self::Files([look(MANIFEST_FILE)?, subtrees?, blockmaps?, meshes]))
    }

    fn has_meshes(&self) -> bool {
        matches!(self, Self::Files([.., Some(_)]))
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
