//! All routes, tested without a port.

use axum::body::Body;
use axum::http::{HeaderMap, Method, Request, StatusCode};
use http_body_util::BodyExt;
use insula_protocol::codec::bincode;
use insula_protocol::route::{self, RouteTemplate};
use insula_protocol::tile_group::{self, GroupMember};
use insula_protocol::{Manifest, TileGroup, TileId, TileKind};
use insula_server::config::ServeConfig;
use insula_server::http::{AppState, HttpService};
use insula_server::store::Store;
use insula_test_support::small_city;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;
use tower::ServiceExt;

const TILE: &str = "/v1/cities/two/0123456789abcdef/blockmaps/1/1/1";
const IMMUTABLE: &str = "public, max-age=31536000, immutable";

struct TestResponse {
    status: StatusCode,
    headers: HeaderMap,
    body: Vec<u8>,
}

impl TestResponse {
    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    fn text(&self) -> Cow<'_, str> {
        String::from_utf8_lossy(&self.body)
    }

    /// Asserts that this is a complete problem document with this status, and that it reveals no path of the server.
    fn assert_problem(&self, status: u16) {
        assert_eq!(self.status.as_u16(), status, "{}", self.text());
        assert_eq!(self.header("content-type"), "application/problem+json");
        let problem: serde_json::Value = serde_json::from_slice(&self.body).unwrap();
        assert_eq!(problem["status"], status);
        for key in ["type", "title", "detail"] {
            assert!(problem[key].as_str().is_some_and(|text| !text.is_empty()), "{problem}");
        }
        assert!(!self.text().contains("tmp") && !self.text().contains("etc/"), "{}", self.text());
    }
}

fn state(folder: &Path, change: impl FnOnce(&mut ServeConfig)) -> AppState {
    let mut config = ServeConfig::default();
    change(&mut config);
    AppState::new(Store::open(&[folder]).unwrap(), &config)
}

async fn request_from(service: &HttpService, method: Method, path: &str, headers: &[(&str, &str)]) -> TestResponse {
    let mut request = Request::builder().method(method).uri(path);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let response = service.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
    let (parts, body) = response.into_parts();
    let body = body.collect().await.unwrap().to_bytes().to_vec();
    TestResponse { status: parts.status, headers: parts.headers, body }
}

async fn get_from(service: &HttpService, path: &str) -> TestResponse {
    request_from(service, Method::GET, path, &[]).await
}

/// Sends a request to a service that all tests share.
async fn request(method: Method, path: &str, headers: &[(&str, &str)]) -> TestResponse {
    static SERVICE: OnceLock<HttpService> = OnceLock::new();
    let service = SERVICE.get_or_init(|| HttpService::new(state(small_city::shared_city(), |_| {})));
    request_from(service, method, path, headers).await
}

async fn get(path: &str) -> TestResponse {
    request(Method::GET, path, &[]).await
}

#[tokio::test]
async fn tiles_are_immutable_and_byte_for_byte() {
    for (id, bytes) in small_city::blockmaps() {
        let path = route::tile("two", small_city::VERSION, TileKind::BlockMap, id);
        let response = get(&path).await;
        assert_eq!((response.status, &response.body), (StatusCode::OK, &bytes), "{path}");
        assert_eq!(response.header("cache-control"), IMMUTABLE);
        assert_eq!(response.header("content-type"), "application/octet-stream");
        assert_eq!(response.header("content-length"), bytes.len().to_string());
        assert_eq!(response.header("accept-ranges"), "bytes");
        let etag = response.header("etag");
        assert!(etag.starts_with('"') && etag.ends_with('"') && etag.len() > 10, "{etag}");
        assert_eq!(get(&path).await.header("etag"), etag, "stable");
    }
    assert_eq!(get("/v1/cities/two/0123456789abcdef/subtrees/0/0/0").await.body, small_city::subtree());
    let tags = [get(TILE).await, get("/v1/cities/two/0123456789abcdef/blockmaps/0/0/0").await];
    assert_ne!(tags[0].header("etag"), tags[1].header("etag"));
}

