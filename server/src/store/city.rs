//! One open city: its manifest and its archives.

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
/// Attempts to open a city that is replaced meanwhile.
const MAX_ATTEMPTS: usize = 5;

static NEXT_SERIAL: AtomicU64 = AtomicU64::new(0);

/// An open city whose manifest and directories have been checked.
#[derive(Debug)]
pub struct CityStore {
    serial: u64,
    location: String,
    stamp: CityStamp,
    manifest: Manifest,
    subtrees: Archive,
    blockmaps: Archive,
    meshes: Option<Archive>,
}

/// A city's archives with their directories read.
pub(super) struct CityArchives {
    pub(super) subtrees: Archive,
    pub(super) blockmaps: Archive,
    pub(super) meshes: Option<Archive>,
}

/// Identity of a city's files, which changes when they are replaced.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum CityStamp {
    /// Of the manifest and each existing archive.
    Files([Option<FileStamp>; 4]),
    /// Hash of the manifest's text.
    Remote(blake3::Hash),
}

/// Device, inode, length and modification time.
type FileStamp = (u64, u64, u64, Option<SystemTime>);

impl CityStore {
    /// Opens a folder with `city.json` and an archive per [`Layer`]. All files are of one version, even if the city is replaced
    /// meanwhile. Fails if a file is missing, damaged, or inconsistent with the manifest.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let location = folder.display().to_string();
        for _ in 0..MAX_ATTEMPTS {
            let stamp = CityStamp::of(folder)?;
            let manifest = read_manifest(&folder.join(MANIFEST_FILE))?;
            let open = |layer: Layer| Archive::open(&folder.join(layer.file_name()));
            let (subtrees, blockmaps) = (open(Layer::Subtrees), open(Layer::BlockMaps));
            let meshes = stamp.has_meshes().then(|| open(Layer::Meshes));
            if CityStamp::of(folder)? != stamp {
                continue;
            }
            let archives = CityArchives { subtrees: subtrees?, blockmaps: blockmaps?, meshes: meshes.transpose()? };
            return Self::new(location, stamp, manifest, archives);
        }
        Err(StoreError::Changing { place: location })
    }

    /// Fails if the archives do not fit the manifest.
    pub(super) fn new(
        location: String,
        stamp: CityStamp,
        manifest: Manifest,
        CityArchives { subtrees, blockmaps, meshes }: CityArchives,
    ) -> Result<Self, StoreError> {
        let serial = NEXT_SERIAL.fetch_add(1, Ordering::Relaxed);
        let city = Self { serial, location, stamp, manifest, subtrees, blockmaps, meshes };
        for (layer, archive) in city.archives() {
            // Each level of detail of the meshes has its own archive level below the leaves'.
            let extra_levels = if layer == Layer::Meshes { MAX_LODS - 1 } else { 0 };
            if archive.deepest() > city.manifest.depth + extra_levels {
                let source = ArchiveError::Directory("it has tiles below the depth that city.json gives");
                return Err(StoreError::Archive { place: city.path_of(layer.file_name()), source });
            }
        }
        if city.manifest.tile_version != tile::VERSION {
            let found = city.manifest.tile_version;
            let reason = format!("its tiles have format version {found}, this program serves {}", tile::VERSION);
            return Err(StoreError::Manifest { place: city.path_of(MANIFEST_FILE), reason });
        }
        Ok(city)
    }

    fn path_of(&self, file: &str) -> String {
        format!("{}/{file}", self.location)
    }

    /// The contents of `city.json`.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Folder or URL of the city, for logs only: clients must not see it.
    pub fn location(&self) -> &str {
        &self.location
    }

    /// A number that differs between all cities and versions that the process has opened.
    pub fn serial(&self) -> u64 {
        self.serial
    }

    pub(super) fn stamp(&self) -> &CityStamp {
        &self.stamp
    }

    /// The archive of a layer. Only meshes may be missing.
    pub fn archive(&self, layer: Layer) -> Option<&Archive> {
        match layer {
            Layer::Subtrees => Some(&self.subtrees),
            Layer::BlockMaps => Some(&self.blockmaps),
            Layer::Meshes => self.meshes.as_ref(),
        }
    }

    /// All archives that exist.
    pub fn archives(&self) -> impl Iterator<Item = (Layer, &Archive)> {
        Layer::ALL.into_iter().filter_map(|layer| Some((layer, self.archive(layer)?)))
    }

    /// The archive of subtrees.
    pub fn subtrees(&self) -> &Archive {
        &self.subtrees
    }

    /// The archive of V-BlockMaps.
    pub fn blockmaps(&self) -> &Archive {
        &self.blockmaps
    }

    /// Reads a tile from a file without checking it; `None` if it does not exist. The id is the one in the archive (for a mesh,
    /// [`insula_protocol::mesh_tile::place`]). Fails if the file cannot be read, or the city is remote.
    pub fn tile(&self, layer: Layer, id: TileId) -> Result<Option<Bytes>, ReadError> {
        self.archive(layer).map_or(Ok(None), |archive| archive.tile(id))
    }

    /// Reads a tile of any city and checks all of its checksums; `None` if it does not exist. A damaged tile is read once more,
    /// past all caches. Fails if it cannot be read or is still damaged.
    pub async fn checked_tile(&self, layer: Layer, id: TileId) -> Result<Option<Bytes>, ReadError> {
        let Some(archive) = self.archive(layer) else { return Ok(None) };
        let Some(range) = archive.find(id) else { return Ok(None) };
        match check(layer, read(archive, &range).await?) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(_) => {
                archive.forget(range.clone()).await;
                check(layer, read(archive, &range).await?).map(Some)
            }
        }
    }

    /// Size of all archives in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.archives().map(|(_, archive)| archive.file_bytes()).sum()
    }
}

