//! 3D Tiles 1.1: a city as a tileset, with an implicit quadtree (OGC 22-025r4, "Implicit tiling") or in a plain form that lists all tiles.
//!
//! The quadtree is the city's own: tile `level/x/y` is node `level/x/y`. A leaf has the finest mesh of the city, other nodes have boxes
//! of merged columns. Refinement replaces a tile by its children. Geometric errors are the measured ones of the city; they and the
//! bounding boxes are in the metadata of subtree files, or beside each tile that is listed.
//!
//! | address | content | made by |
//! |---|---|---|
//! | `tileset.json` | root with its place on Earth, attribution; schema, or the tiles of five levels | [`Tileset::tileset_json`] |
//! | `subtrees/{level}/{x}/{y}.subtree` | what exists in five levels below a node of level 0, 5, 10, ... | [`Tileset::subtree`] |
//! | `tiles/{level}/{x}/{y}.json` | in the plain form, the tiles of five levels below a node of level 5, 10, ... | `explicit` |
//! | `content/{level}/{x}/{y}.glb` | the surfaces of a node with its objects | [`Tileset::content`] |
//!
//! Content is compressed by meshoptimizer, or in the plain form needs no extension. Its property tables are complete in leaves; in
//! coarser tiles, where a table would be larger than the surfaces, names or only numbers of objects remain.

mod archive;
mod explicit;
mod frame;
mod subtree;
#[cfg(test)]
mod tests;
mod write;

use crate::boxes;
use crate::glb::builder::{GlbBuilder, Packing};
use crate::glb::content::ContentWriter;
use crate::glb::metadata::{Rows, add_table};
use crate::glb::reach::Reach;
use crate::glb::{ExportError, mesh_of, subtree_at};
use crate::matrix::{Y_UP, numbers_of};
use crate::selection::ObjectSelection;
use crate::source::ExportSource;
use crate::table::city::City;
use frame::Frame;
pub use frame::ToGeocentric;
use insula_protocol::subtree::NodeInfo;
use insula_protocol::{Subtree, TileId};
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt;
use subtree::Tile;
pub use write::{Destination, each_file, write_tileset};

/// Largest property table of a tile that is no leaf, in bytes: about as much as its surfaces take.
const FAR_TABLE_BYTES: usize = 16 << 10;
/// Address of the root of the tileset.
pub const TILESET_JSON: &str = "tileset.json";

/// How a tileset is written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TilesetForm {
    /// Small: an implicit quadtree, and content that is compressed.
    #[default]
    Implicit,
    /// For programs that read neither: all tiles are listed, and content needs no extension.
    Plain,
}

/// A city as 3D Tiles. Tiles are made when they are asked for; the same city gives the same bytes.
pub struct Tileset<'a> {
    source: &'a dyn ExportSource,
    selection: &'a ObjectSelection,
    frame: Frame<'a>,
    city: City<'a>,
    reach: Reach<'a>,
    form: TilesetForm,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct TilesetDocument<R> {
    asset: Value,
    geometric_error: f64,
    root: R,
    #[serde(skip_serializing_if = "Option::is_none")]
    schema: Option<Value>,
}

impl<R: Serialize> TilesetDocument<R> {
    fn to_bytes(&self) -> Result<Vec<u8>, ExportError> {
        serde_json::to_vec(self).map_err(|error| ExportError::Encode(error.to_string()))
    }
}

/// A tile's content, with what an export counts.
struct Content {
    bytes: Vec<u8>,
    triangles: usize,
    objects: usize,
}

impl<'a> Tileset<'a> {
    /// `to_geocentric` places the city on Earth. If it gives nothing in the middle of the city, the manifest's `location` does; a city
    /// without either keeps its own metres, from the middle of its bounds.
    ///
    /// Fails if the selection names objects and a block of objects cannot be read.
    pub fn new(
        source: &'a dyn ExportSource,
        selection: &'a ObjectSelection,
        to_geocentric: ToGeocentric<'a>,
    ) -> Result<Self, ExportError> {
        let frame = Frame::new(source.manifest(), to_geocentric);
        let reach = Reach::new(source, selection)?;
        let city = City::new(source);
        Ok(Self { source, selection, frame, city, reach, form: TilesetForm::default() })
    }

