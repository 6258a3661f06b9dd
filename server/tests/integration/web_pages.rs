//! The pages with the browser viewer, the viewer's files, and published sites. The viewer here is made up: building the real one
//! needs another compiler.

use crate::test_server::{TestServer, assert_problem, replace_city};
use axum::body::Body;
use axum::http::{HeaderMap, Request, StatusCode};
use http_body_util::BodyExt;
use insula_protocol::Manifest;
use insula_protocol::manifest::Attribution;
use insula_protocol::release::Release;
use insula_server::args::PublishArgs;
use insula_server::commands::publish_site;
use insula_server::config::ServeConfig;
use insula_server::http::{AppState, HttpService};
use insula_server::page::{ViewerAssets, ViewerFile};
use insula_server::store::Store;
use insula_test_support::folder::tree;
use insula_test_support::small_city;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use tower::ServiceExt;

const HASH: &str = "00112233445566ff";
const APP: &str = "/assets/00112233445566ff/app.js";
const IMMUTABLE: &str = "public, max-age=31536000, immutable";
const JPEG: &[u8] = b"\xff\xd8\xff and so on";
const HOSTILE: &str = "</script><script>alert('x')</script><img src=x onerror=\"alert(1)\">&";

/// A language: the English one with other words.
fn german() -> String {
    let english = concat!(env!("CARGO_MANIFEST_DIR"), "/../client/web/page/language-en.json");
    let english = fs::read_to_string(english).unwrap();
    english.replace("\"en-GB\"", "\"de\"").replace("\"cities\": \"Cities\"", "\"cities\": \"Orte\"")
}

/// A viewer of a few files.
pub(crate) fn viewer() -> ViewerAssets {
    let file = |name: &str, text: &str| {
        let [plain, brotli, gzip] = [text.to_owned(), format!("br {name}"), format!("gz {name}")].map(Into::into);
        (name.to_owned(), ViewerFile { plain, brotli, gzip })
    };
    let long = "// a comment that makes the file longer than its compressed forms\n".repeat(3);
    let script = |imports: &str| format!("{imports}\n{long}");
    ViewerAssets::new(
        HASH,
        [
            file("app.js", &script("import './insula-city.js';\nconst { start } = await import('./panel.js');")),
            file("insula-city.js", &script("import { a } from './network.js';")),
            file("network.js", &script("")),
            file("panel.js", &script("")),
            file("engine.js", &script("import init from './insula_web.js';")),
            file("insula_web.js", &script("")),
            file("insula_web_bg.wasm", &script("")),
            file("shaders.txt", &script("")),
            file("style.css", &script("")),
            file("icon.svg", "<svg/>"),
            file("manifest.webmanifest", &script("")),
            file("service-worker.js", &script("")),
            file("language-de.json", &german()),
            file("../escape.js", ""),
        ],
    )
}

pub(crate) struct Page {
    pub(crate) status: StatusCode,
    headers: HeaderMap,
    pub(crate) text: String,
}

impl Page {
    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }
}

pub(crate) fn service(folder: &Path, viewer: Option<ViewerAssets>) -> HttpService {
    let store = Store::open(&[folder]).unwrap();
    HttpService::new(AppState::with_viewer(store, &ServeConfig::default(), viewer))
}

pub(crate) async fn get(service: &HttpService, path: &str, headers: &[(&str, &str)]) -> Page {
    let mut request = Request::get(path).header("host", "cities.example.org");
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let response = service.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
    let (parts, body) = response.into_parts();
    let body = body.collect().await.unwrap().to_bytes();
    Page { status: parts.status, headers: parts.headers, text: String::from_utf8_lossy(&body).into_owned() }
}

