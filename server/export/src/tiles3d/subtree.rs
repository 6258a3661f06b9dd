//! Subtree files of implicit tilings (3D Tiles 1.1, "Subtree files"): which tiles, contents and child subtrees exist, and each tile's
//! bounding box and geometric error (3D Metadata semantics `TILE_BOUNDING_BOX` and `TILE_GEOMETRIC_ERROR`).

use crate::glb::ExportError;
use crate::glb::columns::bits;
use insula_protocol::TileId;
use serde_json::{Value, json};

pub(super) const LEVELS: u8 = insula_protocol::subtree::LEVELS;
const MAGIC: &[u8; 4] = b"subt";
const VERSION: u32 = 1;
/// Tiles of a subtree file: (4^5 - 1) / 3.
const TILES: usize = 341;
/// Child subtrees of a subtree file: 4^5.
const CHILDREN: usize = 1024;
/// Parts of a file begin at multiples of this.
const ALIGN: usize = 8;

/// A tile that exists.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tile {
    pub(super) id: TileId,
    pub(super) has_content: bool,
    pub(super) geometric_error_m: f32,
    pub(super) bounding_box: [f32; 12],
}

/// Class of the metadata of tiles in the schema of the tileset.
pub(super) const CLASS: &str = "tile";

pub(super) fn schema() -> Value {
    let float = |semantic: &str| json!({ "type": "SCALAR", "componentType": "FLOAT32", "semantic": semantic, "required": true });
    let mut bounding_box = float("TILE_BOUNDING_BOX");
    bounding_box["array"] = json!(true);
    bounding_box["count"] = json!(12);
    let properties = json!({ "boundingBox": bounding_box, "geometricError": float("TILE_GEOMETRIC_ERROR") });
    json!({ "id": "insula_tiles", "classes": { CLASS: { "properties": properties } } })
}

/// The place of a node among those of its level below `root`: bits of x and y in turn, x first (Morton order).
fn morton(root: TileId, id: TileId) -> usize {
    let depth = id.level() - root.level();
    let bit = |value: u32, k: u8| ((value >> k) & 1) as usize;
    (0..depth).map(|k| bit(id.x(), k) << (2 * k) | bit(id.y(), k) << (2 * k + 1)).sum()
}

/// The place of a node among all tiles of the subtree below `root`, by level and then in Morton order.
pub(super) fn tile_index(root: TileId, id: TileId) -> usize {
    let above = ((1usize << (2 * (id.level() - root.level()))) - 1) / 3;
    above + morton(root, id)
}

/// The file of the subtree below `root`. `tiles` are those less than [`LEVELS`] levels below it, `children` those just below these.
pub(super) fn encode(root: TileId, mut tiles: Vec<Tile>, children: &[TileId]) -> Result<Vec<u8>, ExportError> {
    tiles.sort_by_key(|tile| tile_index(root, tile.id));
    let (mut has_tile, mut has_content, mut has_child) = ([false; TILES], [false; TILES], [false; CHILDREN]);
    for tile in &tiles {
        has_tile[tile_index(root, tile.id)] = true;
        has_content[tile_index(root, tile.id)] = tile.has_content;
    }
    children.iter().for_each(|child| has_child[morton(root, *child)] = true);
    let mut file = SubtreeFile::default();
    let tile_availability = file.availability(&has_tile);
    let content_availability = file.availability(&has_content);
    let child_availability = file.availability(&has_child);
    let boxes: Vec<u8> = tiles.iter().flat_map(|tile| tile.bounding_box).flat_map(f32::to_le_bytes).collect();
    let errors: Vec<u8> = tiles.iter().flat_map(|tile| tile.geometric_error_m.to_le_bytes()).collect();
    let (boxes, errors) = (file.add(&boxes), file.add(&errors));
    let columns = json!({ "boundingBox": { "values": boxes }, "geometricError": { "values": errors } });
    let json = json!({
        "buffers": [{ "byteLength": file.binary.len() }],
        "bufferViews": file.views,
        "tileAvailability": tile_availability,
        "contentAvailability": [content_availability],
        "childSubtreeAvailability": child_availability,
        "propertyTables": [{ "class": CLASS, "count": tiles.len(), "properties": columns }],
        "tileMetadata": 0,
    });
    file.finish(&json)
}

#[derive(Default)]
struct SubtreeFile {
    binary: Vec<u8>,
    views: Vec<Value>,
}

impl SubtreeFile {
    fn add(&mut self, bytes: &[u8]) -> usize {
        self.views.push(json!({ "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() }));
        self.binary.extend_from_slice(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(ALIGN), 0);
        self.views.len() - 1
    }

    /// A constant where possible, else a bitstream.
    fn availability(&mut self, is_available: &[bool]) -> Value {
        let count = is_available.iter().filter(|available| **available).count();
        if count == 0 || count == is_available.len() {
            return json!({ "constant": u8::from(count > 0) });
        }
        json!({ "bitstream": self.add(&bits(is_available)), "availableCount": count })
    }

    fn finish(self, json: &Value) -> Result<Vec<u8>, ExportError> {
        let mut json = serde_json::to_vec(json).map_err(|error| ExportError::Encode(error.to_string()))?;
        json.resize(json.len().next_multiple_of(ALIGN), b' ');
        let mut out = Vec::with_capacity(24 + json.len() + self.binary.len());
        out.extend_from_slice(MAGIC);
        out.extend_from_slice(&VERSION.to_le_bytes());
        out.extend_from_slice(&(json.len() as u64).to_le_bytes());
        out.extend_from_slice(&(self.binary.len() as u64).to_le_bytes());
        out.extend_from_slice(&json);
        out.extend_from_slice(&self.binary);
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_counted_by_level_in_morton_order() {
        let root = TileId::new(5, 3, 7).unwrap();
        let at = |path: &[usize]| path.iter().fold(root, |id, quadrant| id.child(*quadrant).unwrap());
        let ids = [at(&[]), at(&[0]), at(&[1]), at(&[2]), at(&[3]), at(&[0, 0]), at(&[0, 1]), at(&[1, 0]), at(&[3, 3])];
        assert_eq!(ids.map(|id| tile_index(root, id)), [0, 1, 2, 3, 4, 5, 6, 9, 20]);
        assert_eq!(tile_index(root, at(&[3, 3, 3, 3])), TILES - 1);
        assert_eq!(morton(root, at(&[3, 3, 3, 3, 3])), CHILDREN - 1);
    }
}
