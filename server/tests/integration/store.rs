//! Folders of cities. What one city must be is tested in `insula-archive`.

use crate::test_server::{PATIENCE, replace_city};
use insula_protocol::{TileKind, mesh_tile};
use insula_server::config::BlockCacheConfig;
use insula_server::store::{CityStore, RetentionPolicy, Store, StoreError};
use insula_test_support::small_city;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::sync_channel;

#[test]
fn a_folder_of_cities_opens_all_of_them() {
    let root = tempfile::tempdir().unwrap();
    assert!(matches!(Store::open(&[root.path()]), Err(StoreError::NoCity(_))));
    for name in ["b", "a"] {
        small_city::write_city(&root.path().join(name), name);
    }
    std::fs::create_dir(root.path().join("other")).unwrap();
    let store = Store::open(&[root.path()]).unwrap();
    let names: Vec<_> = store.cities().map(|city| city.manifest().name.clone()).collect();
    assert_eq!(names, ["a", "b"]);
    assert!(store.city("a").is_some() && store.city("c").is_none());
    let twice = Store::open(&[root.path().join("a"), root.path().to_owned()]);
    assert!(matches!(twice, Err(StoreError::SameName { .. })));
    assert!(matches!(Store::open(&[root.path().join("missing")]), Err(StoreError::Io { .. })));
    let file = root.path().join("town.gml");
    std::fs::write(&file, "<CityModel/>").unwrap();
    assert!(matches!(Store::open(&[&file]), Err(StoreError::NotAFolder(_))));
    let error = CityStore::open(&file).err().unwrap().to_string();
    assert!(error.contains("town.gml is a file, not the folder of a city; make a city of it with"), "{error}");
}

#[tokio::test]
async fn a_start_serves_what_can_be_opened_and_a_reload_the_rest() {
    let root = tempfile::tempdir().unwrap();
    let [good, broken, empty] = ["good", "broken", "empty"].map(|name| root.path().join(name));
    small_city::write_city(&good, "good");
    small_city::write_city(&broken, "broken");
    std::fs::write(broken.join(TileKind::BlockMap.file_name()), b"nothing").unwrap();
    std::fs::create_dir(&empty).unwrap();
    // A port that nothing listens on.
    let closed = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let missing = root.path().join("missing");
    let host = format!("http://{closed}/city").into();
    let places = [root.path().to_owned(), empty.clone(), missing, host, "htps://a/city".into()];
    let cache = BlockCacheConfig { timeout_secs: 1, ..BlockCacheConfig::default() };
    let started = Store::start(&places, &cache).await.unwrap();
    assert_eq!(started.failures.len(), 5, "{:?}", started.failures);
    assert!(started.store.failures().any(|failure| failure.contains("htps://a/city")));
    assert!(started.store.failures().any(|failure| failure.contains("blockmaps.pmtiles")));
    assert!(Store::open_anywhere(&places, &cache).await.is_err(), "one of them cannot be opened");
    let store = started.usable().unwrap();
    let names = |store: &Store| store.cities().map(|city| city.manifest().name.clone()).collect::<Vec<_>>();
    assert_eq!((names(&store), store.failures().count()), (vec!["good".to_owned()], 5));
    replace_city(&broken, |next| small_city::write_city(next, "broken"));
    small_city::write_city(&empty, "late");
    let reload = store.reload(RetentionPolicy::default(), false).await;
    assert!(reload.must_replace());
    assert_eq!(names(&reload.store), ["broken", "good", "late"]);
    let left =
        "the missing folder, the host, which was not asked, the city that two places name, and the wrong address";
    assert_eq!(reload.store.failures().count(), 4, "{left}");
    let nothing = Store::start(&[root.path().join("missing")], &cache).await.unwrap();
    assert!(matches!(nothing.usable(), Err(StoreError::Io { .. })));
}

