//! A server on a port, and clients that are slow, rude, or many.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use insula_server::{
    config::ServeConfig,
    http::{HttpServer, ServeError},
    store::Store,
};
use std::{
    net::SocketAddr,
    path::Path,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    sync::{Notify, oneshot},
    task::JoinHandle,
    time::{sleep, timeout},
};

const TILE: &str = "/v1/cities/two/0123456789abcdef/blockmaps/1/1/1";

struct TestServer {
    folder: tempfile::TempDir,
    address: SocketAddr,
    look: Arc<Notify>,
    stop: Option<oneshot::Sender<()>>,
    task: JoinHandle<Result<(), ServeError>>,
}

impl TestServer {
    async fn start(change: impl FnOnce(&mut ServeConfig)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        common::city(&folder.path().join("two"), "two");
        let mut config = ServeConfig { threads: 2, drain_secs: 1, ..ServeConfig::default() };
        config.reload.watch_secs = 0;
        change(&mut config);
        let server = HttpServer::new(Store::open(&[folder.path()]).unwrap(), &config).unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (address, look) = (listener.local_addr().unwrap(), server.look());
        let (stop, stopped) = oneshot::channel::<()>();
        let task = tokio::spawn(server.run(listener, async {
            let _ = stopped.await;
        }));
        Self { folder, address, look, stop: Some(stop), task }
    }

    async fn connect(&self) -> TcpStream {
        TcpStream::connect(self.address).await.unwrap()
    }

    /// One request on a connection of its own.
    async fn get(&self, path: &str, headers: &str) -> String {
        let mut stream = self.connect().await;
        exchange(&mut stream, &format!("GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n{headers}\r\n")).await
    }

    /// Asks until an answer is as it is `meant`; a loaded machine takes its time.
    async fn until(&self, path: &str, meant: impl Fn(&str) -> bool) -> String {
        let deadline = Instant::now() + Duration::from_secs(5);
        loop {
            let answer = self.get(path, "").await;
            if meant(&answer) {
                return answer;
            }
            assert!(Instant::now() < deadline, "{path}: {answer}");
            sleep(Duration::from_millis(20)).await;
        }
    }

    async fn stop(mut self) {
        self.stop.take().unwrap().send(()).unwrap();
        timeout(Duration::from_secs(5), self.task).await.unwrap().unwrap().unwrap();
    }
}

/// Everything that is answered until the server closes.
async fn exchange(stream: &mut (impl AsyncReadExt + AsyncWriteExt + Unpin), request: &str) -> String {
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    let _ = timeout(Duration::from_secs(5), stream.read_to_end(&mut answer)).await.expect("it does not close");
    String::from_utf8_lossy(&answer).into_owned()
}

#[track_caller]
fn is_problem(answer: &str, status: u16) {
    assert!(answer.starts_with(&format!("HTTP/1.1 {status} ")), "{answer}");
    assert!(answer.contains("content-type: application/problem+json\r\n"), "{answer}");
    let body = answer.split_once("\r\n\r\n").unwrap().1;
    let problem: serde_json::Value = serde_json::from_str(body).unwrap();
    assert_eq!(problem["status"], status);
}

#[tokio::test]
async fn what_is_no_request_is_a_problem_too() {
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
        let answer = exchange(&mut stream, &request).await;
        is_problem(&answer, status);
        assert_eq!(answer.matches("HTTP/1.1").count(), 1, "one answer, then the end: {answer}");
    }
    server.stop().await;
}

/// Shapes that two readers of one stream could split differently: one answer at most, and never one to what is hidden.
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
        let answer = exchange(&mut stream, &format!("GET {TILE} HTTP/1.1\r\nHost: x\r\n{head}\r\n{hidden}")).await;
        assert!(answer.matches("HTTP/1.1 ").count() <= 1 && !answer.contains("\r\n\r\nok\n"), "{head}: {answer}");
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 400"), "{head}: {answer}");
    }
    server.stop().await;
}

