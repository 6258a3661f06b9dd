//! What an export reads: tiles and objects of a city.

use insula_objects::block::ObjectBlock;
use insula_objects::schema::Schema;
use insula_protocol::{BlockMap, Manifest, MeshTile, Subtree, TileId};

/// Why a city cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{what} cannot be read: {reason}")]
pub struct SourceError {
    /// A tile or block, such as `blockmaps 3/4/5`.
    pub what: String,
    pub reason: String,
}

/// A baked city, wherever it is stored.
pub trait ExportSource {
    fn manifest(&self) -> &Manifest;
    fn schema(&self) -> &Schema;
    /// The objects of a block; `None` if the city has no such block.
    fn objects(&self, block: u32) -> Result<Option<ObjectBlock>, SourceError>;
    /// The subtree below a node; `None` if there is none.
    fn subtree(&self, root: TileId) -> Result<Option<Subtree>, SourceError>;
    /// The columns of a node; `None` if it has none.
    fn columns(&self, node: TileId) -> Result<Option<BlockMap>, SourceError>;
    /// A level of detail of a leaf's mesh; `None` if it has none.
    fn mesh(&self, leaf: TileId, lod: u8) -> Result<Option<MeshTile>, SourceError>;
}
