//! The search of objects: by HTTP with and without tokens and share links, by the command line, and after a replacement.

use crate::test_server::{TestServer, assert_problem, replace_city};
use crate::web_pages::share_query;
use insula_archive::city::SEARCH_FILE;
use insula_objects::search::SearchIndexBuilder;
use insula_objects::{FeatureKind, ObjectRecord, Schema, block};
use insula_protocol::object_tile::{self, SCHEMA_ID, block_id};
use insula_protocol::{TileKind, route};
use insula_server::config::{BlockCacheConfig, ServeConfig};
use insula_server::http::{AppState, HttpService};
use insula_server::store::{CityStore, Store};
use insula_test_support::faulty_host::FaultyHost;
use insula_test_support::small_city;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

const TOKEN: &str = "Authorization: Bearer 0123456789abcdef-office\r\n";
const TEXTS: [(&str, u32); 4] = [("Pand.1", 0), ("Oude Kerk", 0), ("Pand.2", 1), ("Markt 87", 1)];

/// Gives a city two objects and their search index.
fn add_objects(folder: &Path) {
    let schema = Schema { objects: 2, ..Schema::default() };
    let record = |identifier: &str, kind| {
        let identifier = identifier.to_owned();
        Some(ObjectRecord { identifier, kind, parent: None, bounds: None, attributes: Vec::new() })
    };
    let records = [record("Pand.1", FeatureKind::Building), record("Pand.2", FeatureKind::BuildingPart)];
    let place = block_id(0).unwrap();
    let tile = |id, content: &[u8]| (id, object_tile::encode(id, content).unwrap());
    let tiles = [
        tile(SCHEMA_ID, &serde_json::to_vec(&schema).unwrap()),
        tile(place, &block::encode(0, &records, &schema).unwrap()),
    ];
    small_city::write_archive(&folder.join(TileKind::Objects.file_name()), &tiles);
    write_index(folder, &TEXTS);
}

fn write_index(folder: &Path, texts: &[(&str, u32)]) {
    let mut builder = SearchIndexBuilder::new();
    texts.iter().for_each(|(text, object)| builder.add(text, *object));
    fs::write(folder.join(SEARCH_FILE), builder.finish().unwrap()).unwrap();
}

/// The address of a search of the small city.
fn address(query: &str) -> String {
    format!("{}?{query}", route::search("two", small_city::VERSION))
}

/// A server whose city has objects and a search index.
async fn start(change: impl FnOnce(&mut ServeConfig)) -> TestServer {
    let server = TestServer::start(change).await;
    add_objects(&server.folder.path().join("two"));
    server.reload().await;
    server
}

fn hits(response: &str) -> serde_json::Value {
    assert!(response.starts_with("HTTP/1.1 200 "), "{response}");
    serde_json::from_str(response.split_once("\r\n\r\n").unwrap().1).unwrap()
}

#[tokio::test]
async fn hits_are_json_and_immutable() {
    let server = start(|_| {}).await;
    let response = server.get(&address("q=OUDE+k%65rk"), "Origin: https://example.org\r\n").await;
    assert_eq!(hits(&response), serde_json::json!([{"text": "Oude Kerk", "object": 0, "typos": 0}]));
    for header in [
        "content-type: application/json\r\n",
        "cache-control: public, max-age=31536000, immutable\r\n",
        "access-control-allow-origin: *\r\n",
        "x-content-type-options: nosniff\r\n",
    ] {
        assert!(response.contains(header), "{header} is not in {response}");
    }
    let etag = response.lines().find_map(|line| line.strip_prefix("etag: ")).unwrap();
    let unchanged = server.get(&address("q=kerk"), &format!("If-None-Match: {etag}\r\n")).await;
    assert!(unchanged.starts_with("HTTP/1.1 304 "), "{unchanged}");
    assert_eq!(hits(&server.get(&address("q=pand"), "").await).as_array().unwrap().len(), 2);
    assert_eq!(hits(&server.get(&address("q=pand&limit=1"), "").await)[0]["object"], 0);
    assert_eq!(hits(&server.get(&address("q=marjt"), "").await)[0]["typos"], 1);
    assert_eq!(hits(&server.get(&address("q=rathaus"), "").await), serde_json::json!([]));
    assert!(server.get("/metrics", "").await.contains("insula_requests_total{route=\"search\",code=\"200\"} 5"));
    server.stop().await;
}

