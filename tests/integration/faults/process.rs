//! A server process that is killed, lacks resources, or has many slow clients.

use super::client::{Connection, request_during, tile_paths};
use super::server::{self, ANY_PORT, metric};
use insula_test_support::programs::{ServerProcess, find_installed, path_text, program, wait_until};
use insula_test_support::{http, small_city, tier};
use insula_tests::ports;
use std::fs;
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

/// Starts the server on an address, which may be that of one that has ended.
fn start_at(folder: &tempfile::TempDir, address: SocketAddr) -> ServerProcess {
    ServerProcess::start(&mut server::command(), path_text(folder.path()), &address.to_string(), &[]).unwrap()
}

/// Waits until `counter` has grown by `n`.
fn wait_for(what: &str, counter: &AtomicU64, n: u64) {
    let begin = counter.load(Relaxed);
    wait_until(what, || counter.load(Relaxed) >= begin + n);
}

/// Kills the server with SIGKILL and restarts it, again and again under load.
pub(super) fn killed() {
    let (folder, address) = (small_city::temporary_city(), ports::restartable().unwrap());
    let mut server = Some(start_at(&folder, address));
    let kills = if tier::is_full() { 10 } else { 3 };
    request_during(address, |counts| {
        for _ in 0..kills {
            wait_for("responses", &counts.intact, 40);
            drop(server.take());
            wait_for("lost connections", &counts.broken, 1);
            server = Some(start_at(&folder, address));
        }
        wait_for("responses after the last restart", &counts.intact, 40);
    });
}

/// Opens more connections than the server has file descriptors, then closes them.
pub(super) fn no_descriptors() {
    let folder = small_city::temporary_city();
    let mut shell = Command::new("sh");
    shell.args(["-c", "ulimit -n 64; exec \"$0\" \"$@\""]).arg(program("insula-server").unwrap());
    let mut server = ServerProcess::start(&mut shell, path_text(folder.path()), ANY_PORT, &[]).unwrap();
    let mut held: Vec<_> = (0..200).map(|_| TcpStream::connect(server.address).unwrap()).collect();
    wait_until("all file descriptors are in use", || server.descriptors() >= 64);
    assert!(server.is_alive());
    held.drain(..150);
    wait_until("it responds when there are descriptors again", || {
        Connection::new(server.address).serves_all(small_city::VERSION)
    });
}

/// One address makes all connections here, and may have more than its share.
const SLOW_HEADERS: [&str; 3] = ["limits.connections=300", "limits.client_connections=300", "limits.header_secs=1"];

/// 250 clients send their headers a byte at a time.
pub(super) fn slow_headers() {
    let (_folder, server) = server::start_small_city(&SLOW_HEADERS);
    let (_, path) = &tile_paths(small_city::VERSION)[0];
    let mut slow: Vec<TcpStream> = Vec::new();
    wait_until("250 slow connections are closed", || {
        while slow.len() < 250 {
            let mut stream = TcpStream::connect(server.address).unwrap();
            stream.write_all(b"GET / HTTP/1.1\r\nX: ").unwrap();
            slow.push(stream);
        }
        slow.retain_mut(|stream| stream.write_all(b"x").is_ok());
        let response = Connection::new(server.address).get(path).unwrap();
        assert_eq!(response.status, 200, "another client is refused");
        metric(server.address, "insula_client_timeouts_total{kind=\"headers\"}") >= 250.0
    });
}

/// The library that changes a process's clock, if it is installed.
pub(super) fn libfaketime() -> Option<PathBuf> {
    let folders = ["/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib"];
    let paths = folders.map(|folder| PathBuf::from(folder).join("faketime/libfaketime.so.1"));
    paths.into_iter().find(|path| path.is_file())
}

/// The year of a response's date.
fn year(address: SocketAddr) -> u32 {
    let request = b"GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n";
    let response = String::from_utf8(http::exchange(address, request).unwrap()).unwrap();
    let date = response.lines().find_map(|line| line.to_ascii_lowercase().strip_prefix("date:").map(str::to_owned));
    date.unwrap().split_whitespace().nth(3).unwrap().parse().unwrap()
}

/// Sets the clock by 15, 10 and -25 years under load.
pub(super) fn clock_jumps() {
    let folder = small_city::temporary_city();
    let clock = tempfile::tempdir().unwrap();
    let file = clock.path().join("time");
    let set = |time: &str| {
        let new = clock.path().join("new");
        fs::write(&new, format!("{time}\n")).unwrap();
        fs::rename(new, &file).unwrap();
    };
    set("-15y");
    let environment = [
        ("LD_PRELOAD", path_text(&libfaketime().unwrap()).to_owned()),
        ("FAKETIME_TIMESTAMP_FILE", path_text(&file).to_owned()),
        ("FAKETIME_NO_CACHE", "1".to_owned()),
        // Setting a clock does not change the monotonic one.
        ("FAKETIME_DONT_FAKE_MONOTONIC", "1".to_owned()),
    ];
    let settings = ["limits.header_secs=60", "limits.client_rate=1000000", "limits.client_burst=1000000"];
    let mut command = server::command();
    command.envs(environment);
    let server = ServerProcess::start(&mut command, path_text(folder.path()), ANY_PORT, &settings).unwrap();
    let first = year(server.address);
    let counts = request_during(server.address, |counts| {
        // hyper caches the date header until the clock has passed it, so the year does not go back.
        for (jump, expected) in [("+0", first + 15), ("+10y", first + 25), ("-15y", first + 25)] {
            set(jump);
            wait_until("the clock jumps", || year(server.address) == expected);
            wait_for("responses after the jump", &counts.intact, 100);
        }
    });
    let count = |count: &AtomicU64| count.load(Relaxed);
    println!("the clock jumped by 15, 10 and -25 years during {} responses", count(&counts.intact));
    assert_eq!((count(&counts.refused), count(&counts.broken)), (0, 0));
}

/// Limits the server's memory to what it has, then opens many connections.
pub(super) fn no_memory() {
    let (folder, address) = (small_city::temporary_city(), ports::restartable().unwrap());
    let mut server = start_at(&folder, address);
    let status = fs::read_to_string(format!("/proc/{}/status", server.pid())).unwrap();
    let mapped_kib =
        status.lines().find_map(|line| line.strip_prefix("VmSize:")?.trim().split(' ').next()?.parse().ok());
    let limit = mapped_kib.map(|kib: u64| kib * 1024 + (1 << 20)).unwrap();
    let (pid, limit) = (server.pid().to_string(), format!("--as={limit}:{limit}"));
    assert!(Command::new(find_installed("prlimit").unwrap()).args(["--pid", &pid, &limit]).status().unwrap().success());
    let counts = request_during(address, |counts| {
        let mut held = Vec::new();
        for number in 0..2000 {
            let Ok(mut stream) = TcpStream::connect(address) else { break };
            let _ = write!(stream, "GET /v1/cities HTTP/1.1\r\nHost: x\r\nX-Long: {}", "x".repeat(number % 8000));
            held.push(stream);
        }
        let begin = counts.all();
        wait_until("requests at the limit", || counts.all() >= begin + 200);
    });
    let alive = server.is_alive();
    println!("{} responses at the memory limit, alive after it: {alive}", counts.intact.load(Relaxed));
    // A refused allocation ends the process; its supervisor restarts it.
    let server = if alive { server } else { start_at(&folder, address) };
    wait_until("it responds again", || Connection::new(server.address).serves_all(small_city::VERSION));
}
