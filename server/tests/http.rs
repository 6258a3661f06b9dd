//! Every route, without a port.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use axum::{
    body::Body,
    http::{HeaderMap, Method, Request, StatusCode},
};
use http_body_util::BodyExt;
use insula_protocol::{Manifest, TileId, codec::bincode, route};
use insula_server::{
    config::ServeConfig,
    http::{AppState, HttpService, app},
    store::Store,
};
use std::sync::OnceLock;
use tower::ServiceExt;

const TILE: &str = "/v1/cities/two/0123456789abcdef/blockmaps/1/1/1";

struct TestResponse {
    status: StatusCode,
    headers: HeaderMap,
    body: Vec<u8>,
}

impl TestResponse {
    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    /// Asserts that it is a problem of this status, and one that says so itself.
    fn is_problem(&self, status: u16) {
        assert_eq!(self.status.as_u16(), status, "{}", String::from_utf8_lossy(&self.body));
        assert_eq!(self.header("content-type"), "application/problem+json");
        let problem: serde_json::Value = serde_json::from_slice(&self.body).unwrap();
        assert_eq!(problem["status"], status);
        for key in ["type", "title", "detail"] {
            assert!(problem[key].as_str().is_some_and(|text| !text.is_empty()), "{problem}");
        }
        let text = String::from_utf8_lossy(&self.body);
        assert!(!text.contains("tmp") && !text.contains("etc/"), "{text}");
    }
}

fn config(max_in_flight: usize) -> ServeConfig {
    let mut config = ServeConfig::default();
    config.limits.in_flight = max_in_flight;
    config
}

fn state(max_in_flight: usize) -> AppState {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        common::city(folder.path(), "two");
        folder
    });
    AppState::new(Store::open(&[folder.path()]).unwrap(), &config(max_in_flight))
}

async fn ask_of(app: HttpService, method: Method, path: &str, headers: &[(&str, &str)]) -> TestResponse {
    let mut request = Request::builder().method(method).uri(path);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let response = app.oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
    let (parts, body) = response.into_parts();
    TestResponse {
        status: parts.status,
        headers: parts.headers,
        body: body.collect().await.unwrap().to_bytes().to_vec(),
    }
}

async fn ask(method: Method, path: &str, headers: &[(&str, &str)]) -> TestResponse {
    ask_of(app(state(8)), method, path, headers).await
}

async fn get(path: &str) -> TestResponse {
    ask(Method::GET, path, &[]).await
}

#[tokio::test]
async fn tiles_are_immutable_and_byte_for_byte() {
    for (id, bytes) in common::blockmaps() {
        let path = route::tile("two", common::VERSION, route::Layer::BlockMaps, id);
        let answer = get(&path).await;
        assert_eq!((answer.status, &answer.body), (StatusCode::OK, &bytes), "{path}");
        assert_eq!(answer.header("cache-control"), "public, max-age=31536000, immutable");
        assert_eq!(answer.header("content-type"), "application/octet-stream");
        assert_eq!(answer.header("content-length"), bytes.len().to_string());
        assert_eq!(answer.header("accept-ranges"), "bytes");
        let etag = answer.header("etag");
        assert!(etag.starts_with('"') && etag.ends_with('"') && etag.len() > 10, "{etag}");
        assert_eq!(get(&path).await.header("etag"), etag, "stable");
    }
    assert_eq!(get("/v1/cities/two/0123456789abcdef/subtrees/0/0/0").await.body, common::subtree());
    let tags = [get(TILE).await, get("/v1/cities/two/0123456789abcdef/blockmaps/0/0/0").await];
    assert_ne!(tags[0].header("etag"), tags[1].header("etag"));
}

#[tokio::test]
async fn what_does_not_exist_is_404() {
    for path in [
        "/v1/cities/three",
        "/v1/cities/three/0123456789abcdef/blockmaps/0/0/0",
        "/v1/cities/two/0123456789abcdee/blockmaps/0/0/0",
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
        get(path).await.is_problem(404);
    }
}

