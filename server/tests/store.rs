//! City folders: intact, damaged, and inconsistent.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use insula_protocol::{Manifest, TileId, TileKind, mesh_tile};
use insula_server::store::{CityStore, Store, StoreError};
use std::path::Path;

/// The message with which a city is refused: one line.
fn refusal(path: &Path) -> String {
    let text = CityStore::open(path).map(drop).expect_err("opened").to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

fn write_manifest(folder: &Path, manifest: &Manifest) {
    std::fs::write(folder.join("city.json"), serde_json::to_vec(manifest).unwrap()).unwrap();
}

/// A city of `depth` levels below the root, with these V-BlockMaps in the archive's order.
fn deep_city(depth: u8, tiles: &[(TileId, Vec<u8>)]) -> tempfile::TempDir {
    let folder = common::temporary_city();
    let root_side_m = 64.0 * f64::from(1u32 << depth);
    write_manifest(folder.path(), &Manifest { depth, root_side_m, ..common::manifest("two") });
    common::write_archive(&folder.path().join("blockmaps.pmtiles"), tiles);
    folder
}

#[test]
fn tiles_are_read_byte_for_byte() {
    let city = CityStore::open(common::shared_city()).unwrap();
    assert_eq!(city.manifest(), &common::manifest("two"));
    for (id, bytes) in common::blockmaps() {
        assert_eq!(city.tile(TileKind::BlockMap, id).unwrap().unwrap(), bytes);
    }
    assert_eq!(city.tile(TileKind::Subtree, TileId::ROOT).unwrap().unwrap(), common::subtree());
    assert_eq!(city.tile(TileKind::Subtree, common::child()).unwrap(), None);
    assert_eq!(city.tile(TileKind::BlockMap, TileId::new(1, 0, 0).unwrap()).unwrap(), None);
    assert_eq!(city.tile(TileKind::BlockMap, TileId::new(20, 1, 1).unwrap()).unwrap(), None);
    let listed: Vec<_> = city.blockmaps().tiles().map(|(id, bytes)| (id, bytes.unwrap().to_vec())).collect();
    assert_eq!(listed, common::blockmaps());
}

#[test]
fn equal_tiles_that_share_an_entry_are_all_found() {
    let id = |i: u32| TileId::new(4, i % 16, i / 16).unwrap();
    let bytes = |i: u32| if i % 16 < 8 { b"same".to_vec() } else { id(i).to_string().into_bytes() };
    let tiles: Vec<_> = (0..256).map(|i| (id(i), bytes(i))).collect();
    let folder = deep_city(4, &tiles);
    let city = CityStore::open(folder.path()).unwrap();
    let archive = city.blockmaps();
    assert_eq!(archive.len(), 256);
    assert!((0..256).all(|i| archive.tile(id(i)).unwrap().unwrap() == bytes(i)));
    assert!(archive.tiles().all(|(id, found)| found.unwrap() == bytes(id.y() * 16 + id.x())));
    assert_eq!(archive.tile(TileId::new(5, 0, 0).unwrap()).unwrap(), None);
}

#[test]
fn a_tile_outlives_its_city_and_its_file() {
    let folder = common::temporary_city();
    let tile = CityStore::open(folder.path()).unwrap().tile(TileKind::Subtree, TileId::ROOT).unwrap().unwrap();
    drop(folder);
    assert_eq!(tile, common::subtree());
}

#[test]
fn archives_with_leaf_directories_are_read_completely() {
    let side = 1u32 << 7;
    let ids = (0..side * side).map(|i| TileId::new(7, i % side, i / side).unwrap());
    // Irregular lengths, as real tiles have, keep the directory too large for the root.
    let bytes = |id: TileId| format!("{id} {}", "x".repeat((id.x() * 7919 + id.y() * 104_729) as usize % 997));
    let mut tiles: Vec<_> = ids.map(|id| (id, bytes(id).into_bytes())).collect();
    tiles.sort_by_key(|(id, _)| {
        pmtiles::TileId::from(pmtiles::TileCoord::new(id.level(), id.x(), id.y()).unwrap()).value()
    });
    let folder = deep_city(7, &tiles);
    let file = std::fs::read(folder.path().join("blockmaps.pmtiles")).unwrap();
    assert_ne!(file[48..56], [0; 8], "the archive has no leaf directories, so this tests nothing");
    let city = CityStore::open(folder.path()).unwrap();
    assert_eq!(city.blockmaps().len(), tiles.len() as u64);
    for (id, bytes) in tiles {
        assert_eq!(city.tile(TileKind::BlockMap, id).unwrap().unwrap(), bytes);
    }
}

#[test]
fn every_truncation_is_refused() {
    for name in ["blockmaps.pmtiles", "subtrees.pmtiles"] {
        let folder = common::temporary_city();
        let path = folder.path().join(name);
        let whole = std::fs::read(&path).unwrap();
        for len in (0..whole.len()).step_by(61).chain([whole.len() - 1]) {
            std::fs::write(&path, &whole[..len]).unwrap();
            assert!(refusal(folder.path()).contains(name), "{len} of {}", whole.len());
        }
    }
}

#[test]
fn flipped_bits_never_panic_and_never_leave_the_file() {
    let folder = common::temporary_city();
    let path = folder.path().join("blockmaps.pmtiles");
    let whole = std::fs::read(&path).unwrap();
    let root_bytes = usize::try_from(u64::from_le_bytes(whole[16..24].try_into().unwrap())).unwrap();
    let mut refused = 0;
    for at in 0..127 + root_bytes {
        for bit in 0..8 {
            let mut damaged = whole.clone();
            damaged[at] ^= 1 << bit;
            std::fs::write(&path, &damaged).unwrap();
            match CityStore::open(folder.path()) {
                Err(error) => {
                    refused += 1;
                    assert!(!error.to_string().contains('\n'));
                }
                Ok(city) => {
                    assert!(city.blockmaps().tiles().all(|(_, bytes)| !bytes.unwrap().is_empty()))
                }
            }
        }
    }
    assert!(refused > 300, "{refused}");
}

#[test]
fn invalid_manifests_are_refused() {
    let folder = common::temporary_city();
    let path = folder.path().join("city.json");
    let valid = common::manifest("two");
    let assert_refused = |change: &dyn Fn(&mut Manifest)| {
        let mut manifest = valid.clone();
        change(&mut manifest);
        write_manifest(folder.path(), &manifest);
        let message = refusal(folder.path());
        assert!(message.contains("pmtiles") || message.contains("city.json"), "{message}");
    };
    assert_refused(&|m| m.format_version = 9);
    assert_refused(&|m| m.name = "../etc".into());
    assert_refused(&|m| m.version = "a b".into());
    assert_refused(&|m| m.depth = 200);
    assert_refused(&|m| (m.depth, m.root_side_m) = (0, 64.0));
    std::fs::write(&path, "{").unwrap();
    refusal(folder.path());
    std::fs::write(&path, vec![b' '; (1 << 20) + 1]).unwrap();
    assert!(refusal(folder.path()).contains("larger than"));
    write_manifest(folder.path(), &valid);
    CityStore::open(folder.path()).unwrap();
    std::fs::remove_file(folder.path().join("subtrees.pmtiles")).unwrap();
    assert!(refusal(folder.path()).contains("subtrees.pmtiles"));
}

#[test]
fn a_folder_of_cities_opens_all_of_them() {
    let root = tempfile::tempdir().unwrap();
    assert!(matches!(Store::open(&[root.path()]), Err(StoreError::NoCity(_))));
    for name in ["b", "a"] {
        common::write_city(&root.path().join(name), name);
    }
    std::fs::create_dir(root.path().join("other")).unwrap();
    let store = Store::open(&[root.path()]).unwrap();
    let names: Vec<_> = store.cities().map(|city| city.manifest().name.clone()).collect();
    assert_eq!(names, ["a", "b"]);
    assert!(store.city("a").is_some() && store.city("c").is_none());
    let twice = Store::open(&[root.path().join("a"), root.path().to_owned()]);
    assert!(matches!(twice, Err(StoreError::SameName { .. })));
    assert!(matches!(Store::open(&[root.path().join("missing")]), Err(StoreError::Io { .. })));
}

#[test]
fn meshes_are_optional_and_must_not_lie_too_deep() {
    let folder = common::temporary_city_with_meshes();
    let archive = folder.path().join(TileKind::Mesh.file_name());
    let city = CityStore::open(folder.path()).unwrap();
    assert_eq!(city.archive(TileKind::Mesh).unwrap().len(), 2);
    let id = mesh_tile::archive_id(common::child(), 1).unwrap();
    assert_eq!(city.tile(TileKind::Mesh, id).unwrap().unwrap(), common::meshes()[1].1);
    common::write_archive(&archive, &[(TileId::new(5, 0, 0).unwrap(), vec![1])]);
    assert!(CityStore::open(folder.path()).is_err());
    std::fs::remove_file(&archive).unwrap();
    let city = CityStore::open(folder.path()).unwrap();
    assert!(city.archive(TileKind::Mesh).is_none());
    assert_eq!(city.tile(TileKind::Mesh, id).unwrap(), None);
}
