//! Runs all programs on generated hostile inputs in little memory. Ends with an error if one of them aborts, panics or hangs.
//!
//! Needs `prlimit`, and built programs: `cargo build --release --workspace`. With `INSULA_TEST_LOG` set, it prints how each
//! program ends.

use anyhow::{Context, Result, ensure};
use clap::Parser;
use insula_test_support::programs::program;
use insula_test_support::rng::Rng;
use insula_tests::deep_city::DeepCityServer;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

/// Memory of a bake, and what its process may take besides.
const BAKE_MEMORY_MIB: u64 = 256;
const BESIDES_MIB: u64 = 512;
/// Address space of all other commands.
const COMMAND_MIB: u64 = 1024;
const MAX_TIME: Duration = Duration::from_secs(60);
/// Most memory that a client with a cache of 16 MiB may hold, in a flight through an endless city.
const DEEP_CITY_MIB: u64 = 300;
/// Length of that flight.
const DEEP_CITY_SECS: u32 = 40;
/// Four times the memory of the subtrees that the client keeps have to pass through it.
const DEEP_CITY_SUBTREES: u64 = 600;
/// A server that holds out for this long has opened its city.
const SERVE_TIME: Duration = Duration::from_millis(700);
const FLIGHT: &str = r#"{"seconds":1,"keys":[{"t":0,"position":[50,-80,90],"target":[50,50,0]},
    {"t":1,"position":[60,-80,90],"target":[50,50,0]}]}"#;
const ARCHIVES: [&str; 3] = ["blockmaps.pmtiles", "subtrees.pmtiles", "meshes.pmtiles"];

#[derive(Parser)]
struct Args {
    /// Number of cases
    #[arg(long, default_value_t = 300)]
    cases: u64,
    /// Number of the first case
    #[arg(long, default_value_t = 0)]
    first: u64,
}

/// An input of a bake.
struct Source {
    name: &'static str,
    bytes: Vec<u8>,
    options: Vec<&'static str>,
}

/// Largest resident set of a process so far, in bytes; 0 if it has ended.
fn peak_resident_bytes(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse().ok());
    peak.unwrap_or(0u64) << 10
}

