//! Tokens, share links and private cities on a running server.

use crate::test_server::{TILE, TestServer, assert_problem, exchange};
use insula_server::config::{AccessConfig, CorsPolicy, ServeConfig};
use insula_server::http::{HttpServer, ServeError};
use insula_server::store::Store;
use insula_test_support::small_city;
use std::path::Path;
use std::process::Command;

const TOKEN: &str = "Authorization: Bearer 0123456789abcdef-office\r\n";

#[tokio::test]
async fn private_cities_need_a_token() {
    let tokens = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(tokens.path(), "# the office\n0123456789abcdef-office\n").unwrap();
    let server = TestServer::start(|config| config.access.tokens = Some(tokens.path().to_owned())).await;
    let invalid_name = "/v1/cities/T/v/blockmaps/0/0/0";
    for path in [TILE, "/v1/cities/two", "/v1/cities/three", invalid_name] {
        for headers in [
            "",
            "Authorization: Bearer 0123456789abcdef-offic\r\n",
            "Authorization: Basic 0123456789abcdef-office\r\n",
            "Authorization: x\r\n",
        ] {
            let response = server.get(path, headers).await;
            assert_problem(&response, 401);
            assert!(response.contains("www-authenticate: Bearer"), "{response}");
        }
    }
    let tile = server.get(TILE, TOKEN).await;
    assert!(tile.starts_with("HTTP/1.1 200") && tile.contains("cache-control: private, max-age"), "{tile}");
    assert!(server.get("/v1/cities/two", TOKEN).await.contains("cache-control: private, no-cache"));
    for path in ["/v1/cities/three", invalid_name] {
        assert_problem(&server.get(path, TOKEN).await, 404);
    }
    assert!(server.get("/v1/cities", "").await.ends_with("[]"));
    assert!(server.get("/v1/cities", TOKEN).await.contains("\"two\""));
    assert!(!server.get("/", "").await.contains("Two") && server.get("/", TOKEN).await.contains("Two"));
    // The old token ends with the reload of another file.
    std::fs::write(tokens.path(), "fedcba9876543210-office\n").unwrap();
    server.reload_until(TILE, TOKEN, 401).await;
    server.stop().await;
}

#[tokio::test]
async fn tokens_that_are_not_listed_any_more_are_gone_at_the_next_reload() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tokens");
    let listed = "0123456789abcdef-office\n";
    std::fs::write(&path, listed).unwrap();
    let server = TestServer::start(|config| config.access.tokens = Some(path.clone())).await;
    for text in ["", "# nobody\n", "short\n", "another-token-of-the-office\n"] {
        std::fs::write(&path, text).unwrap();
        server.reload_until(TILE, TOKEN, 401).await;
        assert_problem(&server.get(TILE, TOKEN).await, 401);
        assert_problem(&server.get(TILE, "").await, 401);
        // A malformed line spoils only itself.
        std::fs::write(&path, [b"short\n\xff\n", listed.as_bytes()].concat()).unwrap();
        server.reload_until(TILE, TOKEN, 200).await;
    }
    // Neither do tokens that cannot be read keep a removed city.
    std::fs::remove_file(&path).unwrap();
    server.reload_until(TILE, TOKEN, 401).await;
    std::fs::remove_dir_all(server.folder.path().join("two")).unwrap();
    small_city::write_city(&server.folder.path().join("three"), "three");
    // Three checks must miss it. The one that the change of the tokens began may have seen it.
    for _ in 0..5 {
        server.reload().await;
        assert_problem(&server.get(TILE, TOKEN).await, 401);
    }
    assert!(!server.has_city("two") && server.has_city("three"));
    std::fs::write(&path, listed).unwrap();
    server.reload_until("/v1/cities/three", TOKEN, 200).await;
    assert_problem(&server.get("/v1/cities/two", TOKEN).await, 404);
    server.stop().await;
}

#[tokio::test]
async fn a_changed_token_file_is_found_without_a_signal() {
    let tokens = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(tokens.path(), "0123456789abcdef-office\n").unwrap();
    let server = TestServer::start(|config| {
        config.access.tokens = Some(tokens.path().to_owned());
        config.reload.watch_secs = 1;
    })
    .await;
    assert!(server.get(TILE, TOKEN).await.starts_with("HTTP/1.1 200"));
    std::fs::write(tokens.path(), "").unwrap();
    server.status_until(TILE, TOKEN, 401).await;
    server.stop().await;
}

