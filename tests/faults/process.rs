//! A process that is killed, starved, and besieged.

use crate::{
    client::{Connection, addresses, while_asking},
    common,
    program::{Served, find, text, until},
};
use std::{
    fs,
    io::{Read, Write},
    net::{SocketAddr, TcpStream},
    path::PathBuf,
    process::Command,
    sync::atomic::Ordering::Relaxed,
    time::{Duration, Instant},
};

pub(crate) fn killed() {
    let folder = tempfile::tempdir().unwrap();
    common::write_city(folder.path(), "two");
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
    assert!(seen.whole.load(Relaxed) > 100);
}

pub(crate) fn no_descriptors() {
    let folder = tempfile::tempdir().unwrap();
    common::write_city(folder.path(), "two");
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

/// One address makes all connections here, and may have more than its share.
const SLOW_HEADERS: [&str; 3] = ["limits.connections=300", "limits.client_connections=300", "limits.header_secs=2"];

pub(crate) fn slow_headers() {
    let folder = tempfile::tempdir().unwrap();
    common::write_city(folder.path(), "two");
    let server = Served::start(text(folder.path()), &SLOW_HEADERS);
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

/// What a clock lies with, if it is installed.
pub(crate) fn libfaketime() -> Option<PathBuf> {
    let folders = ["/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib"];
    folders
        .map(|folder| PathBuf::from(folder).join("faketime/libfaketime.so.1"))
        .into_iter()
        .find(|path| path.is_file())
}

/// The year that a server thinks it is.
fn year(address: SocketAddr) -> u32 {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let date = answer.lines().find_map(|line| line.to_ascii_lowercase().strip_prefix("date:").map(str::to_owned));
    date.unwrap().split_whitespace().nth(3).unwrap().parse().unwrap()
}

pub(crate) fn clock_jumps() {
    let folder = tempfile::tempdir().unwrap();
    common::write_city(folder.path(), "two");
    let clock = tempfile::tempdir().unwrap();
    let file = clock.path().join("time");
    let set = |time: &str| {
        let new = clock.path().join("new");
        fs::write(&new, format!("{time}\n")).unwrap();
        fs::rename(new, &file).unwrap();
    };
    set("-15y");
    let environment = [
        ("LD_PRELOAD", text(&libfaketime().unwrap()).to_owned()),
        ("FAKETIME_TIMESTAMP_FILE", text(&file).to_owned()),
        ("FAKETIME_NO_CACHE", "1".to_owned()),
        // A clock that is set jumps; the one that measures does not.
        ("FAKETIME_DONT_FAKE_MONOTONIC", "1".to_owned()),
    ];
    let settings = ["limits.header_secs=2", "limits.client_rate=1000000", "limits.client_burst=1000000"];
    let server = Served::start_in(&environment, text(folder.path()), &settings);
    let first = year(server.address);
    let mut years = Vec::new();
    let seen = while_asking(server.address, || {
        for jump in ["+0", "+10y", "-15y"] {
            set(jump);
            std::thread::sleep(Duration::from_millis(1500));
            years.push(year(server.address));
        }
    });
    // The header of the date follows only forwards: hyper thinks that a second that has not come yet is still to come.
    assert_eq!(years, [first + 15, first + 25, first + 25], "the clock did not jump: the test tests nothing");
    let count = |count: &std::sync::atomic::AtomicU64| count.load(Relaxed);
    println!("the clock jumped by 15, 10 and -25 years under {} answers", count(&seen.whole));
    assert_eq!((count(&seen.wrong), count(&seen.refused), count(&seen.broken)), (0, 0, 0));
    assert!(count(&seen.whole) > 100);
}

pub(crate) fn no_memory() {
    let folder = tempfile::tempdir().unwrap();
    common::write_city(folder.path(), "two");
    let mut server = Served::start(text(folder.path()), &[]);
    let address = server.address;
    let status = fs::read_to_string(format!("/proc/{}/status", server.pid())).unwrap();
    let mapped_kib =
        status.lines().find_map(|line| line.strip_prefix("VmSize:")?.trim().split(' ').next()?.parse().ok());
    // What it has, and not one block more than that of an allocator.
    let limit = mapped_kib.map(|kib: u64| kib * 1024 + (1 << 20)).unwrap();
    let (pid, limit) = (server.pid().to_string(), format!("--as={limit}:{limit}"));
    assert!(Command::new(find("prlimit").unwrap()).args(["--pid", &pid, &limit]).status().unwrap().success());
    let seen = while_asking(address, || {
        let mut held = Vec::new();
        for number in 0..2000 {
            let Ok(mut stream) = TcpStream::connect(address) else { break };
            let _ = write!(stream, "GET /v1/cities HTTP/1.1\r\nHost: x\r\nX-Long: {}", "x".repeat(number % 8000));
            held.push(stream);
        }
        std::thread::sleep(Duration::from_millis(500));
    });
    let alive = server.is_alive();
    println!("{} answers at its limit of memory, alive after it: {alive}", seen.whole.load(Relaxed));
    assert_eq!(seen.wrong.load(Relaxed), 0, "wrong bytes were served");
    // Memory that is refused ends a process; whoever watches it starts it again.
    let server = if alive { server } else { Served::start_at(text(folder.path()), address, &[]) };
    until("it answers again", || {
        addresses(common::VERSION)
            .iter()
            .all(|(_, path)| Connection::new(server.address).get(path).is_ok_and(|answer| answer.status == 200))
    });
}
