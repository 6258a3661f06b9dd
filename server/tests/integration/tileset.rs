//! Cities as 3D Tiles over HTTP: files that are made when they are asked for, versions, tokens, and damaged cities.

use crate::test_server::{TestServer, assert_problem};
use crate::web_pages::share_query;
use insula_protocol::{TileKind, route};
use insula_server::config::ServeConfig;
use insula_test_support::small_city;
use std::fs;

const TOKEN: &str = "Authorization: Bearer 0123456789abcdef-office\r\n";

async fn start(change: impl FnOnce(&mut ServeConfig)) -> TestServer {
    let server = TestServer::start(change).await;
    small_city::write_city_with_meshes(&server.folder.path().join("two"), "two");
    server.reload().await;
    server
}

/// The tileset's JSON of a response, and the addresses of files as it has them.
fn tileset(response: &str) -> (serde_json::Value, impl Fn(&str, [u32; 3]) -> String + use<>) {
    assert!(response.starts_with("HTTP/1.1 200 "), "{response}");
    let json: serde_json::Value = serde_json::from_str(response.split_once("\r\n\r\n").unwrap().1).unwrap();
    let root = json["root"].clone();
    let file = move |pointer: &str, [level, x, y]: [u32; 3]| {
        let template = root.pointer(pointer).unwrap().as_str().unwrap();
        let path = template.replace("{level}", &level.to_string()).replace("{x}", &x.to_string());
        route::tileset("two").replace("tileset.json", &path.replace("{y}", &y.to_string()))
    };
    (json, file)
}

const CONTENT: &str = "/content/uri";
const SUBTREE: &str = "/implicitTiling/subtrees/uri";

#[tokio::test]
async fn the_files_that_the_tileset_names_are_served() {
    let server = start(|_| {}).await;
    let response = server.get(&route::tileset("two"), "Origin: https://example.org\r\n").await;
    let (json, file) = tileset(&response);
    assert_eq!(json["asset"]["version"], "1.1");
    assert_eq!(json["root"]["implicitTiling"]["availableLevels"], 2);
    for header in
        ["content-type: application/json\r\n", "cache-control: no-cache\r\n", "access-control-allow-origin: *\r\n"]
    {
        assert!(response.contains(header), "{header} is not in {response}");
    }
    let etag = response.lines().find_map(|line| line.strip_prefix("etag: ")).unwrap();
    let unchanged = server.get(&route::tileset("two"), &format!("If-None-Match: {etag}\r\n")).await;
    assert!(unchanged.starts_with("HTTP/1.1 304 "), "{unchanged}");

    let immutable = "cache-control: public, max-age=31536000, immutable\r\n";
    let subtree = server.get(&file(SUBTREE, [0, 0, 0]), "").await;
    assert!(subtree.starts_with("HTTP/1.1 200 ") && subtree.contains(immutable), "{subtree}");
    assert!(subtree.split_once("\r\n\r\n").unwrap().1.starts_with("subt"), "{subtree}");
    for node in [[0, 0, 0], [1, 1, 1]] {
        let content = server.get(&file(CONTENT, node), "").await;
        assert!(content.starts_with("HTTP/1.1 200 ") && content.contains(immutable), "{node:?}: {content}");
        assert!(content.contains("content-type: model/gltf-binary\r\n"), "{content}");
        assert!(content.split_once("\r\n\r\n").unwrap().1.starts_with("glTF"), "{content}");
    }
    let metrics = server.get("/metrics", "").await;
    assert!(metrics.contains("insula_requests_total{route=\"tileset-files\",code=\"200\"} 3"), "{metrics}");
    server.stop().await;
}

#[tokio::test]
async fn other_addresses_are_problems() {
    let server = start(|_| {}).await;
    let (_, file) = tileset(&server.get(&route::tileset("two"), "").await);
    for node in [[1, 0, 0], [2, 0, 0], [20, 5, 5]] {
        assert_problem(&server.get(&file(CONTENT, node), "").await, 404);
        assert_problem(&server.get(&file(SUBTREE, node), "").await, 404);
    }
    assert_problem(&server.get(&file(CONTENT, [1, 2, 0]), "").await, 400);
    assert_problem(&server.get(&file(CONTENT, [21, 0, 0]), "").await, 400);
    let other = file(CONTENT, [0, 0, 0]).replace(small_city::VERSION, "0123456789abcdee");
    let without_extension = file(CONTENT, [0, 0, 0]).replace(".glb", "");
    assert_problem(&server.get(&other, "").await, 410);
    for path in [without_extension, route::tileset("three"), route::tileset("two") + "/x"] {
        assert_problem(&server.get(&path, "").await, 404);
    }
    server.stop().await;
}

