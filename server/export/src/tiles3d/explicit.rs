//! The plain form: tilesets that list their tiles. Tiles down to the next roots of subtrees are in one file, and those below each of
//! these in a file of its own (3D Tiles 1.1, "External tilesets"), so that a file has at most 1,365 tiles.

use super::subtree::Tile;
use super::{Tileset, TilesetDocument, TilesetFile};
use crate::glb::ExportError;
use crate::matrix::numbers_of;
use insula_protocol::subtree::NodeInfo;
use insula_protocol::{Subtree, TileId};
use serde::Serialize;
use serde_json::json;

/// From the folder of a file of tiles to that of the tileset.
const TO_TILESET: &str = "../../../";

/// A tile with those below it.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TileInList {
    bounding_volume: BoundingVolume,
    geometric_error: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    refine: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    transform: Option<[f64; 16]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    content: Option<ContentAddress>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    children: Vec<TileInList>,
}

#[derive(Serialize)]
struct BoundingVolume {
    #[serde(rename = "box")]
    bounding_box: [f32; 12],
}

#[derive(Serialize)]
struct ContentAddress {
    uri: String,
}

impl Tileset<'_> {
    /// The root of the whole tileset, whose files are in `folder`.
    pub(super) fn listed_root(&self, subtree: &Subtree, node: &NodeInfo, folder: &str) -> TileInList {
        let transform = self.frame.to_earth.map(numbers_of);
        TileInList { refine: Some("REPLACE"), transform, ..self.listed(subtree, node, node.id, folder) }
    }

    /// The file of the tiles from a node on; `None` if they are listed elsewhere.
    pub(super) fn external(&self, root: TileId, subtree: &Subtree) -> Result<Option<Vec<u8>>, ExportError> {
        let is_root = |node: &&NodeInfo| node.id == root && root != TileId::ROOT && has_file(node);
        let Some(node) = subtree.nodes.iter().find(is_root) else { return Ok(None) };
        let root = TileInList { refine: Some("REPLACE"), ..self.listed(subtree, node, root, TO_TILESET) };
        let geometric_error = f64::from(root.geometric_error);
        TilesetDocument { asset: json!({ "version": "1.1" }), geometric_error, root, schema: None }.to_bytes().map(Some)
    }

    /// A node with those below it, as far as the file from `root` on lists them.
    fn listed(&self, subtree: &Subtree, node: &NodeInfo, root: TileId, folder: &str) -> TileInList {
        let Tile { has_content, geometric_error_m, bounding_box, .. } = self.tile(subtree, node);
        let is_elsewhere = node.id != root && has_file(node);
        let file = if is_elsewhere {
            Some(TilesetFile::Tiles(node.id))
        } else {
            has_content.then_some(TilesetFile::Content(node.id))
        };
        let is_child = |child: &&NodeInfo| child.id.parent() == Some(node.id) && self.is_selected(child.id);
        let children = subtree.nodes.iter().filter(|child| !is_elsewhere && is_child(child));
        TileInList {
            bounding_volume: BoundingVolume { bounding_box },
            geometric_error: geometric_error_m,
            refine: None,
            transform: None,
            content: file.map(|file| ContentAddress { uri: format!("{folder}{file}") }),
            children: children.map(|child| self.listed(subtree, child, root, folder)).collect(),
        }
    }
}

/// Whether the tiles from a node on have a file of their own.
fn has_file(node: &NodeInfo) -> bool {
    Subtree::is_root(node.id) && node.child_mask & 0xf != 0
}

#[cfg(test)]
mod tests {
    use super::super::tests::{EVERYTHING, deep_city, tileset};
    use super::super::{Destination, TILESET_JSON, Tileset, TilesetForm, each_file, write_tileset};
    use crate::glb::ExportError;
    use crate::glb::test_city::{TestCity, city};
    use crate::glb::test_reader::Glb;
    use crate::selection::ObjectSelection;
    use serde_json::Value;
    use std::collections::BTreeMap;

    type Files = BTreeMap<String, Vec<u8>>;

    fn files(tileset: &Tileset<'_>) -> Files {
        let mut files = Files::new();
        let mut take = |name: &str, bytes: &[u8]| {
            files.insert(name.to_owned(), bytes.to_vec());
            Ok(())
        };
        each_file(tileset, &mut take).unwrap();
        files
    }

    /// The lowest and the highest corner of a tile's box.
    fn span(tile: &Value) -> [[f64; 3]; 2] {
        let numbers = tile["boundingVolume"]["box"].as_array().unwrap();
        let at = |i: usize| numbers[i].as_f64().unwrap();
        [-1.0, 1.0].map(|side| [0, 1, 2].map(|k| at(k) + side * at(3 + 4 * k)))
    }

    fn contains([min, max]: [[f64; 3]; 2], point: [f64; 3]) -> bool {
        (0..3).all(|k| min[k] - 1e-3 <= point[k] && point[k] <= max[k] + 1e-3)
    }

