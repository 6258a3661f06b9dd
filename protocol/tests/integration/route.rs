//! Addresses: round trips, hostile paths, and the classification of paths for metrics.

use insula_protocol::mesh_tile::MAX_LODS;
use insula_protocol::object_tile::{SCHEMA_ID, block_id};
use insula_protocol::route::{self, Route, RouteError, RouteTemplate, TileRoute, TilesetFileKind};
use insula_protocol::{TileGroup, TileId, TileKind};
use proptest::prelude::*;

const VERSION: &str = "0123456789abcdef";

fn leaf() -> TileId {
    TileId::new(7, 100, 3).unwrap()
}

fn tile(kind: TileKind, lod: u8) -> Route<'static> {
    Route::Tile(TileRoute { city: "delft", version: VERSION, kind, id: leaf(), lod })
}

fn objects(id: TileId) -> Route<'static> {
    Route::Tile(TileRoute { city: "delft", version: VERSION, kind: TileKind::Objects, id, lod: 0 })
}

fn tileset_file(kind: TilesetFileKind) -> Route<'static> {
    Route::TilesetFile { city: "delft", version: VERSION, kind, id: leaf() }
}

fn group(kind: TileKind, doublings: u8, lod: u8) -> Route<'static> {
    let group = TileGroup::around(kind, leaf(), doublings, lod).unwrap();
    Route::Group { city: "delft", version: VERSION, group }
}

fn tile_error(rest: &str) -> RouteError {
    Route::parse(&format!("/v1/cities/delft/{VERSION}/{rest}")).unwrap_err()
}

#[test]
fn every_address_has_its_path() {
    for (route, path) in [
        (Route::Index, "/"),
        (Route::OpenApi, "/v1/openapi.json"),
        (Route::Health, "/healthz"),
        (Route::Readiness, "/readyz"),
        (Route::Metrics, "/metrics"),
        (Route::Cities, "/v1/cities"),
        (Route::Manifest { city: "delft" }, "/v1/cities/delft"),
        (Route::CityPage { city: "delft" }, "/cities/delft"),
        (Route::Thumbnail { city: "delft" }, "/cities/delft/thumbnail.jpg"),
        (Route::Asset { hash: VERSION, file: "insula_web_bg.wasm" }, "/assets/0123456789abcdef/insula_web_bg.wasm"),
        (Route::ServiceWorker, "/service-worker.js"),
        (tile(TileKind::Subtree, 0), "/v1/cities/delft/0123456789abcdef/subtrees/7/100/3"),
        (tile(TileKind::BlockMap, 0), "/v1/cities/delft/0123456789abcdef/blockmaps/7/100/3"),
        (tile(TileKind::Mesh, 0), "/v1/cities/delft/0123456789abcdef/meshes/7/100/3/0"),
        (tile(TileKind::Mesh, 3), "/v1/cities/delft/0123456789abcdef/meshes/7/100/3/3"),
        (objects(SCHEMA_ID), "/v1/cities/delft/0123456789abcdef/objects/schema"),
        (objects(block_id(0).unwrap()), "/v1/cities/delft/0123456789abcdef/objects/0"),
        (objects(block_id(54_321).unwrap()), "/v1/cities/delft/0123456789abcdef/objects/54321"),
        (Route::Search { city: "delft", version: VERSION }, "/v1/cities/delft/0123456789abcdef/search"),
        (Route::Search { city: "search", version: "objects" }, "/v1/cities/search/objects/search"),
        (Route::Filter { city: "delft", version: VERSION }, "/v1/cities/delft/0123456789abcdef/filter"),
        (group(TileKind::BlockMap, 3, 0), "/v1/cities/delft/0123456789abcdef/groups/blockmaps/7/100/2/8/0"),
        (group(TileKind::Mesh, 1, 2), "/v1/cities/delft/0123456789abcdef/groups/meshes/7/100/3/2/2"),
        (Route::Draw { city: "delft" }, "/v1/cities/delft/draw"),
        (Route::Analyse { city: "delft" }, "/v1/cities/delft/analyse"),
        (Route::Proposals { city: "delft" }, "/v1/cities/delft/proposals.json"),
        (Route::Tileset { city: "delft" }, "/v1/cities/delft/3dtiles/tileset.json"),
        (tileset_file(TilesetFileKind::Subtree), "/v1/cities/delft/3dtiles/0123456789abcdef/subtrees/7/100/3.subtree"),
        (tileset_file(TilesetFileKind::Content), "/v1/cities/delft/3dtiles/0123456789abcdef/content/7/100/3.glb"),
    ] {
        assert_eq!(route.path(), path);
        assert_eq!(Route::parse(path), Ok(route));
        assert_eq!(RouteTemplate::of_path(path), route.template());
    }
}