/// Writes a city of which every text is hostile.
fn write_hostile_city(folder: &Path) {
    small_city::write_city(folder, "two");
    let mut manifest = small_city::manifest("two");
    manifest.title = HOSTILE.into();
    manifest.crs = Some(HOSTILE.into());
    let url = Some("javascript:alert(1)".to_owned());
    manifest.attribution = vec![Attribution { text: HOSTILE.into(), licence: Some(HOSTILE.into()), url }];
    fs::write(folder.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
}

/// Asserts that the elements with scripts and images are those of the page, and that the manifest in it can be read.
fn assert_no_markup_of_cities(html: &str) {
    let (text, rest) = html.split_once("id=\"insula-manifest\">").unwrap_or((html, ""));
    for markup in ["<script>", "<img src=x", "onerror=\"", "alert('x')", "href=\"javascript:"] {
        assert!(!text.contains(markup), "{markup} in {text}");
    }
    if let Some((json, end)) = rest.split_once("</script>") {
        assert_eq!(end, "</body></html>\n", "the manifest ends its element");
        let manifest: serde_json::Value = serde_json::from_str(json).unwrap();
        assert_eq!(manifest["title"], HOSTILE);
    }
}

#[tokio::test]
async fn the_page_of_a_city_names_the_viewer_and_the_city() {
    let folder = small_city::temporary_city();
    let service = service(folder.path(), Some(viewer()));
    // Addresses are relative, so that a proxy may have the server below any path.
    for (path, root) in [("/", ""), ("/cities/two", "../")] {
        let page = get(&service, path, &[]).await;
        assert_eq!((page.status, page.header("content-type")), (StatusCode::OK, "text/html; charset=utf-8"), "{path}");
        assert_eq!((page.header("cache-control"), page.header("referrer-policy")), ("no-cache", "no-referrer"));
        assert_eq!(page.header("x-content-type-options"), "nosniff");
        for part in [
            "<insula-city src=\"ROOTv1/cities/two\" full></insula-city>",
            "<script type=\"module\" src=\"ROOTassets/00112233445566ff/app.js\"></script>",
            "<link rel=\"preload\" as=\"fetch\" crossorigin href=\"ROOTassets/00112233445566ff/insula_web_bg.wasm\">",
            "<link rel=\"modulepreload\" href=\"ROOTassets/00112233445566ff/insula_web.js\">",
            "<meta name=\"insula-service-worker\" content=\"ROOTservice-worker.js\">",
            "<meta name=\"insula-languages\" content=\"de\">",
            "<link rel=\"canonical\" href=\"http://cities.example.org/cities/two\">",
            "<meta property=\"og:title\" content=\"Two &lt;b&gt;nodes&lt;/b&gt;\">",
            "insula view http://cities.example.org/v1/cities/two",
            "3D BAG</a> (CC BY 4.0)",
        ] {
            let part = part.replace("ROOT", root);
            assert!(page.text.contains(&part), "{path} lacks {part}: {}", page.text);
        }
        assert!(!page.text.contains("style=\"") && !page.text.contains("og:image"), "{}", page.text);
        assert!(!page.text.contains("=\"/"), "an address from the host's root: {}", page.text);
    }
}

#[tokio::test]
async fn the_policy_of_pages_allows_only_this_host() {
    let folder = small_city::temporary_city();
    let service = service(folder.path(), Some(viewer()));
    let policy = get(&service, "/cities/two", &[]).await.header("content-security-policy").to_owned();
    for rule in [
        "default-src 'none'", "script-src 'self' 'wasm-unsafe-eval'", "style-src 'self'", "img-src 'self' blob: data:",
        "connect-src 'self'", "worker-src 'self'", "base-uri 'none'", "form-action 'none'", "frame-ancestors *",
        "require-trusted-types-for 'script'", "trusted-types insula",
    ] {
        assert!(policy.split("; ").any(|found| found == rule), "{rule} in {policy}");
    }
    assert!(!policy.contains("unsafe-inline"));
}

#[tokio::test]
async fn names_of_cities_never_become_markup() {
    let folder = tempfile::tempdir().unwrap();
    write_hostile_city(&folder.path().join("two"));
    small_city::write_city(&folder.path().join("three"), "three");
    for viewer in [Some(viewer()), None] {
        let service = service(folder.path(), viewer);
        for path in ["/", "/cities/two"] {
            assert_no_markup_of_cities(&get(&service, path, &[]).await.text);
        }
        let page = get(&service, "/cities/two", &[("host", "\"><script>")]).await;
        assert_no_markup_of_cities(&page.text);
    }
}

#[tokio::test]
async fn several_cities_are_a_list_with_links_to_their_pages() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["two", "three"] {
        small_city::write_city(&folder.path().join(name), name);
    }
    let service = service(folder.path(), Some(viewer()));
    let page = get(&service, "/", &[]).await;
    assert!(page.text.contains("<h2><a href=\"cities/two\">") && page.text.contains("<h2><a href=\"cities/three\">"));
    assert!(!page.text.contains("<insula-city") && !page.text.contains("just dist"));
    let policy = page.header("content-security-policy");
    assert!(policy.contains("style-src 'sha256-") && !policy.contains("script-src"), "{policy}");
    assert!(get(&service, "/cities/three", &[]).await.text.contains("<a rel=\"up\" href=\"../\">All cities</a>"));
    // A city that stands alone on a later page of the list is none.
    assert!(!get(&service, "/?after=three", &[]).await.text.contains("<insula-city"));
}

