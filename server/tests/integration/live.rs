//! A server on a port, with clients that are slow, malicious or numerous.

use crate::test_server::{
    PATIENCE, TILE, TestServer, assert_problem, exchange, http2, read_to_end, replace_city, stall,
};
use insula_server::config::{LimitsConfig, ServeConfig};
use insula_server::http::{ServeError, serve};
use insula_server::store::Store;
use insula_test_support::small_city;
use std::future::pending;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

#[tokio::test]
async fn malformed_requests_are_problems() {
    let server = TestServer::start(|_| {}).await;
    for (request, status) in [
        ("nonsense\r\n\r\n".to_owned(), 400),
        ("GET / HTTP/3.7\r\n\r\n".to_owned(), 400),
        ("GET /\u{1} HTTP/1.1\r\nHost: x\r\n\r\n".to_owned(), 400),
        ("GET / HTTP/1.1\r\nHo st: x\r\n\r\n".to_owned(), 400),
        ("GET / HTTP/1.1\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n".to_owned(), 400),
        ("GET / HTTP/1.1\r\nTransfer-Encoding: gzip\r\n\r\n".to_owned(), 400),
        (format!("GET / HTTP/1.1\r\nX: {}\r\n\r\n", "x".repeat(20_000)), 431),
        (format!("GET / HTTP/1.1\r\n{}\r\n", "X: y\r\n".repeat(200)), 431),
        (format!("GET /{} HTTP/1.1\r\n\r\n", "x".repeat(20_000)), 431),
    ] {
        let mut stream = server.connect().await;
        let response = exchange(&mut stream, &request).await;
        assert_problem(&response, status);
        assert_eq!(response.matches("HTTP/1.1").count(), 1, "one response, then the end: {response}");
    }
    server.stop().await;
}

/// A proxy and the server could split these streams differently. The hidden request must never be served.
#[tokio::test]
async fn smuggled_requests_are_not_answered() {
    let server = TestServer::start(|_| {}).await;
    let hidden = "GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n";
    for head in [
        format!("Content-Length: {}\r\n", hidden.len()),
        format!("Content-Length: {}\r\nTransfer-Encoding: chunked\r\n", hidden.len()),
        "Transfer-Encoding: chunked\r\nContent-Length: 4\r\n".to_owned(),
        "Transfer-Encoding: chunked\r\n".to_owned(),
        "Transfer-Encoding: xchunked\r\n".to_owned(),
        "Transfer-Encoding : chunked\r\n".to_owned(),
        "Transfer-Encoding: chunked\r\nTransfer-Encoding: identity\r\n".to_owned(),
        "Content-Length: +3\r\n".to_owned(),
        "Content-Length: 3\r\nContent-Length: 30\r\n".to_owned(),
        "X: a\r\n b\r\nContent-Length: 3\r\n".to_owned(),
    ] {
        let mut stream = server.connect().await;
        let response = exchange(&mut stream, &format!("GET {TILE} HTTP/1.1\r\nHost: x\r\n{head}\r\n{hidden}")).await;
        assert!(response.matches("HTTP/1.1 ").count() <= 1 && !response.contains("\r\n\r\nok\n"), "{head}: {response}");
        assert!(response.is_empty() || response.starts_with("HTTP/1.1 400"), "{head}: {response}");
    }
    server.stop().await;
}

/// A server with one strict limit that `change` sets. A client that another limit closes is counted as of that one.
async fn start_strict(change: impl FnOnce(&mut LimitsConfig)) -> TestServer {
    TestServer::start(|config| {
        (config.limits.header_secs, config.limits.idle_secs, config.limits.write_secs) = (15, 15, 15);
        config.metrics_address = Some("127.0.0.1:0".into());
        change(&mut config.limits);
    })
    .await
}

/// Waits until the server closes the connection of a client that sends `first` and then, if it `drips`, a byte now and then.
async fn until_closed(server: &TestServer, first: &[u8], drips: bool) {
    let mut stream = server.connect().await;
    stream.write_all(first).await.unwrap();
    let (mut reader, mut writer) = stream.split();
    let drip = async {
        while drips && writer.write_all(b"x").await.is_ok() {
            sleep(Duration::from_millis(50)).await;
        }
        pending::<()>().await;
    };
    let closed = async { while let Ok(1..) = reader.read(&mut [0; 1024]).await {} };
    let first_of_both = async {
        tokio::select! {
            () = drip => {}
            () = closed => {}
        }
    };
    timeout(PATIENCE, first_of_both).await.expect("the connection stays open");
}

