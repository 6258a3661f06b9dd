//! One open city: its manifest and its archives.

use super::{
    archive::Archive,
    error::{ArchiveError, StoreError},
    source::{Read, ReadError},
};
use bytes::Bytes;
use insula_protocol::{
    Manifest, TileId, TileKind,
    codec::bincode,
    mesh_tile::MAX_LODS,
    tile::{self, TileReader},
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
    /// Opens a folder with `city.json` and an archive per [`TileKind`]. All files are of one version, even if the city is replaced
    /// meanwhile. Fails if a file is missing, damaged, or inconsistent with the manifest.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let location = folder.display().to_string();
        for _ in 0..MAX_ATTEMPTS {
            let stamp = CityStamp::of(folder)?;
            let manifest = read_manifest(&folder.join(MANIFEST_FILE))?;
            let open = |kind: TileKind| Archive::open(&folder.join(kind.file_name()));
            let (subtrees, blockmaps) = (open(TileKind::Subtree), open(TileKind::BlockMap));
            let meshes = stamp.has_meshes().then(|| open(TileKind::Mesh));
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
        for (kind, archive) in city.archives() {
            // Each level of detail of the meshes has its own archive level below the leaves'.
            let extra_levels = if kind == TileKind::Mesh { MAX_LODS - 1 } else { 0 };
            if archive.deepest() > city.manifest.depth + extra_levels {
                let source = ArchiveError::Directory("it has tiles below the depth that city.json gives");
                return Err(StoreError::Archive { place: city.path_of(kind.file_name()), source });
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

    /// The archive of a kind. Only meshes may be missing.
    pub fn archive(&self, kind: TileKind) -> Option<&Archive> {
        match kind {
            TileKind::Subtree => Some(&self.subtrees),
            TileKind::BlockMap => Some(&self.blockmaps),
            TileKind::Mesh => self.meshes.as_ref(),
        }
    }

    /// All archives that exist.
    pub fn archives(&self) -> impl Iterator<Item = (TileKind, &Archive)> {
        TileKind::ALL.into_iter().filter_map(|kind| Some((kind, self.archive(kind)?)))
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
    /// [`insula_protocol::mesh_tile::archive_id`]). Fails if the file cannot be read, or the city is remote.
    pub fn tile(&self, kind: TileKind, id: TileId) -> Result<Option<Bytes>, ReadError> {
        self.archive(kind).map_or(Ok(None), |archive| archive.tile(id))
    }

    /// Reads a tile of any city and checks all of its checksums; `None` if it does not exist. A damaged tile is read once more,
    /// past all caches. Fails if it cannot be read or is still damaged.
    pub async fn checked_tile(&self, kind: TileKind, id: TileId) -> Result<Option<Bytes>, ReadError> {
        let Some(archive) = self.archive(kind) else { return Ok(None) };
        let Some(range) = archive.find(id) else { return Ok(None) };
        match check(kind, read(archive, &range).await?) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(_) => {
                archive.forget(range.clone()).await;
                check(kind, read(archive, &range).await?).map(Some)
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
fn check(kind: TileKind, bytes: Bytes) -> Result<Bytes, ReadError> {
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
        let meshes = match file_stamp(TileKind::Mesh.file_name()) {
            Err(StoreError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => None,
            found => found?,
        };
        let [subtrees, blockmaps] = [TileKind::Subtree, TileKind::BlockMap].map(|kind| file_stamp(kind.file_name()));
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