#[test]
fn a_server_without_any_usable_token_does_not_start() {
    let tokens = tempfile::NamedTempFile::new().unwrap();
    for text in ["", "short\n"] {
        std::fs::write(tokens.path(), text).unwrap();
        let access = AccessConfig { tokens: Some(tokens.path().to_owned()), ..AccessConfig::default() };
        let config = ServeConfig { access, ..ServeConfig::default() };
        let error = HttpServer::new(Store::open(&[small_city::shared_city()]).unwrap(), &config).unwrap_err();
        assert!(matches!(&error, ServeError::Access(_)) && !error.to_string().contains("short"), "{error}");
    }
}

#[tokio::test]
async fn private_and_missing_cities_look_the_same() {
    let tokens = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(tokens.path(), "0123456789abcdef-office\n").unwrap();
    let server = TestServer::start(|config| {
        config.access.tokens = Some(tokens.path().to_owned());
        config.access.private = vec!["secret".into()];
    })
    .await;
    small_city::write_city(&server.folder.path().join("secret"), "secret");
    server.reload().await;
    assert!(server.get("/v1/cities/two", "").await.starts_with("HTTP/1.1 200"), "another city is public");
    let without_id = |response: String| {
        let varies = |line: &&str| !line.starts_with("x-request-id") && !line.starts_with("date");
        response.lines().filter(varies).collect::<Vec<_>>().join("\n")
    };
    for rest in ["", "/0123456789abcdef/blockmaps/1/1/1", "/0123456789abcdef/meshes/1/1/1/0", "/x/subtrees/0/0/0"] {
        for headers in ["", "Authorization: Bearer 0123456789abcdef\r\n"] {
            let [private, missing] = [format!("/v1/cities/secret{rest}"), format!("/v1/cities/secres{rest}")];
            let (private, missing) = (server.get(&private, headers).await, server.get(&missing, headers).await);
            assert_problem(&private, 401);
            assert_eq!(without_id(private), without_id(missing));
        }
    }
    assert!(!server.get("/", "").await.contains("secret") && !server.get("/v1/cities", "").await.contains("secret"));
    assert!(server.get("/metrics", "").await.contains("insula_cities 1\n"), "private cities are not counted");
    assert!(server.get("/metrics", TOKEN).await.contains("insula_cities 2\n"));
    assert!(server.get("/v1/cities/secret", TOKEN).await.starts_with("HTTP/1.1 200"));
    assert_problem(&server.get("/v1/cities/secres", TOKEN).await, 404);
    server.stop().await;
}

#[tokio::test]
async fn metrics_can_have_a_listener_of_their_own() {
    let server = TestServer::start(|config| config.metrics_address = Some("127.0.0.1:0".into())).await;
    assert_problem(&server.get("/metrics", "").await, 404);
    for path in ["/healthz", "/readyz", "/metrics"] {
        assert!(server.get_as_operator(path).await.starts_with("HTTP/1.1 200"), "{path}");
    }
    for path in [TILE, "/", "/v1/cities"] {
        assert_problem(&server.get_as_operator(path).await, 404);
    }
    assert!(server.get("/healthz", "").await.starts_with("HTTP/1.1 200"));
    server.stop().await;
}

/// Runs `insula-server sign` and returns path and query of the link.
fn sign(keys: &Path, args: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    let output = command.args(["sign", "--keys", keys.to_str().unwrap(), "--city", "two"]).args(args).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let link = text.strip_prefix("http://127.0.0.1:7700").unwrap_or_else(|| panic!("{output:?}"));
    link.trim_end().to_owned()
}

#[test]
fn a_share_link_begins_with_the_public_address() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys");
    std::fs::write(&keys, "old 0123456789abcdef0123456789abcdef\n").unwrap();
    let config = folder.path().join("serve.toml");
    std::fs::write(&config, "public_url = \"https://cities.example.org/3d/\"\n").unwrap();
    let link = |url: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
        command.args(["sign", "--city", "two", "--expires", "1h", "--keys"]).arg(&keys).arg("--config").arg(&config);
        String::from_utf8(command.args(url).output().unwrap().stdout).unwrap()
    };
    assert!(link(&[]).starts_with("https://cities.example.org/3d/v1/cities/two?share="), "{}", link(&[]));
    assert!(link(&["--url", "http://other"]).starts_with("http://other/v1/cities/two?share="));
}

