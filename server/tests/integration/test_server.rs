//! A running server for a test, and clients of raw HTTP/1.1 and of HTTP/2.

use bytes::Bytes;
use h2::client::{ResponseFuture, SendRequest};
use insula_server::config::ServeConfig;
use insula_server::http::{AppState, HttpServer, ServeError};
use insula_server::store::Store;
use insula_test_support::programs::wait_until;
use insula_test_support::small_city;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::{Notify, oneshot};
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

pub(crate) const TILE: &str = "/v1/cities/two/0123456789abcdef/blockmaps/1/1/1";
/// Header of requests with a body.
pub(crate) const JSON: &str = "Content-Type: application/json\r\n";
/// Longest wait for anything that must happen: it turns a hang into an error.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);
/// Pause between two looks at a state.
const POLL: Duration = Duration::from_millis(10);

/// A running server with a folder of cities, of which one is named "two".
pub(crate) struct TestServer {
    pub(crate) folder: tempfile::TempDir,
    address: SocketAddr,
    metrics_address: Option<SocketAddr>,
    state: AppState,
    reload_signal: Arc<Notify>,
    stop: oneshot::Sender<()>,
    task: JoinHandle<Result<(), ServeError>>,
}

impl TestServer {
    /// Checks for changes only when a test asks for it, unless `change` says otherwise.
    pub(crate) async fn start(change: impl FnOnce(&mut ServeConfig)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        small_city::write_city(&folder.path().join("two"), "two");
        let mut config = ServeConfig { threads: 2, drain_secs: 1, ..ServeConfig::default() };
        config.reload.watch_secs = 0;
        change(&mut config);
        let server = HttpServer::new(Store::open(&[folder.path()]).unwrap(), &config).unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (address, state) = (listener.local_addr().unwrap(), server.state().clone());
        let metrics_address = server.metrics_address();
        let reload_signal = server.reload_signal();
        let (stop, stopped) = oneshot::channel::<()>();
        let task = tokio::spawn(server.run(listener, async {
            let _ = stopped.await;
        }));
        Self { folder, address, metrics_address, state, reload_signal, stop, task }
    }

    pub(crate) async fn connect(&self) -> TcpStream {
        TcpStream::connect(self.address).await.unwrap()
    }

    /// Connects from another address of the loopback network: another client.
    pub(crate) async fn connect_from(&self, ip: [u8; 4]) -> TcpStream {
        let socket = TcpSocket::new_v4().unwrap();
        socket.bind((ip, 0).into()).unwrap();
        socket.connect(self.address).await.unwrap()
    }

    /// Opens connections with one served request each.
    pub(crate) async fn hold(&self, count: usize) -> Vec<TcpStream> {
        let mut held = Vec::new();
        for _ in 0..count {
            let mut stream = self.connect().await;
            stream.write_all(b"GET /readyz HTTP/1.1\r\nHost: x\r\n\r\n").await.unwrap();
            assert_ne!(stream.read(&mut [0; 512]).await.unwrap(), 0);
            held.push(stream);
        }
        held
    }

    /// Sends one request to the listener for operators.
    pub(crate) async fn get_as_operator(&self, path: &str) -> String {
        let mut stream = TcpStream::connect(self.metrics_address.unwrap()).await.unwrap();
        exchange(&mut stream, &format!("GET {path} HTTP/1.1\r\nHost: x\r\n\r\n")).await
    }

    /// Sends one request on a new connection.
    pub(crate) async fn get(&self, path: &str, headers: &str) -> String {
        let mut stream = self.connect().await;
        exchange(&mut stream, &format!("GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n{headers}\r\n")).await
    }

    /// Repeats a request until its response is as expected.
    pub(crate) async fn get_until(&self, path: &str, is_expected: impl FnMut(&str) -> bool) {
        poll_until(path, async || self.get(path, "").await, is_expected).await;
    }

    /// As [`Self::get_until`] for metrics on the listener for operators. Returns them.
    pub(crate) async fn operator_metrics_until(&self, is_expected: impl FnMut(&str) -> bool) -> String {
        poll_until("/metrics", async || self.get_as_operator("/metrics").await, is_expected).await
    }

    /// Repeats a request until its response has the status.
    pub(crate) async fn status_until(&self, path: &str, headers: &str, status: u16) {
        let start = format!("HTTP/1.1 {status} ");
        poll_until(path, async || self.get(path, headers).await, |response| response.starts_with(&start)).await;
    }

    /// Makes the server check cities, certificate and tokens, and waits until it has: each check replaces the catalog.
    ///
    /// Other tokens and keys replace it before the cities are checked. After a change of those, use [`Self::reload_until`].
    pub(crate) async fn reload(&self) {
        let before = Arc::clone(&self.state.catalog());
        self.reload_signal.notify_one();
        let deadline = Instant::now() + PATIENCE;
        while Arc::ptr_eq(&before, &self.state.catalog()) {
            assert!(Instant::now() < deadline, "no reload");
            sleep(POLL).await;
        }
    }

    /// As [`Self::reload`], without a moment for the tasks of this thread, of which one accepts connections.
    pub(crate) fn reload_without_this_thread(&self) {
        let before = Arc::clone(&self.state.catalog());
        self.reload_signal.notify_one();
        wait_until("a reload on another thread", || !Arc::ptr_eq(&before, &self.state.catalog()));
    }