#[tokio::test]
async fn what_cannot_be_is_400() {
    let long = "9".repeat(400);
    for place in [
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
        &format!("1/{long}/0"),
    ] {
        for layer in ["blockmaps", "subtrees"] {
            get(&format!("/v1/cities/two/0123456789abcdef/{layer}/{place}")).await.is_problem(400);
        }
    }
    get("/v1/cities/two/0123456789abcdef/meshes/1/0/0/x").await.is_problem(400);
    get("/v1/cities/two/0123456789abcdef/meshes/1/7/0/0").await.is_problem(400);
    get("/v1/cities/two/0123456789abcdef/meshes/1/1/1/4").await.is_problem(400);
    get("/v1/cities/two/0123456789abcdef/meshes/1/1/1/00").await.is_problem(400);
    get("/v1/cities/%ff").await.is_problem(400);
}

#[tokio::test]
async fn meshes_are_served_by_level_of_detail_where_there_are_any() {
    let folder = tempfile::tempdir().unwrap();
    common::city_with_meshes(folder.path(), "two");
    let app = insula_server::http::app(AppState::new(Store::open(&[folder.path()]).unwrap(), &config(8)));
    let get = async |path: &str| ask_of(app.clone(), Method::GET, path, &[]).await;
    let mut tags = Vec::new();
    for (lod, bytes) in common::meshes() {
        let path = route::mesh("two", common::VERSION, common::child(), lod);
        let answer = get(&path).await;
        assert_eq!((answer.status, &answer.body), (StatusCode::OK, &bytes), "{path}");
        assert_eq!(answer.header("cache-control"), "public, max-age=31536000, immutable");
        tags.push(answer.header("etag").to_owned());
        let again = ask_of(app.clone(), Method::GET, &path, &[("if-none-match", &tags[usize::from(lod)])]).await;
        assert_eq!(again.status, StatusCode::NOT_MODIFIED);
        let part = ask_of(app.clone(), Method::GET, &path, &[("range", "bytes=4-9")]).await;
        assert_eq!((part.status, &part.body[..]), (StatusCode::PARTIAL_CONTENT, &bytes[4..10]));
    }
    assert_ne!(tags[0], tags[1]);
    // Of a leaf without a mesh, a level that it has not, a node that is no leaf, and what would be its place as a leaf's.
    for place in ["1/0/1/0", "1/1/1/2", "0/0/0/0", "2/2/2/0", "20/0/0/3"] {
        get(&format!("/v1/cities/two/0123456789abcdef/meshes/{place}")).await.is_problem(404);
    }
    get("/v1/cities/two/0123456789abcdef/meshes/1/1/1").await.is_problem(404);
}

#[tokio::test]
async fn a_mesh_that_is_damaged_on_disk_is_never_served() {
    use std::os::unix::fs::FileExt;
    let folder = tempfile::tempdir().unwrap();
    common::city_with_meshes(folder.path(), "two");
    let mut config = config(8);
    config.limits.tile_bytes = 0;
    let app = insula_server::http::app(AppState::new(Store::open(&[folder.path()]).unwrap(), &config));
    let path = folder.path().join("meshes.pmtiles");
    let (whole, (lod, bytes)) = (std::fs::read(&path).unwrap(), common::meshes().remove(1));
    let at = whole.windows(bytes.len()).position(|window| window == bytes).unwrap() as u64;
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    let address = route::mesh("two", common::VERSION, common::child(), lod);
    for offset in 0..bytes.len() {
        file.write_all_at(&[bytes[offset] ^ 0x10], at + offset as u64).unwrap();
        ask_of(app.clone(), Method::GET, &address, &[]).await.is_problem(500);
        file.write_all_at(&[bytes[offset]], at + offset as u64).unwrap();
    }
    assert_eq!(ask_of(app, Method::GET, &address, &[]).await.body, bytes, "mended, it is served again");
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
        get(path).await.is_problem(404);
    }
}

#[tokio::test]
async fn other_methods_are_405() {
    for path in ["/", "/v1/cities", "/v1/cities/two", TILE, "/healthz", "/readyz", "/metrics"] {
        for method in [Method::POST, Method::PUT, Method::DELETE, Method::PATCH] {
            let answer = ask(method, path, &[]).await;
            answer.is_problem(405);
            assert_eq!(answer.header("allow"), "GET,HEAD,OPTIONS", "{path}");
        }
    }
}