#[tokio::test]
async fn without_the_viewer_the_page_says_how_to_build_it() {
    let folder = small_city::temporary_city();
    let service = service(folder.path(), None);
    for path in ["/", "/cities/two"] {
        let page = get(&service, path, &[]).await;
        assert_eq!(page.status, StatusCode::OK);
        assert!(page.text.contains("just dist") && page.text.contains("insula view http://"), "{}", page.text);
        assert!(!page.text.contains("<script") && !page.text.contains("/assets/"));
    }
    for path in [APP, "/service-worker.js"] {
        assert_eq!(get(&service, path, &[]).await.status, StatusCode::NOT_FOUND, "{path}");
    }
}

#[tokio::test]
async fn files_of_the_viewer_are_immutable_and_compressed() {
    let folder = small_city::temporary_city();
    let service = service(folder.path(), Some(viewer()));
    let mut tags = BTreeSet::new();
    for (accept, coding) in
        [("", ""), ("gzip", "gzip"), ("gzip, deflate, br, zstd", "br"), ("zstd", ""), ("br;q=0", "")]
    {
        let file = get(&service, APP, &[("accept-encoding", accept)]).await;
        assert_eq!((file.status, file.header("content-encoding")), (StatusCode::OK, coding), "{accept}");
        assert_eq!((file.header("cache-control"), file.header("vary")), (IMMUTABLE, "accept-encoding"));
        assert_eq!(file.header("content-type"), "text/javascript; charset=utf-8");
        assert_eq!(file.header("x-content-type-options"), "nosniff");
        assert_eq!(file.header("access-control-allow-origin"), "*", "other sites embed the viewer");
        assert_eq!(file.text.starts_with("import"), coding.is_empty());
        let etag = file.header("etag").to_owned();
        let again = get(&service, APP, &[("accept-encoding", accept), ("if-none-match", &etag)]).await;
        assert_eq!((again.status, again.text.as_str()), (StatusCode::NOT_MODIFIED, ""));
        tags.insert(etag);
    }
    assert_eq!(tags.len(), 3, "each coding has its own ETag");
    let wasm = get(&service, "/assets/00112233445566ff/insula_web_bg.wasm", &[]).await;
    assert_eq!(wasm.header("content-type"), "application/wasm");
    let shaders = get(&service, "/assets/00112233445566ff/shaders.txt", &[]).await;
    assert_eq!(shaders.header("content-type"), "text/plain; charset=utf-8");
    let small = get(&service, "/assets/00112233445566ff/icon.svg", &[("accept-encoding", "br")]).await;
    assert_eq!((small.header("content-encoding"), small.text.as_str()), ("", "<svg/>"), "compression would enlarge it");
    let worker = get(&service, "/service-worker.js", &[]).await;
    assert_eq!((worker.status, worker.header("cache-control")), (StatusCode::OK, "no-cache"));
    assert!(worker.header("content-security-policy").contains("connect-src 'self'"));
}