#[tokio::test]
async fn indexes_beyond_the_limit_are_evicted_and_read_again() {
    const CITIES: usize = 12;
    const TILE_BYTES: usize = 1 << 20;
    let texts: Vec<String> = (0..2000).map(|number| format!("Street {number}")).collect();
    let texts: Vec<(&str, u32)> = texts.iter().map(|text| (text.as_str(), 0)).collect();
    let measured = tempfile::tempdir().unwrap();
    write_index(measured.path(), &texts);
    let index_bytes = fs::metadata(measured.path().join(SEARCH_FILE)).unwrap().len() as usize;
    // Three of them and a half, and an eighth for directories.
    let room = index_bytes * 4;
    let server = TestServer::start(|config| {
        config.limits.tile_bytes = TILE_BYTES;
        config.cache.memory_bytes = 0;
        config.limits.cache_bytes = TILE_BYTES + room;
    })
    .await;
    let names: Vec<String> = (0..CITIES).map(|number| format!("city-{number}")).collect();
    for name in &names {
        let folder = server.folder.path().join(name);
        small_city::write_city(&folder, name);
        add_objects(&folder);
        write_index(&folder, &texts);
    }
    server.reload().await;
    let cached_bytes = async || -> usize {
        let metrics = server.get("/metrics", "").await;
        let prefix = "insula_cached_bytes{kind=\"computed\"} ";
        metrics.lines().find_map(|line| line.strip_prefix(prefix)).unwrap().parse().unwrap()
    };
    // The second time, all but the last three have left, and come back.
    for name in names.iter().chain(&names) {
        let address = format!("{}?q=street+7&limit=1", route::search(name, small_city::VERSION));
        assert_eq!(hits(&server.get(&address, "").await).as_array().unwrap().len(), 1, "{name}");
        let bytes = cached_bytes().await;
        assert!((index_bytes..=room).contains(&bytes), "{name}: {bytes} bytes of {room}");
    }
    assert!(cached_bytes().await > 3 * index_bytes, "three are kept");
    server.stop().await;
}

#[tokio::test]
async fn invalid_searches_are_problems() {
    let server = start(|_| {}).await;
    for query in
        ["", "limit=3", "q=", "q=%20", "q=%ff", &format!("q={}", "a".repeat(129)), "q=a&limit=0", "q=a&limit=101"]
    {
        assert_problem(&server.get(&address(query), "").await, 400);
    }
    for (path, status) in [
        ("/v1/cities/three/0123456789abcdef/search", 404),
        ("/v1/cities/two/0123456789abcdee/search", 410),
        ("/v1/cities/T/v/search", 404),
    ] {
        assert_problem(&server.get(&format!("{path}?q=kerk"), "").await, status);
    }
    fs::remove_file(server.folder.path().join("two").join(SEARCH_FILE)).unwrap();
    server.reload().await;
    assert_problem(&server.get(&address("q=kerk"), "").await, 404);
    fs::write(server.folder.path().join("two").join(SEARCH_FILE), "INSXnonsense").unwrap();
    server.reload().await;
    let damaged = server.get(&address("q=kerk"), "").await;
    assert_problem(&damaged, 500);
    assert!(damaged.contains("retry-after: 60\r\n"), "{damaged}");
    server.stop().await;
}

