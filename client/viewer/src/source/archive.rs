//! A city's archives in a folder or on a plain host.

use super::{PendingGroup, PendingTile, TileSource};
use crate::{scene::TileKey, source::FetchError};
use insula_archive::{ArchiveError, LazyCity, ReadError, SharedSource};
use insula_protocol::{Manifest, TileGroup, TileId, TileKind, mesh_tile};

/// A city without a server.
#[derive(Debug)]
pub struct ArchivedCity {
    location: String,
    city: LazyCity,
}

impl ArchivedCity {
    /// The city of a manifest. `open` returns the source of each archive; `location` is for people.
    pub fn new(location: String, manifest: &Manifest, open: impl Fn(TileKind) -> SharedSource) -> Self {
        Self { location, city: LazyCity::new(manifest, open) }
    }
}

/// A tile's id in its archive. Fails if a mesh cannot exist.
fn archive_id(key: TileKey) -> Result<TileId, FetchError> {
    match key.kind() {
        TileKind::Mesh => mesh_tile::archive_id(key.id, key.lod).ok_or(FetchError::Missing),
        TileKind::BlockMap | TileKind::Subtree | TileKind::Objects | TileKind::Visibility => Ok(key.id),
    }
}

impl TileSource for ArchivedCity {
    fn tile(&self, key: TileKey) -> PendingTile<'_> {
        Box::pin(async move {
            let id = archive_id(key)?;
            self.city.archive(key.kind()).tile(id).await.map_err(from_archive)?.ok_or(FetchError::Missing)
        })
    }

    fn group<'a>(&'a self, group: TileGroup, keys: &'a [TileKey]) -> PendingGroup<'a> {
        Box::pin(async move {
            let ids = keys.iter().map(|key| archive_id(*key)).collect::<Result<Vec<_>, _>>()?;
            self.city.archive(group.kind()).tiles(&ids).await.map_err(from_archive)
        })
    }

    fn has_groups(&self) -> bool {
        true
    }

    fn location(&self) -> &str {
        &self.location
    }
}

fn from_archive(error: ArchiveError) -> FetchError {
    match error {
        ArchiveError::Read(ReadError::Missing) => FetchError::Missing,
        ArchiveError::Read(ReadError::Busy { status, retry_after }) => FetchError::Busy { status, retry_after },
        ArchiveError::Read(ReadError::Failed(reason)) => FetchError::Network(reason),
        ArchiveError::Read(ReadError::Damaged(_)) => FetchError::Broken,
        ArchiveError::Read(ReadError::Replaced) | ArchiveError::OtherVersion => FetchError::replaced(),
        ArchiveError::Read(ReadError::Unusable(reason)) => FetchError::Unusable(reason),
        damaged => FetchError::Archive(damaged.to_string()),
    }
}

/// What an error of the network means to an archive.
pub fn to_read_error(error: FetchError) -> ReadError {
    match error {
        FetchError::Missing => ReadError::Missing,
        FetchError::Busy { status, retry_after } => ReadError::Busy { status, retry_after },
        FetchError::Unusable(reason) => ReadError::Unusable(reason),
        FetchError::Broken | FetchError::Damaged(_) => ReadError::Damaged(error.to_string()),
        FetchError::Network(reason) | FetchError::Archive(reason) => ReadError::Failed(reason),
    }
}