#[tokio::test]
async fn other_paths_are_404() {
    let folder = small_city::temporary_city();
    let service = service(folder.path(), Some(viewer()));
    for path in [
        "/assets/0000000000000000/app.js",
        "/assets/00112233445566ff/none.js",
        "/assets/00112233445566ff/app.js/",
        "/assets/00112233445566ff/..%2f..%2fetc%2fpasswd",
        "/assets/00112233445566ff/../escape.js",
        "/assets/00112233445566ff/",
        "/assets/app.js",
        "/cities",
        "/cities/",
        "/cities/three",
        "/cities/Two",
        "/cities/%ff",
        "/cities/..%2f..%2fetc%2fpasswd",
        "/cities/two/",
        "/cities/two/city.json",
        "/cities/two/thumbnail.jpg",
        "/cities/three/thumbnail.jpg",
    ] {
        let page = get(&service, path, &[]).await;
        assert_eq!(
            (page.status, page.header("content-type")),
            (StatusCode::NOT_FOUND, "application/problem+json"),
            "{path}"
        );
    }
}

#[tokio::test]
async fn the_picture_of_a_city_is_served_and_shown() {
    let folder = small_city::temporary_city();
    fs::write(folder.path().join("thumbnail.jpg"), JPEG).unwrap();
    let service = service(folder.path(), Some(viewer()));
    let picture = get(&service, "/cities/two/thumbnail.jpg", &[]).await;
    assert_eq!((picture.status, picture.header("content-type")), (StatusCode::OK, "image/jpeg"));
    assert_eq!(picture.header("cache-control"), "no-cache");
    let page = get(&service, "/cities/two", &[]).await;
    let preview = "<meta property=\"og:image\" content=\"http://cities.example.org/cities/two/thumbnail.jpg\">";
    assert!(page.text.contains(preview) && page.text.contains("<img src=\"../cities/two/thumbnail.jpg\""));
    // Only pictures leave the server.
    fs::write(folder.path().join("thumbnail.jpg"), "secrets").unwrap();
    assert_eq!(get(&service, "/cities/two/thumbnail.jpg", &[]).await.status, StatusCode::NOT_FOUND);
}

#[cfg(unix)]
#[tokio::test]
async fn pages_of_private_cities_are_hidden() {
    let folder = tempfile::tempdir().unwrap();
    let [tokens, keys] = ["tokens", "keys"].map(|name| folder.path().join(name));
    fs::write(&tokens, "0123456789abcdef-office\n").unwrap();
    fs::write(&keys, "key 0123456789abcdef0123456789abcdef\n").unwrap();
    let server = TestServer::start(|config| {
        config.access.tokens = Some(tokens.clone());
        config.access.share_keys = Some(keys.clone());
    })
    .await;
    replace_city(&server.folder.path().join("two"), |next| {
        small_city::write_city(next, "two");
        fs::write(next.join("thumbnail.jpg"), JPEG).unwrap();
    });
    server.reload().await;
    let token = "Authorization: Bearer 0123456789abcdef-office\r\n";
    for path in
        ["/cities/two", "/cities/three", "/cities/two/thumbnail.jpg", "/cities/three/thumbnail.jpg", "/cities/T"]
    {
        let response = server.get(path, "").await;
        assert_problem(&response, 401);
        assert!(!response.contains("Two"), "{response}");
    }
    assert!(!server.get("/", "").await.contains("Two"));
    let page = server.get("/cities/two", token).await;
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("cache-control: private, no-cache"), "{page}");
    assert_problem(&server.get("/cities/three", token).await, 404);
    for (arguments, picture) in [(&[][..], "200"), (&["--read-only"], "200"), (&["--bbox-metres", "0,0,1,1"], "404")] {
        let query = share_query(&keys, arguments);
        let page = server.get(&format!("/cities/two?{query}"), "").await;
        assert!(page.starts_with("HTTP/1.1 200") && page.contains(&format!("/v1/cities/two?{query}")), "{page}");
        assert!(!page.contains("canonical"), "a share link is a secret: {page}");
        let response = server.get(&format!("/cities/two/thumbnail.jpg?{query}"), "").await;
        assert_eq!(&response[9..12], picture, "{arguments:?}");
        assert_problem(&server.get(&format!("/cities/three?{query}"), "").await, 401);
    }
    server.stop().await;
}