#[test]
fn path_builders_agree_with_routes() {
    assert_eq!(route::manifest("delft"), Route::Manifest { city: "delft" }.path());
    assert_eq!(route::search("delft", VERSION), Route::Search { city: "delft", version: VERSION }.path());
    assert_eq!(route::tile("delft", VERSION, TileKind::Subtree, leaf()), tile(TileKind::Subtree, 0).path());
    assert_eq!(route::mesh("delft", VERSION, leaf(), 2), tile(TileKind::Mesh, 2).path());
    let stored = TileId::new(9, 400, 12).unwrap();
    assert_eq!(route::archive_tile("delft", VERSION, TileKind::Mesh, stored, 7), Some(tile(TileKind::Mesh, 2).path()));
    assert_eq!(route::archive_tile("delft", VERSION, TileKind::Mesh, leaf(), 8), None);
}

#[test]
fn other_shapes_are_unknown() {
    for path in [
        "",
        "*",
        "healthz",
        "/healthz/",
        "/HEALTHZ",
        "//",
        "/v1",
        "/v1/",
        "/v1/citiesx",
        "/v2/cities",
        "/v1/openapi.json/",
        "/v1/cities/delft/",
        "/v1/cities/delft/0123456789abcdef",
        "/v1/cities/delft/0123456789abcdef/subtrees",
        "/v1/cities/delft/0123456789abcdef/subtrees/7/100",
        "/v1/cities/delft/0123456789abcdef/subtrees/7/100/3/0",
        "/v1/cities/delft/0123456789abcdef/meshes/7/100/3",
        "/v1/cities/delft/0123456789abcdef/meshes/7/100/3/0/",
        "/v1/cities/delft/0123456789abcdef/Subtrees/7/100/3",
        "/v1/cities/delft/0123456789abcdef/objects/7/100/3",
        "/v1/cities/delft%2F0123456789abcdef/subtrees/7/100/3",
        "/v1/cities/delft/search",
        "/v1/cities/delft/0123456789abcdef/search/",
        "/v1/cities/delft/0123456789abcdef/search/a",
        "/v1/cities/delft/0123456789abcdef/Search",
        "/v1/cities/delft/0123456789abcdef/x/search",
        "/cities",
        "/cities/delft/",
        "/cities/delft/city.json",
        "/cities/delft/thumbnail.jpg/",
        "/assets",
        "/assets/0123456789abcdef",
        "/assets/0123456789abcdef/",
        "/assets/0123456789abcdef/.app.js",
        "/assets/0123456789abcdef/a/app.js",
        "/assets/0123456789abcdef/..%2fapp.js",
        "/assets/../app.js",
        "/service-worker.js/",
    ] {
        assert_eq!(Route::parse(path), Err(RouteError::Unknown), "{path}");
    }
}