#[test]
fn the_area_of_a_share_link_may_be_in_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys");
    std::fs::write(&keys, "key 0123456789abcdef0123456789abcdef\n").unwrap();
    let city = folder.path().join("Two");
    small_city::write_city(&city, "two");
    let run = |city: &Path, area: [&str; 2]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
        command.args(["sign", "--expires", "1h"]).args(area).arg("--keys").arg(&keys);
        command.arg("--city").arg(city).output().unwrap()
    };
    let degrees = ["--bbox", "4.3678,51.9979,4.3700,51.9990"];
    let link = String::from_utf8(run(&city, degrees).stdout).unwrap();
    assert!(link.contains("/v1/cities/two?share="), "{link}");
    // The box begins near x = 84,994 and y = 445,991, which are in the link in millimetres.
    assert!(link.contains("~84993") && link.contains("~445991"), "{link}");
    for (city, area, words) in [
        (Path::new("two"), degrees, "--bbox-metres"),
        (city.as_path(), ["--bbox", "8,44,8.1,44.1"], "--bbox 8,44,8.1,44.1: beyond the city, which lies in 4.36"),
        (city.as_path(), ["--bbox-metres", "0,0,9,9"], "beyond the city, which lies in 85000,"),
    ] {
        let failed = run(city, area);
        let message = String::from_utf8_lossy(&failed.stderr);
        assert!(failed.status.code() == Some(2) && message.contains(words), "{message}");
        assert!(failed.stdout.is_empty(), "no link that opens nothing");
    }
}

#[test]
fn a_missing_key_file_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys");
    let run = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
        command.args(["sign", "--city", "two", "--expires", "1h", "--keys"]).arg(&keys).output().unwrap()
    };
    let failed = run();
    let message = String::from_utf8_lossy(&failed.stderr);
    assert!(message.starts_with("error: sign: ") && message.lines().count() == 1, "{message}");
    // Of a file with a key, lines that are none are told beside the link.
    std::fs::write(&keys, "short 0123\nkey 0123456789abcdef0123456789abcdef\n").unwrap();
    let signed = run();
    let message = String::from_utf8_lossy(&signed.stderr);
    assert!(signed.status.success() && message.starts_with("warning: part of the keys"), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
}

#[tokio::test]
async fn the_openapi_document_is_printed_as_it_is_served() {
    let server = TestServer::start(|_| {}).await;
    let printed = Command::new(env!("CARGO_BIN_EXE_insula-server")).arg("openapi").output().unwrap();
    let printed = String::from_utf8(printed.stdout).unwrap();
    let served = server.get("/v1/openapi.json", "").await;
    assert!(served.ends_with(&printed) && printed.len() > 1000, "{printed}");
    server.stop().await;
}

#[tokio::test]
async fn a_share_link_opens_a_private_city() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys");
    let (old, new) = ("old 0123456789abcdef0123456789abcdef\n", "new fedcba9876543210fedcba9876543210\n");
    std::fs::write(&keys, old).unwrap();
    let server = TestServer::start(|config| config.access.share_keys = Some(keys.clone())).await;
    assert_problem(&server.get("/v1/cities/two", "").await, 401);
    let link = sign(&keys, &["--expires", "1h"]);
    let query = link.split_once('?').unwrap().1;
    let manifest = server.get(&link, "").await;
    assert!(manifest.starts_with("HTTP/1.1 200") && manifest.contains("cache-control: private"), "{manifest}");
    assert!(manifest.contains("referrer-policy: no-referrer"), "{manifest}");
    let page = server.get(&link, "Accept: text/html,*/*;q=0.8\r\n").await;
    assert!(page.contains("text/html") && page.contains(&format!("insula view http://x{link}")), "{page}");
    let tile = format!("{TILE}?{query}");
    assert!(server.get(&tile, "").await.starts_with("HTTP/1.1 200"));
    assert!(server.get(&tile, "Range: bytes=0-3\r\n").await.starts_with("HTTP/1.1 206"));
    assert!(server.get(&format!("/v1/cities?{query}"), "").await.contains("\"two\""));
    assert!(server.get(&format!("/?{query}"), "").await.contains("/v1/cities/two?share="));
    for invalid in [format!("/v1/cities/three?{query}"), format!("{tile}0"), tile.replace("share", "shared")] {
        assert_problem(&server.get(&invalid, "").await, 401);
    }
    // Rotation: a new key signs, the old one verifies until it is removed.
    std::fs::write(&keys, format!("{old}{new}")).unwrap();
    let newer = sign(&keys, &["--expires", "1h"]);
    assert!(newer.contains("share=s1.new."), "{newer}");
    server.reload_until(&newer, "", 200).await;
    assert!(server.get(&link, "").await.starts_with("HTTP/1.1 200"));
    std::fs::write(&keys, new).unwrap();
    server.reload_until(&link, "", 401).await;
    assert!(server.get(&newer, "").await.starts_with("HTTP/1.1 200"));
    std::fs::remove_file(&keys).unwrap();
    server.reload_until(&newer, "", 401).await;
    server.stop().await;
}