    /// Whether the city has a place on Earth: without one, globes draw it at the centre of the Earth.
    #[must_use]
    pub fn has_place(&self) -> bool {
        self.frame.to_earth.is_some()
    }

    /// The same city in a form.
    #[must_use]
    pub fn in_form(self, form: TilesetForm) -> Self {
        Self { form, ..self }
    }

    /// The tileset's JSON, whose files are in `folder`: empty, or an address relative to the JSON with a slash at its end. Fails if the
    /// root's subtree cannot be read.
    pub fn tileset_json(&self, folder: &str) -> Result<Vec<u8>, ExportError> {
        let manifest = self.source.manifest();
        let subtree = subtree_at(self.source, TileId::ROOT)?;
        let node = subtree.nodes.first().ok_or(ExportError::Nothing("the city has no nodes"))?;
        let root = self.tile(&subtree, node);
        let asset = json!({
            "version": "1.1",
            "tilesetVersion": manifest.version,
            "extras": { "title": manifest.title, "crs": manifest.crs, "attribution": manifest.attribution },
        });
        // Without any tile, the whole city is missing.
        let geometric_error = manifest.root_side_m.max(f64::from(root.geometric_error_m));
        if self.form == TilesetForm::Plain {
            let root = self.listed_root(&subtree, node, folder);
            return TilesetDocument { asset, geometric_error, root, schema: None }.to_bytes();
        }
        let mut tile = json!({
            "boundingVolume": { "box": root.bounding_box },
            "geometricError": root.geometric_error_m,
            "refine": "REPLACE",
            "content": { "uri": format!("{folder}content/{{level}}/{{x}}/{{y}}.glb") },
            "implicitTiling": {
                "subdivisionScheme": "QUADTREE",
                "subtreeLevels": subtree::LEVELS,
                "availableLevels": manifest.depth + 1,
                "subtrees": { "uri": format!("{folder}subtrees/{{level}}/{{x}}/{{y}}.subtree") },
            },
        });
        if let Some(to_earth) = self.frame.to_earth {
            tile["transform"] = json!(numbers_of(to_earth));
        }
        TilesetDocument { asset, geometric_error, root: tile, schema: Some(subtree::schema()) }.to_bytes()
    }

    /// The subtree file of a node; `None` if there is none at this address. Fails if the city's subtrees cannot be read.
    pub fn subtree(&self, level: u8, x: u32, y: u32) -> Result<Option<Vec<u8>>, ExportError> {
        let Some(root) = TileId::new(level, x, y).filter(|id| Subtree::is_root(*id)) else { return Ok(None) };
        let Some(subtree) = self.subtree_with(root)? else { return Ok(None) };
        let is_below = |node: &&NodeInfo| node.id.ancestor(root.level()) == Some(root) && self.is_selected(node.id);
        let nodes = || subtree.nodes.iter().filter(is_below);
        let end = root.level() + subtree::LEVELS;
        let tiles: Vec<Tile> = nodes().filter(|n| n.id.level() < end).map(|n| self.tile(&subtree, n)).collect();
        if tiles.is_empty() {
            return Ok(None);
        }
        let children: Vec<TileId> = nodes().map(|node| node.id).filter(|id| id.level() == end).collect();
        subtree::encode(root, tiles, &children).map(Some)
    }

    /// The file, beside the tileset's own, that says which tiles there are from a root of subtrees on; `None` if there is none.
    fn tiles_file(&self, root: TileId, subtree: &Subtree) -> Result<Option<(TilesetFile, Vec<u8>)>, ExportError> {
        Ok(match self.form {
            TilesetForm::Implicit => {
                let file = self.subtree(root.level(), root.x(), root.y())?;
                file.map(|bytes| (TilesetFile::Subtree(root), bytes))
            }
            TilesetForm::Plain => self.external(root, subtree)?.map(|bytes| (TilesetFile::Tiles(root), bytes)),
        })
    }