#[tokio::test]
async fn slow_clients_are_closed_and_others_are_not() {
    let server = TestServer::start(|config| {
        (config.limits.header_secs, config.limits.idle_secs, config.limits.write_secs) = (1, 2, 1);
    })
    .await;
    let until_closed = async |mut stream: TcpStream, drip: bool| {
        let start = Instant::now();
        let mut byte = [0; 1024];
        while start.elapsed() < Duration::from_secs(8) {
            if drip && stream.write_all(b"x").await.is_err() {
                break;
            }
            if let Ok(Ok(0) | Err(_)) = timeout(Duration::from_millis(100), stream.read(&mut byte)).await {
                break;
            }
        }
        start.elapsed().as_secs_f64()
    };
    let silent = server.connect().await;
    let mut half = server.connect().await;
    half.write_all(b"GET / HTTP/1.1\r\nX: ").await.unwrap();
    let mut idle = server.connect().await;
    idle.write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n").await.unwrap();
    let mut second = server.connect().await;
    second.write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\nGET /hea").await.unwrap();
    let (silent, half, idle, second) = tokio::join!(
        until_closed(silent, false),
        until_closed(half, true),
        until_closed(idle, false),
        until_closed(second, true)
    );
    assert!((0.9..4.0).contains(&silent), "a connection without a request: {silent}");
    assert!((0.9..4.0).contains(&half), "headers that drip: {half}");
    assert!((1.8..6.0).contains(&idle), "between requests: {idle}");
    assert!((0.9..4.0).contains(&second), "a second request that drips: {second}");
    // One that never reads what it asked for, again and again.
    let mut deaf = server.connect().await;
    let request = format!("GET {TILE} HTTP/1.1\r\nHost: x\r\n\r\n").repeat(1000);
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(8) && deaf.write_all(request.as_bytes()).await.is_ok() {}
    assert!((0.5..6.0).contains(&start.elapsed().as_secs_f64()), "a client that does not read: {:?}", start.elapsed());
    for kind in ["headers", "idle", "reading"] {
        let counted = format!("insula_client_timeouts_total{{kind=\"{kind}\"}}");
        server.until("/metrics", |metrics| metrics.contains(&counted)).await;
    }
    server.stop().await;
}

#[tokio::test]
async fn connections_over_the_limit_are_told_so() {
    let server = TestServer::start(|config| config.limits.connections = 8).await;
    let mut held = Vec::new();
    for _ in 0..8 {
        let mut stream = server.connect().await;
        stream.write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n").await.unwrap();
        assert_ne!(stream.read(&mut [0; 512]).await.unwrap(), 0);
        held.push(stream);
    }
    let mut over = server.connect().await;
    let answer = exchange(&mut over, &format!("GET {TILE} HTTP/1.1\r\nHost: x\r\n\r\n")).await;
    is_problem(&answer, 503);
    assert!(answer.contains("retry-after: 1\r\n") && answer.contains("connection: close\r\n"), "{answer}");
    held.pop();
    server.until(TILE, |answer| answer.starts_with("HTTP/1.1 200")).await;
    server.stop().await;
}

#[tokio::test]
async fn a_client_over_its_rate_is_429() {
    let server = TestServer::start(|config| (config.limits.client_rate, config.limits.client_burst) = (0.5, 3)).await;
    for _ in 0..3 {
        assert!(server.get(TILE, "").await.starts_with("HTTP/1.1 200"));
    }
    let answer = server.get(TILE, "").await;
    is_problem(&answer, 429);
    assert!(answer.contains("retry-after: 2\r\n"), "{answer}");
    assert!(server.get("/readyz", "").await.starts_with("HTTP/1.1 200"), "health is no client's burden");
    server.stop().await;
}