#[tokio::test]
async fn private_cities_are_searched_with_a_token_or_a_link_to_all_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let (tokens, keys) = (folder.path().join("tokens"), folder.path().join("keys"));
    fs::write(&tokens, "0123456789abcdef-office\n").unwrap();
    fs::write(&keys, "key 0123456789abcdef0123456789abcdef\n").unwrap();
    let server = start(|config| {
        config.access.tokens = Some(tokens.clone());
        config.access.share_keys = Some(keys.clone());
    })
    .await;
    for path in [address("q=kerk"), "/v1/cities/none/v/search?q=kerk".into(), "/v1/cities/T/v/search?q=kerk".into()] {
        assert_problem(&server.get(&path, "").await, 401);
    }
    let response = server.get(&address("q=kerk"), TOKEN).await;
    assert_eq!(hits(&response)[0]["object"], 0);
    assert!(response.contains("cache-control: private, max-age=31536000, immutable\r\n"), "{response}");
    let get = async |args: &[&str]| server.get(&address(&format!("q=kerk&{}", share_query(&keys, args))), "").await;
    for args in [&[][..], &["--read-only"], &["--version", "0123*"]] {
        assert_eq!(hits(&get(args).await)[0]["object"], 0, "{args:?}");
    }
    let filter = |link: &str| format!("{}?expr=height+%3E+0&{link}", route::filter("two", small_city::VERSION));
    assert!(server.get(&filter(&share_query(&keys, &[])), "").await.starts_with("HTTP/1.1 200"));
    // A read-only link opens searches and tiles only, also of objects.
    let link = share_query(&keys, &["--read-only"]);
    assert_problem(&server.get(&filter(&link), "").await, 404);
    let schema = format!("/v1/cities/two/{}/objects/schema", small_city::VERSION);
    for link in [link.replace('~', "%7E").replace('.', "%2E"), link] {
        assert!(server.get(&format!("{schema}?{link}"), "").await.starts_with("HTTP/1.1 200"), "{link}");
    }
    // The area contains the whole city, and still is one.
    assert_problem(&get(&["--bbox-metres", "0,0,999999,999999"]).await, 404);
    assert_problem(&get(&["--version", "1*"]).await, 401);
    server.stop().await;
}

#[tokio::test]
async fn filters_name_the_objects_that_pass() {
    use insula_objects::filter::{FilteredObjects, MAX_FILTER_BYTES};
    let server = start(|_| {}).await;
    let filter = |query: &str| format!("{}?{query}", route::filter("two", small_city::VERSION));
    let response = server.get(&filter("expr=kind+%3D%3D+'building'"), "").await;
    assert!(response.starts_with("HTTP/1.1 200 "), "{response}");
    for header in ["cache-control: public, max-age=31536000, immutable\r\n", "content-length: "] {
        assert!(response.contains(header), "{header} is not in {response}");
    }
    // The part is of another kind, of which none passes.
    let expected =
        FilteredObjects { passing: [0].into_iter().collect(), passing_wholes: 1, ..FilteredObjects::default() };
    assert!(response.contains(&format!("content-length: {}\r\n", expected.encode().len())), "{response}");
    let too_long = format!("expr={}", "a".repeat(MAX_FILTER_BYTES + 1));
    for query in [
        "", "expr", "expr=", "expr=%ff", "expr=heigt+%3E+3", "expr=height+%3E", "expr=height&expr=height", "q=height",
        &too_long,
    ] {
        assert_problem(&server.get(&filter(query), "").await, 400);
    }
    let other = route::filter("two", "0123456789abcdee");
    assert_problem(&server.get(&format!("{other}?expr=height"), "").await, 410);
    fs::remove_file(server.folder.path().join("two").join(TileKind::Objects.file_name())).unwrap();
    server.reload().await;
    assert_problem(&server.get(&filter("expr=height"), "").await, 404);
    server.stop().await;
}

#[tokio::test]
async fn the_index_of_an_older_version_stays_that_of_its_city() {
    let server = start(|_| {}).await;
    // The old folder is replaced before its index was read.
    replace_city(&server.folder.path().join("two"), |next| {
        small_city::write_city(next, "two");
        write_index(next, &[("Nieuwe Kerk", 5)]);
        let manifest = fs::read_to_string(next.join("city.json")).unwrap();
        fs::write(next.join("city.json"), manifest.replace(small_city::VERSION, "fedcba9876543210")).unwrap();
    });
    server.reload().await;
    assert_eq!(hits(&server.get(&address("q=kerk"), "").await)[0]["text"], "Oude Kerk");
    let newer = format!("{}?q=kerk", route::search("two", "fedcba9876543210"));
    assert_eq!(hits(&server.get(&newer, "").await)[0]["text"], "Nieuwe Kerk");
    server.stop().await;
}

