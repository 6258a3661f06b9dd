//! The built program, driven from outside.

use crate::test_server::PATIENCE;
use insula_test_support::programs::{ServerProcess, path_text as text};
use insula_test_support::small_city;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    command.env_remove("RUST_LOG").stdin(Stdio::null());
    command
}

fn run(args: &[&str]) -> Output {
    program().args(args).output().unwrap()
}

/// Runs a command that fails. Returns the one line that it must print, and its exit code.
fn failure(args: &[&str]) -> (String, Option<i32>) {
    let output = run(args);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.starts_with("error: ") && text.matches('\n').count() == 1 && text.ends_with('\n'), "{text:?}");
    (text, output.status.code())
}

/// Serves the shared city.
fn start_server() -> ServerProcess {
    ServerProcess::start(&mut program(), text(small_city::shared_city()), "127.0.0.1:0", &[]).unwrap()
}

fn connect(server: &ServerProcess) -> TcpStream {
    let stream = TcpStream::connect(server.address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

fn get(server: &ServerProcess, path: &str) -> String {
    let mut stream = connect(server);
    write!(stream, "GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n").unwrap();
    let mut response = Vec::new();
    stream.read_to_end(&mut response).unwrap();
    String::from_utf8_lossy(&response).into_owned()
}

#[test]
fn port_0_picks_a_port_and_serves() {
    let server = start_server();
    assert_ne!(server.address.port(), 0);
    assert!(get(&server, "/readyz").starts_with("HTTP/1.1 200"));
    let response = get(&server, "/v1/cities/two/0123456789abcdef/blockmaps/0/0/0");
    assert!(response.starts_with("HTTP/1.1 200") && response.contains("INSU"), "{response}");
    assert!(get(&server, "/v1/cities/..%2f..%2fetc%2fpasswd").starts_with("HTTP/1.1 404"));
    let (line, code) = failure(&["serve", text(small_city::shared_city()), "--listen", &server.address.to_string()]);
    assert_eq!(code, Some(1), "the port is in use");
    assert!(line.contains(&server.address.to_string()) && line.contains("--listen"), "{line}");
}

#[test]
fn http_2_is_supported() {
    let server = start_server();
    let mut stream = connect(&server);
    // The preface and an empty SETTINGS frame. The server's first frame must be SETTINGS (type 4) as well.
    stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0").unwrap();
    let mut frame = [0; 9];
    stream.read_exact(&mut frame).unwrap();
    assert_eq!(frame[3], 4, "{frame:?}");
}

/// Sends a signal while one connection idles and another has sent half a request, which must still be served.
#[cfg(feature = "bake")]
fn assert_signal_drains_and_ends(signal: &str) {
    let city = small_city::temporary_city_with_meshes();
    let settings = ["drain_secs=600", "drawings.at_once=1"];
    let server = ServerProcess::start(&mut program(), city.path(), "127.0.0.1:0", &settings).unwrap();
    let mut idle = connect(&server);
    write!(idle, "GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n").unwrap();
    idle.read_exact(&mut [0; 15]).unwrap();
    let mut busy = connect(&server);
    let body = r#"{"format":"svg"}"#;
    let head = format!("Host: x\r\nContent-Type: application/json\r\nContent-Length: {}\r\n", body.len());
    write!(busy, "POST /v1/cities/two/draw HTTP/1.1\r\n{head}Expect: 100-continue\r\n\r\n").unwrap();
    // With this, the server says that it has the head and waits for the rest.
    let interim = "HTTP/1.1 100 Continue\r\n\r\n";
    let mut told = vec![0; interim.len()];
    busy.read_exact(&mut told).unwrap();
    assert_eq!(String::from_utf8_lossy(&told), interim);
    server.signal(signal);
    insula_test_support::programs::wait_until("no new connections", || TcpStream::connect(server.address).is_err());
    // Within the ten minutes, it closes the idle connection and waits for the busy one.
    idle.read_to_end(&mut Vec::new()).unwrap();
    busy.write_all(body.as_bytes()).unwrap();
    let mut response = String::new();
    busy.read_to_string(&mut response).unwrap();
    assert!(response.starts_with("HTTP/1.1 200") && response.contains("<svg"), "{response:?}");
    let (status, rest) = server.wait();
    assert_eq!((status.code(), rest.as_str()), (Some(0), ""), "exactly one line on standard output");
}

#[test]
#[cfg(feature = "bake")]
fn sigterm_drains_and_ends_with_0() {
    assert_signal_drains_and_ends("-TERM");
}

#[test]
#[cfg(feature = "bake")]
fn sigint_drains_and_ends_with_0() {
    assert_signal_drains_and_ends("-INT");
}

#[test]
fn cities_and_configs_that_cannot_be_used_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing");
    for command in ["serve", "inspect", "verify"] {
        let (line, code) = failure(&[command, text(&missing)]);
        assert_eq!(code, Some(1));
        assert!(line.contains("missing"), "{line}");
    }
    assert!(failure(&["serve", text(folder.path())]).0.contains("city.json"));
    small_city::write_city(&missing, "two");
    std::fs::write(missing.join("blockmaps.pmtiles"), b"PMTiles\x03 and then nothing").unwrap();
    assert!(failure(&["serve", text(&missing)]).0.contains("blockmaps.pmtiles"));
    let config = folder.path().join("config.toml");
    std::fs::write(&config, "\n[limits]\nport = 1").unwrap();
    assert!(failure(&["serve", "x", "--config", text(&config)]).0.contains("config.toml, line 3, limits.port"));
}

#[test]
fn a_broken_city_among_others_stops_a_strict_start_only() {
    let folder = tempfile::tempdir().unwrap();
    small_city::write_city(&folder.path().join("two"), "two");
    small_city::write_city(&folder.path().join("broken"), "broken");
    std::fs::write(folder.path().join("broken/subtrees.pmtiles"), b"nothing").unwrap();
    assert!(failure(&["serve", text(folder.path()), "--strict"]).0.contains("subtrees.pmtiles"));
    let server = ServerProcess::start(&mut program(), folder.path(), "127.0.0.1:0", &["reload.watch_secs=0"]).unwrap();
    assert!(get(&server, "/v1/cities/two").starts_with("HTTP/1.1 200"));
    let metrics = get(&server, "/metrics");
    assert!(metrics.contains("insula_cities 1\n") && metrics.contains("insula_cities_failed 1\n"), "{metrics}");
    assert!(metrics.contains("insula_reloads_total{kind=\"failed\"} 1\n"), "{metrics}");
}

/// More files than the process may open.
#[cfg(unix)]
#[test]
fn many_cities_are_served_with_few_open_files() {
    const CITIES: usize = 60;
    let folder = tempfile::tempdir().unwrap();
    for city in 0..CITIES {
        small_city::write_city(&folder.path().join(format!("c{city}")), &format!("c{city}"));
    }
    // A limit that stays, and one that the program may raise.
    for limit in ["-n", "-Sn"] {
        let mut command = Command::new("sh");
        let script = format!(r#"ulimit {limit} 80 && exec "$0" "$@""#);
        command.args(["-c", &script, env!("CARGO_BIN_EXE_insula-server")]);
        let settings = ["threads=2", "limits.connections=8"];
        let server = ServerProcess::start(&mut command, folder.path(), "127.0.0.1:0", &settings).unwrap();
        for city in (0..CITIES).chain(0..CITIES) {
            for kind in ["subtrees", "blockmaps"] {
                let response = get(&server, &format!("/v1/cities/c{city}/0123456789abcdef/{kind}/0/0/0"));
                assert!(response.starts_with("HTTP/1.1 200"), "{limit} {city} {response}");
            }
        }
    }
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
        &["inspect", "a", "--volume", "1/1/1"],
        &["inspect", "a", "--tile", "1/1/1", "--ply", "p"],
        &["inspect", "a", "--tile", "1/1/1", "--volume", "1/1/1", "--png", "p"],
        &["sign", "--city", "a", "--expires", "7d"],
        &["bake", "a"],
        &["bake", "a", "--out", "b", "--cell", "-1"],
    ] {
        let (line, code) = failure(args);
        assert_eq!(code, Some(2), "{args:?}");
        assert!(line.contains("--help") || line.contains("--keys"), "{line}");
    }
    assert_eq!(run(&[]).status.code(), Some(2));
    let (line, _) = failure(&["bake", "a", "--out", "b", "--cell", "-1"]);
    assert!(line.contains("--cell") && line.contains("between 0.01 and 1000"), "{line}");
}

#[test]
fn every_help_has_an_example() {
    for command in ["", "bake", "serve", "sign", "inspect", "verify"] {
        let args = [command, "--help"];
        let output = run(&args[usize::from(command.is_empty())..]);
        assert_eq!(output.status.code(), Some(0));
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.contains("Example:\n  insula-server ") || text.contains("Example:\n  echo "), "{command}");
    }
    assert_eq!(run(&["--version"]).status.code(), Some(0));
}