#[tokio::test]
async fn unknown_paths_are_404() {
    for path in [
        "/v1/cities/three",
        "/v1/cities/three/0123456789abcdef/blockmaps/0/0/0",
        "/v1/cities/two/0123456789abcdef/blockmaps/1/0/0",
        "/v1/cities/two/0123456789abcdef/blockmaps/20/1048575/0",
        "/v1/cities/two/0123456789abcdef/subtrees/1/1/1",
        "/v1/cities/two/0123456789abcdef/pictures/0/0/0",
        "/v1/cities/two/0123456789abcdef/meshes/0/0/0/0",
        "/v1/cities/two/0123456789abcdef/blockmaps/0/0/0/",
        "/v1/cities/two/0123456789abcdef",
        "/v1/cities/",
        "/v2/cities",
        "/favicon.ico",
    ] {
        get(path).await.assert_problem(404);
    }
    // A client with an old manifest learns that it is one.
    for rest in ["blockmaps/0/0/0", "groups/blockmaps/1/0/0/4/0", "search?q=a", "filter?expr=height"] {
        get(&format!("/v1/cities/two/0123456789abcdee/{rest}")).await.assert_problem(410);
    }
}

#[tokio::test]
async fn hostile_paths_reach_nothing() {
    for path in [
        "/v1/cities/..%2f..%2fetc/passwd",
        "/v1/cities/..%2f..%2f..%2fetc%2fpasswd",
        "/v1/cities/%2fetc%2fpasswd",
        "/v1/cities/../../etc/passwd",
        "/v1/cities/two%00",
        "/v1/cities/two%2f",
        "/v1/cities/..",
        "/v1/cities/two/..%2f..%2f/blockmaps/0/0/0",
        "/v1/cities/two%2f0123456789abcdef%2fblockmaps%2f0%2f0%2f0",
        "/../../etc/passwd",
        "//etc/passwd",
        "/v1/cities/two/city.json",
        "/city.json",
    ] {
        get(path).await.assert_problem(404);
    }
}

#[tokio::test]
async fn invalid_tile_numbers_are_400() {
    let too_long = "9".repeat(400);
    for numbers in [
        "1/2/0",
        "1/0/2",
        "0/0/1",
        "21/0/0",
        "256/0/0",
        "-1/0/0",
        "+1/0/0",
        "01/0/0",
        "1/00/0",
        "a/0/0",
        "0/0/0.0",
        "0/0/0.pbf",
        "1/4294967296/0",
        "1/18446744073709551617/0",
        "0x1/0/0",
        "%31%20/0/0",
        "1/%00/0",
        "1/%ff/0",
        "1/%D9%A1/0",
        &format!("1/{too_long}/0"),
    ] {
        for layer in ["blockmaps", "subtrees"] {
            get(&format!("/v1/cities/two/0123456789abcdef/{layer}/{numbers}")).await.assert_problem(400);
        }
    }
    for numbers in ["1/0/0/x", "1/7/0/0", "1/1/1/6", "1/1/1/00"] {
        get(&format!("/v1/cities/two/0123456789abcdef/meshes/{numbers}")).await.assert_problem(400);
    }
    get("/v1/cities/tw%6f").await.assert_problem(404);
}

#[tokio::test]
async fn meshes_are_served_by_level_of_detail() {
    let folder = small_city::temporary_city_with_meshes();
    let service = HttpService::new(state(folder.path(), |_| {}));
    let mut tags = Vec::new();
    for (lod, bytes) in small_city::meshes() {
        let path = route::mesh("two", small_city::VERSION, small_city::child(), lod);
        let response = get_from(&service, &path).await;
        assert_eq!((response.status, &response.body), (StatusCode::OK, &bytes), "{path}");
        assert_eq!(response.header("cache-control"), IMMUTABLE);
        let etag = response.header("etag").to_owned();
        let again = request_from(&service, Method::GET, &path, &[("if-none-match", &etag)]).await;
        assert_eq!(again.status, StatusCode::NOT_MODIFIED);
        let part = request_from(&service, Method::GET, &path, &[("range", "bytes=4-9")]).await;
        assert_eq!((part.status, &part.body[..]), (StatusCode::PARTIAL_CONTENT, &bytes[4..10]));
        tags.push(etag);
    }
    assert_ne!(tags[0], tags[1]);
    // A leaf without a mesh, a missing LOD, nodes that are no leaves, a leaf's archive id, a path without LOD.
    for numbers in ["1/0/1/0", "1/1/1/2", "0/0/0/0", "2/2/2/0", "20/0/0/3", "1/1/1"] {
        let path = format!("/v1/cities/two/0123456789abcdef/meshes/{numbers}");
        get_from(&service, &path).await.assert_problem(404);
    }
}