#[tokio::test]
async fn conditional_requests() {
    for path in [TILE, "/v1/cities", "/v1/cities/two", "/"] {
        let whole = get(path).await;
        let etag = whole.header("etag").to_owned();
        for value in [etag.clone(), format!("W/{etag}"), "*".into(), format!("\"x\", {etag}")] {
            for method in [Method::GET, Method::HEAD] {
                let answer = ask(method, path, &[("if-none-match", &value), ("range", "bytes=0-1")]).await;
                assert_eq!((answer.status, answer.body.len()), (StatusCode::NOT_MODIFIED, 0), "{path} {value}");
                assert_eq!(answer.header("etag"), etag);
                assert_eq!(answer.header("cache-control"), whole.header("cache-control"));
                assert_eq!(answer.header("vary"), whole.header("vary"));
            }
        }
        let answer = ask(Method::GET, path, &[("if-none-match", "\"other\"")]).await;
        assert_eq!((answer.status, answer.body), (StatusCode::OK, whole.body));
    }
}

#[tokio::test]
async fn ranges() {
    let whole = get(TILE).await;
    let (etag, length) = (whole.header("etag").to_owned(), whole.body.len());
    for (range, part) in [("bytes=0-9", 0..10), ("bytes=10-", 10..length), ("bytes=-7", length - 7..length)] {
        let answer = ask(Method::GET, TILE, &[("range", range)]).await;
        assert_eq!((answer.status, &answer.body[..]), (StatusCode::PARTIAL_CONTENT, &whole.body[part.clone()]));
        let content_range = format!("bytes {}-{}/{length}", part.start, part.end - 1);
        assert_eq!(answer.header("content-range"), content_range);
        assert_eq!(answer.header("etag"), etag);
    }
    let outside = ask(Method::GET, TILE, &[("range", "bytes=999999-")]).await;
    outside.is_problem(416);
    assert_eq!(outside.header("content-range"), format!("bytes */{length}"));
    for headers in [
        &[("range", "bytes=0-1,4-5")][..],
        &[("range", "bytes=5-2")],
        &[("range", "bytes=0-1"), ("if-range", "\"other\"")],
    ] {
        let answer = ask(Method::GET, TILE, headers).await;
        assert_eq!((answer.status, &answer.body), (StatusCode::OK, &whole.body), "{headers:?}");
    }
    let same = ask(Method::GET, TILE, &[("range", "bytes=0-1"), ("if-range", &etag)]).await;
    assert_eq!(same.status, StatusCode::PARTIAL_CONTENT);
    let head = ask(Method::HEAD, TILE, &[("range", "bytes=0-1")]).await;
    assert_eq!((head.status, head.header("content-length")), (StatusCode::OK, &*length.to_string()));
}

#[tokio::test]
async fn head_is_get_without_a_body() {
    for path in ["/", "/v1/cities", "/v1/cities/two", TILE, "/healthz", "/v1/cities/three"] {
        let (head, get) = (ask(Method::HEAD, path, &[]).await, get(path).await);
        assert_eq!((head.status, head.body.len()), (get.status, 0), "{path}");
        for name in ["etag", "content-length", "content-type", "cache-control", "accept-ranges"] {
            assert_eq!(head.header(name), get.header(name), "{path} {name}");
        }
        assert_eq!(head.header("content-length"), get.body.len().to_string(), "{path}");
    }
}

#[tokio::test]
async fn manifests_in_json_and_bincode() {
    let json = get("/v1/cities/two").await;
    assert_eq!((json.header("content-type"), json.header("cache-control")), ("application/json", "no-cache"));
    let read: Manifest = serde_json::from_slice(&json.body).unwrap();
    assert_eq!(read, common::manifest("two"));
    let packed = ask(Method::GET, "/v1/cities/two", &[("accept", "application/x-bincode")]).await;
    assert_eq!(packed.header("content-type"), "application/x-bincode");
    assert_eq!(bincode::from_bytes::<Manifest>(&packed.body).unwrap(), read);
    assert_ne!(packed.header("etag"), json.header("etag"));
    assert_eq!((packed.header("vary"), json.header("vary")), ("accept, accept-encoding", "accept, accept-encoding"));
}

