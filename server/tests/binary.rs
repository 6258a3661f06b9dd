//! The built program, as scripts and people meet it.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::Path,
    process::{Child, ChildStdout, Command, Output, Stdio},
    time::{Duration, Instant},
};

fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    command.env_remove("RUST_LOG").stdin(Stdio::null());
    command
}

fn run(args: &[&str]) -> Output {
    program().args(args).output().unwrap()
}

/// The one line that a failed command must have written, and its exit code.
fn failure(args: &[&str]) -> (String, Option<i32>) {
    let output = run(args);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.starts_with("error: ") && text.matches('\n').count() == 1 && text.ends_with('\n'), "{text:?}");
    (text, output.status.code())
}

fn city() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    common::city(folder.path(), "two");
    folder
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A running server; killed at the end if the test has not ended it.
struct ServerProcess {
    child: Child,
    out: BufReader<ChildStdout>,
    address: String,
}

impl ServerProcess {
    fn start(city: &Path) -> Self {
        let mut child = program()
            .args(["serve", text(city), "--listen", "127.0.0.1:0"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        let address = line.trim_end().strip_prefix("listening on http://").expect(&line).to_owned();
        Self { child, out, address }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        stream
    }

    fn get(&self, path: &str) -> String {
        let mut stream = self.connect();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        String::from_utf8_lossy(&answer).into_owned()
    }

    fn signal(&self, name: &str) {
        assert!(Command::new("kill").args([name, &self.child.id().to_string()]).status().unwrap().success());
    }

    /// Waits for its end: exit code and what else it said on standard output.
    fn wait(mut self) -> (Option<i32>, String) {
        let deadline = Instant::now() + Duration::from_secs(15);
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < deadline, "it does not end");
            std::thread::sleep(Duration::from_millis(10));
        };
        let mut rest = String::new();
        self.out.read_to_string(&mut rest).unwrap();
        (status.code(), rest)
    }
}

impl Drop for ServerProcess {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn port_0_serves_and_says_where() {
    let city = city();
    let server = ServerProcess::start(city.path());
    assert!(!server.address.ends_with(":0"), "{}", server.address);
    assert!(server.get("/readyz").starts_with("HTTP/1.1 200"));
    let answer = server.get("/v1/cities/two/0123456789abcdef/blockmaps/0/0/0");
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("INSU"), "{answer}");
    assert!(server.get("/v1/cities/..%2f..%2fetc%2fpasswd").starts_with("HTTP/1.1 404"));
}

#[test]
fn http_2_is_spoken() {
    let city = city();
    let server = ServerProcess::start(city.path());
    let mut stream = server.connect();
    // The preface and an empty SETTINGS frame; a server of HTTP/2 answers with its own SETTINGS (type 4).
    stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").unwrap();
    let mut frame = [0; 9];
    stream.read_exact(&mut frame).unwrap();
    assert_eq!(frame[3], 4, "{frame:?}");
}

#[test]
fn signals_drain_and_end_with_0() {
    for signal in ["-TERM", "-INT"] {
        let city = city();
        let server = ServerProcess::start(city.path());
        // One connection idles, one has half a request on the way and must still be answered.
        let mut idle = server.connect();
        write!(idle, "GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n").unwrap();
        let mut first = [0; 15];
        idle.read_exact(&mut first).unwrap();
        let mut busy = server.connect();
        write!(busy, "GET /v1/cities/two HTTP/1.1\r\nHost: x\r\n").unwrap();
        std::thread::sleep(Duration::from_millis(200));
        let start = Instant::now();
        server.signal(signal);
        std::thread::sleep(Duration::from_millis(200));
        assert!(TcpStream::connect(&server.address).is_err(), "it still accepts connections");
        write!(busy, "\r\n").unwrap();
        let mut answer = String::new();
        busy.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("EPSG:7415"), "{answer:?}");
        let (code, rest) = server.wait();
        assert_eq!((code, rest.as_str()), (Some(0), ""), "exactly one line on standard output");
        assert!(start.elapsed() < Duration::from_secs(9), "it waited for the idle connection");
    }
}

#[test]
fn a_port_in_use_is_one_line() {
    let city = city();
    let server = ServerProcess::start(city.path());
    let (line, code) = failure(&["serve", text(city.path()), "--listen", &server.address]);
    assert_eq!(code, Some(1));
    assert!(line.contains(&server.address) && line.contains("--listen"), "{line}");
}

#[test]
fn cities_that_cannot_be_opened_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing");
    for command in ["serve", "inspect", "verify"] {
        let (line, code) = failure(&[command, text(&missing)]);
        assert_eq!(code, Some(1));
        assert!(line.contains("missing"), "{line}");
    }
    assert!(failure(&["serve", text(folder.path())]).0.contains("city.json"));
    common::city(&missing, "two");
    std::fs::write(missing.join("blockmaps.pmtiles"), b"PMTiles\x03 and then nothing").unwrap();
    assert!(failure(&["serve", text(&missing)]).0.contains("blockmaps.pmtiles"));
    let config = folder.path().join("config.toml");
    std::fs::write(&config, "\n[limits]\nport = 1").unwrap();
    assert!(failure(&["serve", "x", "--config", text(&config)]).0.contains("config.toml, line 3, limits.port"));
}