#[tokio::test]
async fn private_cities_want_a_token() {
    let tokens = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(tokens.path(), "# of the office\n0123456789abcdef-office\n").unwrap();
    let server = TestServer::start(|config| config.access.tokens = Some(tokens.path().to_owned())).await;
    let token = "Authorization: Bearer 0123456789abcdef-office\r\n";
    for path in [TILE, "/v1/cities/two", "/v1/cities/three"] {
        for headers in [
            "",
            "Authorization: Bearer 0123456789abcdef-offic\r\n",
            "Authorization: Basic 0123456789abcdef-office\r\n",
            "Authorization: x\r\n",
        ] {
            let answer = server.get(path, headers).await;
            is_problem(&answer, 401);
            assert!(answer.contains("www-authenticate: Bearer"), "{answer}");
        }
    }
    let tile = server.get(TILE, token).await;
    assert!(tile.starts_with("HTTP/1.1 200") && tile.contains("cache-control: private, max-age"), "{tile}");
    assert!(server.get("/v1/cities/two", token).await.contains("cache-control: private, no-cache"));
    is_problem(&server.get("/v1/cities/three", token).await, 404);
    assert!(server.get("/v1/cities", "").await.ends_with("[]"));
    assert!(server.get("/v1/cities", token).await.contains("\"two\""));
    assert!(!server.get("/", "").await.contains("Two") && server.get("/", token).await.contains("Two"));
    // Another file, read again: the old token is worth nothing.
    std::fs::write(tokens.path(), "fedcba9876543210-office\n").unwrap();
    server.look.notify_one();
    let deadline = Instant::now() + Duration::from_secs(5);
    while server.get(TILE, token).await.starts_with("HTTP/1.1 200") && Instant::now() < deadline {
        sleep(Duration::from_millis(20)).await;
    }
    is_problem(&server.get(TILE, token).await, 401);
    server.stop().await;
}

