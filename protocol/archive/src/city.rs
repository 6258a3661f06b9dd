//! A baked city: its manifest and its archives.

use crate::limits::max_tile_bytes;
use crate::{Archive, ArchiveError, CityError, ReadError};
use bytes::Bytes;
use insula_protocol::codec::bincode;
use insula_protocol::mesh_tile::MAX_LODS;
#[cfg(feature = "fs")]
use insula_protocol::release::SharedCity;
use insula_protocol::tile::{self, TileReader};
use insula_protocol::{Manifest, TileId, TileKind};

#[cfg(feature = "fs")]
mod folder;
#[cfg(feature = "fs")]
mod version;

#[cfg(feature = "fs")]
pub use folder::{dated_folder, first_city_in};
#[cfg(feature = "fs")]
pub use version::{ArchiveDigest, content_version, version_of};

/// The manifest's file name in a city's folder.
pub const MANIFEST_FILE: &str = "city.json";
/// The file of a city's search index, if the city has one.
pub const SEARCH_FILE: &str = "search.index";
/// Largest search index in bytes. It is read whole, so it takes as much memory.
pub const MAX_SEARCH_BYTES: u64 = 256 << 20;
/// Largest manifest.
pub const MAX_MANIFEST_BYTES: usize = bincode::LIMIT;

/// A city whose manifest and directories have been checked.
#[derive(Debug)]
pub struct BakedCity {
    location: String,
    manifest: Manifest,
    archives: CityArchives,
}

/// The archives of a city.
#[derive(Debug)]
pub struct CityArchives {
    pub subtrees: Archive,
    pub blockmaps: Archive,
    /// The leaves' meshes, if the city has any.
    pub meshes: Option<Archive>,
    /// Schema and blocks of the objects, if the city has any.
    pub objects: Option<Archive>,
    /// What can be seen from streets, if the bake has computed it.
    pub visibility: Option<Archive>,
}

impl BakedCity {
    /// Checks that manifest and archives can be of one city. `location` is the folder's path or address, for messages.
    pub fn new(location: String, manifest: Manifest, archives: CityArchives) -> Result<Self, CityError> {
        let city = Self { location, manifest, archives };
        for (kind, archive) in city.archives() {
            // Each level of detail of the meshes has its own level of the archive, from the leaves' level on.
            let extra_levels = if kind == TileKind::Mesh { MAX_LODS - 1 } else { 0 };
            let refuse = |source| Err(CityError::Archive { location: city.path_of(kind.file_name()), source });
            let damage = |what| refuse(ArchiveError::Directory(what));
            if !archive.is_of(&city.manifest) {
                return refuse(ArchiveError::OtherVersion);
            }
            if kind != TileKind::Objects && archive.deepest_level() > city.manifest.depth + extra_levels {
                return damage("it has tiles below the depth that city.json gives");
            }
            // Only V-BlockMaps do not name their node and may be equal. A run of millions would take a program hours to read.
            if kind != TileKind::BlockMap && archive.has_runs() {
                return damage("several nodes share a tile that names its node");
            }
            if archive.longest_tile_bytes() as usize > max_tile_bytes(kind) {
                return damage("a tile is longer than any tile may be");
            }
        }
        if city.manifest.tile_version != tile::VERSION {
            let found = city.manifest.tile_version;
            let reason = format!(
                "its tiles have format version {found}, this program reads {}: bake the city again",
                tile::VERSION
            );
            return Err(CityError::Manifest { location: city.path_of(MANIFEST_FILE), reason });
        }
        Ok(city)
    }