#[tokio::test]
async fn the_list_and_the_page_name_the_sources() {
    let list = get("/v1/cities").await;
    let list: serde_json::Value = serde_json::from_slice(&list.body).unwrap();
    assert_eq!(list.as_array().map(Vec::len), Some(1));
    assert_eq!(list[0]["name"], "two");
    assert_eq!(list[0]["manifest"], "/v1/cities/two");
    assert_eq!(list[0]["version"], common::VERSION);
    assert_eq!(list[0]["attribution"][0]["licence"], "CC BY 4.0");
    let page = ask(Method::GET, "/", &[("host", "127.0.0.1:7700")]).await;
    assert_eq!(page.header("content-type"), "text/html; charset=utf-8");
    assert!(page.header("content-security-policy").contains("default-src 'none'"));
    let html = String::from_utf8(page.body).unwrap();
    assert!(html.contains("insula view http://127.0.0.1:7700"), "{html}");
    assert!(html.contains("3D BAG") && html.contains("CC BY 4.0"));
    assert!(html.contains("Two &lt;b&gt;nodes") && !html.contains("<b>"), "titles are text");
    let page = ask(Method::GET, "/", &[("host", "x\"><script>")]).await;
    assert!(!String::from_utf8(page.body).unwrap().contains("<script>"));
}

#[tokio::test]
async fn any_origin_may_read() {
    for path in [TILE, "/v1/cities/two", "/v1/cities/three", "/v1/cities/two/0123456789abcdef/blockmaps/9/x/0"] {
        let answer = ask(Method::GET, path, &[("origin", "https://example.org")]).await;
        assert_eq!(answer.header("access-control-allow-origin"), "*", "{path}");
        let exposed = answer.header("access-control-expose-headers");
        assert_eq!(exposed, "*");
    }
    let headers = [
        ("origin", "https://example.org"),
        ("access-control-request-method", "GET"),
        ("access-control-request-headers", "range,if-none-match"),
    ];
    let preflight = ask(Method::OPTIONS, TILE, &headers).await;
    assert!(preflight.status.is_success());
    assert!(preflight.header("access-control-allow-headers").contains("range"));
    assert!(preflight.header("access-control-allow-methods").contains("GET"));
}

#[tokio::test]
async fn every_answer_has_a_request_id() {
    let first = get(TILE).await.header("x-request-id").to_owned();
    assert!(!first.is_empty() && get(TILE).await.header("x-request-id") != first);
    assert_eq!(ask(Method::GET, "/nothing", &[("x-request-id", "mine")]).await.header("x-request-id"), "mine");
}

#[tokio::test]
async fn too_much_at_once_is_503() {
    let app = app(state(1));
    // An answer whose body nobody reads is still in flight.
    let request = Request::get(TILE).body(Body::empty()).unwrap();
    let held = app.clone().oneshot(request).await.unwrap();
    for path in [TILE, "/v1/cities", "/"] {
        let answer = ask_of(app.clone(), Method::GET, path, &[("origin", "https://example.org")]).await;
        answer.is_problem(503);
        assert_eq!(answer.header("retry-after"), "1");
        assert_eq!(answer.header("access-control-allow-origin"), "*");
    }
    for path in ["/healthz", "/readyz", "/metrics"] {
        assert_eq!(ask_of(app.clone(), Method::GET, path, &[]).await.status, StatusCode::OK, "{path}");
    }
    drop(held);
    assert_eq!(ask_of(app, Method::GET, TILE, &[]).await.status, StatusCode::OK);
}

#[tokio::test]
async fn health() {
    assert_eq!(get("/healthz").await.status, StatusCode::OK);
    let state = state(8);
    assert_eq!(ask_of(app(state.clone()), Method::GET, "/readyz", &[]).await.status, StatusCode::OK);
    state.drain();
    ask_of(app(state.clone()), Method::GET, "/readyz", &[]).await.is_problem(503);
    assert_eq!(ask_of(app(state.clone()), Method::GET, "/healthz", &[]).await.status, StatusCode::OK);
    assert_eq!(ask_of(app(state), Method::GET, TILE, &[]).await.status, StatusCode::OK, "what is in flight goes on");
    let empty = AppState::new(Store::default(), &config(8));
    ask_of(app(empty.clone()), Method::GET, "/readyz", &[]).await.is_problem(503);
    assert_eq!(ask_of(app(empty), Method::GET, "/v1/cities", &[]).await.body, b"[]");
}

#[tokio::test]
async fn metrics_count_what_happened() {
    let app = app(state(8));
    let ask = |path: &'static str| ask_of(app.clone(), Method::GET, path, &[]);
    let bytes = ask(TILE).await.body.len() + ask(TILE).await.body.len();
    ask("/v1/cities/two/0123456789abcdef/blockmaps/9/x/0").await;
    ask("/v1/cities/two").await;
    ask("/nonsense/%7Bevil%7D").await;
    let text = String::from_utf8(ask("/metrics").await.body).unwrap();
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
    assert!(!text.contains("evil"));
    let id = TileId::ROOT;
    assert!(text.lines().all(|l| !l.contains(&id.to_string())), "no address becomes a label");
}