/// Asserts that so many clients were closed by one limit, and none by another. Stops the server.
async fn assert_closed_by(server: TestServer, kind: &str, count: u32) {
    let line = format!("insula_client_timeouts_total{{kind=\"{kind}\"}} {count}\n");
    let metrics = server.operator_metrics_until(|metrics| metrics.contains(&line)).await;
    assert_eq!(metrics.matches("insula_client_timeouts_total{").count(), 1, "{metrics}");
    server.stop().await;
}

#[tokio::test]
async fn slow_clients_are_closed() {
    let headers = async {
        let server = start_strict(|limits| limits.header_secs = 1).await;
        let _idle = server.hold(1).await;
        tokio::join!(
            until_closed(&server, b"", false),
            until_closed(&server, b"GET / HTTP/1.1\r\nX: ", true),
            until_closed(&server, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\nGET /hea", true),
        );
        assert_closed_by(server, "headers", 3).await;
    };
    let idle = async {
        let server = start_strict(|limits| limits.idle_secs = 1).await;
        let _silent = server.connect().await;
        until_closed(&server, b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n", false).await;
        assert_closed_by(server, "idle", 1).await;
    };
    let reading = async {
        let server = start_strict(|limits| limits.write_secs = 1).await;
        let _idle = server.hold(1).await;
        let mut deaf = server.connect().await;
        let requests = format!("GET {TILE} HTTP/1.1\r\nHost: x\r\n\r\n").repeat(1000);
        let closed = async { while deaf.write_all(requests.as_bytes()).await.is_ok() {} };
        timeout(PATIENCE, closed).await.expect("the connection stays open");
        assert_closed_by(server, "reading", 1).await;
    };
    tokio::join!(headers, idle, reading);
}

#[tokio::test]
async fn connections_over_the_limit_are_503() {
    let server =
        TestServer::start(|config| (config.limits.connections, config.limits.client_connections) = (8, 8)).await;
    let mut held = server.hold(8).await;
    let mut over = server.connect().await;
    let response = exchange(&mut over, &format!("GET {TILE} HTTP/1.1\r\nHost: x\r\n\r\n")).await;
    assert_problem(&response, 503);
    assert!(response.contains("retry-after: 1\r\n") && response.contains("connection: close\r\n"), "{response}");
    held.pop();
    server.status_until(TILE, "", 200).await;
    server.stop().await;
}

#[tokio::test]
async fn a_client_over_its_rate_is_429() {
    let server = TestServer::start(|config| (config.limits.client_rate, config.limits.client_burst) = (0.001, 3)).await;
    for _ in 0..3 {
        assert!(server.get(TILE, "").await.starts_with("HTTP/1.1 200"));
    }
    let response = server.get(TILE, "").await;
    assert_problem(&response, 429);
    // One is allowed again after a thousand seconds, of which a few have passed.
    let retry_secs = response.lines().find_map(|line| line.strip_prefix("retry-after: "));
    assert!((900..=1000).contains(&retry_secs.unwrap().parse::<u32>().unwrap()), "{response}");
    assert!(server.get("/readyz", "").await.starts_with("HTTP/1.1 200"), "the limit does not apply to health");
    server.stop().await;
}

#[tokio::test]
async fn clients_behind_a_trusted_proxy_are_told_apart() {
    let server = TestServer::start(|config| {
        (config.limits.client_rate, config.limits.client_burst) = (0.001, 1);
        config.access.proxies = vec!["127.0.0.0/8".parse().unwrap()];
    })
    .await;
    for client in ["203.0.113.1", "203.0.113.2"] {
        let header = format!("X-Forwarded-For: 198.51.100.9, {client}\r\n");
        assert!(server.get(TILE, &header).await.starts_with("HTTP/1.1 200"), "{client}");
        assert_problem(&server.get(TILE, &header).await, 429);
    }
    server.stop().await;
}

/// Replaces the city by another version.
fn publish(folder: &Path, version: &str) {
    replace_city(&folder.join("two"), |next| {
        small_city::write_city(next, "two");
        let mut manifest = small_city::manifest("two");
        manifest.version = version.into();
        std::fs::write(next.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    });
}

#[tokio::test]
async fn a_new_version_replaces_the_old_one_which_stays_available() {
    let server = TestServer::start(|config| config.reload.keep_versions = 2).await;
    let get_tile = async |version: &str| server.get(&format!("/v1/cities/two/{version}/blockmaps/1/1/1"), "").await;
    for version in ["b", "c", "d"] {
        publish(server.folder.path(), version);
        server.reload().await;
        assert!(server.get("/v1/cities/two", "").await.contains(&format!("\"{version}\"")));
    }
    for (version, status) in [("d", 200), ("c", 200), ("b", 200), ("0123456789abcdef", 410)] {
        let response = get_tile(version).await;
        assert!(response.starts_with(&format!("HTTP/1.1 {status}")), "{version}: {response}");
    }
    std::fs::write(server.folder.path().join("two/city.json"), "{").unwrap();
    server.reload().await;
    assert!(get_tile("d").await.starts_with("HTTP/1.1 200"), "a damaged city replaces nothing");
    std::fs::remove_dir_all(server.folder.path().join("two")).unwrap();
    small_city::write_city(&server.folder.path().join("three"), "three");
    for checks in 1..=2 {
        server.reload().await;
        assert!(get_tile("d").await.starts_with("HTTP/1.1 200"), "removed after {checks} checks");
    }
    server.reload().await;
    assert!(get_tile("d").await.starts_with("HTTP/1.1 404"), "missing at three checks");
    assert!(server.get("/v1/cities/three", "").await.starts_with("HTTP/1.1 200"));
    server.stop().await;
}

/// A server by the embedding interface: `serve` with a future that ends it.
async fn embedded(config: ServeConfig) -> (SocketAddr, oneshot::Sender<()>, JoinHandle<Result<(), ServeError>>) {
    let store = Store::open(&[small_city::shared_city()]).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = oneshot::channel::<()>();
    let shutdown = async {
        let _ = stopped.await;
    };
    (address, stop, tokio::spawn(async move { serve(listener, store, &config, shutdown).await }))
}

#[tokio::test]
async fn shutdown_drops_requests_that_do_not_finish_in_time() {
    let (address, stop, server) = embedded(ServeConfig { drain_secs: 1, ..ServeConfig::default() }).await;
    let mut client = TcpStream::connect(address).await.unwrap();
    assert!(exchange(&mut client, "GET /v1/cities HTTP/1.0\r\n\r\n").await.contains("\"two\""));
    let mut half_request = TcpStream::connect(address).await.unwrap();
    half_request.write_all(b"GET / HTTP/1.1\r\nHost:").await.unwrap();
    // The response to this client has begun, and cannot end.
    let mut client = http2(TcpStream::connect(address).await.unwrap(), 0).await;
    let mut stalled = stall(&mut client, 1).await;
    let start = Instant::now();
    stop.send(()).unwrap();
    timeout(PATIENCE, server).await.unwrap().unwrap().unwrap();
    assert!(start.elapsed() >= Duration::from_secs(1), "the response had no time to end");
    assert_eq!(half_request.read(&mut [0; 1]).await.unwrap_or(0), 0, "the connection is closed");
    let end = timeout(PATIENCE, stalled[0].data()).await.expect("the response goes on");
    assert!(!matches!(end, Some(Ok(_))), "{end:?}");
}

/// Load balancers learn from `/readyz` that the server goes before it refuses what they send.
#[tokio::test]
async fn a_server_that_goes_still_accepts_connections() {
    // So long that it does not end during the test.
    let (address, stop, server) = embedded(ServeConfig { drain_notice_secs: 3600, ..ServeConfig::default() }).await;
    let get = async |path: &str| {
        let mut client = TcpStream::connect(address).await.unwrap();
        exchange(&mut client, &format!("GET {path} HTTP/1.0\r\n\r\n")).await
    };
    assert!(get("/readyz").await.contains(" 200 "));
    stop.send(()).unwrap();
    let begin = Instant::now();
    while !get("/readyz").await.contains(" 503 ") {
        assert!(begin.elapsed() < PATIENCE, "the server is still ready");
    }
    assert!(get("/v1/cities").await.contains("\"two\""), "it still serves");
    server.abort();
}

mod tls {
    use super::*;
    use tokio_rustls::TlsConnector;
    use tokio_rustls::rustls::crypto::ring;
    use tokio_rustls::rustls::pki_types::CertificateDer;
    use tokio_rustls::rustls::{ClientConfig, RootCertStore};

    /// Writes a new certificate and its key. Returns the certificate.
    fn write_certificate(folder: &Path) -> CertificateDer<'static> {
        let certified = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
        std::fs::write(folder.join("cert.pem"), certified.cert.pem()).unwrap();
        std::fs::write(folder.join("key.pem"), certified.signing_key.serialize_pem()).unwrap();
        certified.cert.der().clone()
    }

    /// Requests a tile. Returns the response (over HTTP/2: the first frame's type) and the negotiated protocol. Fails if the
    /// certificate is not trusted.
    async fn get_tile(
        server: &TestServer,
        trusted: &CertificateDer<'static>,
        alpn: &[&str],
    ) -> std::io::Result<(String, Option<Vec<u8>>)> {
        let mut roots = RootCertStore::empty();
        roots.add(trusted.clone()).unwrap();
        let mut config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_root_certificates(roots)
            .with_no_client_auth();
        config.alpn_protocols = alpn.iter().map(|name| name.as_bytes().to_vec()).collect();
        let connector = TlsConnector::from(Arc::new(config));
        let mut stream = connector.connect("localhost".try_into().unwrap(), server.connect().await).await?;
        let protocol = stream.get_ref().1.alpn_protocol().map(<[u8]>::to_vec);
        if protocol.as_deref() == Some(b"h2") {
            stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").await?;
            let mut frame = [0; 9];
            stream.read_exact(&mut frame).await?;
            return Ok((format!("frame {}", frame[3]), protocol));
        }
        let request = format!("GET {TILE} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
        Ok((exchange(&mut stream, &request).await, protocol))
    }

    #[tokio::test]
    async fn https_is_served_and_its_certificate_can_be_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let first = write_certificate(folder.path());
        let server = TestServer::start(|config| {
            config.tls.certificate = Some(folder.path().join("cert.pem"));
            config.tls.key = Some(folder.path().join("key.pem"));
        })
        .await;
        let (response, protocol) = get_tile(&server, &first, &["http/1.1"]).await.unwrap();
        assert!(response.starts_with("HTTP/1.1 200") && response.contains("INSU"), "{response}");
        assert_eq!(protocol.as_deref(), Some(&b"http/1.1"[..]));
        let (response, protocol) = get_tile(&server, &first, &["h2", "http/1.1"]).await.unwrap();
        assert_eq!((response.as_str(), protocol.as_deref()), ("frame 4", Some(&b"h2"[..])), "a SETTINGS frame");
        for garbage in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0x16, 3, 1, 0xff, 0xff, 1], &[0xff; 600]] {
            let mut stream = server.connect().await;
            stream.write_all(garbage).await.unwrap();
            // The server may have closed the connection.
            let _ = stream.shutdown().await;
            assert!(!read_to_end(&mut stream).await.starts_with(b"HTTP"), "a response without encryption");
        }
        let second = write_certificate(folder.path());
        server.reload().await;
        assert!(get_tile(&server, &first, &[]).await.is_err(), "the old certificate is still in use");
        assert!(get_tile(&server, &second, &[]).await.unwrap().0.starts_with("HTTP/1.1 200"));
        std::fs::write(folder.path().join("key.pem"), "no key").unwrap();
        server.reload().await;
        let (response, _) = get_tile(&server, &second, &[]).await.unwrap();
        assert!(response.starts_with("HTTP/1.1 200"), "an invalid key replaces nothing");
        server.stop().await;
    }
}