#[tokio::test]
async fn groups_have_the_tiles_below_a_node() {
    let folder = small_city::temporary_city_with_meshes();
    let service = HttpService::new(state(folder.path(), |_| {}));
    let path = |numbers: &str| format!("/v1/cities/two/0123456789abcdef/groups/{numbers}");
    let members = |body: &[u8]| {
        let of = |member: GroupMember<std::ops::Range<usize>>| {
            if let GroupMember::Tile(range) = member { Some(body[range].to_vec()) } else { None }
        };
        tile_group::decode(body, 4).unwrap().into_iter().map(of).collect::<Vec<_>>()
    };
    let (id, blockmap) = small_city::blockmaps().remove(1);
    let group = get_from(&service, &path("blockmaps/1/0/0/4/0")).await;
    let place = TileGroup::around(TileKind::BlockMap, id, 2, 0).unwrap().position(id).unwrap();
    let alone = |tile: &[u8]| (0..4).map(|at| (at == place).then(|| tile.to_vec())).collect::<Vec<_>>();
    assert_eq!((group.status, members(&group.body)), (StatusCode::OK, alone(&blockmap)));
    assert_eq!(group.header("cache-control"), IMMUTABLE);
    let mesh = get_from(&service, &path("meshes/1/0/0/4/1")).await;
    assert_eq!(members(&mesh.body), alone(&small_city::meshes().remove(1).1));
    for (numbers, status) in [
        ("blockmaps/1/0/0/2/0", 404),
        ("blockmaps/1/0/0/3/0", 400),
        ("objects/1/0/0/2/0", 400),
        ("blockmaps/1/0/0/2", 404),
    ] {
        get_from(&service, &path(numbers)).await.assert_problem(status);
    }
}

/// Flips a bit in each byte of a tile in `archive`: every request for `path` is a problem, until the byte is restored.
async fn assert_damage_is_found(service: &HttpService, archive: &Path, path: &str, tile: &[u8]) {
    let whole = std::fs::read(archive).unwrap();
    let start = whole.windows(tile.len()).position(|window| window == tile).unwrap() as u64;
    let file = std::fs::OpenOptions::new().write(true).open(archive).unwrap();
    for (offset, byte) in (start..).zip(tile) {
        file.write_all_at(&[byte ^ 0x10], offset).unwrap();
        get_from(service, path).await.assert_problem(500);
        file.write_all_at(&[*byte], offset).unwrap();
    }
    assert_eq!(get_from(service, path).await.body, tile, "after the repair");
    file.set_len(start + 5).unwrap();
    get_from(service, path).await.assert_problem(503);
    std::fs::write(archive, &whole).unwrap();
    assert_eq!(get_from(service, path).await.body, tile, "after the file is complete again");
}

#[tokio::test]
async fn a_tile_that_is_damaged_on_disk_is_never_served() {
    let folder = small_city::temporary_city_with_meshes();
    let service = HttpService::new(state(folder.path(), |config| config.limits.tile_bytes = 0));
    let (id, blockmap) = small_city::blockmaps().remove(1);
    let path = route::tile("two", small_city::VERSION, TileKind::BlockMap, id);
    assert_damage_is_found(&service, &folder.path().join("blockmaps.pmtiles"), &path, &blockmap).await;
    let (lod, mesh) = small_city::meshes().remove(1);
    let path = route::mesh("two", small_city::VERSION, small_city::child(), lod);
    assert_damage_is_found(&service, &folder.path().join("meshes.pmtiles"), &path, &mesh).await;
    let metrics = get_from(&service, "/metrics").await;
    let line = format!("insula_tile_failures_total{{kind=\"damaged\"}} {}", blockmap.len() + mesh.len());
    assert!(metrics.text().contains(&line), "{}", metrics.text());
}

#[tokio::test]
async fn other_methods_are_405() {
    for path in ["/", "/v1/cities", "/v1/cities/two", TILE, "/healthz", "/readyz", "/metrics"] {
        for method in [Method::POST, Method::PUT, Method::DELETE, Method::PATCH] {
            let response = request(method, path, &[]).await;
            response.assert_problem(405);
            assert_eq!(response.header("allow"), "GET,HEAD,OPTIONS", "{path}");
        }
    }
}