#[cfg(unix)]
#[tokio::test]
async fn a_city_that_cannot_be_looked_at_is_reported() {
    let root = tempfile::tempdir().unwrap();
    small_city::write_city(&root.path().join("good"), "good");
    std::os::unix::fs::symlink("loop", root.path().join("loop")).unwrap();
    let started = Store::start(&[root.path().to_owned()], &BlockCacheConfig::default()).await.unwrap();
    assert!(started.failures[0].to_string().contains("loop"), "{:?}", started.failures);
    assert_eq!(started.usable().unwrap().cities().len(), 1);
}

#[cfg(target_os = "linux")]
#[tokio::test]
async fn a_folder_whose_name_is_not_text_changes_only_if_its_files_do() {
    use std::os::unix::ffi::OsStrExt;
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join(std::ffi::OsStr::from_bytes(b"city\xff"));
    small_city::write_city(&folder, "a");
    let store = Store::open(&[&folder]).unwrap();
    let retention = RetentionPolicy { time: std::time::Duration::ZERO, versions: 1 };
    let unchanged = store.reload(retention, false).await;
    assert!(!unchanged.must_replace() && unchanged.failures.is_empty(), "{unchanged:?}");
    replace_city(&folder, |next| small_city::write_city(next, "a"));
    assert_eq!(store.reload(retention, false).await.changed, ["a"]);
}

#[test]
fn meshes_are_optional() {
    let folder = small_city::temporary_city_with_meshes();
    let archive = folder.path().join(TileKind::Mesh.file_name());
    let city = CityStore::open(folder.path()).unwrap();
    assert_eq!(city.archive(TileKind::Mesh).unwrap().len(), 2);
    let id = mesh_tile::archive_id(small_city::child(), 1).unwrap();
    assert_eq!(city.tile(TileKind::Mesh, id).unwrap().unwrap(), small_city::meshes()[1].1);
    std::fs::remove_file(&archive).unwrap();
    let city = CityStore::open(folder.path()).unwrap();
    assert!(city.archive(TileKind::Mesh).is_none());
    assert_eq!(city.tile(TileKind::Mesh, id).unwrap(), None);
}

#[tokio::test]
async fn an_address_with_a_query_is_refused_and_not_shown() {
    for url in ["https://me:secret@h/city?key=secret", "s3://bucket/city#secret"] {
        let opened = Store::open_anywhere(&[url.into()], &BlockCacheConfig::default()).await;
        let error = opened.unwrap_err().to_string();
        assert!(error.contains("with a query") && !error.contains("secret"), "{error}");
    }
}

#[tokio::test]
async fn a_web_server_cannot_redirect_to_another_host() {
    let (hostile, victim) = (TcpListener::bind("127.0.0.1:0").unwrap(), TcpListener::bind("127.0.0.2:0").unwrap());
    let url = format!("http://{}/city", hostile.local_addr().unwrap());
    let location = format!("http://{}/latest/meta-data", victim.local_addr().unwrap());
    let (request, requested) = sync_channel(1);
    std::thread::spawn(move || {
        for mut stream in hostile.incoming().flatten() {
            if let Ok(1..) = stream.read(&mut [0; 4096]) {
                let _ = request.try_send(());
            }
            let _ = write!(stream, "HTTP/1.1 302 Found\r\nLocation: {location}\r\nContent-Length: 0\r\n\r\n");
        }
    });
    let cache = BlockCacheConfig { timeout_secs: 1, ..BlockCacheConfig::default() };
    let opened = Store::open_anywhere(&[url.into()], &cache).await;
    assert!(matches!(opened, Err(StoreError::Remote { .. })));
    requested.recv_timeout(PATIENCE).expect("the web server was not asked");
    // Connections are accepted in their order: an earlier one would come before this one.
    let own = TcpStream::connect(victim.local_addr().unwrap()).unwrap();
    assert_eq!(victim.accept().unwrap().1, own.local_addr().unwrap(), "the victim was asked");
}