    /// Walks over a tile and those below it. Gives the names of contents, in `folder`, to `found`.
    fn walk(files: &Files, tile: &Value, folder: &str, found: &mut Vec<String>) {
        let span_m = span(tile);
        if let Some(uri) = tile["content"]["uri"].as_str() {
            let name = uri.strip_prefix(folder).unwrap();
            let bytes = &files[name];
            if name.ends_with(".json") {
                let json: Value = serde_json::from_slice(bytes).unwrap();
                assert_eq!((&json["asset"]["version"], &json["root"]["refine"]), (&"1.1".into(), &"REPLACE".into()));
                assert!(json["root"]["transform"].is_null() && tile["children"].is_null());
                assert_eq!(json["root"]["boundingVolume"], tile["boundingVolume"]);
                return walk(files, &json["root"], super::TO_TILESET, found);
            }
            let positions = Glb::parse(bytes).scene_positions();
            // From y up to z up.
            assert!(positions.iter().all(|[x, y, z]| contains(span_m, [*x, -z, *y])), "{name}");
            found.push(name.to_owned());
        }
        for child in tile["children"].as_array().into_iter().flatten() {
            assert!(span(child).iter().all(|corner| contains(span_m, *corner)));
            assert!(child["geometricError"].as_f64() <= tile["geometricError"].as_f64());
            walk(files, child, folder, found);
        }
    }

    /// Checks the plain form of a city against the implicit one. Gives its files.
    fn check(city: &TestCity, selection: &ObjectSelection) -> Files {
        let implicit = files(&tileset(city, selection));
        let plain = files(&tileset(city, selection).in_form(TilesetForm::Plain));
        let json: Value = serde_json::from_slice(&plain[TILESET_JSON]).unwrap();
        let same: Value = serde_json::from_slice(&implicit[TILESET_JSON]).unwrap();
        for member in ["transform", "refine"] {
            assert_eq!(json["root"][member], same["root"][member], "{member}");
        }
        // One of them has its numbers as f32.
        let side = |root: &Value, k: usize| root["boundingVolume"]["box"][k].as_f64().unwrap();
        for k in 0..12 {
            let [plain, implicit] = [&json["root"], &same["root"]].map(|root| side(root, k));
            assert!((plain - implicit).abs() <= 1e-5 * implicit.abs().max(1.0), "{k}: {plain} {implicit}");
        }
        assert_eq!((&json["asset"], &json["geometricError"]), (&same["asset"], &same["geometricError"]));
        let mut found = Vec::new();
        walk(&plain, &json["root"], "", &mut found);
        found.sort();
        let contents: Vec<&String> = implicit.keys().filter(|name| name.starts_with("content/")).collect();
        assert_eq!(found.iter().collect::<Vec<_>>(), contents);
        for name in contents {
            let [packed, plain] = [&implicit[name], &plain[name]].map(|bytes| Glb::parse(bytes));
            assert!(plain.list("extensionsRequired").is_empty(), "{name}");
            assert_eq!(plain.check_primitives(), packed.check_primitives());
            assert_eq!(plain.scene_positions(), packed.scene_positions(), "{name}");
            assert!(plain.list("images").iter().all(|image| image["mimeType"] == "image/jpeg"));
            for primitive in plain.list("meshes").iter().flat_map(|mesh| mesh["primitives"].as_array().unwrap()) {
                let accessor =
                    |name: &str| Some(&plain.json["accessors"][primitive["attributes"][name].as_u64()? as usize]);
                assert_eq!(accessor("POSITION").unwrap()["componentType"], 5126);
                assert!(accessor("TEXCOORD_0").is_none_or(|uv| uv["componentType"] == 5126));
            }
        }
        plain
    }

    #[test]
    fn a_plain_tileset_lists_the_tiles_of_the_implicit_one() {
        let files = check(&city(), &EVERYTHING);
        assert_eq!(files.len(), 6, "a tileset and five contents: {:?}", files.keys());
        let images = |name: &str| Glb::parse(&files[name]).list("images").len();
        assert_eq!((images("content/1/0/0.glb"), images("content/1/1/0.glb")), (1, 0));
        check(&city(), &ObjectSelection { bbox: Some([[1000.0, 2000.0], [1063.0, 2128.0]]), ..EVERYTHING });
    }

    #[test]
    fn tiles_below_five_levels_are_in_files_of_their_own() {
        // A leaf at a level of roots has none.
        assert!(check(&deep_city(5), &EVERYTHING).keys().all(|name| !name.starts_with("tiles/")));
        let files = check(&deep_city(7), &EVERYTHING);
        assert_eq!(
            files.keys().filter(|name| name.ends_with(".json")).collect::<Vec<_>>(),
            ["tiles/5/0/0.json", TILESET_JSON]
        );
    }

    #[test]
    fn a_json_file_of_somebody_else_is_not_replaced() {
        let (city, folder) = (deep_city(7), tempfile::tempdir().unwrap());
        let tileset = tileset(&city, &EVERYTHING).in_form(TilesetForm::Plain);
        let name = files(&tileset).into_keys().find(|name| name.starts_with("tiles/")).unwrap();
        let (path, mine) = (folder.path().join(name), r#"{"my": "notes"}"#);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, mine).unwrap();
        let written = write_tileset(&tileset, Destination::of(folder.path()));
        assert!(matches!(written, Err(ExportError::Write { .. })), "{written:?}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), mine);
        std::fs::remove_file(&path).unwrap();
        for _ in 0..2 {
            write_tileset(&tileset, Destination::of(folder.path())).unwrap();
        }
    }
}