#[tokio::test]
async fn if_none_match_gives_304() {
    for path in [TILE, "/v1/cities", "/v1/cities/two", "/"] {
        let whole = get(path).await;
        let etag = whole.header("etag").to_owned();
        for value in [etag.clone(), format!("W/{etag}"), "*".into(), format!("\"x\", {etag}")] {
            for method in [Method::GET, Method::HEAD] {
                let response = request(method, path, &[("if-none-match", &value), ("range", "bytes=0-1")]).await;
                assert_eq!((response.status, response.body.len()), (StatusCode::NOT_MODIFIED, 0), "{path} {value}");
                for name in ["etag", "cache-control", "vary"] {
                    assert_eq!(response.header(name), whole.header(name), "{path} {name}");
                }
            }
        }
        let response = request(Method::GET, path, &[("if-none-match", "\"other\"")]).await;
        assert_eq!((response.status, response.body), (StatusCode::OK, whole.body));
    }
}

#[tokio::test]
async fn ranges_give_206_or_416() {
    let whole = get(TILE).await;
    let (etag, length) = (whole.header("etag").to_owned(), whole.body.len());
    for (range, part) in [("bytes=0-9", 0..10), ("bytes=10-", 10..length), ("bytes=-7", length - 7..length)] {
        let response = request(Method::GET, TILE, &[("range", range)]).await;
        assert_eq!((response.status, &response.body[..]), (StatusCode::PARTIAL_CONTENT, &whole.body[part.clone()]));
        let content_range = format!("bytes {}-{}/{length}", part.start, part.end - 1);
        assert_eq!(response.header("content-range"), content_range);
        assert_eq!(response.header("etag"), etag);
    }
    let outside = request(Method::GET, TILE, &[("range", "bytes=999999-")]).await;
    outside.assert_problem(416);
    assert_eq!(outside.header("content-range"), format!("bytes */{length}"));
    for headers in [
        &[("range", "bytes=0-1,4-5")][..],
        &[("range", "bytes=5-2")],
        &[("range", "bytes=0-1"), ("if-range", "\"other\"")],
    ] {
        let response = request(Method::GET, TILE, headers).await;
        assert_eq!((response.status, &response.body), (StatusCode::OK, &whole.body), "{headers:?}");
    }
    let same = request(Method::GET, TILE, &[("range", "bytes=0-1"), ("if-range", &etag)]).await;
    assert_eq!(same.status, StatusCode::PARTIAL_CONTENT);
    let head = request(Method::HEAD, TILE, &[("range", "bytes=0-1")]).await;
    assert_eq!((head.status, head.header("content-length")), (StatusCode::OK, &*length.to_string()));
}

#[tokio::test]
async fn head_is_get_without_a_body() {
    for path in ["/", "/v1/cities", "/v1/cities/two", TILE, "/healthz", "/v1/cities/three"] {
        let (head, get) = (request(Method::HEAD, path, &[]).await, get(path).await);
        assert_eq!((head.status, head.body.len()), (get.status, 0), "{path}");
        for name in ["etag", "content-length", "content-type", "cache-control", "accept-ranges"] {
            assert_eq!(head.header(name), get.header(name), "{path} {name}");
        }
        assert_eq!(head.header("content-length"), get.body.len().to_string(), "{path}");
    }
}

#[tokio::test]
async fn manifests_are_json_or_bincode() {
    let json = get("/v1/cities/two").await;
    assert_eq!((json.header("content-type"), json.header("cache-control")), ("application/json", "no-cache"));
    let manifest: Manifest = serde_json::from_slice(&json.body).unwrap();
    assert_eq!(manifest, small_city::manifest("two"));
    let bincode = request(Method::GET, "/v1/cities/two", &[("accept", "application/x-bincode")]).await;
    assert_eq!(bincode.header("content-type"), "application/x-bincode");
    assert_eq!(bincode::from_bytes::<Manifest>(&bincode.body).unwrap(), manifest);
    assert_ne!(bincode.header("etag"), json.header("etag"));
    assert_eq!((bincode.header("vary"), json.header("vary")), ("accept, accept-encoding", "accept, accept-encoding"));
}