/// The query of a share link to the city "two".
pub(crate) fn share_query(keys: &Path, arguments: &[&str]) -> String {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_insula-server"));
    command.args(["sign", "--keys", keys.to_str().unwrap(), "--city", "two", "--expires", "1h"]).args(arguments);
    let link = String::from_utf8(command.output().unwrap().stdout).unwrap();
    link.trim_end().split_once('?').unwrap().1.to_owned()
}

fn publish(cities: &[&Path], out: &Path) -> Result<(), String> {
    let cities = cities.iter().map(|city| city.to_path_buf()).collect();
    let url = Some("https://cities.example.org/".to_owned());
    let title = Some("Our <cities>".into());
    let args = PublishArgs { cities, out: out.to_owned(), title, url, ..PublishArgs::default() };
    publish_site(&args, &viewer()).map_err(|error| error.to_string())
}

fn files_below(folder: &Path) -> BTreeSet<String> {
    let paths = tree(folder).into_keys().filter(|path| path.is_file());
    paths.map(|path| path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned()).collect()
}

/// Asserts that every address in a page of a site is relative and leads to a file, or to a folder with a page.
fn assert_links_resolve(site: &Path, page: &str) {
    let path = site.join(page);
    let html = fs::read_to_string(&path).unwrap();
    let html = html.split("id=\"insula-manifest\"").next().unwrap();
    assert!(
        html.contains("<meta http-equiv=\"Content-Security-Policy\" content=\"default-src &#39;none&#39;;"),
        "{html}"
    );
    assert!(!html.contains("frame-ancestors"), "a rule that only a header can have");
    let mut count = 0;
    for attribute in ["href=\"", "src=\"", "service-worker\" content=\""] {
        for target in html.split(attribute).skip(1).map(|rest| rest.split('"').next().unwrap()) {
            if target.starts_with("https://example.org") || target.starts_with("https://cities.example.org/") {
                continue;
            }
            assert!(!target.starts_with('/') && !target.contains("://"), "{page}: {target}");
            let found = path.parent().unwrap().join(target);
            assert!(found.is_file() || found.join("index.html").is_file(), "{page}: {target}");
            count += 1;
        }
    }
    assert!(count > 2, "{page} has {count} links");
}

#[test]
fn a_site_of_one_city_opens_it() {
    let folder = tempfile::tempdir().unwrap();
    let (city, site) = (folder.path().join("two"), folder.path().join("sites/site"));
    small_city::write_city_with_meshes(&city, "two");
    fs::write(city.join("thumbnail.jpg"), JPEG).unwrap();
    fs::write(city.join("fingerprints.bin"), "for bakes only").unwrap();
    publish(&[&city], &site).unwrap();
    let files = files_below(&site);
    for file in [
        "index.html", "service-worker.js", "insula-site.json", "assets/00112233445566ff/app.js",
        "assets/00112233445566ff/app.js.br", "assets/00112233445566ff/app.js.gz", "cities/two/index.html",
        "cities/two/city.json", "cities/two/blockmaps.pmtiles", "cities/two/subtrees.pmtiles",
        "cities/two/meshes.pmtiles", "cities/two/thumbnail.jpg",
    ] {
        assert!(files.contains(file), "{file} is not in {files:?}");
    }
    assert!(!files.iter().any(|file| file.contains("fingerprints") || file.contains("escape")), "{files:?}");
    for (page, source) in [("index.html", "cities/two/"), ("cities/two/index.html", "./")] {
        assert_links_resolve(&site, page);
        let html = fs::read_to_string(site.join(page)).unwrap();
        assert!(html.contains(&format!("<insula-city src=\"{source}\" full>")), "{html}");
        assert!(html.contains("content=\"https://cities.example.org/cities/two/thumbnail.jpg\""), "{html}");
        assert!(html.contains("- Our &lt;cities&gt;</title>"), "{html}");
    }
    // What is published can be served, too, and is the city.
    assert_eq!(Store::open(&[site.join("cities")]).unwrap().cities().len(), 1);
    assert_eq!(fs::read_dir(site.parent().unwrap()).unwrap().count(), 1, "nothing stays beside it");
}