#[tokio::test]
async fn many_searches_at_once_are_all_answered() {
    use axum::body::Body;
    use axum::http::Request;
    use tower::ServiceExt;
    let folder = small_city::temporary_city();
    add_objects(folder.path());
    let service = HttpService::new(AppState::new(Store::open(&[folder.path()]).unwrap(), &ServeConfig::default()));
    let search = || service.clone().oneshot(Request::get(address("q=kerk")).body(Body::empty()).unwrap());
    let tasks: Vec<_> = (0..64).map(|_| tokio::spawn(search())).collect();
    for task in tasks {
        assert_eq!(task.await.unwrap().unwrap().status(), 200);
    }
}

fn run(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_insula-server")).args(args).output().unwrap()
}

#[test]
fn command_prints_number_identifier_and_kind() {
    let city = small_city::temporary_city();
    let folder = city.path().to_str().unwrap();
    add_objects(city.path());
    let text = |args: &[&str]| String::from_utf8(run(args).stdout).unwrap();
    assert_eq!(text(&["search", folder, "kerk oude"]), "0 Pand.1 (building): Oude Kerk\n");
    assert_eq!(text(&["search", folder, "pand", "--limit", "1"]), "0 Pand.1 (building)\n");
    assert_eq!(text(&["search", folder, "rathaus"]), "nothing found\n");
    let json: serde_json::Value = serde_json::from_str(&text(&["search", folder, "markt", "--json"])).unwrap();
    let expected = serde_json::json!([
        {"object": 1, "text": "Markt 87", "typos": 0, "identifier": "Pand.2", "kind": "building-part"}
    ]);
    assert_eq!(json, expected);
}

#[test]
fn index_is_part_of_the_version_and_of_verification() {
    let city = small_city::temporary_city();
    let folder = city.path().to_str().unwrap();
    add_objects(city.path());
    small_city::set_version(city.path());
    let version = CityStore::open(city.path()).unwrap().manifest().version.clone();
    let verified = run(&["verify", folder]);
    let text = String::from_utf8_lossy(&verified.stdout);
    assert!(!text.contains(SEARCH_FILE) && !text.contains("its version is"), "{text}");
    write_index(city.path(), &TEXTS[1..]);
    let found = insula_archive::city::content_version(city.path(), &version).unwrap();
    assert_ne!(found, version);
    fs::write(city.path().join(SEARCH_FILE), "INSXnonsense").unwrap();
    let damaged = run(&["verify", folder]);
    let text = String::from_utf8_lossy(&damaged.stdout).into_owned();
    assert!(text.contains(SEARCH_FILE) && text.contains("its version is"), "{text}");
    let failed = run(&["search", folder, "kerk"]);
    assert_eq!(failed.status.code(), Some(1));
    fs::remove_file(city.path().join(SEARCH_FILE)).unwrap();
    let failed = run(&["search", folder, "kerk"]);
    let text = String::from_utf8_lossy(&failed.stderr).into_owned();
    assert!(
        failed.status.code() == Some(1) && text.contains("has no search index") && text.lines().count() == 1,
        "{text}"
    );
}

/// A city on another host has its search, and nothing of the index is fetched before the first one.
#[tokio::test(flavor = "multi_thread")]
async fn a_remote_city_is_searched() {
    let folder = small_city::temporary_city();
    add_objects(folder.path());
    let host = FaultyHost::start(folder.path());
    let store = Store::open_anywhere(&[host.url().into()], &BlockCacheConfig::default()).await.unwrap();
    let city = store.cities().next().unwrap();
    assert!(city.has_search());
    let (before, searched) = (host.requests(), city.clone());
    let found = tokio::task::spawn_blocking(move || searched.search_index().map(|index| index.search("kerk", 3)));
    assert_eq!(found.await.unwrap().unwrap()[0].object, 0);
    assert_eq!(host.requests(), before + 1);
    fs::remove_file(folder.path().join(SEARCH_FILE)).unwrap();
    let store = Store::open_anywhere(&[host.url().into()], &BlockCacheConfig::default()).await.unwrap();
    assert!(!store.cities().next().unwrap().has_search());
}
