//! The share of a running server that one client may use, and service for others at the same time.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod test_server;

use bytes::Bytes;
use h2::client::{ResponseFuture, SendRequest};
use insula_server::{
    config::ServeConfig,
    http::{AppState, HttpService},
    store::Store,
};
use insula_test_support::small_city;
use std::time::{Duration, Instant};
use test_server::{PATIENCE, TILE, TestServer, assert_problem, exchange};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    time::{sleep, timeout},
};

const ATTACKER: [u8; 4] = [127, 0, 0, 2];

#[tokio::test]
async fn a_response_is_in_flight_until_it_is_sent() {
    let server = TestServer::start(|_| {}).await;
    let mut deaf = server.connect().await;
    let requests = format!("GET {TILE} HTTP/1.1\r\nHost: x\r\n\r\n").repeat(1000);
    // Writes until the server does not read any more, because its responses are not read.
    while let Ok(written) = timeout(Duration::from_millis(300), deaf.write_all(requests.as_bytes())).await {
        written.unwrap();
    }
    server.get_until("/metrics", |metrics| metrics.contains("insula_requests_in_flight 1\n")).await;
    drop(deaf);
    server.get_until("/metrics", |metrics| metrics.contains("insula_requests_in_flight 0\n")).await;
    server.stop().await;
}

/// An HTTP/2 client whose streams have a window of `window_bytes`.
async fn http2(stream: TcpStream, window_bytes: u32) -> SendRequest<Bytes> {
    let mut builder = h2::client::Builder::new();
    let (client, connection) = builder.initial_window_size(window_bytes).handshake(stream).await.unwrap();
    tokio::spawn(connection);
    client.ready().await.unwrap()
}

/// Requests a tile `count` times and waits for the headers of all responses, whose bodies cannot be sent.
async fn stall(client: &mut SendRequest<Bytes>, count: usize) -> Vec<h2::RecvStream> {
    let request = || http::Request::get(format!("http://x{TILE}")).body(()).unwrap();
    let pending: Vec<ResponseFuture> = (0..count).map(|_| client.send_request(request(), true).unwrap().0).collect();
    let mut stalled = Vec::new();
    for response in pending {
        stalled.push(timeout(PATIENCE, response).await.unwrap().unwrap().into_body());
    }
    stalled
}

