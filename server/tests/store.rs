//! City folders, whole and damaged.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use insula_protocol::{TileId, route::Layer};
use insula_server::store::{CityStore, Store, StoreError};
use std::path::Path;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    common::city(folder.path(), "two");
    folder
}

/// The one line that opening gives instead of a city.
fn refusal(path: &Path) -> String {
    let text = CityStore::open(path).map(drop).expect_err("opened").to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

#[test]
fn tiles_come_back_byte_for_byte() {
    let folder = folder();
    let city = CityStore::open(folder.path()).unwrap();
    assert_eq!(city.manifest(), &common::manifest("two"));
    for (id, bytes) in common::blockmaps() {
        assert_eq!(city.tile(Layer::BlockMaps, id).unwrap().unwrap(), bytes);
    }
    assert_eq!(city.tile(Layer::Subtrees, TileId::ROOT).unwrap().unwrap(), common::subtree());
    assert_eq!(city.tile(Layer::Subtrees, common::child()).unwrap(), None);
    assert_eq!(city.tile(Layer::BlockMaps, TileId::new(1, 0, 0).unwrap()).unwrap(), None);
    assert_eq!(city.tile(Layer::BlockMaps, TileId::new(20, 1, 1).unwrap()).unwrap(), None);
    let listed: Vec<_> = city.blockmaps().tiles().map(|(id, bytes)| (id, bytes.unwrap().to_vec())).collect();
    assert_eq!(listed, common::blockmaps());
}

#[test]
fn nodes_that_share_a_tile_are_all_there() {
    let folder = folder();
    let id = |i: u32| TileId::new(4, i % 16, i / 16).unwrap();
    let bytes = |i: u32| if i % 16 < 8 { b"same".to_vec() } else { id(i).to_string().into_bytes() };
    let tiles: Vec<_> = (0..256).map(|i| (id(i), bytes(i))).collect();
    common::archive(&folder.path().join("blockmaps.pmtiles"), &tiles);
    let mut manifest = common::manifest("two");
    manifest.depth = 4;
    manifest.root_side_m = 64.0 * 16.0;
    std::fs::write(folder.path().join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    let city = CityStore::open(folder.path()).unwrap();
    let archive = city.blockmaps();
    assert_eq!(archive.len(), 256);
    assert!((0..256).all(|i| archive.tile(id(i)).unwrap().unwrap() == bytes(i)));
    assert!(archive.tiles().all(|(id, found)| found.unwrap() == bytes(id.y() * 16 + id.x())));
    assert_eq!(archive.tile(TileId::new(5, 0, 0).unwrap()).unwrap(), None);
}

#[test]
fn a_tile_outlives_its_store() {
    let folder = folder();
    let tile = CityStore::open(folder.path()).unwrap().tile(Layer::Subtrees, TileId::ROOT).unwrap().unwrap();
    drop(folder);
    assert_eq!(tile, common::subtree());
}

#[test]
fn archives_with_leaf_directories_are_read_whole() {
    let folder = folder();
    let side = 1u32 << 7;
    let ids = (0..side * side).map(|i| TileId::new(7, i % side, i / side).unwrap());
    // Lengths as irregular as real tiles', so that the directory does not fit into its root.
    let bytes = |id: TileId| format!("{id} {}", "x".repeat((id.x() * 7919 + id.y() * 104_729) as usize % 997));
    let tiles: Vec<_> = ids.map(|id| (id, bytes(id).into_bytes())).collect();
    let mut manifest = common::manifest("two");
    manifest.depth = 7;
    manifest.root_side_m = 64.0 * 128.0;
    std::fs::write(folder.path().join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    let mut in_order = tiles.clone();
    in_order.sort_by_key(|(id, _)| {
        pmtiles::TileId::from(pmtiles::TileCoord::new(id.level(), id.x(), id.y()).unwrap()).value()
    });
    let path = folder.path().join("blockmaps.pmtiles");
    common::archive(&path, &in_order);
    let file = std::fs::read(&path).unwrap();
    assert_ne!(file[48..56], [0; 8], "the archive has no leaf directories: the test tests nothing");
    let city = CityStore::open(folder.path()).unwrap();
    assert_eq!(city.blockmaps().len(), tiles.len() as u64);
    for (id, bytes) in tiles {
        assert_eq!(city.tile(Layer::BlockMaps, id).unwrap().unwrap(), bytes);
    }
}

#[test]
fn every_truncation_is_refused() {
    for name in ["blockmaps.pmtiles", "subtrees.pmtiles"] {
        let folder = folder();
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
    let folder = folder();
    let path = folder.path().join("blockmaps.pmtiles");
    let whole = std::fs::read(&path).unwrap();
    let root_bytes = usize::try_from(u64::from_le_bytes(whole[16..24].try_into().unwrap())).unwrap();
    let mut refused = 0;
    for at in 0..127 + root_bytes {
        for bit in 0..8 {
            let mut wrong = whole.clone();
            wrong[at] ^= 1 << bit;
            std::fs::write(&path, &wrong).unwrap();
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
fn manifests_that_lie_are_refused() {
    let folder = folder();
    let path = folder.path().join("city.json");
    let good = common::manifest("two");
    let write = |manifest: &insula_protocol::Manifest| {
        std::fs::write(&path, serde_json::to_vec(manifest).unwrap()).unwrap();
    };
    let refused = |change: &dyn Fn(&mut insula_protocol::Manifest)| {
        let mut manifest = good.clone();
        change(&mut manifest);
        write(&manifest);
        assert!(refusal(folder.path()).contains("pmtiles") || refusal(folder.path()).contains("city.json"));
    };
    refused(&|m| m.format_version = 9);
    refused(&|m| m.name = "../etc".into());
    refused(&|m| m.version = "a b".into());
    refused(&|m| m.depth = 200);
    refused(&|m| (m.depth, m.root_side_m) = (0, 64.0));
    std::fs::write(&path, "{").unwrap();
    refusal(folder.path());
    std::fs::write(&path, vec![b' '; (1 << 20) + 1]).unwrap();
    assert!(refusal(folder.path()).contains("larger than"));
    write(&good);
    CityStore::open(folder.path()).unwrap();
    std::fs::remove_file(folder.path().join("subtrees.pmtiles")).unwrap();
    assert!(refusal(folder.path()).contains("subtrees.pmtiles"));
}

#[test]
fn a_folder_of_cities_gives_them_all() {
    let root = tempfile::tempdir().unwrap();
    assert!(matches!(Store::open(&[root.path()]), Err(StoreError::NoCity(_))));
    for name in ["b", "a"] {
        common::city(&root.path().join(name), name);
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
fn a_city_with_meshes_opens_and_one_whose_meshes_lie_too_deep_does_not() {
    let folder = tempfile::tempdir().unwrap();
    common::city_with_meshes(folder.path(), "two");
    let city = CityStore::open(folder.path()).unwrap();
    assert_eq!(city.archive(Layer::Meshes).unwrap().len(), 2);
    let place = insula_protocol::mesh_tile::place(common::child(), 1).unwrap();
    assert_eq!(city.tile(Layer::Meshes, place).unwrap().unwrap(), common::meshes()[1].1);
    let deep = [(TileId::new(5, 0, 0).unwrap(), vec![1])];
    common::archive(&folder.path().join(Layer::Meshes.file_name()), &deep);
    assert!(CityStore::open(folder.path()).is_err());
    std::fs::remove_file(folder.path().join(Layer::Meshes.file_name())).unwrap();
    let city = CityStore::open(folder.path()).unwrap();
    assert!(city.archive(Layer::Meshes).is_none());
    assert_eq!(city.tile(Layer::Meshes, place).unwrap(), None);
}
