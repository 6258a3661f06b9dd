//! One city's folder.
//!
//! In: a folder. Out: [`CityStore`]: its manifest and its archives. Next: `Store` holds several.

use super::{Archive, ArchiveError, MANIFEST_FILE, StoreError};
use bytes::Bytes;
use insula_protocol::{Manifest, TileId, codec::bincode, route::Layer};
use std::{
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

/// A city whose manifest and directories have been checked.
#[derive(Debug)]
pub struct CityStore {
    folder: PathBuf,
    manifest: Manifest,
    subtrees: Archive,
    blockmaps: Archive,
}

impl CityStore {
    /// Opens a folder with `city.json` and an archive for each [`Layer`].
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let manifest = read_manifest(&folder.join(MANIFEST_FILE))?;
        let archive = |layer: Layer| {
            let path = folder.join(layer.file_name());
            let archive = Archive::open(&path)?;
            let deepest = archive.lengths().last().map_or(0, |(id, _)| id.level());
            if deepest > manifest.depth {
                let source = ArchiveError::Directory("it has levels that city.json does not know");
                return Err(StoreError::Archive { path, source });
            }
            Ok(archive)
        };
        let (subtrees, blockmaps) = (archive(Layer::Subtrees)?, archive(Layer::BlockMaps)?);
        Ok(Self { folder: folder.to_owned(), manifest, subtrees, blockmaps })
    }

    /// What a client must know first.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Where it was opened; for messages to the host, never for clients.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The archive of a layer.
    pub fn archive(&self, layer: Layer) -> &Archive {
        match layer {
            Layer::Subtrees => &self.subtrees,
            Layer::BlockMaps => &self.blockmaps,
        }
    }

    /// A tile's bytes, without a copy.
    pub fn tile(&self, layer: Layer, id: TileId) -> Option<Bytes> {
        self.archive(layer).tile(id)
    }

    /// Size of all archives.
    pub fn file_bytes(&self) -> u64 {
        Layer::ALL.into_iter().map(|layer| self.archive(layer).file_bytes()).sum()
    }
}

fn read_manifest(path: &Path) -> Result<Manifest, StoreError> {
    let unreadable = |source| StoreError::Io { path: path.to_owned(), source };
    let unusable = |reason: String| StoreError::Manifest { path: path.to_owned(), reason };
    let mut text = Vec::new();
    let limit = bincode::LIMIT as u64;
    File::open(path).and_then(|file| file.take(limit + 1).read_to_end(&mut text)).map_err(unreadable)?;
    if text.len() as u64 > limit {
        return Err(unusable(format!("a manifest is at most {limit} bytes")));
    }
    let manifest: Manifest = serde_json::from_slice(&text).map_err(|error| unusable(error.to_string()))?;
    manifest.check().map_err(unusable)?;
    Ok(manifest)
}