#[test]
fn numbers_have_one_spelling_and_limits() {
    let long = "9".repeat(4000);
    for number in ["", "00", "01", "+1", "-1", " 1", "1 ", "%31", "1e1", "0x1", "\u{661}", "4294967296", &long] {
        for rest in [format!("{number}/0/0"), format!("1/{number}/0"), format!("1/0/{number}")] {
            assert_eq!(tile_error(&format!("subtrees/{rest}")), RouteError::InvalidTile, "{rest}");
            assert_eq!(tile_error(&format!("meshes/{rest}/0")), RouteError::InvalidTile, "{rest}");
        }
        assert_eq!(tile_error(&format!("meshes/1/0/0/{number}")), RouteError::InvalidTile, "{number}");
    }
    for rest in ["subtrees/21/0/0", "subtrees/1/2/0", "blockmaps/1/0/2", "subtrees/256/0/0", "meshes/1/0/0/6"] {
        assert_eq!(tile_error(rest), RouteError::InvalidTile, "{rest}");
    }
    assert!(Route::parse(&format!("/v1/cities/delft/{VERSION}/blockmaps/20/1048575/1048575")).is_ok());
}

#[test]
fn names_are_limited_and_never_decoded() {
    let longest = "a".repeat(64);
    assert_eq!(Route::parse(&format!("/v1/cities/{longest}")), Ok(Route::Manifest { city: &longest }));
    let too_long = "a".repeat(65);
    for name in ["", ".", "..", "%2e%2e", "%64elft", "Delft", "a b", "a?b", "a#b", "a\0b", "d\u{e9}lft", &too_long] {
        assert_eq!(Route::parse(&format!("/v1/cities/{name}")), Err(RouteError::InvalidName), "{name}");
        for path in [
            format!("/v1/cities/{name}/{VERSION}/subtrees/0/0/0"),
            format!("/v1/cities/delft/{name}/meshes/0/0/0/0"),
            format!("/v1/cities/{name}/{VERSION}/search"),
            format!("/v1/cities/delft/{name}/search"),
        ] {
            assert_eq!(Route::parse(&path), Err(RouteError::InvalidName), "{path}");
        }
    }
    assert_eq!(Route::parse("/cities/.."), Err(RouteError::InvalidName));
    assert_eq!(Route::parse("/cities/Delft/thumbnail.jpg"), Err(RouteError::InvalidName));
    assert_eq!(Route::parse("/v1/cities/../x/subtrees/99/0/0"), Err(RouteError::InvalidTile), "numbers come first");
}

#[test]
fn templates_are_bounded_and_complete() {
    let mut labels: Vec<_> = RouteTemplate::ALL.into_iter().map(RouteTemplate::label).collect();
    for (index, template) in RouteTemplate::ALL.into_iter().enumerate() {
        assert_eq!(template as usize, index);
        let Some(pattern) = template.pattern() else { continue };
        assert_eq!(RouteTemplate::of_path(pattern), template, "{pattern}");
    }
    labels.sort_unstable();
    labels.dedup();
    assert_eq!(labels.len(), RouteTemplate::ALL.len());
    let operational: Vec<_> = RouteTemplate::ALL.into_iter().filter(|template| template.is_operational()).collect();
    assert_eq!(operational, [RouteTemplate::Health, RouteTemplate::Readiness, RouteTemplate::Metrics]);
}

