//! Folders of cities. What a single city must be is tested in `insula-archive`.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use insula_protocol::route::Layer;
use insula_server::store::{CityStore, Store, StoreError};

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
fn a_city_with_meshes_has_one_more_archive() {
    let folder = tempfile::tempdir().unwrap();
    common::city_with_meshes(folder.path(), "two");
    let city = CityStore::open(folder.path()).unwrap();
    assert_eq!(city.archive(Layer::Meshes).unwrap().len(), 2);
    let place = insula_protocol::mesh_tile::place(common::child(), 1).unwrap();
    assert_eq!(city.tile(Layer::Meshes, place).unwrap().unwrap(), common::meshes()[1].1);
    std::fs::remove_file(folder.path().join(Layer::Meshes.file_name())).unwrap();
    let city = CityStore::open(folder.path()).unwrap();
    assert!(city.archive(Layer::Meshes).is_none());
    assert_eq!(city.tile(Layer::Meshes, place).unwrap(), None);
}