    /// Makes the server check cities, certificate and tokens once, and waits until a response has the status.
    pub(crate) async fn reload_until(&self, path: &str, headers: &str, status: u16) {
        self.reload_signal.notify_one();
        self.status_until(path, headers, status).await;
    }

    /// Whether there is a city of this name, for whomever.
    pub(crate) fn has_city(&self, name: &str) -> bool {
        self.state.catalog().store().city(name).is_some()
    }

    pub(crate) async fn stop(self) {
        self.stop.send(()).unwrap();
        timeout(PATIENCE, self.task).await.unwrap().unwrap().unwrap();
    }
}

/// Asks for `path` until the response is as expected, and returns it.
async fn poll_until(path: &str, ask: impl AsyncFn() -> String, mut is_expected: impl FnMut(&str) -> bool) -> String {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let response = ask().await;
        if is_expected(&response) {
            return response;
        }
        assert!(Instant::now() < deadline, "{path}: {response}");
        sleep(POLL).await;
    }
}

/// Sends a request. Returns everything that the server sends until it closes the connection.
pub(crate) async fn exchange(stream: &mut (impl AsyncReadExt + AsyncWriteExt + Unpin), request: &str) -> String {
    stream.write_all(request.as_bytes()).await.unwrap();
    String::from_utf8_lossy(&read_to_end(stream).await).into_owned()
}

/// Everything that the server sends until it closes the connection, in whatever way.
pub(crate) async fn read_to_end(stream: &mut (impl AsyncReadExt + Unpin)) -> Vec<u8> {
    let mut response = Vec::new();
    let _ = timeout(PATIENCE, stream.read_to_end(&mut response)).await.expect("the server does not close");
    response
}

/// Head and body of the response to options.
pub(crate) async fn post(server: &TestServer, path: &str, headers: &str, body: &str) -> (String, Vec<u8>) {
    let mut stream = server.connect().await;
    let length = body.len();
    let request = format!(
        "POST {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: {length}\r\n{headers}\r\n{body}"
    );
    // The server may respond, and close, before it has the whole body.
    let _ = stream.write_all(request.as_bytes()).await;
    let mut response = read_to_end(&mut stream).await;
    let end = response.windows(4).position(|window| window == b"\r\n\r\n").unwrap();
    let body = response.split_off(end + 4);
    (String::from_utf8(response).unwrap(), body)
}

/// Asserts that a request with these options is refused with a problem that has these words.
#[cfg(feature = "bake")]
pub(crate) async fn assert_refused(
    server: &TestServer,
    path: &str,
    headers: &str,
    options: &str,
    status: u16,
    words: &str,
) {
    let (head, problem) = post(server, path, headers, options).await;
    let response = head + &String::from_utf8(problem).unwrap();
    assert_problem(&response, status);
    assert!(response.contains(words), "{options}: {response}");
}

/// Asserts that of many requests, those that find no place in the queue are 503 at once, and all others are served.
#[cfg(feature = "bake")]
pub(crate) async fn assert_full_queue_sheds(server: &TestServer, path: &str, options: &str) {
    let requests: Vec<_> = (0..12).map(|_| post(server, path, JSON, options)).collect();
    let mut made = 0;
    for (head, _) in futures_util::future::join_all(requests).await {
        let is_made = head.starts_with("HTTP/1.1 200 ");
        assert!(is_made || head.starts_with("HTTP/1.1 503 ") && head.contains("retry-after: 1\r\n"), "{head}");
        made += usize::from(is_made);
    }
    assert!(made >= 2, "the one in work and the one that waits are made, not {made}");
}

#[track_caller]
pub(crate) fn assert_problem(response: &str, status: u16) {
    assert!(response.starts_with(&format!("HTTP/1.1 {status} ")), "{response}");
    assert!(response.contains("content-type: application/problem+json\r\n"), "{response}");
    let body = response.split_once("\r\n\r\n").unwrap().1;
    let problem: serde_json::Value = serde_json::from_str(body).unwrap();
    assert_eq!(problem["status"], status);
}

/// An HTTP/2 client whose streams have a window of `window_bytes`.
pub(crate) async fn http2(stream: TcpStream, window_bytes: u32) -> SendRequest<Bytes> {
    let mut builder = h2::client::Builder::new();
    let (client, connection) = builder.initial_window_size(window_bytes).handshake(stream).await.unwrap();
    tokio::spawn(connection);
    client.ready().await.unwrap()
}

/// Requests a tile `count` times and waits for the headers of all responses, whose bodies cannot be sent.
pub(crate) async fn stall(client: &mut SendRequest<Bytes>, count: usize) -> Vec<h2::RecvStream> {
    let request = || http::Request::get(format!("http://x{TILE}")).body(()).unwrap();
    let pending: Vec<ResponseFuture> = (0..count).map(|_| client.send_request(request(), true).unwrap().0).collect();
    let mut stalled = Vec::new();
    for response in pending {
        stalled.push(timeout(PATIENCE, response).await.unwrap().unwrap().into_body());
    }
    stalled
}

/// Replaces a city as the bake does: by two renames. `write` writes the new one to a folder.
///
/// Files that are written in place look unchanged to the server if the file system's clock has not ticked meanwhile.
pub(crate) fn replace_city(city: &Path, write: impl FnOnce(&Path)) {
    let [next, old] = [".next", ".old"].map(|name| city.with_file_name(name));
    write(&next);
    std::fs::rename(city, &old).unwrap();
    std::fs::rename(&next, city).unwrap();
    std::fs::remove_dir_all(&old).unwrap();
}
