//! The bytes of finished tiles, wherever they are.

use super::tile_pack::{PackReader, StoredMesh, StoredTile};
use crate::error::BakeError;

/// Finished tiles and meshes.
pub(crate) trait TileContent {
    /// Bytes of a V-BlockMap. Fails if they cannot be read.
    fn tile(&mut self, stored: &StoredTile) -> Result<Vec<u8>, BakeError>;
    /// Bytes of a mesh. Fails if they cannot be read.
    fn mesh(&mut self, stored: &StoredMesh) -> Result<Vec<u8>, BakeError>;
}

impl TileContent for PackReader<'_> {
    fn tile(&mut self, stored: &StoredTile) -> Result<Vec<u8>, BakeError> {
        self.read(stored)
    }

    fn mesh(&mut self, stored: &StoredMesh) -> Result<Vec<u8>, BakeError> {
        self.read_mesh(stored)
    }
}