#[tokio::test]
async fn text_is_packed_as_the_client_likes() {
    for path in ["/v1/cities", "/v1/cities/two", "/v1/openapi.json"] {
        let plain = get(path).await;
        assert_eq!(plain.header("content-encoding"), "");
        assert!(plain.header("vary").contains("accept-encoding"), "{path}");
        for encoding in ["gzip", "br", "zstd"] {
            let packed = ask(Method::GET, path, &[("accept-encoding", encoding)]).await;
            assert_eq!(packed.header("content-encoding"), encoding, "{path}");
            assert!(packed.body.len() < plain.body.len() && packed.header("etag") != plain.header("etag"));
            let etag = packed.header("etag").to_owned();
            let same = [("accept-encoding", encoding), ("if-none-match", &etag)];
            assert_eq!(ask(Method::GET, path, &same).await.status, StatusCode::NOT_MODIFIED);
            assert_eq!(ask(Method::GET, path, &[("if-none-match", &etag)]).await.status, StatusCode::OK);
        }
    }
    assert_eq!(ask(Method::GET, TILE, &[("accept-encoding", "gzip")]).await.header("content-encoding"), "");
}

#[tokio::test]
async fn requests_with_a_body_or_too_many_headers_are_refused() {
    for header in [("content-length", "5"), ("transfer-encoding", "chunked"), ("content-length", "0, 5")] {
        ask(Method::GET, TILE, &[header]).await.is_problem(400);
        ask(Method::POST, TILE, &[header]).await.is_problem(400);
    }
    assert_eq!(ask(Method::GET, TILE, &[("content-length", "0")]).await.status, StatusCode::OK);
    let names: Vec<String> = (0..65).map(|number| format!("x-{number}")).collect();
    let many: Vec<_> = names.iter().map(|name| (name.as_str(), "1")).collect();
    ask(Method::GET, TILE, &many).await.is_problem(431);
    assert_eq!(ask(Method::GET, TILE, &many[..64]).await.status, StatusCode::OK);
}

#[tokio::test]
async fn request_ids_that_could_break_a_log_are_not_taken_over() {
    for id in ["a b", "", &"x".repeat(65)] {
        assert_ne!(ask(Method::GET, TILE, &[("x-request-id", id)]).await.header("x-request-id"), id);
    }
}

#[tokio::test]
async fn a_tile_that_is_damaged_on_disk_is_never_served() {
    use std::{io::Write, os::unix::fs::FileExt};
    let folder = tempfile::tempdir().unwrap();
    common::city(folder.path(), "two");
    let mut config = config(8);
    config.limits.tile_bytes = 0;
    let app = insula_server::http::app(AppState::new(Store::open(&[folder.path()]).unwrap(), &config));
    let path = folder.path().join("blockmaps.pmtiles");
    let whole = std::fs::read(&path).unwrap();
    let [root, child] = common::blockmaps().try_into().unwrap();
    let at = whole.windows(child.1.len()).position(|window| window == child.1).unwrap() as u64;
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    let address = |id| route::tile("two", common::VERSION, route::Layer::BlockMaps, id);
    let get = async |id| ask_of(app.clone(), Method::GET, &address(id), &[]).await;
    for offset in 0..child.1.len() as u64 {
        let byte = child.1[offset as usize];
        file.write_all_at(&[byte ^ 0x10], at + offset).unwrap();
        get(child.0).await.is_problem(500);
        file.write_all_at(&[byte], at + offset).unwrap();
    }
    assert_eq!(get(child.0).await.body, child.1, "mended, it is served again");
    assert_eq!(get(root.0).await.body, root.1);
    file.set_len(at + 5).unwrap();
    get(child.0).await.is_problem(503);
    let metrics = ask_of(app.clone(), Method::GET, "/metrics", &[]).await.body;
    let line = format!("insula_tile_failures_total{{kind=\"damaged\"}} {}", child.1.len());
    assert!(String::from_utf8(metrics).unwrap().contains(&line));
    drop(file);
    std::fs::File::create(&path).unwrap().write_all(&whole).unwrap();
    assert_eq!(get(child.0).await.body, child.1);
}