#[tokio::test]
async fn stalled_streams_of_one_address_lock_nobody_out() {
    let server = TestServer::start(|config| config.limits.in_flight = 16).await;
    let mut held = Vec::new();
    for _ in 0..4 {
        let mut client = http2(server.connect_from(ATTACKER).await, 0).await;
        held.push((stall(&mut client, 8).await, client));
    }
    for _ in 0..20 {
        let response = server.get(TILE, "").await;
        assert!(response.starts_with("HTTP/1.1 200"), "{response}");
    }
    let mut stream = server.connect_from(ATTACKER).await;
    let request = format!("GET {TILE} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
    assert_problem(&exchange(&mut stream, &request).await, 503);
    drop(held);
    server.get_until("/metrics", |metrics| metrics.contains("insula_requests_in_flight 0\n")).await;
    server.stop().await;
}

#[tokio::test]
async fn streams_without_progress_are_reset() {
    let server = TestServer::start(|config| config.limits.write_secs = 1).await;
    // One client whose stream takes nothing, and one whose stream takes a byte, after which the rest waits in the connection.
    for window_bytes in [0, 1] {
        let mut client = http2(server.connect().await, window_bytes).await;
        let mut bodies = stall(&mut client, 3).await;
        for body in &mut bodies {
            let end = async { while let Some(Ok(_)) = body.data().await {} };
            timeout(PATIENCE, end).await.expect("the stream is still open");
        }
    }
    let has_count = |metrics: &str| {
        let count =
            metrics.lines().find_map(|line| line.strip_prefix("insula_client_timeouts_total{kind=\"stream\"} "));
        count.is_some_and(|count| count.parse::<u32>().unwrap() >= 4)
            && metrics.contains("insula_requests_in_flight 0\n")
    };
    server.get_until("/metrics", has_count).await;
    server.stop().await;
}

/// Opens connections with one served request each.
async fn hold(server: &TestServer, count: usize) -> Vec<TcpStream> {
    let mut held = Vec::new();
    for _ in 0..count {
        let mut stream = server.connect().await;
        stream.write_all(b"GET /readyz HTTP/1.1\r\nHost: x\r\n\r\n").await.unwrap();
        assert_ne!(stream.read(&mut [0; 512]).await.unwrap(), 0);
        held.push(stream);
    }
    held
}

#[tokio::test]
async fn health_is_reported_when_connections_are_full() {
    let server = TestServer::start(|config| {
        (config.limits.connections, config.limits.client_connections) = (4, 4);
        config.metrics_address = Some("127.0.0.1:0".into());
    })
    .await;
    let held = hold(&server, 4).await;
    for _ in 0..5 {
        // The connection before may still be closing.
        server.get_until("/healthz", |response| response.starts_with("HTTP/1.1 200")).await;
        server.get_until(TILE, |response| response.starts_with("HTTP/1.1 503")).await;
        assert!(server.get_as_operator("/healthz").await.starts_with("HTTP/1.1 200"));
    }
    drop(held);
    server.stop().await;
}

#[tokio::test]
async fn an_address_that_has_its_share_can_still_ask_for_health() {
    let server = TestServer::start(|config| config.limits.connections = 4).await;
    let mut held = hold(&server, 3).await;
    // Of the fourth and fifth connection, requests are rejected. They stay open as long as they have sent none.
    held.extend([server.connect().await, server.connect().await]);
    assert!(server.get("/healthz", "").await.starts_with("HTTP/1.1 200"));
    assert_problem(&server.get(TILE, "").await, 503);
    drop(held);
    server.stop().await;
}

#[tokio::test]
async fn one_address_cannot_take_all_connections() {
    let server = TestServer::start(|config| config.limits.connections = 8).await;
    let mut held = Vec::new();
    for _ in 0..40 {
        held.push(server.connect_from(ATTACKER).await);
    }
    for _ in 0..5 {
        // Two connections are left to others. The connections before may still be closing.
        server.get_until(TILE, |response| response.starts_with("HTTP/1.1 200")).await;
    }
    server.get_until("/metrics", |metrics| metrics.contains("insula_connections_refused_total 17\n")).await;
    server.stop().await;
}

#[tokio::test]
async fn a_touched_city_does_not_delay_connections() {
    let server = TestServer::start(|_| {}).await;
    for number in 0..150 {
        let name = format!("city-{number}");
        small_city::write_city(&server.folder.path().join(&name), &name);
    }
    server.reload().await;
    let start = Instant::now();
    drop(HttpService::new(AppState::new(Store::open(&[server.folder.path()]).unwrap(), &ServeConfig::default())));
    let full_secs = start.elapsed().as_secs_f64();
    // The acceptor runs on this thread as well: what delays this task delays it.
    let ticker = tokio::spawn(async {
        let mut longest_secs = 0.0f64;
        loop {
            let start = Instant::now();
            sleep(Duration::from_millis(1)).await;
            longest_secs = longest_secs.max(start.elapsed().as_secs_f64());
            LONGEST.set(longest_secs);
        }
    });
    small_city::write_city(&server.folder.path().join("city-7"), "city-7");
    let start = Instant::now();
    server.reload().await;
    let (reload_secs, longest_secs) = (start.elapsed().as_secs_f64(), LONGEST.get());
    ticker.abort();
    assert!(longest_secs < full_secs / 3.0, "{longest_secs} s of {full_secs} s, in a reload of {reload_secs} s");
    assert!(server.get("/v1/cities/city-7", "").await.starts_with("HTTP/1.1 200"));
    server.stop().await;
}

thread_local! {
    static LONGEST: std::cell::Cell<f64> = const { std::cell::Cell::new(0.0) };
}

#[tokio::test]
async fn the_last_city_of_a_folder_can_be_removed() {
    let server = TestServer::start(|config| config.reload.watch_secs = 1).await;
    std::fs::remove_dir_all(server.folder.path().join("two")).unwrap();
    server.get_until(TILE, |response| response.starts_with("HTTP/1.1 404")).await;
    assert_problem(&server.get("/readyz", "").await, 503);
    small_city::write_city(&server.folder.path().join("two"), "two");
    server.get_until(TILE, |response| response.starts_with("HTTP/1.1 200")).await;
    server.stop().await;
}

#[tokio::test]
async fn a_city_whose_own_folder_is_removed_is_not_served_any_more() {
    let folder = tempfile::tempdir().unwrap();
    let city = folder.path().join("two");
    small_city::write_city(&city, "two");
    let store = Store::open(&[&city]).unwrap();
    std::fs::remove_dir_all(&city).unwrap();
    let retention = insula_server::store::RetentionPolicy { time: Duration::ZERO, versions: 0 };
    let mut left = Vec::new();
    let mut store = store;
    for _ in 0..3 {
        store = store.reload(retention, false).await.store;
        left.push(store.cities().len());
    }
    assert_eq!(left, [1, 1, 0]);
}