#[tokio::test]
async fn private_cities_need_their_token() {
    let folder = tempfile::tempdir().unwrap();
    let tokens = folder.path().join("tokens");
    fs::write(&tokens, "0123456789abcdef-office\n").unwrap();
    let server = start(|config| config.access.tokens = Some(tokens.clone())).await;
    assert_problem(&server.get(&route::tileset("two"), "").await, 401);
    assert_problem(&server.get(&route::tileset("none"), "").await, 401);
    let response = server.get(&route::tileset("two"), TOKEN).await;
    assert!(response.contains("cache-control: private, no-cache\r\n"), "{response}");
    let (_, file) = tileset(&response);
    let path = file(CONTENT, [0, 0, 0]);
    // The token's request fills the cache, which opens the file to nobody else.
    assert!(server.get(&path, TOKEN).await.contains("cache-control: private, max-age=31536000, immutable\r\n"));
    assert_problem(&server.get(&path, "").await, 401);
    server.stop().await;
}

/// Programs send the query of the root with no file that it names, unless it is part of their addresses.
#[cfg(unix)]
#[tokio::test]
async fn a_share_link_opens_the_files_that_the_tileset_names() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys");
    fs::write(&keys, "key 0123456789abcdef0123456789abcdef\n").unwrap();
    let server = start(|config| config.access.share_keys = Some(keys.clone())).await;
    let query = share_query(&keys, &[]);
    let (_, file) = tileset(&server.get(&format!("{}?{query}", route::tileset("two")), "").await);
    for path in [file(SUBTREE, [0, 0, 0]), file(CONTENT, [1, 1, 1])] {
        assert!(path.ends_with(&format!("?{query}")), "{path}");
        assert!(server.get(&path, "").await.starts_with("HTTP/1.1 200 "), "{path}");
        assert_problem(&server.get(path.split('?').next().unwrap(), "").await, 401);
    }
    // The root is cached, and each link is in the answer to its own request only.
    let other = share_query(&keys, &["--version", "0123*"]);
    assert_ne!(other, query);
    let root = server.get(&format!("{}?{other}", route::tileset("two")), "").await;
    assert!(root.contains(&other) && !root.contains(&query), "{root}");
    let (_, file) = tileset(&root);
    assert!(server.get(&file(CONTENT, [1, 1, 1]), "").await.starts_with("HTTP/1.1 200 "));
    // Links to a part of the city, and those for reading only, open neither the root nor a file.
    for arguments in [&["--bbox-metres", "85001,446001,85002,446002"][..], &["--read-only"]] {
        let query = share_query(&keys, arguments);
        assert_problem(&server.get(&format!("{}?{query}", route::tileset("two")), "").await, 404);
        let path = file(CONTENT, [1, 1, 1]).split('?').next().unwrap().to_owned();
        assert_problem(&server.get(&format!("{path}?{query}"), "").await, 404);
    }
    server.stop().await;
}

#[tokio::test]
async fn a_damaged_tile_fails_alone() {
    let server = start(|_| {}).await;
    let archive = server.folder.path().join("two").join(TileKind::BlockMap.file_name());
    let mut bytes = fs::read(&archive).unwrap();
    let tile = small_city::blockmaps().swap_remove(0).1;
    let at = bytes.windows(tile.len()).position(|window| window == tile).unwrap();
    bytes[at + tile.len() / 2] ^= 1;
    fs::write(&archive, bytes).unwrap();
    server.reload().await;
    let (_, file) = tileset(&server.get(&route::tileset("two"), "").await);
    let damaged = server.get(&file(CONTENT, [0, 0, 0]), "").await;
    assert_problem(&damaged, 500);
    assert!(damaged.contains("retry-after: 60\r\n"), "{damaged}");
    assert!(server.get(&file(CONTENT, [1, 1, 1]), "").await.starts_with("HTTP/1.1 200 "));
    server.stop().await;
}