#[tokio::test]
async fn openapi_document_describes_every_route() {
    let document: serde_json::Value = serde_json::from_slice(&get("/v1/openapi.json").await.body).unwrap();
    let paths = document["paths"].as_object().unwrap();
    let mut described = BTreeSet::new();
    for (path, item) in paths {
        let parameters = item["get"]["parameters"].as_array().or(item["post"]["parameters"].as_array());
        let layer = parameters.and_then(|all| all.iter().find(|parameter| parameter["name"] == "layer"));
        match layer {
            Some(layer) => described.extend(
                layer["schema"]["enum"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|word| path.replace("{layer}", word.as_str().unwrap())),
            ),
            None => described.extend([path.clone()]),
        }
    }
    let routes: BTreeSet<_> =
        RouteTemplate::ALL.into_iter().filter_map(RouteTemplate::pattern).map(str::to_owned).collect();
    assert_eq!(described, routes);
}

#[tokio::test]
async fn city_list_and_page_name_the_sources() {
    let list: serde_json::Value = serde_json::from_slice(&get("/v1/cities").await.body).unwrap();
    assert_eq!(list.as_array().map(Vec::len), Some(1));
    assert_eq!(list[0]["name"], "two");
    assert_eq!(list[0]["manifest"], "/v1/cities/two");
    assert_eq!(list[0]["version"], small_city::VERSION);
    assert_eq!(
        list[0]["bytes"],
        small_city::archive_bytes(small_city::shared_city()),
        "as on the page and in `inspect`"
    );
    assert_eq!(list[0]["attribution"][0]["licence"], "CC BY 4.0");
    let page = request(Method::GET, "/", &[("host", "127.0.0.1:7700")]).await;
    assert_eq!(page.header("content-type"), "text/html; charset=utf-8");
    assert!(page.header("content-security-policy").contains("default-src 'none'"));
    let html = page.text();
    assert!(html.contains("insula view http://127.0.0.1:7700"), "{html}");
    assert!(html.contains("3D BAG") && html.contains("CC BY 4.0"));
    assert!(html.contains("Two &lt;b&gt;nodes") && !html.contains("<b>"), "titles are escaped");
    let page = request(Method::GET, "/", &[("host", "x\"><script>")]).await;
    assert!(!page.text().contains("<script>"));
}

#[tokio::test]
async fn a_long_list_comes_in_pages() {
    let folder = tempfile::tempdir().unwrap();
    let names: Vec<String> = (100..205).map(|number| format!("c{number}")).collect();
    for name in &names {
        small_city::write_city(&folder.path().join(name), name);
    }
    let service = HttpService::new(state(folder.path(), |_| {}));
    let page = async |path: &str| {
        let response = get_from(&service, path).await;
        let next = response.header("link").strip_prefix('<').and_then(|link| link.strip_suffix(">; rel=\"next\""));
        let list: serde_json::Value = serde_json::from_slice(&response.body).unwrap();
        let entries = list.as_array().unwrap();
        let names: Vec<_> = entries.iter().map(|entry| entry["name"].as_str().unwrap().to_owned()).collect();
        (names, next.map(str::to_owned))
    };
    for (first, pages) in [("/v1/cities", 2), ("/v1/cities?limit=40", 3), ("/v1/cities?limit=1000", 1)] {
        let (mut all, mut path, mut count) = (Vec::new(), Some(first.to_owned()), 0);
        while let Some(at) = path {
            let (names, next) = page(&at).await;
            all.extend(names);
            (path, count) = (next, count + 1);
        }
        assert_eq!((all, count), (names.clone(), pages), "{first}");
    }
    assert_eq!(page("/v1/cities?after=c203").await, (vec!["c204".to_owned()], None));
    for invalid in ["limit=0", "limit=1001", "limit=x", "limit", "limit=5&limit=5", "after=", "after=A", "after=../x"] {
        get_from(&service, &format!("/v1/cities?{invalid}")).await.assert_problem(400);
        get_from(&service, &format!("/?{invalid}")).await.assert_problem(400);
    }
    let html = get_from(&service, "/").await;
    assert_eq!(html.text().matches("<summary aria-label").count(), 100, "a card for each city of the page");
    assert!(html.text().contains("/?limit=100&amp;after=c199"), "a link to the next page");
}