#[tokio::test]
async fn a_share_link_can_be_limited_to_an_area_and_a_version() {
    let keys = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(keys.path(), "key 0123456789abcdef0123456789abcdef\n").unwrap();
    let server = TestServer::start(|config| config.access.share_keys = Some(keys.path().to_owned())).await;
    let status = async |args: &[&str], path: &str| {
        let link = sign(keys.path(), args);
        server.get(&format!("{path}?{}", link.split_once('?').unwrap().1), "").await[9..12].to_owned()
    };
    let root = "/v1/cities/two/0123456789abcdef/blockmaps/0/0/0";
    // Of the root's children, only the tile exists.
    let group = "/v1/cities/two/0123456789abcdef/groups/blockmaps/1/0/0/4/0";
    // The root spans 128 m from (85000, 446000); the tile is its north-eastern quarter.
    let (inside, outside) = ("85065,446065,85066,446066", "85001,446001,85002.5,446002");
    for (area, path, expected) in [
        (inside, TILE, "200"),
        (inside, root, "200"),
        (outside, root, "200"),
        (outside, TILE, "404"),
        (inside, group, "200"),
        (outside, group, "404"),
        ("0,0,1,1", root, "404"),
        ("0,0,1,1", "/v1/cities/two", "200"),
    ] {
        assert_eq!(
            status(&["--expires", "1d", "--read-only", "--bbox-metres", area], path).await,
            expected,
            "{area} {path}"
        );
    }
    for (version, expected) in [("0123456789abcdef", "200"), ("0123*", "200"), ("1*", "401"), ("0123", "401")] {
        for path in [TILE, "/v1/cities/two"] {
            let status = status(&["--expires", "1d", "--version", version], path).await;
            assert_eq!(status, expected, "{version} {path}");
        }
        // Lists have no city of which the link opens another version only.
        let link = sign(keys.path(), &["--expires", "1d", "--version", version]);
        for path in ["/", "/v1/cities", "/v1/cities?limit=5"] {
            let address =
                format!("{path}{}{}", if path.contains('?') { "&" } else { "?" }, link.split_once('?').unwrap().1);
            let list = server.get(&address, "").await;
            let has_city = list.contains("Two") || list.contains("\"two\"");
            assert_eq!(has_city, expected == "200", "{version} {path}: {list}");
        }
    }
    server.stop().await;
}

#[tokio::test]
async fn hosts_and_origins_can_be_restricted() {
    let server = TestServer::start(|config| {
        config.access.hosts = vec!["localhost".into(), "127.0.0.1".into()];
        config.access.cors = CorsPolicy::None;
    })
    .await;
    let get = async |host: &str| {
        let mut stream = server.connect().await;
        let request = format!("GET {TILE} HTTP/1.1\r\n{host}Origin: https://evil.example\r\nConnection: close\r\n\r\n");
        exchange(&mut stream, &request).await
    };
    for host in ["Host: localhost\r\n", "Host: LOCALHOST:1234\r\n", "Host: 127.0.0.1:80\r\n"] {
        let response = get(host).await;
        assert!(response.starts_with("HTTP/1.1 200") && !response.contains("access-control"), "{response}");
    }
    for host in ["Host: evil.example\r\n", "Host: localhost.evil.example:80\r\n", "Host: \r\n"] {
        assert_problem(&get(host).await, 421);
    }
    for hosts in ["", "Host: localhost\r\nHost: localhost\r\n"] {
        assert_problem(&get(hosts).await, 400);
    }
    server.stop().await;
}
