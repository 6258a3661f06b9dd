//! A process that is killed, starved, and besieged.

use crate::{
    client::{Connection, addresses, while_asking},
    common,
    program::{Served, text, until},
};
use std::{
    io::Write,
    net::TcpStream,
    sync::atomic::Ordering::Relaxed,
    time::{Duration, Instant},
};

pub(crate) fn killed() {
    let folder = tempfile::tempdir().unwrap();
    common::city(folder.path(), "two");
    let mut server = Some(Served::start(text(folder.path()), &[]));
    let address = server.as_ref().unwrap().address;
    let seen = while_asking(address, || {
        for _ in 0..10 {
            std::thread::sleep(Duration::from_millis(150));
            // Its end is SIGKILL.
            drop(server.take());
            server = Some(Served::start_at(text(folder.path()), address, &[]));
        }
        std::thread::sleep(Duration::from_millis(150));
    });
    assert_eq!(seen.wrong.load(Relaxed), 0, "wrong bytes were served");
    assert!(seen.broken.load(Relaxed) > 0, "nobody noticed: the test tests nothing");
    assert!(seen.whole.load(Relaxed) > 1000);
}

pub(crate) fn no_descriptors() {
    let folder = tempfile::tempdir().unwrap();
    common::city(folder.path(), "two");
    let mut server = Served::start_limited("-n 64", text(folder.path()), &[]);
    let mut held: Vec<_> = (0..200).map(|_| TcpStream::connect(server.address).unwrap()).collect();
    std::thread::sleep(Duration::from_millis(500));
    assert!(server.is_alive());
    held.drain(..150);
    let (_, path) = &addresses(common::VERSION)[0];
    until("it answers when there are descriptors again", || {
        Connection::new(server.address).get(path).is_ok_and(|answer| answer.status == 200)
    });
}

pub(crate) fn slow_headers() {
    let folder = tempfile::tempdir().unwrap();
    common::city(folder.path(), "two");
    let server = Served::start(text(folder.path()), &["limits.connections=300", "limits.header_secs=2"]);
    let (_, path) = &addresses(common::VERSION)[0];
    // More of them than there are places, for longer than one of them is allowed.
    let start = Instant::now();
    let mut slow: Vec<TcpStream> = Vec::new();
    let mut longest = Duration::ZERO;
    while start.elapsed() < Duration::from_secs(6) {
        while slow.len() < 250 {
            let mut stream = TcpStream::connect(server.address).unwrap();
            stream.write_all(b"GET / HTTP/1.1\r\nX: ").unwrap();
            slow.push(stream);
        }
        slow.retain_mut(|stream| stream.write_all(b"x").is_ok());
        let asked = Instant::now();
        let answer = Connection::new(server.address).get(path).unwrap();
        assert_eq!(answer.status, 200, "kept out");
        longest = longest.max(asked.elapsed());
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(longest < Duration::from_secs(2), "an answer took {longest:?}");
    assert!(server.metric("insula_client_timeouts_total{kind=\"headers\"}") >= 250.0, "they were not closed");
}
