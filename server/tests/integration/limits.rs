//! The share of a running server that one client may use, and service for others at the same time.

use crate::test_server::{PATIENCE, TILE, TestServer, assert_problem, exchange, http2, read_to_end, stall};
use insula_server::store::{RetentionPolicy, Store};
use insula_test_support::small_city;
use std::time::Duration;
use tokio::io::AsyncWriteExt;
use tokio::time::timeout;

const ATTACKER: [u8; 4] = [127, 0, 0, 2];

#[tokio::test]
async fn a_response_is_in_flight_until_it_is_sent() {
    let server = TestServer::start(|config| {
        // All connections have one thread: one that can go on does so between two answers to another.
        config.threads = 1;
        config.limits.write_secs = 600;
    })
    .await;
    let mut deaf = server.connect().await;
    let requests = format!("GET {TILE} HTTP/1.1\r\nHost: x\r\n\r\n").repeat(1000);
    let client = tokio::spawn(async move { while deaf.write_all(requests.as_bytes()).await.is_ok() {} });
    // The client reads nothing, so after a number of responses the next one cannot be sent.
    let mut before = None;
    let is_stuck = |metrics: &str| {
        let sent = metrics.lines().find(|line| line.starts_with("insula_requests_total{route=\"blockmaps\""));
        let sent = sent.map(str::to_owned);
        let has_sent_none = sent.is_some() && sent == before;
        before = sent;
        has_sent_none && metrics.contains("insula_requests_in_flight 1\n")
    };
    server.get_until("/metrics", is_stuck).await;
    client.abort();
    server.get_until("/metrics", |metrics| metrics.contains("insula_requests_in_flight 0\n")).await;
    server.stop().await;
}

#[tokio::test]
async fn stalled_streams_of_one_address_lock_nobody_out() {
    let server = TestServer::start(|config| (config.limits.in_flight, config.limits.write_secs) = (16, 600)).await;
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
    let until_reset = async |window_bytes| {
        let mut client = http2(server.connect().await, window_bytes).await;
        let mut bodies = stall(&mut client, 3).await;
        for body in &mut bodies {
            let end = async { while let Some(Ok(_)) = body.data().await {} };
            timeout(PATIENCE, end).await.expect("the stream is still open");
        }
    };
    tokio::join!(until_reset(0), until_reset(1));
    let has_count = |metrics: &str| {
        let count =
            metrics.lines().find_map(|line| line.strip_prefix("insula_client_timeouts_total{kind=\"stream\"} "));
        count.is_some_and(|count| count.parse::<u32>().unwrap() >= 4)
            && metrics.contains("insula_requests_in_flight 0\n")
    };
    server.get_until("/metrics", has_count).await;
    server.stop().await;
}

#[tokio::test]
async fn health_is_reported_when_connections_are_full() {
    let server = TestServer::start(|config| {
        (config.limits.connections, config.limits.client_connections) = (4, 4);
        config.metrics_address = Some("127.0.0.1:0".into());
    })
    .await;
    let held = server.hold(4).await;
    for _ in 0..5 {
        // The connection before may still be closing.
        server.status_until("/healthz", "", 200).await;
        server.status_until(TILE, "", 503).await;
        assert!(server.get_as_operator("/healthz").await.starts_with("HTTP/1.1 200"));
    }
    drop(held);
    server.stop().await;
}

#[tokio::test]
async fn an_address_that_has_its_share_can_still_ask_for_health() {
    let server = TestServer::start(|config| config.limits.connections = 4).await;
    let mut held = server.hold(3).await;
    // Of the fourth and fifth connection, requests are rejected. They stay open as long as they have sent none.
    held.extend([server.connect().await, server.connect().await]);
    assert!(server.get("/healthz", "").await.starts_with("HTTP/1.1 200"));
    assert_problem(&server.get(TILE, "").await, 503);
    drop(held);
    server.stop().await;
}

#[tokio::test]
async fn one_address_cannot_take_all_connections() {
    let server = TestServer::start(|config| {
        (config.limits.connections, config.limits.header_secs) = (8, 600);
        config.metrics_address = Some("127.0.0.1:0".into());
    })
    .await;
    let mut held = Vec::new();
    for _ in 0..40 {
        held.push(server.connect_from(ATTACKER).await);
    }
    for _ in 0..5 {
        // Two connections are left to others. The connections before may still be closing.
        server.status_until(TILE, "", 200).await;
    }
    // At most 17 were open besides those that are served. They end after two seconds, and others take their places.
    let metrics = server.get_as_operator("/metrics").await;
    let refused = metrics.lines().find_map(|line| line.strip_prefix("insula_connections_refused_total "));
    assert!((1..=17).contains(&refused.unwrap().parse::<u32>().unwrap()), "{metrics}");
    let request = format!("GET {TILE} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
    let mut served = 0;
    for mut stream in held {
        // Most are closed already.
        let _ = stream.write_all(request.as_bytes()).await;
        served += u32::from(read_to_end(&mut stream).await.starts_with(b"HTTP/1.1 200"));
    }
    assert_eq!(served, 6, "three quarters of eight");
    server.stop().await;
}

/// A check of many cities takes seconds.
#[tokio::test]
async fn a_touched_city_does_not_delay_connections() {
    let server = TestServer::start(|_| {}).await;
    server.reload().await;
    small_city::write_city(&server.folder.path().join("three"), "three");
    // The task that accepts connections runs on this thread, too: what needs no moment of it delays none.
    server.reload_without_this_thread();
    assert!(server.get("/v1/cities/three", "").await.starts_with("HTTP/1.1 200"));
    server.stop().await;
}

#[tokio::test]
async fn the_last_city_of_a_folder_can_be_removed() {
    let server = TestServer::start(|config| config.reload.watch_secs = 1).await;
    std::fs::remove_dir_all(server.folder.path().join("two")).unwrap();
    server.status_until(TILE, "", 404).await;
    assert_problem(&server.get("/readyz", "").await, 503);
    small_city::write_city(&server.folder.path().join("two"), "two");
    server.status_until(TILE, "", 200).await;
    server.stop().await;
}

#[tokio::test]
async fn a_city_whose_own_folder_is_removed_is_not_served_any_more() {
    let folder = tempfile::tempdir().unwrap();
    let city = folder.path().join("two");
    small_city::write_city(&city, "two");
    let store = Store::open(&[&city]).unwrap();
    std::fs::remove_dir_all(&city).unwrap();
    let retention = RetentionPolicy { time: Duration::ZERO, versions: 0 };
    let mut left = Vec::new();
    let mut store = store;
    for _ in 0..3 {
        store = store.reload(retention, false).await.store;
        left.push(store.cities().len());
    }
    assert_eq!(left, [1, 1, 0]);
}