#[tokio::test]
async fn responses_for_operators_have_no_cors_headers() {
    for path in ["/metrics", "/healthz", "/readyz"] {
        for method in [Method::GET, Method::OPTIONS, Method::POST] {
            let response = request(method, path, &[("origin", "https://evil.example")]).await;
            assert!(!response.headers.keys().any(|name| name.as_str().starts_with("access-control")), "{path}");
        }
    }
}

#[tokio::test]
async fn the_page_names_scheme_and_host_of_the_request() {
    let page = get("http://cities.example.org:8080/").await;
    assert!(page.text().contains("insula view http://cities.example.org:8080/v1"), "HTTP/2 has no Host header");
    assert_eq!(page.header("referrer-policy"), "no-referrer");
    let service =
        HttpService::new(state(small_city::shared_city(), |config| config.tls.certificate = Some("c".into())));
    let page = request_from(&service, Method::GET, "/", &[("host", "h")]).await;
    assert!(page.text().contains("insula view https://h/v1"));
}

#[tokio::test]
async fn a_flood_of_failures_is_not_a_flood_of_messages() {
    let service = HttpService::new(state(small_city::shared_city(), |config| config.limits.in_flight = 1));
    let held = service.clone().oneshot(Request::get(TILE).body(Body::empty()).unwrap()).await.unwrap();
    let start = Instant::now();
    for _ in 0..200 {
        get_from(&service, TILE).await.assert_problem(503);
    }
    let seconds = 1 + start.elapsed().as_secs();
    drop(held);
    let metrics = get_from(&service, "/metrics").await;
    let suppressed = metrics
        .text()
        .lines()
        .find_map(|line| line.strip_prefix("insula_log_suppressed_total{kind=\"request\"} ")?.parse::<u64>().ok());
    // Ten messages of each second are written.
    assert!(suppressed.unwrap_or(0) >= 200u64.saturating_sub(10 * seconds), "{}", metrics.text());
}

#[tokio::test]
async fn any_origin_may_read() {
    for path in [TILE, "/v1/cities/two", "/v1/cities/three", "/v1/cities/two/0123456789abcdef/blockmaps/9/x/0"] {
        let response = request(Method::GET, path, &[("origin", "https://example.org")]).await;
        assert_eq!(response.header("access-control-allow-origin"), "*", "{path}");
        assert_eq!(response.header("access-control-expose-headers"), "*", "{path}");
    }
    let headers = [
        ("origin", "https://example.org"),
        ("access-control-request-method", "GET"),
        ("access-control-request-headers", "range,if-none-match"),
    ];
    let preflight = request(Method::OPTIONS, TILE, &headers).await;
    assert!(preflight.status.is_success());
    assert!(preflight.header("access-control-allow-headers").contains("range"));
    assert!(preflight.header("access-control-allow-methods").contains("GET"));
}

#[tokio::test]
async fn every_response_has_a_request_id() {
    let first = get(TILE).await.header("x-request-id").to_owned();
    assert!(!first.is_empty() && get(TILE).await.header("x-request-id") != first);
    assert_eq!(request(Method::GET, "/nothing", &[("x-request-id", "mine")]).await.header("x-request-id"), "mine");
    // Ids that could break a log line are replaced.
    for id in ["a b", "", &"x".repeat(65)] {
        assert_ne!(request(Method::GET, TILE, &[("x-request-id", id)]).await.header("x-request-id"), id);
    }
}

#[tokio::test]
async fn too_much_at_once_is_503() {
    let service = HttpService::new(state(small_city::shared_city(), |config| config.limits.in_flight = 1));
    // A response whose body is not read stays in flight.
    let held = service.clone().oneshot(Request::get(TILE).body(Body::empty()).unwrap()).await.unwrap();
    for path in [TILE, "/v1/cities", "/"] {
        let response = request_from(&service, Method::GET, path, &[("origin", "https://example.org")]).await;
        response.assert_problem(503);
        assert_eq!(response.header("retry-after"), "1");
        assert_eq!(response.header("access-control-allow-origin"), "*");
    }
    for path in ["/healthz", "/readyz", "/metrics"] {
        assert_eq!(get_from(&service, path).await.status, StatusCode::OK, "{path}");
    }
    drop(held);
    assert_eq!(get_from(&service, TILE).await.status, StatusCode::OK);
}

