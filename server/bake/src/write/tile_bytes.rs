//! The bytes of finished tiles, wherever they are.

use super::tile_pack::{PackReader, StoredMesh, StoredTile};
use crate::error::BakeError;
use std::path::Path;

/// Finished tiles and meshes.
pub(crate) trait TileContent {
    /// Bytes of a V-BlockMap. Fails if they cannot be read.
    fn tile(&mut self, stored: &StoredTile) -> Result<Vec<u8>, BakeError>;
    /// Bytes of a mesh. Fails if they cannot be read.
    fn mesh(&mut self, stored: &StoredMesh) -> Result<Vec<u8>, BakeError>;
}

/// Tiles in a folder of packs.
pub(crate) struct PackedTiles<'a>(PackReader<'a>);

impl<'a> PackedTiles<'a> {
    pub(crate) fn new(folder: &'a Path) -> Self {
        Self(PackReader::new(folder))
    }
}

impl TileContent for PackedTiles<'_> {
    fn tile(&mut self, stored: &StoredTile) -> Result<Vec<u8>, BakeError> {
        self.0.read(stored)
    }

    fn mesh(&mut self, stored: &StoredMesh) -> Result<Vec<u8>, BakeError> {
        self.0.read_mesh(stored)
    }
}