    /// Opens a folder with `city.json` and its archives. Fails if that takes longer than
    /// [`MAX_OPENING_TIME`](crate::limits::MAX_OPENING_TIME).
    #[cfg(feature = "fs")]
    pub fn open(folder: &std::path::Path) -> Result<Self, CityError> {
        let manifest = read_manifest(folder)?;
        let beside = folder.join("..");
        let is_missing = |shared: &&SharedCity| !beside.join(&shared.name).join(MANIFEST_FILE).is_file();
        if let Some(SharedCity { name, .. }) = manifest.shared().iter().find(is_missing) {
            return Err(CityError::NotBeside { location: folder.display().to_string(), name: name.clone() });
        }
        let deadline = std::time::Instant::now() + crate::limits::MAX_OPENING_TIME;
        let open = |kind: TileKind| open_archive(folder, &beside, manifest.shared(), kind, deadline);
        let open_optional = |kind: TileKind| match open(kind) {
            Err(CityError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Ok(None),
            archive => archive.map(Some),
        };
        let archives = CityArchives {
            subtrees: open(TileKind::Subtree)?,
            blockmaps: open(TileKind::BlockMap)?,
            meshes: open_optional(TileKind::Mesh)?,
            objects: open_optional(TileKind::Objects)?,
            visibility: open_optional(TileKind::Visibility)?,
        };
        Self::new(folder.display().to_string(), manifest, archives)
    }

    fn path_of(&self, file: &str) -> String {
        format!("{}/{file}", self.location)
    }

    /// What a client needs before its first tile.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Path or address of the folder, for messages to the host.
    pub fn location(&self) -> &str {
        &self.location
    }

    /// The archive of one kind of tile. All cities have subtrees and V-BlockMaps.
    pub fn archive(&self, kind: TileKind) -> Option<&Archive> {
        match kind {
            TileKind::Subtree => Some(&self.archives.subtrees),
            TileKind::BlockMap => Some(&self.archives.blockmaps),
            TileKind::Mesh => self.archives.meshes.as_ref(),
            TileKind::Objects => self.archives.objects.as_ref(),
            TileKind::Visibility => self.archives.visibility.as_ref(),
        }
    }

    /// The archives that the city has.
    pub fn archives(&self) -> impl Iterator<Item = (TileKind, &Archive)> {
        TileKind::ALL.into_iter().filter_map(|kind| Some((kind, self.archive(kind)?)))
    }

    /// Which nodes exist.
    pub fn subtrees(&self) -> &Archive {
        &self.archives.subtrees
    }

    /// The nodes' V-BlockMaps.
    pub fn blockmaps(&self) -> &Archive {
        &self.archives.blockmaps
    }

    /// Reads a tile of a local city, unchecked. A mesh is named by its position in the archive
    /// ([`insula_protocol::mesh_tile::archive_id`]).
    pub fn tile(&self, kind: TileKind, id: TileId) -> Result<Option<Bytes>, ReadError> {
        self.archive(kind).map_or(Ok(None), |archive| archive.tile(id))
    }

    /// Length of a tile in bytes. `None` if there is no such tile. Fails if a directory cannot be read.
    pub async fn tile_bytes(&self, kind: TileKind, id: TileId) -> Result<Option<u64>, ReadError> {
        let Some(archive) = self.archive(kind) else { return Ok(None) };
        Ok(archive.find(id).await?.map(|range| range.end - range.start))
    }

    /// Reads a tile whose frame and checksums are right. `None` if there is no such tile.
    ///
    /// A damaged tile is dropped from all caches and read once more before the error is returned.
    pub async fn checked_tile(&self, kind: TileKind, id: TileId) -> Result<Option<Bytes>, ReadError> {
        let Some(archive) = self.archive(kind) else { return Ok(None) };
        let Some(range) = archive.find(id).await? else { return Ok(None) };
        match check(kind, archive.read(range.clone()).bytes().await?) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(_) => {
                archive.invalidate(range.clone()).await;
                check(kind, archive.read(range).bytes().await?).map(Some)
            }
        }
    }

    /// Length of all archives in bytes.
    pub fn file_bytes(&self) -> u64 {
        self.archives().map(|(_, archive)| archive.file_bytes()).sum()
    }
}

/// The checksums of a tile's frame cover every byte of it.
fn check(kind: TileKind, bytes: Bytes) -> Result<Bytes, ReadError> {
    match TileReader::new(&bytes, kind) {
        Ok(_) => Ok(bytes),
        Err(error) => Err(ReadError::Damaged(error.to_string())),
    }
}

/// Opens an archive in a city's folder, which goes on in those of other cities: their folders, which have their names, are in `beside`.
/// Fails as [`Archive::open_joined`].
#[cfg(feature = "fs")]
pub fn open_archive(
    folder: &std::path::Path,
    beside: &std::path::Path,
    shared: &[SharedCity],
    kind: TileKind,
    deadline: std::time::Instant,
) -> Result<Archive, CityError> {
    let path_of = |city: &SharedCity| beside.join(&city.name).join(kind.file_name());
    let shared: Vec<_> = shared.iter().map(|city| (path_of(city), city.version.as_str())).collect();
    Archive::open_joined(&folder.join(kind.file_name()), &shared, deadline)
}

/// Reads and checks the manifest in a city's folder.
#[cfg(feature = "fs")]
pub fn read_manifest(folder: &std::path::Path) -> Result<Manifest, CityError> {
    use std::io::Read as _;
    let path = folder.join(MANIFEST_FILE);
    let mut text = Vec::new();
    let file = crate::file::open_regular(&path);
    let read = file.and_then(|file| file.take(MAX_MANIFEST_BYTES as u64 + 1).read_to_end(&mut text));
    read.map_err(|source| CityError::Io { path: path.clone(), source })?;
    parse_manifest(&text).map_err(|reason| CityError::Manifest { location: path.display().to_string(), reason })
}

/// Parses a manifest. Fails if the text is too long, not JSON, or not a valid manifest.
pub fn parse_manifest(text: &[u8]) -> Result<Manifest, String> {
    if text.len() > MAX_MANIFEST_BYTES {
        return Err(format!("the manifest is larger than {MAX_MANIFEST_BYTES} bytes"));
    }
    let manifest: Manifest = serde_json::from_slice(text).map_err(|error| error.to_string())?;
    manifest.check()?;
    Ok(manifest)
}

#[cfg(test)]
#[cfg(feature = "fs")]
mod tests;
