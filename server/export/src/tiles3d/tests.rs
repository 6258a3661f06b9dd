//! Tilesets of a synthetic city.

use super::archive::INDEX;
use super::{Destination, TILESET_JSON, Tileset, write_tileset};
use crate::glb::ExportError;
use crate::glb::test_city::{TestCity, city};
use crate::glb::test_reader::Glb;
use crate::selection::ObjectSelection;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use insula_archive::Archive;
use insula_archive::limits::MAX_OPENING_TIME;
use insula_protocol::subtree::NodeInfo;
use insula_protocol::{Subtree, TileId};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::Read as _;
use std::time::Instant;

pub(super) const EVERYTHING: ObjectSelection = ObjectSelection { bbox: None, polygons: None, objects: None };

/// A plane that touches the Earth at the null island.
fn to_geocentric([x, y, z]: [f64; 3]) -> Option<[f64; 3]> {
    Some([6_378_137.0 + z, x, y])
}

pub(super) fn tileset<'a>(city: &'a TestCity, selection: &'a ObjectSelection) -> Tileset<'a> {
    Tileset::new(city, selection, &to_geocentric).unwrap()
}

/// The JSON and the binary part of a subtree file.
fn parse_subtree(bytes: &[u8]) -> (Value, Vec<u8>) {
    assert_eq!((&bytes[..4], bytes[4]), (&b"subt"[..], 1));
    let u64_at = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let (json, binary) = (u64_at(8), u64_at(16));
    assert_eq!((json % 8, binary % 8, bytes.len()), (0, 0, 24 + json + binary));
    (serde_json::from_slice(&bytes[24..24 + json]).unwrap(), bytes[24 + json..].to_vec())
}

/// A view of a subtree file's buffer.
fn view<'b>(json: &Value, binary: &'b [u8], index: &Value) -> &'b [u8] {
    let view = &json["bufferViews"][index.as_u64().unwrap() as usize];
    let number = |member: &str| view[member].as_u64().unwrap() as usize;
    assert_eq!(number("byteOffset") % 8, 0);
    &binary[number("byteOffset")..number("byteOffset") + number("byteLength")]
}