/// Replaces the folder as the bake does: two renames.
fn publish(folder: &Path, version: &str) {
    let (next, old, here) = (folder.join(".next"), folder.join(".old"), folder.join("two"));
    common::city(&next, "two");
    let mut manifest = common::manifest("two");
    manifest.version = version.into();
    std::fs::write(next.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    std::fs::rename(&here, &old).unwrap();
    std::fs::rename(&next, &here).unwrap();
    std::fs::remove_dir_all(&old).unwrap();
}

#[tokio::test]
async fn a_new_version_takes_over_and_the_old_one_is_served_for_a_while() {
    let server = TestServer::start(|config| config.reload.keep_versions = 2).await;
    let tile = |version: &str| format!("/v1/cities/two/{version}/blockmaps/1/1/1");
    let versions = ["0123456789abcdef", "b", "c", "d"];
    for version in &versions[1..] {
        publish(server.folder.path(), version);
        server.look.notify_one();
        server.until("/v1/cities/two", |manifest| manifest.contains(&format!("\"{version}\""))).await;
        assert!(server.get(&tile(version), "").await.starts_with("HTTP/1.1 200"));
    }
    for (version, status) in [("d", 200), ("c", 200), ("b", 200), ("0123456789abcdef", 404)] {
        let answer = server.get(&tile(version), "").await;
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{version}: {answer}");
    }
    // What cannot be opened changes nothing; nor does a folder that is gone for a moment.
    std::fs::write(server.folder.path().join("two/city.json"), "{").unwrap();
    server.look.notify_one();
    sleep(Duration::from_millis(300)).await;
    assert!(server.get(&tile("d"), "").await.starts_with("HTTP/1.1 200"));
    std::fs::remove_dir_all(server.folder.path().join("two")).unwrap();
    common::city(&server.folder.path().join("three"), "three");
    for looks in 1..=2 {
        server.look.notify_one();
        sleep(Duration::from_millis(200)).await;
        assert!(server.get(&tile("d"), "").await.starts_with("HTTP/1.1 200"), "gone after {looks} looks");
    }
    // The third look, unless the first two were one.
    let look = |answer: &str| {
        server.look.notify_one();
        answer.starts_with("HTTP/1.1 404")
    };
    server.until(&tile("d"), look).await;
    server.until("/v1/cities/three", |answer| answer.starts_with("HTTP/1.1 200")).await;
    server.stop().await;
}

mod tls {
    use super::*;
    use tokio_rustls::{
        TlsConnector,
        rustls::{ClientConfig, RootCertStore, crypto::aws_lc_rs, pki_types::CertificateDer},
    };

    /// Writes a new certificate and its key; gives the certificate.
    fn certify(folder: &Path) -> CertificateDer<'static> {
        let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
        std::fs::write(folder.join("cert.pem"), made.cert.pem()).unwrap();
        std::fs::write(folder.join("key.pem"), made.signing_key.serialize_pem()).unwrap();
        made.cert.der().clone()
    }

    /// The answer, or that there is no trust; and what the two agreed to speak.
    async fn ask(
        server: &TestServer,
        trusted: &CertificateDer<'static>,
        alpn: &[&str],
    ) -> std::io::Result<(String, Option<Vec<u8>>)> {
        let mut roots = RootCertStore::empty();
        roots.add(trusted.clone()).unwrap();
        let mut config = ClientConfig::builder_with_provider(Arc::new(aws_lc_rs::default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_root_certificates(roots)
            .with_no_client_auth();
        config.alpn_protocols = alpn.iter().map(|name| name.as_bytes().to_vec()).collect();
        let connector = TlsConnector::from(Arc::new(config));
        let mut stream = connector.connect("localhost".try_into().unwrap(), server.connect().await).await?;
        let spoken = stream.get_ref().1.alpn_protocol().map(<[u8]>::to_vec);
        if spoken.as_deref() == Some(b"h2") {
            stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").await?;
            let mut frame = [0; 9];
            stream.read_exact(&mut frame).await?;
            return Ok((format!("frame {}", frame[3]), spoken));
        }
        let request = format!("GET {TILE} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
        Ok((exchange(&mut stream, &request).await, spoken))
    }

    #[tokio::test]
    async fn it_is_spoken_and_its_certificate_can_be_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let first = certify(folder.path());
        let server = TestServer::start(|config| {
            config.tls.certificate = Some(folder.path().join("cert.pem"));
            config.tls.key = Some(folder.path().join("key.pem"));
        })
        .await;
        let (answer, spoken) = ask(&server, &first, &["http/1.1"]).await.unwrap();
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("INSU"), "{answer}");
        assert_eq!(spoken.as_deref(), Some(&b"http/1.1"[..]));
        let (answer, spoken) = ask(&server, &first, &["h2", "http/1.1"]).await.unwrap();
        assert_eq!((answer.as_str(), spoken.as_deref()), ("frame 4", Some(&b"h2"[..])), "it answers with its settings");
        for garbage in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0x16, 3, 1, 0xff, 0xff, 1], &[0xff; 600]] {
            let mut stream = server.connect().await;
            stream.write_all(garbage).await.unwrap();
            let mut answer = Vec::new();
            stream.shutdown().await.unwrap();
            let _ = timeout(Duration::from_secs(5), stream.read_to_end(&mut answer)).await.expect("it does not close");
            assert!(!answer.starts_with(b"HTTP"), "no word in the clear");
        }
        let second = certify(folder.path());
        server.look.notify_one();
        let deadline = Instant::now() + Duration::from_secs(5);
        while ask(&server, &first, &[]).await.is_ok() {
            assert!(Instant::now() < deadline, "the old one stays");
            sleep(Duration::from_millis(20)).await;
        }
        assert!(ask(&server, &second, &[]).await.unwrap().0.starts_with("HTTP/1.1 200"));
        // What cannot be used changes nothing.
        std::fs::write(folder.path().join("key.pem"), "no key").unwrap();
        server.look.notify_one();
        sleep(Duration::from_millis(300)).await;
        assert!(ask(&server, &second, &[]).await.unwrap().0.starts_with("HTTP/1.1 200"));
        server.stop().await;
    }
}