#[test]
fn invalid_addresses_are_classified_by_their_shape() {
    for (path, template) in [
        ("/v1/cities/", RouteTemplate::Manifest),
        ("/v1/cities/%ff", RouteTemplate::Manifest),
        ("/v1/cities/a/b", RouteTemplate::Other),
        ("/v1/cities/a/b/blockmaps", RouteTemplate::BlockMaps),
        ("/v1/cities/a/b/meshes/x/y/z/more", RouteTemplate::Meshes),
        ("/v1/cities/a/b/objects", RouteTemplate::Objects),
        ("/v1/cities/a/b/objects/-1/more", RouteTemplate::Objects),
        ("/v1/cities/a/b/object/1", RouteTemplate::Other),
        ("/v1/cities/A/./search", RouteTemplate::Search),
        ("/v1/cities/a/b/search/more", RouteTemplate::Search),
        ("/v1/cities/a/search", RouteTemplate::Other),
        ("/v1", RouteTemplate::Other),
        ("/metrics/x", RouteTemplate::Other),
        ("/favicon.ico", RouteTemplate::Other),
        ("/cities/", RouteTemplate::CityPage),
        ("/cities/%ff", RouteTemplate::CityPage),
        ("/cities", RouteTemplate::Other),
        ("/cities/a/b", RouteTemplate::Other),
        ("/assets/A/..", RouteTemplate::Asset),
        ("/assets/a/b/c", RouteTemplate::Other),
    ] {
        assert_eq!(RouteTemplate::of_path(path), template, "{path}");
    }
}

proptest! {
    #[test]
    fn tiles_round_trip(city in "[a-z0-9_-]{1,64}", version in "[0-9a-f]{16}", level in 0u8..=20, x: u32, y: u32, kind in 0usize..3, lod in 0..MAX_LODS) {
        let kind = TileKind::ALL[kind];
        let mask = (1u32 << level) - 1;
        let id = TileId::new(level, x & mask, y & mask).unwrap();
        let lod = if kind == TileKind::Mesh { lod } else { 0 };
        let route = Route::Tile(TileRoute { city: &city, version: &version, kind, id, lod });
        let path = route.path();
        prop_assert_eq!(Route::parse(&path), Ok(route));
    }

    #[test]
    fn a_parsed_path_is_the_only_path_of_its_route(path in "(/(v1|cities|assets|thumbnail.jpg|meshes|subtrees|[a-z%.0-9/]{0,6})){0,10}") {
        if let Ok(route) = Route::parse(&path) {
            prop_assert_eq!(route.path(), path.clone());
            prop_assert_eq!(RouteTemplate::of_path(&path), route.template());
        }
    }

    #[test]
    fn any_text_is_parsed_or_refused(path: String) {
        if let Ok(route) = Route::parse(&path) {
            prop_assert_eq!(route.path(), path);
        }
    }
}

#[test]
fn only_addresses_of_one_host_are_the_same_host() {
    for (from, to) in [
        ("http://h/a", "http://h/b?c"),
        ("http://h/a", "https://h/a"),
        ("https://h:7/", "https://u:p@h:7/b"),
        ("http://[::1]/", "https://[::1]/"),
    ] {
        assert!(route::is_same_host(from, to), "{from} {to}");
    }
    for (from, to) in [
        ("https://h/a", "http://h/a"),
        ("http://h/a", "http://127.0.0.1/a"),
        ("http://h:7/", "http://h:8/"),
        ("http://h:7/", "https://h:7/"),
        ("http://[::1]:7/", "https://[::1]:7/"),
        ("http://h/a", "http://h.evil/a"),
        ("http://h/a", "http://h@evil/a"),
        ("http://h/a", "http://evil?http://h/a"),
        ("http://h/a", "file:///h/a"),
        ("h", "h"),
    ] {
        assert!(!route::is_same_host(from, to), "{from} {to}");
    }
}

#[test]
fn addresses_are_shown_without_secrets() {
    for (address, shown) in [
        ("https://me:pass@example.org:8443/a/b.json?key=1#x", "https://example.org:8443/a/b.json"),
        ("https://example.org?key=1", "https://example.org"),
        ("https://a@b@example.org/", "https://example.org/"),
        ("s3://bucket/a b.gml", "s3://bucket/a b.gml"),
        ("https://example.org/@me/x", "https://example.org/@me/x"),
        ("folder/a?b.gml", "folder/a?b.gml"),
    ] {
        assert_eq!(route::without_secrets(address), shown);
        assert_eq!(route::host_of(shown).is_some(), shown.contains("://"), "{shown}");
    }
}