#[test]
fn usage_errors_are_one_line_and_exit_2() {
    for args in [
        &["dance"][..],
        &["serve"],
        &["serve", "a", "--port", "1"],
        &["serve", "a", "--listen", "nowhere"],
        &["inspect", "a", "--tile", "1/2/3", "--png", "p"],
        &["inspect", "a", "--tile", "1/1/1"],
        &["bake", "a"],
        &["bake", "a", "--out", "b", "--cell", "-1"],
    ] {
        let (line, code) = failure(args);
        assert_eq!(code, Some(2), "{args:?}");
        assert!(line.contains("--help"), "{line}");
    }
    assert_eq!(run(&[]).status.code(), Some(2));
}

#[test]
fn every_help_has_an_example() {
    for args in
        [&["--help"][..], &["bake", "--help"], &["serve", "--help"], &["inspect", "--help"], &["verify", "--help"]]
    {
        let output = run(args);
        assert_eq!(output.status.code(), Some(0));
        assert!(String::from_utf8(output.stdout).unwrap().contains("Example:\n  insula-server "), "{args:?}");
    }
    assert_eq!(run(&["--version"]).status.code(), Some(0));
}

#[test]
fn inspect_shows_a_city_and_draws_a_node() {
    let city = city();
    let output = run(&["inspect", text(city.path())]);
    let table = String::from_utf8(output.stdout).unwrap();
    for word in ["two", "EPSG:7415", "3D BAG", "CC BY 4.0", "1.000 to 1.000", "2 nodes"] {
        assert!(table.contains(word), "{word} is not in\n{table}");
    }
    let json: serde_json::Value =
        serde_json::from_slice(&run(&["inspect", text(city.path()), "--json"]).stdout).unwrap();
    assert_eq!(json["levels"].as_array().map(Vec::len), Some(2));
    assert_eq!(json["levels"][1]["nodes"], 1);
    assert_eq!(json["levels"][1]["bytes_max"], common::blockmap(common::child()).len());
    assert_eq!(json["levels"][0]["error_m_max"], 2.0);
    assert_eq!(json["manifest"]["name"], "two");
    let png = city.path().join("node.png");
    let output = run(&["inspect", text(city.path()), "--tile", "1/1/1", "--png", text(&png)]);
    assert_eq!(output.status.code(), Some(0));
    assert!(image::open(&png).unwrap().width() > 1000);
    let (line, code) = failure(&["inspect", text(city.path()), "--tile", "1/0/0", "--png", text(&png)]);
    assert!(code == Some(1) && line.contains("1/0/0"), "{line}");
    let nowhere = city.path().join("no/node.png");
    assert!(
        failure(&["inspect", text(city.path()), "--tile", "1/1/1", "--png", text(&nowhere)]).0.contains("node.png")
    );
}

#[test]
fn verify_finds_every_kind_of_damage() {
    let found = |damage: &dyn Fn(&Path)| {
        let city = city();
        damage(city.path());
        let output = run(&["verify", text(city.path())]);
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    };
    let finds = |word: &str, damage: &dyn Fn(&Path)| {
        let (code, list) = found(damage);
        assert!(code == Some(1) && list.lines().any(|line| line.contains(word)), "{word}: {list}");
    };
    assert_eq!(found(&|_| {}).0, Some(0));
    let blockmaps = |tiles: &[_]| {
        let tiles = tiles.to_vec();
        move |city: &Path| common::archive(&city.join("blockmaps.pmtiles"), &tiles)
    };
    let [root, child] = <[_; 2]>::try_from(common::blockmaps()).unwrap();
    let mut flipped = child.clone();
    *flipped.1.last_mut().unwrap() ^= 1;
    finds("blockmaps/1/1/1: checksum", &blockmaps(&[root.clone(), flipped]));
    finds("blockmaps/1/1/1: missing", &blockmaps(std::slice::from_ref(&root)));
    let stray = insula_protocol::TileId::new(1, 0, 0).unwrap();
    finds("blockmaps/1/0/0: no subtree", &blockmaps(&[root.clone(), (stray, common::blockmap(stray)), child.clone()]));
    finds("blockmaps/1/1/1: its columns are 2 m wide", &blockmaps(&[root.clone(), (child.0, root.1.clone())]));
    finds("city.json: it counts", &|city| {
        let mut manifest = common::manifest("two");
        manifest.counts.nodes_per_level = vec![1, 4];
        std::fs::write(city.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    });
    finds("subtrees/0/0/0: truncated", &|city| {
        let tile = common::subtree();
        common::archive(&city.join("subtrees.pmtiles"), &[(root.0, tile[..tile.len() - 1].to_vec())]);
    });
    // The archive is whole, a byte of a tile inside it is not.
    finds("blockmaps/", &|city| {
        let path = city.join("blockmaps.pmtiles");
        let mut bytes = std::fs::read(&path).unwrap();
        let at = bytes.windows(4).rposition(|window| window == b"INSU").unwrap();
        bytes[at + 20] ^= 0x40;
        std::fs::write(&path, bytes).unwrap();
    });
}