#[tokio::test]
async fn readiness_ends_with_draining() {
    let state = state(small_city::shared_city(), |_| {});
    let service = HttpService::new(state.clone());
    assert_eq!(get_from(&service, "/healthz").await.status, StatusCode::OK);
    assert_eq!(get_from(&service, "/readyz").await.status, StatusCode::OK);
    state.start_draining();
    get_from(&service, "/readyz").await.assert_problem(503);
    assert_eq!(get_from(&service, "/healthz").await.status, StatusCode::OK);
    assert_eq!(get_from(&service, TILE).await.status, StatusCode::OK, "requests are still served");
}

#[tokio::test]
async fn without_cities_it_is_not_ready() {
    let empty = HttpService::new(AppState::new(Store::default(), &ServeConfig::default()));
    get_from(&empty, "/readyz").await.assert_problem(503);
    assert_eq!(get_from(&empty, "/v1/cities").await.body, b"[]");
}

#[tokio::test]
async fn metrics_count_requests_and_bytes() {
    let service = HttpService::new(state(small_city::shared_city(), |_| {}));
    let get = |path: &'static str| get_from(&service, path);
    let bytes = get(TILE).await.body.len() + get(TILE).await.body.len();
    get("/v1/cities/two/0123456789abcdef/blockmaps/9/x/0").await;
    get("/v1/cities/two").await;
    get("/nonsense/%7Bevil%7D").await;
    let metrics = get("/metrics").await;
    let text = metrics.text();
    for line in [
        "insula_requests_total{route=\"blockmaps\",code=\"200\"} 2",
        "insula_requests_total{route=\"blockmaps\",code=\"400\"} 1",
        "insula_requests_total{route=\"manifest\",code=\"200\"} 1",
        "insula_requests_total{route=\"other\",code=\"404\"} 1",
        "insula_request_seconds_count{route=\"blockmaps\"} 3",
        "insula_request_seconds_bucket{le=\"+Inf\",route=\"blockmaps\"} 3",
        "insula_requests_in_flight 0",
        "insula_cities 1",
    ] {
        assert!(text.lines().any(|l| l == line), "{line} is not in\n{text}");
    }
    let sent = text.lines().find_map(|l| l.strip_prefix("insula_response_bytes_total{route=\"blockmaps\"} ")).unwrap();
    assert!(sent.parse::<usize>().unwrap() >= bytes, "{text}");
    assert!(!text.contains("evil") && !text.contains(&TileId::ROOT.to_string()), "no path becomes a label");
}

#[tokio::test]
async fn text_is_compressed_as_the_client_accepts() {
    for path in ["/v1/cities", "/v1/cities/two", "/v1/openapi.json"] {
        let plain = get(path).await;
        assert_eq!(plain.header("content-encoding"), "");
        assert!(plain.header("vary").contains("accept-encoding"), "{path}");
        for encoding in ["gzip", "br", "zstd"] {
            let encoded = request(Method::GET, path, &[("accept-encoding", encoding)]).await;
            assert_eq!(encoded.header("content-encoding"), encoding, "{path}");
            assert!(encoded.body.len() < plain.body.len() && encoded.header("etag") != plain.header("etag"));
            let etag = encoded.header("etag").to_owned();
            let same = [("accept-encoding", encoding), ("if-none-match", &etag)];
            assert_eq!(request(Method::GET, path, &same).await.status, StatusCode::NOT_MODIFIED);
            assert_eq!(request(Method::GET, path, &[("if-none-match", &etag)]).await.status, StatusCode::OK);
        }
    }
    assert_eq!(request(Method::GET, TILE, &[("accept-encoding", "gzip")]).await.header("content-encoding"), "");
}

#[tokio::test]
async fn requests_with_a_body_or_too_many_headers_are_refused() {
    for header in [("content-length", "5"), ("transfer-encoding", "chunked"), ("content-length", "0, 5")] {
        request(Method::GET, TILE, &[header]).await.assert_problem(400);
        request(Method::POST, TILE, &[header]).await.assert_problem(400);
    }
    assert_eq!(request(Method::GET, TILE, &[("content-length", "0")]).await.status, StatusCode::OK);
    let names: Vec<String> = (0..65).map(|number| format!("x-{number}")).collect();
    let headers: Vec<_> = names.iter().map(|name| (name.as_str(), "1")).collect();
    request(Method::GET, TILE, &headers).await.assert_problem(431);
    assert_eq!(request(Method::GET, TILE, &headers[..64]).await.status, StatusCode::OK);
}