/// Flies through an endless city. Returns what is wrong.
fn deep_city_case(folder: &Path) -> Result<Option<String>> {
    let server = DeepCityServer::start();
    let path = folder.join("deep.json");
    // At stops far from each other, a second each, so that all but the topmost levels are new at each.
    let stop = |number: u32| {
        let [x, y] = [0.381, 0.618].map(|step| (0.3 + f64::from(number) * step).fract() * 6e7);
        let view = format!("\"position\":[{x},{y},30],\"target\":[{},{},20]", x + 90.0, y + 200.0);
        format!("{{\"t\":{number},{view}}},{{\"t\":{number}.9,{view}}}")
    };
    let keys: Vec<String> = (0..DEEP_CITY_SECS).map(stop).collect();
    fs::write(&path, format!("{{\"seconds\":{DEEP_CITY_SECS},\"keys\":[{}]}}", keys.join(",")))?;
    let arguments = ["fly", "--path", text(&path), "--server", &server.url, "--size", "320x180", "--adapter", "cpu"];
    let mut child = Command::new(program("insula")?);
    let child = child.args(arguments).args(["--cache-mib", "16"]).stdin(Stdio::null()).stdout(Stdio::null());
    let mut child = child.spawn()?;
    let (begin, mut peak_bytes) = (Instant::now(), 0);
    let status = loop {
        peak_bytes = peak_bytes.max(peak_resident_bytes(child.id()));
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if begin.elapsed() > MAX_TIME {
            child.kill()?;
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let (subtrees, sent_mib) = (server.subtrees.load(Relaxed), server.bytes.load(Relaxed) >> 20);
    let peak_mib = peak_bytes >> 20;
    println!("endless city: {subtrees} subtrees, {sent_mib} MiB sent, client took {peak_mib} MiB at most");
    Ok(if !status.success() {
        Some(format!("fly ends with {status}"))
    } else if subtrees < DEEP_CITY_SUBTREES {
        Some(format!("only {subtrees} subtrees were fetched"))
    } else {
        (peak_mib > DEEP_CITY_MIB).then(|| format!("fly took {peak_mib} MiB, the limit is {DEEP_CITY_MIB}"))
    })
}

/// Runs a program with at most `mib` of address space. Returns what is wrong with its end.
fn run_limited(mib: u64, max_time: Duration, program_name: &str, arguments: &[&str]) -> Result<Option<String>> {
    let mut command = Command::new("prlimit");
    command.arg(format!("--as={}", mib << 20)).arg(program(program_name)?).args(arguments);
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let mut pipe = child.stderr.take().context("no standard error")?;
    let reader = std::thread::spawn(move || {
        let mut text = Vec::new();
        let _ = pipe.by_ref().take(1 << 20).read_to_end(&mut text);
        String::from_utf8_lossy(&text).into_owned()
    });
    let begin = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break Some(status);
        }
        if begin.elapsed() > max_time {
            child.kill()?;
            child.wait()?;
            break None;
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    let errors = reader.join().unwrap_or_default();
    let last_line = errors.lines().last().unwrap_or_default().to_owned();
    if std::env::var_os("INSULA_TEST_LOG").is_some() {
        println!("{program_name} {}: {status:?} {last_line}", arguments[0]);
    }
    Ok(match status {
        _ if errors.contains("panicked") => Some(format!("panics: {last_line}")),
        None if max_time < MAX_TIME => None,
        None => Some(format!("still runs after {max_time:?}")),
        Some(status) => match status.code() {
            Some(0) => None,
            Some(1 | 2) if !last_line.is_empty() => None,
            _ => Some(format!("ends with {status}: {last_line}")),
        },
    })
}

fn cityjson(objects: &str, vertices: &str) -> Vec<u8> {
    format!(
        "{{\"type\":\"CityJSON\",\"version\":\"2.0\",\"transform\":{{\"scale\":[0.001,0.001,0.001],\"translate\":[0,0,0]}},\
         \"CityObjects\":{{{objects}}},\"vertices\":[{vertices}]}}"
    )
    .into_bytes()
}

fn geojson(rings: &str, properties: &str) -> Vec<u8> {
    format!(
        "{{\"type\":\"FeatureCollection\",\"crs\":{{\"type\":\"name\",\"properties\":{{\"name\":\"EPSG:28992\"}}}},\"features\":[{{\"type\":\"Feature\",\"properties\":{{{properties}}},\
         \"geometry\":{{\"type\":\"Polygon\",\"coordinates\":[{rings}]}}}}]}}"
    )
    .into_bytes()
}

fn random_ring(rng: &mut Rng, corners: usize) -> String {
    let points: Vec<String> =
        (0..corners).map(|_| format!("[{:.2},{:.2}]", rng.range(0.0, 900.0), rng.range(0.0, 900.0))).collect();
    format!("[{},{}]", points.join(","), points[0])
}

/// A small valid file, changed at a few places.
fn altered(rng: &mut Rng, mut bytes: Vec<u8>) -> Vec<u8> {
    for _ in 0..=rng.below(8) {
        let at = rng.below(bytes.len());
        match rng.below(4) {
            0 => bytes[at] = rng.below(256) as u8,
            1 => drop(bytes.drain(at..(at + rng.below(40)).min(bytes.len()))),
            2 => drop(bytes.splice(at..at, *b"99999999999999999999e9")),
            _ => {
                let part = bytes[at..].to_vec();
                bytes.splice(at..at, part);
            }
        }
        if bytes.is_empty() {
            bytes.push(b'{');
        }
    }
    bytes
}

fn source(number: u64, rng: &mut Rng) -> Source {
    let many = |text: &str, count: usize| text.repeat(count);
    let vertices = "[0,0,0],[9000,0,0],[9000,9000,0],[0,9000,0]";
    let solid = "\"a\":{\"type\":\"Building\",\"geometry\":[{\"type\":\"MultiSurface\",\"lod\":\"1\",\"boundaries\":[[[0,1,2,3]]]}]}";
    let triangle = "v 0 0 0\nv 9 0 0\nv 0 9 5\n";
    let (name, bytes, options): (_, Vec<u8>, Vec<_>) = match number % 14 {
        0 => ("faces.obj", format!("{triangle}{}", many("f 1 2 3\n", 1 + rng.below(400_000))).into_bytes(), vec![]),
        1 => {
            let height = 10f64.powi(rng.below(9) as i32);
            let text = format!("v 0 0 0\nv 1 0 0\nv 1 1 {height}\nv 0 1 {height}\nf 1 2 3 4\n");
            ("tower.obj", text.into_bytes(), vec!["--cell", "0.1"])
        }
        2 => (
            "numbers.obj",
            format!("v nan inf 1e308\nv {} 0 0\nv 0 1e300 0\nf 1 2 3\nf -9999999 2 3\n", "9".repeat(400)).into_bytes(),
            vec![],
        ),
        3 => (
            "long.obj",
            format!("o {}\n{triangle}f 1 2 3\nmtllib {}\n", many("x", 1 << 20), many("a.mtl ", 50_000)).into_bytes(),
            vec![],
        ),
        4 => ("deep.city.json", many("[", 1 + rng.below(1_000_000)).into_bytes(), vec![]),
        5 => (
            "far.city.json",
            cityjson(solid, "[0,0,0],[2147483647,0,0],[2147483647,2147483647,0],[0,2147483647,2147483647]"),
            vec![],
        ),
        6 => {
            let geometry =
                many("{\"type\":\"MultiSurface\",\"lod\":\"1\",\"boundaries\":[[[0,1,2,3]]]},", rng.below(30_000));
            let geometry = geometry.trim_end_matches(',');
            (
                "many.city.json",
                cityjson(&format!("\"a\":{{\"type\":\"Building\",\"geometry\":[{geometry}]}}"), vertices),
                vec![],
            )
        }
        7 => {
            let title = many("t", 2 << 20);
            (
                "title.city.json",
                format!(
                    "{{\"metadata\":{{\"title\":\"{title}\"}},{}",
                    &String::from_utf8_lossy(&cityjson(solid, vertices))[1..]
                )
                .into_bytes(),
                vec![],
            )
        }
        8 => (
            "corners.geojson",
            {
                let corners = 4 + rng.below(20_000);
                geojson(&random_ring(rng, corners), "\"height\":10")
            },
            vec![],
        ),
        9 => {
            let holes: Vec<String> = (0..1 + rng.below(5000)).map(|_| random_ring(rng, 4)).collect();
            (
                "holes.geojson",
                geojson(&format!("[[0,0],[900,0],[900,900],[0,900],[0,0]],{}", holes.join(",")), "\"height\":9"),
                vec![],
            )
        }
        10 => (
            "height.geojson",
            geojson("[[0,0],[9,0],[9,9],[0,0]]", &format!("\"height\":1e{}", rng.below(308))),
            vec![],
        ),
        11 => ("altered.city.json", altered(rng, cityjson(solid, vertices)), vec![]),
        12 => ("altered.geojson", altered(rng, geojson("[[0,0],[90,0],[90,90],[0,0]]", "\"height\":10")), vec![]),
        _ => ("altered.obj", altered(rng, format!("{triangle}f 1 2 3\n").into_bytes()), vec![]),
    };
    Source { name, bytes, options }
}

fn bake_case(number: u64, rng: &mut Rng, folder: &Path) -> Result<Option<String>> {
    let Source { name, bytes, options } = source(number, rng);
    let (input, out) = (folder.join(name), folder.join("out"));
    fs::write(&input, bytes)?;
    let memory = format!("{BAKE_MEMORY_MIB}MiB");
    let mut arguments = vec!["bake", text(&input), "--out", text(&out), "--memory", &memory, "--threads", "2"];
    arguments.extend(options);
    let finding = run_limited(BAKE_MEMORY_MIB + BESIDES_MIB, MAX_TIME, "insula-server", &arguments)?;
    Ok(finding.map(|finding| format!("bake {name} {finding}")))
}

/// Changes a baked city: numbers of its manifest, fields of a header, any bytes, or the length of an archive.
fn damage(rng: &mut Rng, city: &Path) -> Result<()> {
    let archive = city.join(ARCHIVES[rng.below(3)]);
    let mut bytes = fs::read(&archive)?;
    match rng.below(8) {
        0 => {
            let manifest = city.join("city.json");
            let altered = altered(rng, fs::read(&manifest)?);
            return Ok(fs::write(manifest, altered)?);
        }
        // The offsets and lengths of a PMTiles header are at bytes 8 to 96.
        1 | 2 => {
            let field = 8 + 8 * rng.below(11);
            let value = if rng.one_in(2) { rng.bits() } else { rng.bits() >> rng.below(64) };
            bytes[field..field + 8].copy_from_slice(&value.to_le_bytes());
        }
        3..6 => (0..=rng.below(20)).for_each(|_| {
            let at = rng.below(bytes.len().min(2000));
            bytes[at] = rng.below(256) as u8;
        }),
        6 => bytes.truncate(rng.below(bytes.len())),
        _ => {
            fs::remove_file(&archive)?;
            ensure!(Command::new("mkfifo").arg(&archive).status()?.success());
            return Ok(());
        }
    }
    Ok(fs::write(archive, bytes)?)
}

fn city_case(rng: &mut Rng, good: &Path, folder: &Path) -> Result<Option<String>> {
    let city = folder.join("city");
    fs::create_dir(&city)?;
    for file in fs::read_dir(good)?.flatten() {
        fs::copy(file.path(), city.join(file.file_name()))?;
    }
    damage(rng, &city)?;
    let (camera, path, image) = (folder.join("camera.json"), folder.join("path.json"), folder.join("image.png"));
    fs::write(&camera, r#"{"position":[50,-80,90],"target":[50,50,0],"up":[0,0,1],"fov_y_deg":60}"#)?;
    fs::write(&path, FLIGHT)?;
    let (city, camera, path, image) = (text(&city), text(&camera), text(&path), text(&image));
    let client = ["--server", city, "--size", "160x90", "--adapter", "cpu", "--timeout", "5", "--cache-mib", "16"];
    let snapshot = [&["snapshot", "--camera", camera, "--out", image][..], &client].concat();
    let fly = [&["fly", "--path", path][..], &client].concat();
    for (program_name, arguments, time) in [
        ("insula-server", &["inspect", city][..], MAX_TIME),
        ("insula-server", &["verify", city][..], MAX_TIME),
        ("insula-server", &["serve", city, "--listen", "127.0.0.1:0"][..], SERVE_TIME),
        ("insula", &snapshot[..], MAX_TIME),
        ("insula", &fly[..], MAX_TIME),
    ] {
        if let Some(finding) = run_limited(COMMAND_MIB, time, program_name, arguments)? {
            return Ok(Some(format!("{} {finding}", arguments[0])));
        }
    }
    Ok(None)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap_or_default()
}

/// A small city with meshes.
fn bake_good_city(folder: &Path) -> Result<PathBuf> {
    let (input, city) = (folder.join("town.geojson"), folder.join("good"));
    fs::write(&input, geojson("[[10,10],[90,10],[90,90],[10,90],[10,10]]", "\"height\":20"))?;
    let status = Command::new(program("insula-server")?).args(["bake", text(&input), "--out", text(&city)]).status()?;
    ensure!(status.success(), "the small city cannot be baked");
    Ok(city)
}

fn main() -> Result<()> {
    let args = Args::parse();
    let root = tempfile::tempdir()?;
    let good = bake_good_city(root.path())?;
    let mut findings = 0;
    if let Some(finding) = deep_city_case(root.path())? {
        findings += 1;
        println!("endless city: {finding}");
    }
    for number in args.first..args.first + args.cases {
        let mut rng = Rng::new(number);
        let folder = tempfile::tempdir_in(root.path())?;
        let is_bake = number % 2 == 0;
        let finding = if is_bake {
            bake_case(number / 2, &mut rng, folder.path())?
        } else {
            city_case(&mut rng, &good, folder.path())?
        };
        if let Some(finding) = finding {
            findings += 1;
            println!("case {number}: {finding}");
        }
    }
    println!("{} cases, {findings} findings", args.cases);
    ensure!(findings == 0, "{findings} findings");
    Ok(())
}