    /// The content of a node, a GLB; `None` if there is none at this address. Fails if the city's tiles cannot be read, or are
    /// damaged.
    pub fn content(&self, level: u8, x: u32, y: u32) -> Result<Option<Vec<u8>>, ExportError> {
        let Some(node) = TileId::new(level, x, y) else { return Ok(None) };
        Ok(self.node_content(node)?.map(|content| content.bytes))
    }

    fn node_content(&self, node: TileId) -> Result<Option<Content>, ExportError> {
        if node.level() > self.source.manifest().depth || !self.is_selected(node) {
            return Ok(None);
        }
        let Some(subtree) = self.subtree_with(node)? else { return Ok(None) };
        let Some(info) = subtree.nodes.iter().find(|info| info.id == node).filter(|info| has_content(&subtree, info))
        else {
            return Ok(None);
        };
        let content = ContentWriter::new(&self.city, self.selection);
        let packing = match self.form {
            TilesetForm::Implicit => Packing::Meshopt,
            TilesetForm::Plain => Packing::Plain,
        };
        let mut glb = GlbBuilder::new(self.source.manifest(), packing);
        let mut rows = Rows::default();
        let place = Y_UP * self.frame.place(node);
        let is_leaf = info.child_mask == 0;
        let shown = if is_leaf {
            content.add_leaf(&mut glb, &mut rows, node, place)?
        } else {
            content.add_columns(&mut glb, &mut rows, node, place)?
        };
        add_table(&mut glb, &self.city, &rows, if is_leaf { usize::MAX } else { FAR_TABLE_BYTES })?;
        Ok(Some(Content { bytes: glb.finish()?, triangles: shown.triangles, objects: rows.len() }))
    }

    /// The subtree that lists a node, as its root if there is such a one.
    fn subtree_with(&self, node: TileId) -> Result<Option<Subtree>, ExportError> {
        if node.level() > self.source.manifest().depth {
            return Ok(None);
        }
        if let Some(subtree) = self.source.subtree(Subtree::root_of(node))? {
            return Ok(Some(subtree));
        }
        // A leaf at a level of roots is only in the subtree above it.
        let Some(parent) = node.parent().filter(|_| Subtree::is_root(node)) else { return Ok(None) };
        let above = self.source.subtree(Subtree::root_of(parent))?;
        Ok(above.filter(|subtree| subtree.nodes.iter().any(|info| info.id == node && info.child_mask == 0)))
    }

    /// Whether a node may have something that is selected.
    fn is_selected(&self, node: TileId) -> bool {
        self.reach.has(node)
    }

    fn tile(&self, subtree: &Subtree, node: &NodeInfo) -> Tile {
        let heights = [f64::from(node.z_min_m), f64::from(node.z_max_m)];
        let cell = self.source.manifest().cell_m_at(node.id.level());
        // Merged tops move by part of a cell, which also moves the bounds.
        let moved = boxes::ERROR_CELLS * cell;
        let mesh = mesh_of(subtree, node);
        let error = match mesh.and_then(|mesh| mesh.lods.first()) {
            Some(lod) => lod.error_m,
            None => node.error_m + moved as f32,
        };
        Tile {
            id: node.id,
            has_content: has_content(subtree, node),
            geometric_error_m: error,
            bounding_box: self.frame.bounding_box(node.id, [heights[0] - moved, heights[1] + moved]).map(|v| v as f32),
        }
    }
}

/// Whether a node shows anything.
fn has_content(subtree: &Subtree, node: &NodeInfo) -> bool {
    node.blockmap_bytes > 0 || mesh_of(subtree, node).is_some()
}

/// A file of a tileset. Displayed as its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TilesetFile {
    Tileset,
    Subtree(TileId),
    /// The tiles from a node on, in the plain form.
    Tiles(TileId),
    Content(TileId),
}

impl fmt::Display for TilesetFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tileset => f.write_str(TILESET_JSON),
            Self::Subtree(root) => write!(f, "subtrees/{root}.subtree"),
            Self::Tiles(root) => write!(f, "tiles/{root}.json"),
            Self::Content(node) => write!(f, "content/{node}.glb"),
        }
    }
}