#[test]
fn the_tileset_is_an_implicit_quadtree_on_earth() {
    let city = city();
    let json: Value = serde_json::from_slice(&tileset(&city, &EVERYTHING).tileset_json("").unwrap()).unwrap();
    assert_eq!((&json["asset"]["version"], &json["root"]["refine"]), (&"1.1".into(), &"REPLACE".into()));
    assert_eq!(json["asset"]["extras"]["attribution"][0]["text"], "Town Hall");
    let tiling = &json["root"]["implicitTiling"];
    assert_eq!((&tiling["subtreeLevels"], &tiling["availableLevels"]), (&5.into(), &2.into()));
    let transform: Vec<f64> =
        json["root"]["transform"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    // East, north and up of the plane; its middle at the height of the ground.
    let expected = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 6_378_168.0, 1064.0, 2064.0, 1.0];
    assert!(transform.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{transform:?}");
    let half_axes = json["root"]["boundingVolume"]["box"].as_array().unwrap();
    assert!(half_axes[3].as_f64().unwrap() >= 64.0 && json["geometricError"].as_f64() >= Some(128.0));
    assert!((json["root"]["geometricError"].as_f64().unwrap() - 2.74).abs() < 0.001, "1.74 m and half a cell of 2 m");
}

#[test]
fn subtrees_say_what_exists_with_errors_and_boxes() {
    let city = city();
    let (json, binary) = parse_subtree(&tileset(&city, &EVERYTHING).subtree(0, 0, 0).unwrap().unwrap());
    let bits = view(&json, &binary, &json["tileAvailability"]["bitstream"]);
    assert_eq!((bits[0], bits.len(), &json["tileAvailability"]["availableCount"]), (0b1_1111, 43, &5.into()));
    assert_eq!(view(&json, &binary, &json["contentAvailability"][0]["bitstream"]), bits);
    assert_eq!(json["childSubtreeAvailability"]["constant"], 0);
    let table = &json["propertyTables"][0];
    assert_eq!((&table["count"], &table["class"], &json["tileMetadata"]), (&5.into(), &"tile".into(), &0.into()));
    let floats = |property: &str| -> Vec<f32> {
        let bytes = view(&json, &binary, &table["properties"][property]["values"]);
        bytes.chunks(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect()
    };
    // Two leaves with meshes, two with columns of a metre.
    assert_eq!(floats("geometricError"), [2.74, 0.02, 0.02, 1.37, 1.37]);
    let boxes = floats("boundingBox");
    assert_eq!(boxes.len(), 60);
    let leaf = &boxes[12..24];
    assert!(
        (leaf[0] + 32.0).abs() < 0.02 && (leaf[1] + 32.0).abs() < 0.02 && (leaf[3] - 32.0).abs() < 0.02,
        "{leaf:?}"
    );
}

#[test]
fn contents_are_compressed_glbs_within_their_boxes() {
    let city = city();
    let tileset = tileset(&city, &EVERYTHING);
    for node in std::iter::once(TileId::ROOT).chain(TileId::ROOT.children()) {
        let glb = Glb::parse(&tileset.content(node.level(), node.x(), node.y()).unwrap().unwrap());
        assert!(glb.check_primitives() > 0);
        assert!(glb.list("extensionsRequired").contains(&"EXT_meshopt_compression".into()));
        let [x, y, z, hx, .., hz] = tileset.frame.bounding_box(node, [0.0, 30.0]);
        for [east, up, south] in glb.scene_positions() {
            assert!((east - x).abs() <= hx && (-south - y).abs() <= hx && (up - z).abs() <= hz, "{node}");
        }
    }
    let root = Glb::parse(&tileset.content(0, 0, 0).unwrap().unwrap());
    assert_eq!(root.column("identifier"), ["terrain", "house-1"]);
    // The ground is at 1 to 2 m above the city's origin, 0 to 1 m above the frame's.
    assert!(root.scene_positions().iter().any(|p| (p[1] - 1.0).abs() < 0.01));
}

#[test]
fn addresses_without_a_tile_have_none() {
    let city = city();
    let tileset = tileset(&city, &EVERYTHING);
    for (level, x, y) in [(0, 1, 0), (1, 2, 0), (2, 0, 0), (5, 0, 0), (21, 0, 0), (255, u32::MAX, u32::MAX)] {
        assert!(tileset.content(level, x, y).unwrap().is_none(), "content {level}/{x}/{y}");
        assert!(tileset.subtree(level, x, y).unwrap().is_none(), "subtree {level}/{x}/{y}");
    }
}

/// A city of which only the nodes down to the south-western leaf at this level exist.
pub(super) fn deep_city(depth: u8) -> TestCity {
    let mut deep = city();
    let leaf = TileId::new(depth, 0, 0).unwrap();
    let (columns, node) = (deep.columns[&TileId::ROOT].clone(), deep.subtrees[&TileId::ROOT].nodes[0]);
    deep.manifest = crate::glb::test_city::manifest(depth, 1.0);
    deep.meshes.clear();
    deep.columns.clear();
    deep.subtrees.clear();
    for id in (0..=depth).map(|level| leaf.ancestor(level).unwrap()) {
        let cell_m = deep.manifest.cell_m_at(id.level()) as f32;
        let mut map = columns.clone();
        map.cell_m = cell_m;
        deep.columns.insert(id, map);
        let node = NodeInfo { id, child_mask: u8::from(id != leaf), z_max_m: 15.0 * cell_m, ..node };
        // A root of subtrees is in the one above, too; a leaf only there.
        let roots = [id.parent().map(Subtree::root_of), (id != leaf).then(|| Subtree::root_of(id))];
        for root in roots.into_iter().flatten().collect::<BTreeSet<_>>() {
            deep.subtrees.entry(root).or_default().nodes.push(node);
        }
    }
    deep
}

#[test]
fn a_leaf_at_a_level_of_roots_has_a_subtree_of_its_own() {
    let city = deep_city(5);
    let tileset = tileset(&city, &EVERYTHING);
    let (json, binary) = parse_subtree(&tileset.subtree(0, 0, 0).unwrap().unwrap());
    let children = view(&json, &binary, &json["childSubtreeAvailability"]["bitstream"]);
    assert_eq!((children[0], children.len()), (1, 128));
    let (json, binary) = parse_subtree(&tileset.subtree(5, 0, 0).unwrap().unwrap());
    assert_eq!(view(&json, &binary, &json["tileAvailability"]["bitstream"])[0], 1);
    assert!(tileset.content(5, 0, 0).unwrap().is_some());
    assert!(tileset.subtree(5, 1, 0).unwrap().is_none() && tileset.content(5, 1, 0).unwrap().is_none());
}

#[test]
fn a_selection_leaves_out_tiles() {
    let city = city();
    let west = ObjectSelection { bbox: Some([[1000.0, 2000.0], [1063.0, 2128.0]]), ..EVERYTHING };
    let tileset = tileset(&city, &west);
    let (json, binary) = parse_subtree(&tileset.subtree(0, 0, 0).unwrap().unwrap());
    assert_eq!(view(&json, &binary, &json["tileAvailability"]["bitstream"])[0], 0b0_1011);
    assert!(tileset.content(1, 1, 0).unwrap().is_none());
    let house = ObjectSelection { objects: Some([4].into_iter().collect()), ..EVERYTHING };
    let tileset = self::tileset(&city, &house);
    assert!(tileset.content(1, 1, 1).unwrap().is_none() && tileset.content(1, 0, 1).unwrap().is_some());
    // The house is there by its bounds, but the columns of this node show another one: a scene without nodes.
    let empty = Glb::parse(&tileset.content(0, 0, 0).unwrap().unwrap());
    assert_eq!((empty.list("nodes").len(), empty.check_primitives()), (0, 0));
}

#[test]
fn a_folder_and_an_archive_have_the_same_files() {
    let city = deep_city(5);
    let tileset = tileset(&city, &EVERYTHING);
    let folder = tempfile::tempdir().unwrap();
    let report = write_tileset(&tileset, Destination::of(&folder.path().join("tiles"))).unwrap();
    assert_eq!(report.files, 6);
    let path = folder.path().join("town.3tz");
    assert_eq!(write_tileset(&tileset, Destination::of(&path)).unwrap(), report);
    let bytes = std::fs::read(&path).unwrap();
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(&bytes)).unwrap();
    let mut index = Vec::new();
    zip.by_name(INDEX).unwrap().read_to_end(&mut index).unwrap();
    assert_eq!((index.len(), zip.len()), (24 * 9, 10));
    for i in 0..zip.len() - 1 {
        let mut entry = zip.by_index(i).unwrap();
        let (name, start) = (entry.name().unwrap().into_owned(), entry.header_start());
        let mut content = Vec::new();
        entry.read_to_end(&mut content).unwrap();
        assert_eq!(content, std::fs::read(folder.path().join("tiles").join(&name)).unwrap());
        let hash: [u8; 16] = <md5::Md5 as md5::Digest>::digest(&name).into();
        let found = index.chunks(24).find(|entry| entry[..16] == hash).unwrap();
        assert_eq!(found[16..], start.to_le_bytes(), "{name}");
    }
    let again = folder.path().join("again.3tz");
    write_tileset(&tileset, Destination::of(&again)).unwrap();
    assert_eq!(std::fs::read(again).unwrap(), bytes);
}

#[test]
fn a_pmtiles_archive_has_the_files_of_a_folder() {
    let city = deep_city(5);
    let tileset = tileset(&city, &EVERYTHING);
    let folder = tempfile::tempdir().unwrap();
    let files = folder.path().join("tiles");
    let report = write_tileset(&tileset, Destination::of(&files)).unwrap();
    let path = folder.path().join("town.pmtiles");
    assert_eq!(write_tileset(&tileset, Destination::of(&path)).unwrap(), report);
    let archive = std::fs::read(&path).unwrap();
    // Offsets and lengths of the header of PMTiles 3.
    let number = |at: usize| u64::from_le_bytes(archive[at..at + 8].try_into().unwrap()) as usize;
    let unzipped = |at: usize| {
        let mut bytes = Vec::new();
        flate2::read::GzDecoder::new(&archive[number(at)..][..number(at + 8)]).read_to_end(&mut bytes).unwrap();
        bytes
    };
    let metadata: serde_json::Value = serde_json::from_slice(&unzipped(24)).unwrap();
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(files.join(TILESET_JSON)).unwrap()).unwrap();
    assert_eq!(metadata["tileset"], json);
    let subtrees = metadata["subtrees"].as_object().unwrap();
    for (root, text) in subtrees {
        let bytes = STANDARD.decode(text.as_str().unwrap()).unwrap();
        assert_eq!(bytes, std::fs::read(files.join(format!("subtrees/{root}.subtree"))).unwrap());
    }
    let opened = Archive::open(&path, Instant::now() + MAX_OPENING_TIME).unwrap();
    assert_eq!((subtrees.len(), opened.len()), (2, 6));
    for (id, content) in opened.tiles() {
        assert!(content.unwrap() == std::fs::read(files.join(format!("content/{id}.glb"))).unwrap(), "{id}");
    }
    let again = folder.path().join("again.pmtiles");
    write_tileset(&tileset, Destination::of(&again)).unwrap();
    assert_eq!(std::fs::read(again).unwrap(), archive);
}