#[test]
fn inspect_shows_a_city_and_draws_a_node() {
    let (city, folder) = (text(small_city::shared_city()), tempfile::tempdir().unwrap());
    let output = run(&["inspect", city]);
    let table = String::from_utf8(output.stdout).unwrap();
    let bytes = small_city::archive_bytes(small_city::shared_city());
    let size = format!(
        "2 nodes in 1 subtree tile, {}\n",
        if bytes < 1000 { format!("{bytes} B") } else { format!("{:.1} kB", bytes as f64 / 1e3) }
    );
    for word in ["two", "EPSG:7415", "3D BAG", "CC BY 4.0", "1.000 to 1.000", &size] {
        assert!(table.contains(word), "{word} is not in\n{table}");
    }
    let json: serde_json::Value = serde_json::from_slice(&run(&["inspect", city, "--json"]).stdout).unwrap();
    assert_eq!(json["levels"].as_array().map(Vec::len), Some(2));
    assert_eq!(json["levels"][1]["nodes"], 1);
    assert_eq!(json["levels"][1]["bytes_max"], small_city::blockmap(small_city::child()).len());
    assert_eq!(json["levels"][0]["error_m_max"], 2.0);
    assert_eq!(json["manifest"]["name"], "two");
    let png = folder.path().join("node.png");
    let output = run(&["inspect", city, "--tile", "1/1/1", "--png", text(&png)]);
    assert_eq!(output.status.code(), Some(0));
    assert!(image::open(&png).unwrap().width() > 1000);
    let (line, code) = failure(&["inspect", city, "--tile", "1/0/0", "--png", text(&png)]);
    assert!(code == Some(1) && line.contains("1/0/0"), "{line}");
    let (png, ply) = (folder.path().join("voxels.png"), folder.path().join("voxels.ply"));
    let output = run(&["inspect", city, "--volume", "1/1/1", "--png", text(&png), "--ply", text(&ply)]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(image::open(&png).unwrap().width() > 1000 && std::fs::metadata(&ply).unwrap().len() > 300);
    let missing_folder = folder.path().join("no/node.png");
    assert!(failure(&["inspect", city, "--tile", "1/1/1", "--png", text(&missing_folder)]).0.contains("node.png"));
}

#[test]
fn verify_finds_every_kind_of_damage() {
    let verify = |damage: &dyn Fn(&Path)| {
        let city = small_city::temporary_city();
        small_city::set_version(city.path());
        damage(city.path());
        let output = run(&["verify", text(city.path())]);
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    };
    let assert_finds = |fault: &str, damage: &dyn Fn(&Path)| {
        let (code, list) = verify(damage);
        assert!(code == Some(1) && list.lines().any(|line| line.contains(fault)), "{fault}: {list}");
    };
    assert_eq!(verify(&|_| {}).0, Some(0));
    let city = small_city::temporary_city();
    let (one_fault, _) = failure(&["verify", text(city.path())]);
    assert!(one_fault.contains("error: verify: 1 fault in "), "{one_fault}");
    let blockmaps = |tiles: &[_]| {
        let tiles = tiles.to_vec();
        move |city: &Path| small_city::write_archive(&city.join("blockmaps.pmtiles"), &tiles)
    };
    let [root, child] = <[_; 2]>::try_from(small_city::blockmaps()).unwrap();
    let mut flipped = child.clone();
    *flipped.1.last_mut().unwrap() ^= 1;
    assert_finds("blockmaps/1/1/1: checksum", &blockmaps(&[root.clone(), flipped]));
    assert_finds("blockmaps/1/1/1: missing", &blockmaps(std::slice::from_ref(&root)));
    let stray = insula_protocol::TileId::new(1, 0, 0).unwrap();
    let tiles = [root.clone(), (stray, small_city::blockmap(stray)), child.clone()];
    assert_finds("blockmaps/1/0/0: unused", &blockmaps(&tiles));
    assert_finds("blockmaps/1/1/1: its columns are 2 m wide", &blockmaps(&[root.clone(), (child.0, root.1.clone())]));
    assert_finds("city.json: it counts", &|city| {
        let mut manifest = small_city::manifest("two");
        manifest.counts.nodes_per_level = vec![1, 4];
        std::fs::write(city.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    });
    // Each part is intact, but the title was changed after the bake.
    assert_finds("city.json: its version is", &|city| {
        let path = city.join("city.json");
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replace("\"title\": \"", "\"title\": \"New ")).unwrap();
    });
    assert_finds("subtrees/0/0/0: truncated", &|city| {
        let tile = small_city::subtree();
        small_city::write_archive(&city.join("subtrees.pmtiles"), &[(root.0, tile[..tile.len() - 1].to_vec())]);
    });
    // The archive is intact, but a byte of a tile in it has changed.
    assert_finds("blockmaps/", &|city| {
        let path = city.join("blockmaps.pmtiles");
        let mut bytes = std::fs::read(&path).unwrap();
        let at = bytes.windows(4).rposition(|window| window == b"INSU").unwrap();
        bytes[at + 20] ^= 0x40;
        std::fs::write(&path, bytes).unwrap();
    });
}

#[test]
#[cfg(feature = "bake")]
fn bakes_have_street_sets_and_a_picture_unless_they_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let house = "v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 9\nf 1 2 3\nf 1 3 4\n";
    std::fs::write(folder.path().join("house.obj"), house).unwrap();
    let has_sets = |options: &[&str]| {
        let out = folder.path().join(format!("city{}", options.concat()));
        let status =
            program().args(["bake", "house.obj", "--out"]).arg(&out).args(options).current_dir(&folder).status();
        assert!(status.unwrap().success());
        let manifest = std::fs::read_to_string(out.join("city.json")).unwrap();
        (out.join("visibility.pmtiles").exists(), manifest.contains("\"street_sets\": true"))
    };
    let has_picture = |city: &str| folder.path().join(city).join("thumbnail.jpg").exists();
    assert_eq!(has_sets(&["--cell", "1"]), (true, true));
    assert!(has_picture("city--cell1"));
    assert_eq!(has_sets(&["--cell", "1", "--no-street-sets"]), (false, false));
    assert_eq!(has_sets(&["--cell", "1", "--no-street-sets", "--no-picture"]), (false, false));
    assert!(!has_picture("city--cell1--no-street-sets--no-picture"));
    assert_eq!(has_sets(&["--cell", "0.1"]), (false, false), "leaves of 6.4 m");
}