async fn read(archive: &Archive, range: &Range<u64>) -> Result<Bytes, ReadError> {
    match archive.read(range.clone()) {
        Read::Now(bytes) => bytes,
        Read::Later(bytes) => bytes.await,
    }
}

/// Checks the checksums of a tile's container, which cover every byte.
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
    /// Fails if a file's metadata cannot be read, or one other than the meshes is missing.
    pub(super) fn of(folder: &Path) -> Result<Self, StoreError> {
        let file_stamp = |name: &str| {
            let path = folder.join(name);
            let metadata = fs::metadata(&path).map_err(|source| StoreError::Io { path, source })?;
            let (device, inode) = identity(&metadata);
            Ok(Some((device, inode, metadata.len(), metadata.modified().ok())))
        };
        let meshes = match file_stamp(Layer::Meshes.file_name()) {
            Err(StoreError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => None,
            found => found?,
        };
        let [subtrees, blockmaps] = [Layer::Subtrees, Layer::BlockMaps].map(|layer| file_stamp(layer.file_name()));
        Ok(Self::Files([file_stamp(MANIFEST_FILE)?, subtrees?, blockmaps?, meshes]))
    }

    fn has_meshes(&self) -> bool {
        matches!(self, Self::Files([.., Some(_)]))
    }
}

/// Device and inode; zeros where the system has none.
#[cfg(unix)]
fn identity(metadata: &fs::Metadata) -> (u64, u64) {
    use std::os::unix::fs::MetadataExt;
    (metadata.dev(), metadata.ino())
}

#[cfg(not(unix))]
fn identity(_metadata: &fs::Metadata) -> (u64, u64) {
    (0, 0)
}

fn read_manifest(path: &Path) -> Result<Manifest, StoreError> {
    let io_error = |source: io::Error| StoreError::Io { path: path.to_owned(), source };
    let mut text = Vec::new();
    let limit = bincode::LIMIT as u64;
    File::open(path).and_then(|file| file.take(limit + 1).read_to_end(&mut text)).map_err(io_error)?;
    parse_manifest(&text).map_err(|reason| StoreError::Manifest { place: path.display().to_string(), reason })
}

/// Fails if the text is too long, not JSON, or not a valid manifest.
pub(super) fn parse_manifest(text: &[u8]) -> Result<Manifest, String> {
    if text.len() > bincode::LIMIT {
        return Err(format!("the manifest is larger than {} bytes", bincode::LIMIT));
    }
    let manifest: Manifest = serde_json::from_slice(text).map_err(|error| error.to_string())?;
    manifest.check()?;
    Ok(manifest)
}
