//! A city as exports and drawings read it, from whatever reads its tiles.

use bytes::Bytes;
use insula_archive::ReadError;
use insula_export::source::{ExportSource, SourceError};
use insula_objects::{ObjectBlock, Schema};
use insula_protocol::object_tile::{self, SCHEMA_ID, block_id};
use insula_protocol::{BlockMap, Manifest, MeshTile, Subtree, TileId, TileKind, mesh_tile};
use std::borrow::Cow;
use std::fmt::Display;

/// Reads a tile by its place in the archive; `None` if there is no such tile.
pub type ReadTileFn<'a> = dyn Fn(TileKind, TileId) -> Result<Option<Bytes>, ReadError> + 'a;

/// A city, and what reads its tiles.
pub struct StoredCity<'a> {
    manifest: &'a Manifest,
    schema: Cow<'a, Schema>,
    read: &'a ReadTileFn<'a>,
}

impl<'a> StoredCity<'a> {
    /// `read` is called for each tile, and may wait.
    pub fn new(manifest: &'a Manifest, schema: &'a Schema, read: &'a ReadTileFn<'a>) -> Self {
        Self { manifest, schema: Cow::Borrowed(schema), read }
    }

    /// As [`Self::new`], with the schema that is read. Fails if it cannot be read, or is damaged.
    pub fn open(manifest: &'a Manifest, read: &'a ReadTileFn<'a>) -> Result<Self, SourceError> {
        Ok(Self { manifest, schema: Cow::Owned(Self::read_schema(read)?), read })
    }

    /// The schema of a city's objects; an empty one if it has no objects.
    fn read_schema(read: &ReadTileFn<'_>) -> Result<Schema, SourceError> {
        let failed = |reason: &dyn Display| source_error(TileKind::Objects, SCHEMA_ID, reason);
        let Some(bytes) = read(TileKind::Objects, SCHEMA_ID).map_err(|error| failed(&error))? else {
            return Ok(Schema::default());
        };
        let content = object_tile::decode(SCHEMA_ID, &bytes).map_err(|error| failed(&error))?;
        let schema: Schema = serde_json::from_slice(&content).map_err(|error| failed(&error))?;
        schema.check().map_err(|error| failed(&error))?;
        Ok(schema)
    }

    fn tile(&self, kind: TileKind, id: TileId) -> Result<Option<Bytes>, SourceError> {
        (self.read)(kind, id).map_err(|error| source_error(kind, id, &error))
    }
}

fn source_error(kind: TileKind, id: TileId, reason: &dyn Display) -> SourceError {
    SourceError { what: format!("{} {id}", kind.path_segment()), reason: reason.to_string() }
}

impl ExportSource for StoredCity<'_> {
    fn manifest(&self) -> &Manifest {
        self.manifest
    }

    fn schema(&self) -> &Schema {
        &self.schema
    }

    fn objects(&self, block: u32) -> Result<Option<ObjectBlock>, SourceError> {
        let Some(id) = block_id(block) else { return Ok(None) };
        let Some(bytes) = self.tile(TileKind::Objects, id)? else { return Ok(None) };
        let decoded =
            object_tile::decode(id, &bytes).and_then(|content| ObjectBlock::decode(block, &content, &self.schema));
        let failed = |error| SourceError { what: format!("objects {block}"), reason: format!("{error}") };
        decoded.map(Some).map_err(failed)
    }

    fn subtree(&self, root: TileId) -> Result<Option<Subtree>, SourceError> {
        let Some(bytes) = self.tile(TileKind::Subtree, root)? else { return Ok(None) };
        Subtree::decode(&bytes).map(Some).map_err(|error| source_error(TileKind::Subtree, root, &error))
    }

    fn columns(&self, node: TileId) -> Result<Option<BlockMap>, SourceError> {
        let Some(bytes) = self.tile(TileKind::BlockMap, node)? else { return Ok(None) };
        BlockMap::decode(node, &bytes).map(Some).map_err(|error| source_error(TileKind::BlockMap, node, &error))
    }

    fn mesh(&self, leaf: TileId, lod: u8) -> Result<Option<MeshTile>, SourceError> {
        let Some(place) = mesh_tile::archive_id(leaf, lod) else { return Ok(None) };
        let Some(bytes) = self.tile(TileKind::Mesh, place)? else { return Ok(None) };
        MeshTile::decode(leaf, lod, &bytes).map(Some).map_err(|error| source_error(TileKind::Mesh, leaf, &error))
    }
}
