//! A running server for the tests of one program, and a client of raw HTTP/1.1.
#![allow(dead_code, reason = "each test program uses a part")]

use insula_server::{
    config::ServeConfig,
    http::{AppState, HttpServer, ServeError},
    store::Store,
};
use insula_test_support::small_city;
use std::{
    net::SocketAddr,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpSocket, TcpStream},
    sync::{Notify, oneshot},
    task::JoinHandle,
    time::{sleep, timeout},
};

pub(crate) const TILE: &str = "/v1/cities/two/0123456789abcdef/blockmaps/1/1/1";
/// Longest wait for anything that must happen.
pub(crate) const PATIENCE: Duration = Duration::from_secs(5);

/// A running server with a folder of cities, of which one is named "two".
pub(crate) struct TestServer {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) address: SocketAddr,
    pub(crate) metrics_address: Option<SocketAddr>,
    state: AppState,
    reload_signal: Arc<Notify>,
    stop: oneshot::Sender<()>,
    task: JoinHandle<Result<(), ServeError>>,
}

impl TestServer {
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
    pub(crate) async fn get_until(&self, path: &str, is_expected: impl Fn(&str) -> bool) {
        self.get_with_until(path, "", is_expected).await;
    }

    /// As [`Self::get_until`] with headers.
    pub(crate) async fn get_with_until(&self, path: &str, headers: &str, is_expected: impl Fn(&str) -> bool) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let response = self.get(path, headers).await;
            if is_expected(&response) {
                return;
            }
            assert!(Instant::now() < deadline, "{path}: {response}");
            sleep(Duration::from_millis(20)).await;
        }
    }

    /// Makes the server check cities, certificate and tokens, and waits until it has: each check replaces the catalog.
    pub(crate) async fn reload(&self) {
        let before = Arc::clone(&self.state.catalog());
        self.reload_signal.notify_one();
        let deadline = Instant::now() + PATIENCE;
        while Arc::ptr_eq(&before, &self.state.catalog()) {
            assert!(Instant::now() < deadline, "no reload");
            sleep(Duration::from_millis(5)).await;
        }
    }

    pub(crate) async fn stop(self) {
        self.stop.send(()).unwrap();
        timeout(PATIENCE, self.task).await.unwrap().unwrap().unwrap();
    }
}

/// Sends a request. Returns everything that the server sends until it closes the connection.
pub(crate) async fn exchange(stream: &mut (impl AsyncReadExt + AsyncWriteExt + Unpin), request: &str) -> String {
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut response = Vec::new();
    let _ = timeout(PATIENCE, stream.read_to_end(&mut response)).await.expect("the server does not close");
    String::from_utf8_lossy(&response).into_owned()
}

#[track_caller]
pub(crate) fn assert_problem(response: &str, status: u16) {
    assert!(response.starts_with(&format!("HTTP/1.1 {status} ")), "{response}");
    assert!(response.contains("content-type: application/problem+json\r\n"), "{response}");
    let body = response.split_once("\r\n\r\n").unwrap().1;
    let problem: serde_json::Value = serde_json::from_str(body).unwrap();
    assert_eq!(problem["status"], status);
}