#[test]
fn a_site_of_several_cities_lists_them() {
    let folder = tempfile::tempdir().unwrap();
    let (cities, site) = (folder.path().join("cities"), folder.path().join("site"));
    write_hostile_city(&cities.join("two"));
    small_city::write_city(&cities.join("three"), "three");
    publish(&[&cities], &site).unwrap();
    for page in ["index.html", "cities/two/index.html", "cities/three/index.html"] {
        assert_links_resolve(&site, page);
    }
    assert_no_markup_of_cities(&fs::read_to_string(site.join("index.html")).unwrap());
    assert_no_markup_of_cities(&fs::read_to_string(site.join("cities/two/index.html")).unwrap());
    // Again: the old site is replaced as a whole.
    publish(&[&cities.join("three")], &site).unwrap();
    assert!(!site.join("cities/two").exists() && site.join("cities/three/index.html").is_file());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing stays beside it");
}

#[tokio::test]
async fn pages_and_lists_name_the_versions_of_a_city() {
    let folder = tempfile::tempdir().unwrap();
    let (cities, site) = (folder.path().join("cities"), folder.path().join("site"));
    for (name, date) in [("three", "2024-01-31"), ("two", "2020-01-01"), ("other", "")] {
        small_city::write_city(&cities.join(name), name);
        let path = cities.join(name).join("city.json");
        let mut manifest: Manifest = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        let (of, date, shared) = ("two".to_owned(), date.to_owned(), Vec::new());
        manifest.release = (name != "other").then_some(Release { of, date, bake_origin: [0.0; 3], shared });
        fs::write(&path, serde_json::to_vec(&manifest).unwrap()).unwrap();
    }
    let service = service(&cities, Some(viewer()));
    let page = get(&service, "/cities/three", &[]).await.text;
    let versions = "content=\"2020-01-01 ../cities/two 2024-01-31 ../cities/three\"";
    assert!(page.contains(&format!("<meta name=\"insula-versions\" {versions}>")), "{page}");
    assert!(!get(&service, "/cities/other", &[]).await.text.contains("insula-versions"));
    assert!(get(&service, "/", &[]).await.text.contains("<p>2024-01-31 "));
    let list: serde_json::Value = serde_json::from_str(&get(&service, "/v1/cities", &[]).await.text).unwrap();
    let of = |index: usize, name: &str| list[index][name].as_str();
    assert_eq!([of(1, "version_of"), of(1, "date"), of(0, "date")], [Some("two"), Some("2024-01-31"), None]);
    publish(&[&cities], &site).unwrap();
    let page = fs::read_to_string(site.join("cities/two/index.html")).unwrap();
    assert!(page.contains("content=\"2020-01-01 ../two/ 2024-01-31 ../three/\""), "{page}");
}

