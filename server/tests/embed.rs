//! The server inside another program, as the client starts it.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use insula_server::{config::ServeConfig, http::serve, store::Store};
use std::time::{Duration, Instant};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    sync::oneshot,
    time::timeout,
};

#[tokio::test]
async fn it_serves_until_told_and_drains_no_longer_than_told() {
    let folder = tempfile::tempdir().unwrap();
    common::city(folder.path(), "two");
    let store = Store::open(&[folder.path()]).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = oneshot::channel::<()>();
    let config = ServeConfig { drain_secs: 1, ..ServeConfig::default() };
    let server = tokio::spawn(async move {
        serve(listener, store, &config, async {
            let _ = stopped.await;
        })
        .await
    });
    let mut asked = TcpStream::connect(address).await.unwrap();
    asked.write_all(b"GET /v1/cities HTTP/1.0\r\n\r\n").await.unwrap();
    let mut answer = String::new();
    asked.read_to_string(&mut answer).await.unwrap();
    assert!(answer.contains("\"two\""), "{answer}");
    // A request whose headers never end must not hold the server up for longer than `drain_secs`.
    let mut stuck = TcpStream::connect(address).await.unwrap();
    stuck.write_all(b"GET / HTTP/1.1\r\nHost:").await.unwrap();
    tokio::time::sleep(Duration::from_millis(100)).await;
    let start = Instant::now();
    stop.send(()).unwrap();
    timeout(Duration::from_secs(8), server).await.unwrap().unwrap().unwrap();
    assert!((0.9..6.0).contains(&start.elapsed().as_secs_f64()), "{:?}", start.elapsed());
    assert_eq!(stuck.read(&mut [0; 1]).await.unwrap_or(0), 0, "it was dropped");
}
