//! A tileset in one PMTiles archive: contents are its tiles, and everything else is in its metadata.
//!
//! Tile `z/x/y` is `content/z/x/y.glb`, not compressed further. The metadata is a JSON object with `tileset`, the tileset's JSON, and
//! `subtrees`, the subtree files in Base64 by `level/x/y`. PMTiles has no type for such tiles: the header says "unknown".

use super::TilesetFile;
use crate::glb::ExportError;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use insula_archive::new_file::NewFile;
use pmtiles::{Compression, PmTilesStreamWriter, PmTilesWriter, PmtError, TileCoord, TileType};
use serde_json::{Map, Value, json};
use std::fs::File;
use std::path::Path;

/// Writes an archive, content by content.
pub(super) struct TileArchive {
    writer: PmTilesStreamWriter<File>,
    new: NewFile,
    tileset: Value,
    subtrees: Map<String, Value>,
    max_level: u8,
    /// The archive's, for errors.
    name: String,
}

impl TileArchive {
    /// Fails if the file cannot be created.
    pub(super) fn create(path: &Path) -> Result<Self, ExportError> {
        let name = path.display().to_string();
        let new = NewFile::create(path).map_err(ExportError::writing(name.clone()))?;
        let file = new.file().map_err(ExportError::writing(name.clone()))?;
        let writer = PmTilesWriter::new(TileType::Unknown).tile_compression(Compression::None).create(file);
        let writer = writer.map_err(|cause| failed(&name, cause))?;
        Ok(Self { writer, new, tileset: Value::Null, subtrees: Map::new(), max_level: 0, name })
    }

    /// Adds a file of the tileset. Fails if the archive cannot be written.
    pub(super) fn add(&mut self, file: TilesetFile, bytes: &[u8]) -> Result<(), ExportError> {
        match file {
            TilesetFile::Tileset => {
                self.tileset = serde_json::from_slice(bytes).map_err(|error| ExportError::Encode(error.to_string()))?;
            }
            TilesetFile::Subtree(root) => {
                self.subtrees.insert(root.to_string(), STANDARD.encode(bytes).into());
            }
            TilesetFile::Tiles(_) => {
                let reason = "this archive has no place for lists of tiles; write a folder, or a .3tz";
                return Err(ExportError::Encode(format!("{}: {reason}", self.name)));
            }
            TilesetFile::Content(node) => {
                self.max_level = self.max_level.max(node.level());
                let add = TileCoord::new(node.level(), node.x(), node.y())
                    .and_then(|place| self.writer.add_tile(place, bytes));
                add.map_err(|cause| failed(&self.name, cause))?;
            }
        }
        Ok(())
    }

    /// Writes metadata and directories. Fails if the archive cannot be written.
    pub(super) fn finish(mut self) -> Result<(), ExportError> {
        self.writer.set_zoom_range(0, self.max_level);
        self.writer.set_metadata(json!({ "tileset": self.tileset, "subtrees": self.subtrees }).to_string());
        self.writer.finalize().map(drop).map_err(|cause| failed(&self.name, cause))?;
        self.new.commit().map(drop).map_err(ExportError::writing(self.name))
    }
}

fn failed(name: &str, cause: PmtError) -> ExportError {
    match cause {
        PmtError::Reading(source) => ExportError::Write { what: name.to_owned(), source },
        other => ExportError::Encode(format!("{name}: {other}")),
    }
}