#[test]
fn only_sites_are_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let (city, site) = (folder.path().join("two"), folder.path().join("site"));
    small_city::write_city(&city, "two");
    fs::create_dir(&site).unwrap();
    publish(&[&city], &site).unwrap();
    for foreign in [
        "letters.txt", "assets/letters.txt", "assets/mine/holiday.png", "cities/two/impressum.html",
        "cities/two/more/index.html",
    ] {
        let path = site.join(foreign);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, "dear").unwrap();
        let error = publish(&[&city], &site).unwrap_err();
        assert!(error.contains("would remove it"), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "dear");
        fs::remove_file(&path).unwrap();
        for folder in ["cities/two/more", "assets/mine"] {
            let _ = fs::remove_dir(site.join(folder));
        }
    }
    // A page that somebody has changed is no longer the one that was written.
    let page = fs::read_to_string(site.join("cities/two/index.html")).unwrap();
    for changed in [page.clone() + "<!-- mine -->", page.replacen("html", "HTML", 1)] {
        fs::write(site.join("cities/two/index.html"), &changed).unwrap();
        assert!(publish(&[&city], &site).unwrap_err().contains("would remove it"));
        assert_eq!(fs::read_to_string(site.join("cities/two/index.html")).unwrap(), changed);
    }
    fs::write(site.join("cities/two/index.html"), page).unwrap();
    assert!(publish(&[&site.join("cities/two")], &site).unwrap_err().contains("contains, the input"));
    publish(&[&city], &site).unwrap();
    // The marker of a site of an earlier version has no list.
    let marker = site.join("insula-site.json");
    fs::write(&marker, r#"{"assets": "1", "cities": ["two"]}"#).unwrap();
    assert!(publish(&[&city], &site).unwrap_err().contains("list of files"));
    fs::remove_file(marker).unwrap();
    assert!(publish(&[&city], &site).unwrap_err().contains("not a published site"));
    let file = folder.path().join("file");
    fs::write(&file, "dear").unwrap();
    assert!(publish(&[&city], &file).unwrap_err().contains("a file or link"));
    assert!(publish(&[&city], &city.join("site")).unwrap_err().contains("lies in a baked city"));
    assert!(publish(&[Path::new("https://h/city")], &site).unwrap_err().contains("download"));
    assert!(publish(&[&folder.path().join("none")], &folder.path().join("new")).is_err());
    assert!(!folder.path().join("new").exists());
    assert!(
        fs::read_dir(folder.path()).unwrap().all(|entry| !entry
            .unwrap()
            .file_name()
            .to_str()
            .unwrap()
            .starts_with('.'))
    );
}

/// A folder as a publish that was killed leaves it: the old site moved away, the new one begun.
#[test]
fn a_publish_that_was_killed_is_ended_by_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let (city, site, work) =
        (folder.path().join("two"), folder.path().join("site"), folder.path().join(".site.publish"));
    small_city::write_city(&city, "two");
    let marker = "Insula keeps unfinished work of `publish` in this folder and removes it.\n";
    let killed = || {
        fs::create_dir_all(work.join("new/assets")).unwrap();
        fs::write(work.join("lock"), marker).unwrap();
        let hash = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262";
        fs::write(work.join("files"), format!("9 {hash} assets/app.js\n0 {hash} empty\n9 {hash} cut")).unwrap();
        fs::write(work.join("new/assets/app.js"), "half").unwrap();
        fs::write(work.join("new/empty"), "").unwrap();
    };
    publish(&[&city], &site).unwrap();
    let before = files_below(&site);
    for is_moved in [false, true] {
        killed();
        if is_moved {
            fs::rename(&site, work.join("old")).unwrap();
        }
        publish(&[&city], &site).unwrap();
        assert_eq!(files_below(&site), before);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing stays beside it");
    }
    // An empty folder in its place is none: the old site is there again, also if there will be no new one.
    killed();
    fs::rename(&site, work.join("old")).unwrap();
    fs::create_dir(&site).unwrap();
    let page = work.join("old/index.html");
    fs::write(&page, fs::read_to_string(&page).unwrap() + "<!-- mine -->").unwrap();
    assert!(publish(&[&city], &site).unwrap_err().contains("would remove it"));
    assert!(fs::read_to_string(site.join("index.html")).unwrap().ends_with("<!-- mine -->"));
    fs::remove_dir_all(&site).unwrap();
    publish(&[&city], &site).unwrap();
    // What is not unfinished work stays.
    killed();
    fs::write(work.join("new/letters.txt"), "dear").unwrap();
    assert!(publish(&[&city], &site).unwrap_err().contains("letters.txt"));
    assert_eq!(fs::read_to_string(work.join("new/letters.txt")).unwrap(), "dear");
    fs::remove_file(work.join("lock")).unwrap();
    assert!(publish(&[&city], &site).unwrap_err().contains("not unfinished work"));
    fs::remove_dir_all(&work).unwrap();
    fs::write(&work, "dear").unwrap();
    assert!(publish(&[&city], &site).is_err());
    assert_eq!(fs::read_to_string(&work).unwrap(), "dear");
}