#[test]
fn broken_tiles_and_full_disks_are_errors() {
    let mut broken = city();
    broken.broken.insert(TileId::ROOT.child(1).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let tileset = tileset(&broken, &EVERYTHING);
    assert!(matches!(write_tileset(&tileset, Destination::of(folder.path())), Err(ExportError::Source(_))));
    let nowhere = folder.path().join("missing").join("town.3tz");
    assert!(matches!(write_tileset(&tileset, Destination::of(&nowhere)), Err(ExportError::Write { .. })));
    let mut empty = city();
    empty.subtrees.clear();
    assert!(Tileset::new(&empty, &EVERYTHING, &|_| None).and_then(|tileset| tileset.tileset_json("")).is_err());
}

#[test]
fn a_tileset_of_nothing_leaves_an_earlier_one() {
    let (city, folder) = (deep_city(5), tempfile::tempdir().unwrap());
    write_tileset(&tileset(&city, &EVERYTHING), Destination::of(folder.path())).unwrap();
    let path = folder.path().join(TILESET_JSON);
    let before = std::fs::read(&path).unwrap();
    let nothing = ObjectSelection { objects: Some(std::iter::empty::<u32>().collect()), ..EVERYTHING };
    let written = write_tileset(&tileset(&city, &nothing), Destination::of(folder.path()));
    assert!(matches!(written, Err(ExportError::Nothing(_))), "{written:?}");
    assert!(std::fs::read(&path).unwrap() == before);
    assert!(std::fs::read(folder.path().join("subtrees/0/0/0.subtree")).is_ok_and(|bytes| bytes.starts_with(b"subt")));
}

#[test]
fn an_unfinished_tileset_shows_nothing_and_leaves_an_earlier_one() {
    let (whole, folder) = (city(), tempfile::tempdir().unwrap());
    let json =
        || -> Value { serde_json::from_slice(&std::fs::read(folder.path().join(TILESET_JSON)).unwrap()).unwrap() };
    let mut broken = city();
    broken.broken.insert(TileId::ROOT.child(3).unwrap());
    write_tileset(&tileset(&broken, &EVERYTHING), Destination::of(folder.path())).unwrap_err();
    let unfinished = json();
    write_tileset(&tileset(&whole, &EVERYTHING), Destination::of(folder.path())).unwrap();
    let complete = json();
    assert!(complete["root"]["implicitTiling"].is_object() && complete["root"]["content"].is_object());
    assert_eq!((&unfinished["root"]["implicitTiling"], &unfinished["root"]["content"]), (&Value::Null, &Value::Null));
    assert!(unfinished["asset"]["extras"]["title"].as_str().unwrap().contains("unfinished"));
    assert_eq!(unfinished["root"]["boundingVolume"], complete["root"]["boundingVolume"]);
    write_tileset(&tileset(&broken, &EVERYTHING), Destination::of(folder.path())).unwrap_err();
    assert_eq!(json(), complete);
    let mut names = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(names.all(|name| !name.to_string_lossy().starts_with('.')), "nothing unfinished stays");
}
